"""Plugins that come with kant_sql; entry points connect them, and the core does not know them."""

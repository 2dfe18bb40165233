"""Plugins of kant_sql that come with it; entry points join them, and the core knows none."""

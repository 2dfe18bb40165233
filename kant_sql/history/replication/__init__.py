"""Replication: the same revisions in another store."""

"""Verification: the tables against the chain of hashes."""

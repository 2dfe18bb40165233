"""Whether the tables say what was hashed: the checks of which `history/verifying.py` makes one."""

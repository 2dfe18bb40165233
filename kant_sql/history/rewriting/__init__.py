"""How an erasure writes texts again, and what it keeps of their hashes."""

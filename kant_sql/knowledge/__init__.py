"""Knowledge at one revision, in memory: definitions, expression trees, canonical text, the hash."""

"""Knowledge in memory: definitions at one revision, expression trees, canonical text, the hash.

Each kind of named element has a module that says what it is. `rows.py` lists the kinds with their
tables: to add one is to add a module, and a line there.
"""

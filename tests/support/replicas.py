"""What a replica holds, compared with its source row by row."""

from __future__ import annotations

from tests.support.archives import TABLES, rows_of

# The head of a replica says where it comes from; verification is each store's own.
OWN = {"head", "verification"}


def equal_histories(source: str, target: str, name: str = "tiago") -> None:
    """Check that two stores have the same rows of a knowledge base."""
    here, there = rows_of(source, name), rows_of(target, name)
    for table in TABLES:
        if table.name not in OWN:
            assert there[table.name] == here[table.name], table.name
    columns = ("revision", "definition_revision", "next_id", "hash", "committed_at")
    head = [
        c.name for c in next(t for t in TABLES if t.name == "head").columns if c.name != "kb_id"
    ]
    places = [head.index(column) for column in columns]
    heads = (
        [tuple(row[place] for place in places) for row in rows["head"]] for rows in (here, there)
    )
    assert next(heads) == next(heads)

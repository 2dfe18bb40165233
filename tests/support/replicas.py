"""What a replica holds, compared with its source row by row."""

from __future__ import annotations

from collections import Counter
from typing import Any

from sqlalchemy import Table

from tests.support.archives import TABLES, Rows, rows_of

# The head of a replica says where it comes from; verification is each store's own.
OWN = {"head", "verification"}


def _known(rows: Rows, table: Table) -> Counter[tuple[Any, ...]]:
    """Give the rows of a table but those of elements that never held.

    What one transaction asserts and retracts leaves an identity, which is not knowledge.
    """
    owner = table.name.removesuffix("_argument")
    version = next((other for other in TABLES if other.name == f"{owner}_version"), None)
    key = "id" if owner == table.name else f"{owner}_id"
    if version is None or key not in table.columns:
        return rows[table.name]
    place, of = (
        [column.name for column in each.columns if column.name != "kb_id"].index(name)
        for each, name in ((table, key), (version, f"{owner}_id"))
    )
    held = {row[of] for row in rows[version.name]}
    return Counter({row: n for row, n in rows[table.name].items() if row[place] in held})


def equal_histories(source: str, target: str, name: str = "tiago") -> None:
    """Check that two stores have the same rows of a knowledge base."""
    here, there = rows_of(source, name), rows_of(target, name)
    for table in TABLES:
        if table.name not in OWN:
            known = _known(here, table)
            assert there[table.name] == known, table.name
    columns = ("revision", "definition_revision", "next_id", "hash", "committed_at")
    head = [
        c.name for c in next(t for t in TABLES if t.name == "head").columns if c.name != "kb_id"
    ]
    places = [head.index(column) for column in columns]
    heads = (
        [tuple(row[place] for place in places) for row in rows["head"]] for rows in (here, there)
    )
    assert next(heads) == next(heads)

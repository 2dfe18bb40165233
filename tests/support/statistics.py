"""Statistics of an SQLite file, and the wrong answers of SQLite 3.34 to 3.41 with them.

There, an index may be stepped through from one value of an `IN` to the next (opcode SeekScan,
correct since 3.42), losing a bound on the next column: see `bounded` in `sql/dialects/words.py`.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing, suppress
from pathlib import Path

# Rows in a store of many small knowledge bases, and rows that agree in the first columns of an
# index: SQLite steps if few rows do.
FLEET = (1_000_000, 20, 2)
_INDEXES = "SELECT name, tbl_name FROM sqlite_master WHERE type = 'index'"
_PLANNED = ("SELECT", "WITH", "UPDATE", "DELETE")


class _Nulls(dict[str, None]):
    """A value for any parameter."""

    def __missing__(self, name: str) -> None:
        return None


def add_statistics(path: Path) -> None:
    """Write what ANALYZE would find in a large store into an empty one."""
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("ANALYZE")
        connection.execute("DELETE FROM sqlite_stat1")
        for index, table in connection.execute(_INDEXES).fetchall():
            width = len(connection.execute(f"PRAGMA index_info({index})").fetchall())
            numbers = [*FLEET, *(1 for _ in range(width))][: width + 1]
            row = table, index, " ".join(map(str, numbers))
            connection.execute("INSERT INTO sqlite_stat1 VALUES (?, ?, ?)", row)


def loses_bound(connection: sqlite3.Connection, sql: str) -> bool:
    """Return whether a statement steps through an index with a bound on the column after `IN`."""
    steps = []
    # Other statements are in another dialect, or about views that a test makes.
    with suppress(sqlite3.OperationalError):
        if sql.lstrip().startswith(_PLANNED):
            steps = connection.execute(f"EXPLAIN {sql}", _Nulls()).fetchall()
    opcodes = [(name, *places) for _, name, *places, _, _ in steps]
    for (scan, *_), (_, _, _, *key), (end, _, _, *last) in zip(
        opcodes, opcodes[1:], opcodes[2:], strict=False
    ):
        # Without a bound, the end of the rows is immediately compared with the sought key.
        if scan == "SeekScan" and (end not in ("IdxGT", "IdxGE") or key != last):
            return True
    return False

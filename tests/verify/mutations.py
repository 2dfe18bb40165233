"""Every way to change one value of one row, and to delete or double a row."""

from __future__ import annotations

import itertools
import json
from collections.abc import Collection, Iterator
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import Column

from kant_sql.knowledge.canonical import time_text
from tests.verify.bare import TABLES, Bare, Row

# By these, rows of one table mean different things.
_MEANINGS = ("operator", "section", "kind", "outcome", "is_goal", "is_constant", "form")
_FREE = ("key", "name")


class Mutation(NamedTuple):
    """A change of a store."""

    table: str  # the table
    column: str  # the column; for a whole row `delete`, `double`, or `insert`: another of a new key
    row: Row  # the row
    changes: Row  # what is set

    def apply(self, bare: Bare) -> None:
        if self.column == "delete":
            bare.delete(self.table, self.row)
        elif self.column in ("double", "insert"):
            bare.insert(self.table, {**self.row, **self.changes})
        else:
            bare.update(self.table, self.row, self.changes)


def samples(rows: list[Row], table: str) -> list[Row]:
    """Choose a row of each meaning: by its operator, section ..., and by what is NULL in it."""
    chosen: dict[Any, Row] = {}
    for row in rows:
        meaning = (
            *(row.get(name) for name in _MEANINGS),
            *(row[column.name] is None for column in TABLES[table].c if column.nullable),
        )
        chosen.setdefault(meaning, row)
    return list(chosen.values())


# No hash covers what somebody says to have verified, nor which requests are not written twice.
UNCOVERED = {"verification", "request"}
# Of a store of which a part is in an archive nothing is erased.
ERASED = {"commitment", "erasure", "replacement"}
COVERED = TABLES.keys() - UNCOVERED - ERASED


def mutations(bare: Bare, names: Collection[str] = COVERED) -> Iterator[Mutation]:
    """Give all mutations of some tables of a store."""
    turn = itertools.count()
    for name, table in TABLES.items():
        if name not in names:
            continue
        rows = bare.rows(name)
        assert rows, f"the story has no row in {name}"
        chosen = [*samples(rows, name), *_without_version(bare, name, rows)]
        for row in chosen:
            yield Mutation(name, "delete", row, {})
        yield Mutation(name, "double", rows[0], {})
        yield Mutation(name, "insert", rows[-1], _next_key(name, rows))
        for column in table.c:
            # A key means the same in each row.
            own = chosen[:1] if column.primary_key else chosen
            for row in own:
                for value in _values(column, row, rows):
                    yield Mutation(name, column.name, row, {column.name: value})
            if bare.session.placeholder == "?":
                # One of them for each column, another for the next.
                others = _of_other_type(chosen[0][column.name])
                for value in others[next(turn) % 4 :][:1] if len(others) > 1 else others:
                    yield Mutation(name, column.name, chosen[0], {column.name: value})


def _without_version(bare: Bare, table: str, rows: list[Row]) -> list[Row]:
    """Choose a fact all versions of which are in an archive."""
    if table != "proposition":
        return []
    held = {row[f"{table}_id"] for row in bare.rows(f"{table}_version")}
    moved = [row for row in rows if row["id"] not in held]
    assert moved, "each proposition has a version"
    return moved[:1]


def _of_other_type(now: Any) -> list[Any]:
    """Give values that SQLite keeps in a column that is of another type."""
    if isinstance(now, int):
        return [now + 0.5, float("inf"), f"{now}x", str(now).encode()]
    return [] if now is None else [str(now).encode()]


def _next_key(table: str, rows: list[Row]) -> Row:
    """Give the last column of the key a value that no row has."""
    column = TABLES[table].primary_key.columns.values()[-1]
    free = max(row[column.name] for row in rows) + 1
    more = {name: f"{rows[0][name]}_" for name in _FREE if name in rows[0]}
    return {column.name: free, **(more if column.name == "id" else {})}


def _values(column: Column[Any], row: Row, rows: list[Row]) -> Iterator[Any]:
    """Give other values of a column: NULL, what another row has, and what no row has."""
    now = row[column.name]
    others = [each[column.name] for each in rows if each[column.name] not in (None, now)]
    if now is not None and column.nullable:
        yield None
    yield others[0] if others else _another(column, now)
    if column.primary_key:
        yield _another(column, now)


def _another(column: Column[Any], now: Any) -> Any:
    if column.name == "source":
        return json.dumps({"file": "other"}, separators=(",", ":"))
    if column.name.endswith("_at") or column.name.startswith("valid_"):
        return _later(now)
    if isinstance(now, bytes) or column.type.python_type is bytes:
        return bytes(16) if now is None else now[::-1]
    if isinstance(now, str) or column.type.python_type is str:
        return f"{now or ''}x"
    if isinstance(now, bool) or column.type.python_type is bool:
        return not now
    return 7 if now is None else now + 1


def _later(now: Any) -> Any:
    if isinstance(now, datetime):
        return now + timedelta(microseconds=1)
    if now is None:
        return "2026-01-31T09:30:00.000000Z"
    return time_text(datetime.fromisoformat(now) + timedelta(microseconds=1))

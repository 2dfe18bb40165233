"""What leaves the store: counted, and compared with what the target has of it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from typing import Any, NamedTuple

from sqlalchemy import (
    Boolean,
    ColumnElement,
    Select,
    Table,
    func,
    literal_column,
    select,
    union_all,
)

from ..backends import Query, Session, in_rows
from ..errors import ConflictError
from ..knowledge.changes import in_range
from ..knowledge.loading import KB
from .converting import converted
from .parts import ATOMS, PARTS, Atoms, Part, children_of, references, text_of

_MODULUS = 2**256


class Leaving(NamedTuple):
    """What is to leave: the versions that ended in a range of revisions.

    Attributes:
        low: the first revision.
        high: the last revision.
        versions: how many, by the name of their table; tables without any are left out.
    """

    low: int
    high: int
    versions: dict[str, int]

    @property
    def total(self) -> int:
        """How many versions there are in all."""
        return sum(self.versions.values())


def _ended(part: Part) -> tuple[ColumnElement[bool], ...]:
    return part.version.c.kb_id == KB, in_range(part.version.c.until)


_COUNT = Query(
    union_all(
        *(
            select(literal_column(f"'{part.version.name}'"), func.count()).where(*_ended(part))
            for part in PARTS
        )
    )
)


def count(session: Session, kb_id: int, low: int, high: int) -> Leaving:
    """Count what ended in a range of revisions, in one statement.

    Args:
        session: the session.
        kb_id: the knowledge base.
        low: the first revision.
        high: the last revision.

    Returns:
        What is to leave.
    """
    rows = session.rows(_COUNT, kb=kb_id, low=low, high=high)
    counts: dict[str, int] = dict(rows)
    found = {part.version.name: counts[part.version.name] for part in PARTS}
    return Leaving(low, high, {name: number for name, number in found.items() if number})


def first_of(session: Session, kb_id: int, leaving: Leaving, most: int) -> Leaving:
    """Give as much of what is to leave as may leave at once: whole revisions, one at least.

    Args:
        session: the session.
        kb_id: the knowledge base.
        leaving: what is to leave.
        most: so many versions are enough.

    Returns:
        What leaves first.
    """
    if leaving.total <= most:
        return leaving
    low, high = leaving.low, leaving.high
    while low < high:
        middle = (low + high) // 2
        if count(session, kb_id, leaving.low, middle).total < most:
            low = middle + 1
        else:
            high = middle
    return count(session, kb_id, leaving.low, high)


def compare(leaving: Leaving, source: tuple[Session, int], target: tuple[Session, int]) -> None:
    """Check that the target has all that is to leave, column by column.

    Args:
        leaving: what is to leave.
        source: a session on the source, in a transaction, and the knowledge base there.
        target: a session on the target, in a transaction, and the knowledge base there.

    Raises:
        ConflictError: something differs.
    """
    for part in PARTS:
        if part.version.name not in leaving.versions:
            continue
        for table, statement in _statements(part):
            here, there = (
                _digest(session, kb_id, statement, leaving) for session, kb_id in (source, target)
            )
            if here != there:
                raise ConflictError(
                    f"{target[0].backend.label}: {there[0]} rows of {table.name} that ended in "
                    f"revisions {leaving.low} to {leaving.high} are there, and not the {here[0]} "
                    f"of {source[0].backend.label}; nothing was removed: verify both stores, and "
                    "archive into another one"
                )


class _Statement(NamedTuple):
    query: Query
    booleans: tuple[int, ...]


@cache
def _statements(part: Part) -> tuple[tuple[Table, _Statement], ...]:
    """Give what reads the rows that leave, of each table."""
    found = [(part.version, _read(part.version, *_ended(part)))]
    ended = in_range(part.version.c.until)
    found += [(child, _read(child, *children_of(part, child, ended))) for child in part.children]
    if part.atoms is not None:
        found += list(_atom_statements(part, part.atoms))
    return tuple(found)


def _atom_statements(part: Part, atoms: Atoms) -> Iterator[tuple[Table, _Statement]]:
    version = part.version.c
    owners = select(version[part.owner[0]]).where(*_ended(part))
    yield atoms.identity, _read(atoms.identity, in_rows(atoms.identity.c.id, owners))
    owner = atoms.arguments.c[part.owner[0]]
    yield atoms.arguments, _read(atoms.arguments, in_rows(owner, owners))


def _read(table: Table, *condition: ColumnElement[bool]) -> _Statement:
    """Read rows without what may be another number in the target: the ids of atoms."""
    of_atoms = {table.columns[index]: ATOMS[to] for index, to in references(table) if to in ATOMS}
    own = {table.c.id} if table in ATOMS else set[Any]()
    columns: list[Any] = []
    for column in table.columns:
        if column in of_atoms:
            columns.append(text_of(of_atoms[column], column).scalar_subquery())
        elif column not in own and column.name != "kb_id":
            columns.append(column)
    booleans = tuple(
        index for index, column in enumerate(columns) if isinstance(column.type, Boolean)
    )
    statement: Select[Any] = select(*columns).where(table.c.kb_id == KB, *condition)
    return _Statement(Query(statement), booleans)


def _digest(
    session: Session, kb_id: int, statement: _Statement, leaving: Leaving
) -> tuple[int, int]:
    """Count rows, and add up their hashes: a sum that does not depend on their order."""
    rows = session.stream(statement.query, kb=kb_id, low=leaving.low, high=leaving.high)
    # SQLite has numbers for them.
    convert = dict.fromkeys(statement.booleans, bool)
    number = total = 0
    for row in rows:
        number += 1
        total += int.from_bytes(sha256(repr(converted(row, convert)).encode()).digest())
    return number, total % _MODULUS

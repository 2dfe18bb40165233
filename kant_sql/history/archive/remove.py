"""Counts the versions to archive, compares them with the target, and removes them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from typing import Any, NamedTuple

from sqlalchemy import Boolean, ColumnElement, Float, Select, Table, delete, func, select, union_all

from ...dao.base import batches
from ...errors import ConflictError, StoreError
from ...sql.changes import in_range
from ...sql.dialects.base import Session
from ...sql.query import Query, constant, in_list, in_rows, integer
from ...sql.rows import KB, AtomTables, looked_up
from ...sql.tables import TABLES
from ...store.head import set_head
from ...store.store import Store
from ..replication.copy import (
    ARCHIVED_TABLES,
    ATOMS,
    CONFIRMATION,
    SAYINGS,
    CopiedTable,
    children_of,
    converted,
    references,
)
from ..replication.target import begin_on

_MODULUS = 2**256


class Leaving(NamedTuple):
    """The versions to remove: those that ended in the revisions from `low` to `high`."""

    low: int
    high: int
    versions: dict[str, int]  # the number of versions by table; without empty tables

    @property
    def total(self) -> int:
        """The number of versions in all tables."""
        return sum(self.versions.values())


def _ended(part: CopiedTable) -> tuple[ColumnElement[bool], ColumnElement[bool]]:
    return part.version.c.kb_id == KB, in_range(part.version.c.until)


_COUNT = Query(
    union_all(
        *(
            select(constant(part.version.name), func.count()).where(*_ended(part))
            for part in ARCHIVED_TABLES
        )
    )
)


def count(session: Session, kb_id: int, low: int, high: int) -> Leaving:
    """Count the versions that ended in a range of revisions, in one statement."""
    rows = session.rows(_COUNT, kb=kb_id, low=low, high=high)
    counts: dict[str, int] = dict(rows)
    found = {part.version.name: counts[part.version.name] for part in ARCHIVED_TABLES}
    return Leaving(low, high, {name: number for name, number in found.items() if number})


def first_of(session: Session, kb_id: int, leaving: Leaving, most: int) -> Leaving:
    """Limit the versions to remove at once: whole revisions, at least one."""
    if leaving.total <= most:
        return leaving
    low = leaving.low
    ends = range(low, leaving.high)
    place = bisect_left(ends, most, key=lambda end: count(session, kb_id, low, end).total)
    return count(session, kb_id, low, low + place)


def compare(leaving: Leaving, source: tuple[Session, int], target: tuple[Session, int]) -> None:
    """Check that the target has all rows to remove, column by column."""
    for part in ARCHIVED_TABLES:
        if part.version.name not in leaving.versions:
            continue
        for table, statement in _statements(part):
            here, there = (
                _digest(session, kb_id, statement, leaving) for session, kb_id in (source, target)
            )
            if here != there:
                raise ConflictError(
                    f"{target[0].backend.label}: its {there[0]} rows of {table.name} that ended in "
                    f"revisions {leaving.low} to {leaving.high} differ from the {here[0]} of "
                    f"{source[0].backend.label}; nothing was removed: verify both stores, and "
                    "archive into another one"
                )


# A query, and the converters of its rows.
_Statement = tuple[Query, dict[int, Callable[[Any], Any]]]


# SQLite stores booleans as numbers. The sum drops the sign of zero: only PostgreSQL stores a
# number too small for a double as a signed zero.
_AS_READ: tuple[tuple[type[Any], Callable[[Any], Any]], ...] = (
    (Boolean, bool),
    (Float, lambda raw: None if raw is None else raw + 0.0),
)


def _leaving(part: CopiedTable) -> dict[Table, tuple[ColumnElement[bool], ...]]:
    """Return the conditions of the rows to remove, by table, parents first."""
    own = _ended(part)
    children = {child: children_of(part, child, own[1]) for child in part.children}
    return {part.version: own, **children}


@cache
def _statements(part: CopiedTable) -> tuple[tuple[Table, _Statement], ...]:
    """Return the queries of the rows to compare, by table."""
    leaving = _leaving(part)
    if part.atoms is not None:
        identity, arguments, *_ = part.atoms
        owners = select(part.version.c[part.owner[0]]).where(*_ended(part))
        leaving[identity] = (in_rows(identity.c.id, owners),)
        leaving[arguments] = (in_rows(arguments.c[part.owner[0]], owners),)
    return tuple((table, _read(table, *which)) for table, which in leaving.items())


def _read(table: Table, *condition: ColumnElement[bool]) -> _Statement:
    """Read rows without the ids of atoms, which may differ in the target."""
    of_atoms = {table.columns[index]: ATOMS[to] for index, to in references(table) if to in ATOMS}
    own = {table.c.id} if table in ATOMS else set[Any]()
    columns: list[Any] = []
    for column in table.columns:
        if column in of_atoms:
            atom = of_atoms[column].identity.c
            columns.append(looked_up(atom.text, atom.id, column))
        elif column not in own and column.name != "kb_id":
            columns.append(column)
    convert = {
        n: of
        for n, column in enumerate(columns)
        for kind, of in _AS_READ
        if isinstance(column.type, kind)
    }
    statement: Select[Any] = select(*columns).where(table.c.kb_id == KB, *condition)
    return Query(statement), convert


def _digest(
    session: Session, kb_id: int, statement: _Statement, leaving: Leaving
) -> tuple[int, int]:
    """Count rows and add up their hashes, independent of their order."""
    query, convert = statement
    number = total = 0
    for row in session.stream(query, kb=kb_id, low=leaving.low, high=leaving.high):
        number += 1
        total += int.from_bytes(sha256(repr(converted(row, convert)).encode()).digest())
    return number, total % _MODULUS


# No knowledge base has this id.
_NONE = -1
# Objects per statement, with the atoms that mention them.
_OBJECTS = 200

_SET = set_head(archived_revision=integer("upto"))
_OBJECT, _OBJECT_VERSION = TABLES["object"].c, TABLES["object_version"].c
_OBJECT_VERSIONS = select(_OBJECT_VERSION.since).where(
    _OBJECT_VERSION.kb_id == KB, _OBJECT_VERSION.object_id == _OBJECT.id
)
_GONE_OBJECTS = Query(select(_OBJECT.id).where(_OBJECT.kb_id == KB, ~_OBJECT_VERSIONS.exists()))


@cache
def _ended_ids(part: CopiedTable) -> tuple[Query, ...]:
    """Build the statements that delete ended versions, children first."""
    leaving = reversed(_leaving(part).items())
    return tuple(Query(delete(table).where(*which)) for table, which in leaving)


@cache
def _without_version(part: CopiedTable, atoms: AtomTables) -> Query:
    """Select the atoms that mention some objects and have no version."""
    version, argument = part.version.c, atoms.arguments.c
    (name,) = part.owner
    users = (version, *(each.c for each in (CONFIRMATION, *SAYINGS) if name in each.c))
    used = [
        select(each.since)
        .where(each.kb_id == KB, each[name] == argument[name])
        .correlate(atoms.arguments)
        for each in users
    ]
    return Query(
        select(argument[name])
        .where(argument.kb_id == KB, in_list(argument.object_id, "objects"))
        .where(*(~each.exists() for each in used))
        .distinct()
    )


@cache
def _remove_atoms(part: CopiedTable, atoms: AtomTables) -> tuple[Query, ...]:
    owners = (atoms.arguments.c[part.owner[0]], atoms.identity.c.id)
    return tuple(
        Query(delete(owner.table).where(owner.table.c.kb_id == KB, in_list(owner, "ids")))
        for owner in owners
    )


def refuse_without_right(store: Store) -> None:
    """Refuse users early who may not archive."""
    with begin_on(store.backend, write=True) as session:
        session.run(_SET, kb=_NONE, upto=0)


def remove(session: Session, kb_id: int, leaving: Leaving) -> None:
    """Remove archived versions and the rows that only they need, and record it in the head."""
    # Names stay, with their spelling and id, and so do ground atoms of objects with a version:
    # they may come back, and a state lists elements by id. Atoms of an object without a version go,
    # unless they have confirmations or sayings.
    session.replan()
    parameters = {"kb": kb_id, "low": leaving.low, "high": leaving.high}
    for part in ARCHIVED_TABLES:
        wanted = leaving.versions.get(part.version.name, 0)
        if wanted:
            *below, versions = _ended_ids(part)
            for query in below:
                session.run(query, **parameters)
            removed = session.run(versions, **parameters)
            if removed != wanted:
                raise StoreError(
                    f"{session.backend.label}: only {removed} of {wanted} rows of "
                    f"{part.version.name} can be removed; nothing was removed: connect as the "
                    "owner of the tables"
                )
    for rows in batches(session.stream(_GONE_OBJECTS, kb=kb_id), _OBJECTS):
        objects = session.list_value([id_ for (id_,) in rows])
        for part in ARCHIVED_TABLES:
            if part.atoms is not None:
                _remove_atoms_of(session, kb_id, part, part.atoms, objects)
    session.run(_SET, kb=kb_id, upto=leaving.high)


def _remove_atoms_of(
    session: Session, kb_id: int, part: CopiedTable, atoms: AtomTables, objects: Any
) -> None:
    rows = session.rows(_without_version(part, atoms), kb=kb_id, objects=objects)
    if rows:
        ids = session.list_value([id_ for (id_,) in rows])
        for query in _remove_atoms(part, atoms):
            session.run(query, kb=kb_id, ids=ids)

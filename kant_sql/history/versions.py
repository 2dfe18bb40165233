"""What held of one element, and from which revision until which."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    bindparam,
    literal_column,
    select,
    union_all,
)

from ..backends import Query, Row, Session, first_rows, in_list
from ..dto.dto import Dto
from ..dto.formula import Node
from ..errors import InvalidKnowledgeError
from ..knowledge.loading import KB
from ..knowledge.sources import FACT, GOAL, SOURCES, Source
from ..store import Store
from .elements import sought
from .owners import find_owners
from .revisions import LARGEST, Revision, read_numbered

_AT: ColumnElement[int] = bindparam("at", type_=BigInteger)


@dataclass(frozen=True)
class Version:
    """What held of one element from one revision until another.

    Attributes:
        kind: what it is a version of: one of the kinds of `Change`.
        text: the element's canonical PDDL text.
        since: the revision that asserted it: by whom, when and why.
        until: the revision that retracted it; None while it holds.
    """

    kind: str
    text: str
    since: Revision
    until: Revision | None


def _versions(name: str, source: Source) -> Select[Any]:
    version = source.version
    return select(source.kind, source.text, version.since, version.until).where(
        version.kb_id == KB, in_list(source.owner, name), version.since <= _AT
    )


def _last_version(name: str, source: Source) -> Select[Any]:
    """Give the last version of each element: one step in an index, however many there are."""
    identity, version = source.identity, source.version
    of_one = version.kb_id == identity.kb_id, source.owner == identity.id, version.since <= _AT
    columns = []
    for column in (source.kind, source.text, version.since, version.until):
        newest_first = select(column).where(*of_one).order_by(version.since.desc())
        last = first_rows(newest_first, literal_column("1")).correlate(identity.id.table)
        columns.append(last.scalar_subquery())
    return select(*columns).where(identity.kb_id == KB, in_list(identity.id, name))


@cache
def _query(names: tuple[str, ...], only_last: bool) -> Query:
    """Give the query of the sources that have the element: to plan all of them takes longer."""
    of_source = _last_version if only_last else _versions
    return Query(union_all(*(of_source(name, SOURCES[name]) for name in names)))


def read_versions(store: Store, element: Dto | Node | str, upto: int | None) -> list[Version]:
    """Read when an element held.

    Args:
        store: the store.
        element: a DTO, a formula, PDDL text, or a name.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        Its versions, oldest first.

    Raises:
        InvalidKnowledgeError: the element is none of these.
    """
    return _read(store, element, upto, only_last=False)


def blame(store: Store, element: Dto | Node | str, at: int | None) -> Version | None:
    """Read which version of an element holds.

    Args:
        store: the store.
        element: a DTO, a formula, PDDL text, or a name.
        at: the revision that a view of the past looks at; None for the head.

    Returns:
        The version; None when it does not hold.

    Raises:
        InvalidKnowledgeError: the element is none of these, or several that hold.
    """
    held = [
        version for version in _read(store, element, at, only_last=True) if version.until is None
    ]
    if {version.kind for version in held} == {FACT, GOAL}:
        # What holds comes before what is wanted to hold.
        held = [version for version in held if version.kind == FACT]
    if len(held) > 1:
        several = ", ".join(f"{version.kind} {version.text}" for version in held)
        raise InvalidKnowledgeError(
            f"{str(element)[:80]!r} stands for several things: {several}; give a DTO of the one"
        )
    return held[0] if held else None


def _read(
    store: Store, element: Dto | Node | str, upto: int | None, only_last: bool
) -> list[Version]:
    wanted = sought(element)
    at = LARGEST if upto is None else upto

    def work(session: Session, kb_id: int | None) -> list[Version]:
        if kb_id is None:
            return []
        owners = find_owners(session, kb_id, wanted)
        if not owners:
            return []
        ids: dict[str, list[int]] = {}
        for owner in sorted(owners):
            ids.setdefault(owner.source, []).append(owner.id)
        lists = {name: session.list_value(of_name) for name, of_name in ids.items()}
        rows = session.rows(_query(tuple(lists), only_last), kb=kb_id, at=at, **lists)
        return _make(session, kb_id, rows, at)

    return store.look(work)


def _make(session: Session, kb_id: int, rows: Iterable[Row], at: int) -> list[Version]:
    """Make versions of rows, oldest first; what ends after a revision holds there."""
    known = [
        (since, until if until is not None and until <= at else None, kind, text)
        for kind, text, since, until in rows
        if since is not None
    ]
    known.sort(key=lambda row: (row[0], row[1] is None, row[1] or 0, row[2:]))
    numbers = {number for row in known for number in row[:2] if number is not None}
    revisions = read_numbered(session, kb_id, numbers)
    return [
        Version(kind, text, revisions[since], None if until is None else revisions[until])
        for since, until, kind, text in known
    ]

"""What held of one element, and from which revision until which."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, lru_cache, partial
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

from ..arguments import shown
from ..backends import Query, Row, Session, first_rows, in_list, in_rows
from ..dto.dto import Dto
from ..dto.formula import Node
from ..errors import InvalidKnowledgeError, check_integer, unreadable
from ..knowledge.loading import KB
from ..knowledge.sources import FACT, GOAL, SOURCES, Source
from ..store import Store
from .elements import Sought, sought
from .owners import find_owners
from .places import Place, each_alone, identity_at, parameters, places
from .revisions import LARGEST, Revision, make_revision, read_numbered, revision_of

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


def _versions(source: Source, owned: ColumnElement[bool], *which: Any) -> Select[Any]:
    version = source.version
    columns: tuple[Any, ...] = source.kind.label("kind"), source.text.label("text")
    columns += version.since, version.until
    return select(*columns).where(version.kb_id == KB, owned, *which)


def _at_place(place: Place, which: Callable[[Any], ColumnElement[bool]]) -> Select[Any]:
    source = SOURCES[place.source]
    owned = in_rows(source.owner, identity_at(place))
    return _versions(source, owned, which(source.version))


def _last_at(place: Place) -> Select[Any]:
    """Give the last version of one identity: one step in an index, however many there are."""
    source = SOURCES[place.source]
    since = source.version.since
    owned = source.owner == identity_at(place).scalar_subquery()
    newest_first = _versions(source, owned, since <= _AT).order_by(since.desc())
    return select(first_rows(newest_first, literal_column("1")).subquery())


# Of the places where the element may be: to plan and to run all of them takes longer.
@lru_cache(maxsize=64)
def _all_of(places: tuple[Place, ...]) -> Query:
    return Query(
        union_all(*(_at_place(each, lambda version: version.since <= _AT) for each in places))
    )


@lru_cache(maxsize=64)
def _held_of(places: tuple[Place, ...], is_now: bool) -> Query:
    """Give the query of what holds, or of what was last, with the revisions that asserted it."""
    if is_now:
        # The live version of an identity is unique, and has an index of its own.
        parts = [_at_place(each, lambda version: version.until.is_(None)) for each in places]
    else:
        parts = [_last_at(each) for place in places for each in each_alone(place)]
    held = union_all(*parts).subquery("held")
    return Query(select(held, *revision_of(held.c.since)))


@cache
def _of_owners(names: tuple[str, ...]) -> Query:
    return Query(
        union_all(
            *(
                _versions(source, in_list(source.owner, name), source.version.since <= _AT)
                for name, source in ((name, SOURCES[name]) for name in names)
            )
        )
    )


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
    wanted, at = sought(element), _last_known(store, upto)
    found = places(wanted)
    if found is None:
        return store.look(partial(_of_identities, wanted=wanted, at=at))

    def work(session: Session, kb_id: int | None) -> list[Version]:
        if kb_id is None or not found:
            return []
        rows = session.rows(_all_of(found), kb=kb_id, at=at, **parameters(wanted))
        return _make(session, kb_id, rows, at)

    # Revisions are for ever: no transaction has to hold both statements together.
    return store.glance(work)


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
    held = _held(store, sought(element), _last_known(store, at))
    if {version.kind for version in held} == {FACT, GOAL}:
        # What holds comes before what is wanted to hold.
        held = [version for version in held if version.kind == FACT]
    if len(held) > 1:
        several = ", ".join(f"{version.kind} {version.text}" for version in held)
        raise InvalidKnowledgeError(
            f"{shown(element)} stands for several things: {several}; give a DTO of the one"
        )
    return held[0] if held else None


def _last_known(store: Store, upto: int | None) -> int:
    """Give the last revision that versions are of; in memory, tables hold what is not committed."""
    transaction = store.current()
    if upto is not None or transaction is None:
        return LARGEST if upto is None else upto
    return transaction.head.revision


def _held(store: Store, wanted: list[Sought], at: int) -> list[Version]:
    """Read which versions hold; one statement, where names tell of what."""
    found, is_now = places(wanted), at == LARGEST
    if found is None:
        versions = store.look(partial(_of_identities, wanted=wanted, at=at))
        return [version for version in versions if version.until is None]

    def work(session: Session, kb_id: int | None) -> list[Version]:
        if kb_id is None or not found:
            return []
        begun = {} if is_now else {"at": at}
        query = _held_of(found, is_now)
        rows = session.rows(query, kb=kb_id, **begun, **parameters(wanted))
        return [
            Version(row[0], row[1], make_revision(session, row[4:]), None)
            for row in rows
            if row[3] is None or row[3] > at
        ]

    return store.glance(work)


def _of_identities(
    session: Session, kb_id: int | None, wanted: list[Sought], at: int
) -> list[Version]:
    """Read the versions of what names alone do not tell of."""
    ids: dict[str, list[int]] = {}
    for owner in sorted(find_owners(session, kb_id, wanted)) if kb_id is not None else ():
        ids.setdefault(owner.source, []).append(owner.id)
    if kb_id is None or not ids:
        return []
    lists = {name: session.list_value(of_name) for name, of_name in ids.items()}
    return _make(
        session, kb_id, session.rows(_of_owners(tuple(lists)), kb=kb_id, at=at, **lists), at
    )


def _make(session: Session, kb_id: int, rows: Iterable[Row], at: int) -> list[Version]:
    """Make versions of rows, oldest first; what ends after a revision holds there."""
    known = []
    for kind, text, since, until in rows:
        for number in (since, until or 0):
            check_integer(f"of the versions of each {kind}", repr(text), "since or until", number)
        ended = until if until is not None and until <= at else None
        known.append((since, ended, kind, text))
    known.sort(key=lambda row: (row[0], row[1] is None, row[1] or 0, row[2:]))
    numbers = {number for row in known for number in row[:2] if number is not None}
    revisions = read_numbered(session, kb_id, numbers)
    for number in numbers - revisions.keys():
        raise unreadable("revision", f"revision {number!r}", LookupError("there is none"))
    return [
        Version(kind, text, revisions[since], None if until is None else revisions[until])
        for since, until, kind, text in known
    ]

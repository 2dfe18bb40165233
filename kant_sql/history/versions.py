"""The versions of an element, each from one revision until another."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import Any

from sqlalchemy import ColumnElement, Select, literal_column, select, union_all

from .. import html
from ..arguments import shown
from ..errors import InvalidKnowledgeError, check_integer, unreadable
from ..sql.dialects.base import Row, Session
from ..sql.query import Query, first_rows, in_list, in_rows
from ..sql.rows import FACT, GOAL, KB, THEN, VERSION_COLUMNS, VersionColumns
from ..store.state import State
from ..store.store import Store
from .elements import (
    MOST_LOOKUPS,
    Element,
    Lookup,
    Sought,
    Written,
    find_owners,
    identities_of,
    lookups,
    parameters,
    refuse_unknown_element,
    sought,
    split_goals,
)
from .involvement import involving
from .revisions import LARGEST, Revision, make_revision, read_numbered, revision_of


@dataclass(frozen=True)
class Version:
    """An element from the revision that asserted it until the one that retracted it.

    Attributes:
        kind: a kind, as in `Change`.
        text: the element's canonical PDDL text.
        since: the revision that asserted it: by whom, when and why.
        until: the revision that retracted it; None while it holds.
    """

    kind: str
    text: str
    since: Revision
    until: Revision | None

    def _html_row_(self) -> html.Row:
        until = self.until
        return {
            "kind": self.kind,
            "text": self.text,
            "since": self.since.number,
            "asserted at": self.since.committed_at,
            "asserted by": self.since.actor,
            "reason": self.since.reason,
            "source": self.since.source_text,
            "until": None if until is None else until.number,
            "retracted at": None if until is None else until.committed_at,
            "retracted by": None if until is None else until.actor,
            "reason to retract": None if until is None else until.reason,
            "source to retract": None if until is None else until.source_text,
        }

    def _repr_html_(self) -> str:
        return html.fields(self._html_row_())


def _versions(source: VersionColumns, owned: ColumnElement[bool], *which: Any) -> Select[Any]:
    version = source.version
    columns: tuple[Any, ...] = source.kind.label("kind"), source.text.label("text")
    columns += version.since, version.until
    return select(*columns).where(version.kb_id == KB, owned, *which)


def _versions_of(lookup: Lookup, which: Callable[[Any], ColumnElement[bool]]) -> Select[Any]:
    source = VERSION_COLUMNS[lookup.source]
    owned = in_rows(source.owner, identities_of(lookup), bounded=source.version.since)
    return _versions(source, owned, which(source.version))


def _last_version_of(lookup: Lookup) -> Select[Any]:
    """Select the last version of one identity: one index step, however many there are."""
    source = VERSION_COLUMNS[lookup.source]
    since = source.version.since
    owned = source.owner == identities_of(lookup).scalar_subquery()
    newest_first = _versions(source, owned, since <= THEN).order_by(since.desc())
    return select(first_rows(newest_first, literal_column("1")).subquery())


# Only the lookups that may find it: planning and running all of them takes longer.
@lru_cache(maxsize=64)
def _all_of(lookups: tuple[Lookup, ...]) -> Query:
    return Query(union_all(*(part for each in lookups for part in _all_versions_of(each))))


def _all_versions_of(lookup: Lookup) -> Iterator[Select[Any]]:
    if not lookup.is_involved:
        yield _versions_of(lookup, lambda version: version.since <= THEN)
        return
    for columns, which in involving(identities_of(lookup).scalar_subquery()):
        yield _versions(columns, which, columns.version.since <= THEN)


@lru_cache(maxsize=64)
def _held_of(lookups: tuple[Lookup, ...], is_now: bool) -> Query:
    """Build the query of the versions that hold, or held last, with their first revisions."""
    if is_now:
        # The live version of an identity has a unique index.
        parts = [_versions_of(each, lambda version: version.until.is_(None)) for each in lookups]
    else:
        parts = [_last_version_of(each) for lookup in lookups for each in split_goals(lookup)]
    held = union_all(*parts).subquery("held")
    return Query(select(held, *revision_of(held.c.since)))


@cache
def _of_owners(names: tuple[str, ...]) -> Query:
    return Query(
        union_all(
            *(
                _versions(
                    source,
                    in_list(source.owner, name, bounded=source.version.since),
                    source.version.since <= THEN,
                )
                for name, source in ((name, VERSION_COLUMNS[name]) for name in names)
            )
        )
    )


def history(state: State, element: Element) -> list[Version]:
    """Read when an element held, and who asserted and retracted it.

    Args:
        element: a DTO (the value of a function value is ignored), a formula, PDDL text, or a
            name, which matches all definitions of that name. The text `(robot_at rb1 wp1)`
            matches the fact and the goal, `(battery rb1)` the values of the fluent; other texts
            are formulas, or definitions as the log shows them. The name or DTO of an object
            matches all that involves it: facts, goals, values, formulas, actions and steps of
            plans, too; `rb1 - robot` only its declaration.

    Returns:
        Its versions in this store, oldest first; empty for an unknown element. Archived
        versions are not included.

    Raises:
        InvalidKnowledgeError: `element` is not one of the above.

    Examples:
        >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
        >>> for version in kb.history("(robot_at rb1 wp1)"):
        ...     print(version.since.number, version.until.number)
        1 2
    """
    versions = _read_versions(state, element)
    if not versions:
        refuse_unknown_element(state.store, element)
    return html.Listing(versions, "version")


def _read_versions(state: State, element: Element) -> list[Version]:
    store, upto = state
    wanted, at = sought(element), _last_known(store, upto)
    found = _in_one_statement(wanted)
    if found is None:
        return store.query_in_snapshot(partial(_of_identities, wanted=wanted, at=at))

    def work(session: Session, kb_id: int | None) -> list[Version]:
        if kb_id is None or not found:
            return []
        rows = session.rows(_all_of(found), kb=kb_id, at=at, **parameters(wanted, found))
        return _make(session, kb_id, rows, at)

    # Revisions never change: both statements need no common transaction.
    return store.query(work)


def blame(state: State, element: Element) -> Version | None:
    """Show who asserted an element that holds now, when and why.

    Args:
        element: as for `history`; of an object, its declaration.

    Returns:
        The version that holds, with the revision that asserted it in `since`; None when the
        element does not hold. A text that matches a fact and a goal gives the fact.

    Raises:
        InvalidKnowledgeError: `element` is not valid, or matches several things that hold.

    Examples:
        >>> kb.blame("(robot_at rb1 wp1)").since.actor
        'perception'
    """
    held = _held(state.store, sought(element), _last_known(*state))
    if {version.kind for version in held} == {FACT, GOAL}:
        # A fact takes precedence over a goal.
        held = [version for version in held if version.kind == FACT]
    if len(held) > 1:
        several = ", ".join(f"{version.kind} {version.text}" for version in held)
        raise InvalidKnowledgeError(
            f"{shown(element)} matches several elements: {several}; give a DTO of one of them"
        )
    if not held:
        refuse_unknown_element(state.store, element)
    return held[0] if held else None


def _last_known(store: Store, upto: int | None) -> int:
    """Return the last visible revision; in memory, the tables hold uncommitted versions, too."""
    transaction = store.current()
    if upto is not None or transaction is None:
        return LARGEST if upto is None else upto
    return transaction.head.revision


def _in_one_statement(wanted: list[Sought]) -> tuple[Lookup, ...] | None:
    """Return the lookups of a question of names alone, if one statement can ask it."""
    found = lookups(wanted)
    has_formulas = any(isinstance(each, Written) for each in wanted)
    return None if has_formulas or len(found) > MOST_LOOKUPS else found


def _held(store: Store, wanted: list[Sought], at: int) -> list[Version]:
    """Read the versions that hold, in one statement where names suffice."""
    found, is_now = _in_one_statement(wanted), at == LARGEST
    if found is None:
        versions = store.query_in_snapshot(partial(_of_identities, wanted=wanted, at=at))
        return [version for version in versions if version.until is None]

    def work(session: Session, kb_id: int | None) -> list[Version]:
        if kb_id is None or not found:
            return []
        begun = {} if is_now else {"at": at}
        query = _held_of(found, is_now)
        rows = session.rows(query, kb=kb_id, **begun, **parameters(wanted, found))
        return [
            Version(row[0], row[1], make_revision(session, row[4:]), None)
            for row in rows
            if row[3] is None or row[3] > at
        ]

    return store.query(work)


def _of_identities(
    session: Session, kb_id: int | None, wanted: list[Sought], at: int
) -> list[Version]:
    """Read the versions of identities that names alone do not find."""
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
    """Build versions from rows, oldest first; one that ends after `at` holds there."""
    known = []
    # Parts of a question may name one element.
    for kind, text, since, until in dict.fromkeys(rows):
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

"""The difference between two states."""

from __future__ import annotations

from typing import Any

from sqlalchemy import ColumnElement, Select, and_, literal_column, or_, select, union_all

from .. import html
from ..moment_text import When
from ..sql.changes import ASSERTED, RETRACTED, Change, unsortable
from ..sql.dialects.base import Session
from ..sql.intervals import ANY_FUNCTION, ANY_PREDICATE, held_then, then
from ..sql.query import Query, integer
from ..sql.rows import (
    KB,
    KIND_TABLES,
    PROPOSITION,
    VALUE,
    VERSION_COLUMNS,
    VersionColumns,
    held_at,
)
from ..sql.tables import HeadRow
from ..store.snapshot import View, refuse_archived
from ..store.state import State
from .moments import states_at

_BEFORE = integer("before")
_AFTER = integer("after")
_FIRST = integer("first")


def _came_and_went(source: VersionColumns) -> list[Select[Any]]:
    """Select the versions of one kind that hold at just one of two revisions."""
    version = source.version
    came = (
        version.since.between(_FIRST, _AFTER),
        or_(version.until.is_(None), version.until > _AFTER),
    )
    went = version.until.between(_FIRST, _AFTER), version.since <= _BEFORE
    columns: tuple[Any, ...] = source.kind, source.text
    return [
        select(literal_column(change), *columns).where(version.kb_id == KB, *conditions)
        for change, conditions in (("1", came), ("-1", went))
    ]


def _differences(*names: str) -> Query:
    # In the same statement: archived versions are missing in the rest.
    none: ColumnElement[str] = literal_column("''")
    columns: tuple[Any, ...] = HeadRow.archived_revision, none, none
    archived = select(*columns).where(HeadRow.kb_id == KB)
    parts = [part for name in names for part in _came_and_went(VERSION_COLUMNS[name])]
    return Query(union_all(archived, *parts))


# By whether definitions may differ, too.
_DIFFERENCES = {
    True: _differences(*VERSION_COLUMNS),
    False: _differences(*(name for name in VERSION_COLUMNS if name not in KIND_TABLES)),
}


def _state(then: bool) -> Query:
    """Select kind and text of all that holds."""
    parts = []
    for name, source in VERSION_COLUMNS.items():
        version = source.version
        held: ColumnElement[bool] = version.until.is_(None)
        if then:
            any_owner = {PROPOSITION: ANY_PREDICATE, VALUE: ANY_FUNCTION}.get(name)
            held = held_at(version) if any_owner is None else and_(any_owner, held_then(version))
        columns: tuple[Any, ...] = source.kind, source.text
        parts.append(select(*columns).where(version.kb_id == KB, held))
    return Query(union_all(*parts))


# By whether it is about the past.
_STATES = {is_past: _state(is_past) for is_past in (False, True)}


def state_lines(state: State) -> list[tuple[str, str]]:
    """Read kind and text of all that belongs to a state, in one statement."""

    def work(view: View) -> list[tuple[str, str]]:
        if view.kb_id is None:
            return []
        past = {} if view.at is None else then(view.session, view.at)
        rows = view.session.rows(_STATES[view.at is not None], kb=view.kb_id, **past)
        return [(kind, text) for kind, text in rows]

    return state.store.read_in_snapshot(work, state.at)


def diff_lines(here: list[tuple[str, str]], there: list[tuple[str, str]]) -> list[Change]:
    """Return the changes from one state to another, of their lines."""
    own, others = set(here), set(there)
    changes = [Change(ASSERTED, *line) for line in others - own]
    changes += [Change(RETRACTED, *line) for line in own - others]
    try:
        return html.Listing(sorted(changes), "change")
    except TypeError as error:
        raise unsortable(((kind, text) for _, kind, text in changes), "now", error) from error


def diff(state: State, a: When, b: When) -> list[Change]:
    """Compare two states. Recorded plans and archives belong to no state.

    Args:
        a: a revision, given as for `kb.at`.
        b: another, before or after `a`.

    Returns:
        `+` for what holds at `b` only, `-` for what holds at `a` only, sorted by sign, kind and
        text.

    Raises:
        UnknownRevisionError: there is no such revision yet, or a time lies in the future or
            has no zone.
        ArchivedError: one of the states was moved to an archive.

    Examples:
        >>> _ = kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
        >>> for change in kb.diff(1, 2):
        ...     print(change.sign, change.kind, change.text)
        + fact (robot_at rb1 wp2)
        + object wp2 - wp
    """
    store, upto = state
    states, stand = states_at(store, (a, b), upto)
    before, after = sorted(states)
    came, went = (ASSERTED, RETRACTED) if before == states[0] else (RETRACTED, ASSERTED)

    def work(session: Session, kb_id: int | None) -> list[Change]:
        if kb_id is None or before == after:
            return []
        query = _DIFFERENCES[before < stand.redefined]
        bounds = {"before": before, "first": before + 1, "after": after}
        rows = session.rows(query, kb=kb_id, **bounds)
        net: dict[tuple[str, str], int] = {}
        for change, kind, text in rows:
            # The same text in another version is no difference.
            net[kind, text] = net.get((kind, text), 0) + change
        refuse_archived(session, kb_id, before, net.pop(("", ""), 0))
        try:
            found = sorted(Change(came if net[key] > 0 else went, *key) for key in net if net[key])
        except TypeError as error:
            raise unsortable(net, f"revisions {before} to {after}", error) from error
        return found

    return html.Listing(store.query(work), "change")

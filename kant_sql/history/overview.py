"""Counts of a state, and of a range of revisions by actor and kind."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, ScalarSelect, func, select

from ..moment_text import When
from ..sql.changes import count_changes, in_range
from ..sql.dialects.base import Session
from ..sql.intervals import held_by
from ..sql.query import Query, first_rows, integer
from ..sql.rows import KB, PROPOSITION, THEN, VALUE
from ..sql.tables import TABLES, FunctionValueVersionRow, PropositionVersionRow, RevisionRow
from ..store.snapshot import View, read_position
from ..store.state import State
from .moments import find_bounds


class Overview(NamedTuple):
    """The counts of a state."""

    objects: int
    facts: int
    goals: int
    values: int


def _count(version: Any, *conditions: ColumnElement[bool]) -> ScalarSelect[int]:
    counted = select(func.count()).where(version.kb_id == KB, *conditions)
    return counted.scalar_subquery()


def _counts(at: ColumnElement[int] | None) -> Query:
    atom, value = PropositionVersionRow, FunctionValueVersionRow
    object_ = TABLES["object_version"].c
    atoms = held_by(PROPOSITION, atom, at)
    return Query(
        select(
            _count(object_, held_by("object", object_, at)),
            _count(atom, atoms, atom.is_goal.is_(False)),
            _count(atom, atoms, atom.is_goal.is_(True)),
            _count(value, held_by(VALUE, value, at)),
        )
    )


# Keyed by whether it is about the past.
_COUNTS = {True: _counts(THEN), False: _counts(None)}


def read_overview(state: State) -> Overview:
    """Count the elements of a state, in one statement."""

    def work(view: View) -> Overview:
        (row,) = view.rows(_COUNTS) or [(0, 0, 0, 0)]
        return Overview(*row)

    return state.store.read_in_snapshot(work, state.at)


class ActorTally(NamedTuple):
    """The revisions of one actor.

    Attributes:
        actor: its name; None for revisions without one.
        revisions: how many.
        first: the first of them.
        last: the last one.
    """

    actor: str | None
    revisions: int
    first: int
    last: int


class Tally(NamedTuple):
    """The actors and changes of a range of revisions."""

    first: int  # the first revision of the range
    last: int  # the last one; below `first` in an empty range
    actors: int  # how many actors there are
    busiest: tuple[ActorTally, ...]  # the actors with the most revisions
    changes: tuple[tuple[str, str, int], ...]  # how many changes of each kind and sign
    archived: int  # versions that ended up to this revision are in an archive, and not counted


_REVISIONS = func.count().label("revisions")
_OF_RANGE = (RevisionRow.kb_id == KB, in_range(RevisionRow.number))
_ACTORS = Query(select(func.count(RevisionRow.actor.distinct())).where(*_OF_RANGE))
_NUMBER = RevisionRow.number
_ACTOR_COLUMNS: Any = RevisionRow.actor, _REVISIONS, func.min(_NUMBER), func.max(_NUMBER)
_BY_ACTOR = (
    select(*_ACTOR_COLUMNS)
    .where(*_OF_RANGE)
    .group_by(RevisionRow.actor)
    .order_by(_REVISIONS.desc(), RevisionRow.actor)
)
_BUSIEST = Query(first_rows(_BY_ACTOR, integer("size")))


def read_tally(state: State, since: When | None, until: When | None, most: int) -> Tally:
    """Count the revisions of a range by actor, and their changes by kind, in five statements."""
    low, high, *_ = find_bounds(state, since, until)

    nothing = Tally(low, high, 0, (), (), 0)

    def work(session: Session, kb_id: int) -> Tally:
        if high < low:
            return nothing
        of_range = {"kb": kb_id, "low": low, "high": high}
        ((named,),) = session.rows(_ACTORS, **of_range)
        rows = session.rows(_BUSIEST, size=most, **of_range)
        busiest = tuple(ActorTally(*row) for row in rows)
        changes = tuple(count_changes(session, kb_id, low, high))
        archived = read_position(session, kb_id).archived
        return Tally(low, high, named, busiest, changes, archived)

    return state.store.query_known(work, nothing)

"""How much a knowledge base holds, for whoever sees it for the first time."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, ScalarSelect, and_, func, select

from .. import html
from ..sql.intervals import ANY_FUNCTION, ANY_PREDICATE, held_then, then
from ..sql.query import Query
from ..sql.rows import KB, held_at
from ..sql.tables import TABLES, FunctionValueVersionRow, PropositionVersionRow
from ..store.snapshot import View
from ..store.store import Store


class Overview(NamedTuple):
    """How much a state holds."""

    objects: int
    facts: int
    goals: int
    values: int

    def _html_row_(self) -> html.Row:
        return self._asdict()


def _count(version: Any, *conditions: ColumnElement[bool]) -> ScalarSelect[int]:
    counted = select(func.count()).where(version.kb_id == KB, *conditions)
    return counted.scalar_subquery()


def _counts(is_past: bool) -> Query:
    atom, value = PropositionVersionRow, FunctionValueVersionRow
    object_ = TABLES["object_version"].c

    def held(version: Any, any_owner: Any) -> ColumnElement[bool]:
        if not is_past:
            return version.until.is_(None)  # type: ignore[no-any-return]
        return and_(any_owner, held_then(version))

    atoms = held(atom, ANY_PREDICATE)
    return Query(
        select(
            _count(object_, held_at(object_) if is_past else object_.until.is_(None)),
            _count(atom, atoms, atom.is_goal.is_(False)),
            _count(atom, atoms, atom.is_goal.is_(True)),
            _count(value, held(value, ANY_FUNCTION)),
        )
    )


# By whether it is about the past.
_COUNTS = {is_past: _counts(is_past) for is_past in (False, True)}


def read_overview(store: Store, at: int | None) -> Overview:
    """Count what holds in a state, in one statement."""

    def work(view: View) -> Overview:
        if view.kb_id is None:
            return Overview(0, 0, 0, 0)
        past = {} if view.at is None else then(view.session, view.at)
        (row,) = view.session.rows(_COUNTS[view.at is not None], kb=view.kb_id, **past)
        return Overview(*row)

    return store.read_in_snapshot(work, at)

"""Expected facts that nobody confirmed or somebody retracted, and facts not seen for a time."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import cache
from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    and_,
    func,
    literal_column,
    or_,
    select,
    union,
)

from .. import html
from ..arguments import period
from ..moment_text import When
from ..sql import tables as t
from ..sql.dialects.base import Row, Session
from ..sql.intervals import ANY_PREDICATE, held_by, then
from ..sql.lanes import revisions_at
from ..sql.query import Query, constant, first_rows, in_list, integer
from ..sql.rows import KB, PROPOSITION, THEN, VERSION_COLUMNS, looked_up, table_of
from ..store.snapshot import View
from ..store.state import State
from .moments import find_bounds
from .revisions import LARGEST, Version, at_most, read_numbered
from .versions import actor_of, had_effect, last_confirmation, make_versions

_FACT = VERSION_COLUMNS[PROPOSITION]
_HELD = _FACT.version
_OUTCOME, _LINK = table_of(t.ExecutionVersionRow).c, table_of(t.RevisionExecutionRow).c
# With more acts, go from the live facts to the acts; otherwise from the acts to the facts.
FEW = 10_000


def _acts() -> tuple[Select[Any], Select[Any]]:
    """Select revisions that record an act with effects, or that name an execution."""
    began = select(_OUTCOME.since).where(_OUTCOME.kb_id == KB, had_effect())
    return began, select(_LINK.number).where(_LINK.kb_id == KB)


def _is_of_act(number: Any) -> Any:
    began = looked_up(_OUTCOME.since, _OUTCOME.since, number, had_effect())
    return or_(began.is_not(None), looked_up(_LINK.number, _LINK.number, number).is_not(None))


_COUNT = Query(select(func.count()).select_from(first_rows(_acts()[0], FEW + 1).subquery()))


@cache
def _query(which: str, is_past: bool, by_acts: bool = False) -> Query:
    """Select facts that hold, or that ended in a range of revisions, oldest or newest first."""
    seen: Any = last_confirmation(by_others=which != "stale")
    where = [_HELD.kb_id == KB, ~_HELD.is_goal]
    if which == "contradicted":
        retracted, asserted = actor_of(_HELD.until), actor_of(_HELD.since)
        where.append(_HELD.until.between(integer("low"), integer("high")))
        where += [retracted.is_distinct_from(asserted), ~_is_of_act(_HELD.until)]
        order = _HELD.until.desc(), _HELD.proposition_id
    else:
        where.append(held_by(PROPOSITION, _HELD, THEN if is_past else None))
        if not by_acts and which != "stale":
            # By the index of live facts: they are few among all that ever held.
            where.append(ANY_PREDICATE)
        # An expression uses no index: that of `since` would read the whole history.
        since = _HELD.since + constant(0)
        where.append(since <= integer("upto"))
        order = since, _HELD.proposition_id
    if which == "stale":
        where.append(in_list(_HELD.proposition_id, "ids", bounded=_HELD.since))
        where.append(or_(seen.is_(None), seen <= integer("upto")))
    else:
        where.append(seen.is_(None))
    rows = select(_FACT.kind, _FACT.text, _HELD.since, _HELD.until, _HELD.proposition_id)
    if by_acts:
        rows = _of_acts(rows, where)
    else:
        rows = rows.where(*where, *([] if which == "stale" else [_is_of_act(_HELD.since)]))
    return Query(first_rows(rows.order_by(*order), integer("size")))


def _of_acts(rows: Select[Any], where: Iterable[ColumnElement[bool]]) -> Select[Any]:
    """Look up the assertions of acts, act by act."""
    # SQLite assumes ten rows for a knowledge base, and so would begin with all versions. It keeps
    # the order of an outer join, unless a condition implies a row on the right.
    acts, zero = union(*_acts()).subquery("act"), literal_column("0", BigInteger)
    versions = table_of(t.PropositionVersionRow)
    found = acts.outerjoin(versions, and_(_HELD.since == acts.c.since, *where))
    return rows.select_from(found).where(func.coalesce(_HELD.since, zero) > zero)


def unconfirmed(
    state: State, *, older_than: float | None = None, limit: int | None = None
) -> list[Version]:
    """Find expected facts: acts asserted them, and no other actor confirmed them.

    Args:
        older_than: only facts asserted at least this many seconds ago.
        limit: the maximum number of facts; None for all.

    Returns:
        The facts that hold, oldest first, with the acts that asserted them.

    Raises:
        InvalidArgumentError: `older_than` is not a number of seconds, from 0.

    Examples:
        >>> kb.unconfirmed(older_than=60)
        []
    """
    return _find(state, "unconfirmed", older_than, limit)


def read_unconfirmed(state: State, view: View) -> list[Version]:
    """Read all expected facts of a state that is open for other reads."""
    return _find(state, "unconfirmed", None, None, view=view)


def contradicted(
    state: State,
    *,
    since: When | None = None,
    until: When | None = None,
    limit: int | None = None,
) -> list[Version]:
    """Find expected facts that another actor retracted before anyone confirmed them.

    A fact that another act deleted is not contradicted: the condition of that act held. Facts that
    ended before an archive are in that archive.

    Args:
        since: only facts retracted from this revision or time on.
        until: only facts retracted up to this revision or time.
        limit: the maximum number of facts; None for all.

    Returns:
        The facts, the last retracted first, with the acts that asserted them.

    Raises:
        UnknownRevisionError: a bound lies in the future, or is a time without zone.

    Examples:
        >>> kb.contradicted()
        []
    """
    bounds = find_bounds(state, since, until)
    return _find(state, "contradicted", None, limit, low=bounds.low, high=bounds.high)


def stale_facts(state: State, view: View, ids: Collection[int], than: float) -> list[Version]:
    """Find the facts of a view that nobody has asserted or confirmed for some seconds."""
    return _find(state, "stale", than, None, view, ids=ids)


def _find(
    state: State,
    which: str,
    seconds: float | None,
    limit: int | None,
    view: View | None = None,
    **given: Any,
) -> list[Version]:
    role = "than" if which == "stale" else "older_than"
    age = None if seconds is None else period(seconds, role)
    size, at = at_most(limit), LARGEST if state.at is None else state.at

    def work(session: Session, kb_id: int) -> list[Version]:
        own = {name: value for name, value in given.items() if name != "ids"}
        if "ids" in given:
            own["ids"] = session.list_value([*given["ids"]])
        if which != "contradicted":
            own["upto"] = at
            if age is not None:
                past = read_numbered(session, kb_id, [state.at] if state.at else [])
                last = next(iter(past.values()), None)
                now = state.store.clock(session) if last is None else last.committed_at
                [own["upto"]] = revisions_at(session, kb_id, [now - age])
            own |= {} if state.at is None else then(session, at)
        own["at"] = at
        count = session.first(_COUNT, kb=kb_id) if which != "stale" else None
        query = _query(which, state.at is not None, count is not None and count[0] <= FEW)
        rows: list[Row] = session.rows(query, kb=kb_id, size=size, **own)
        made = make_versions(session, kb_id, rows, at)
        order = {(row[1], row[2]): place for place, row in enumerate(rows)}
        return sorted(made, key=lambda one: order[one.text, one.since.number])

    # Pending changes of a transaction have no revision yet.
    if view is None or view.kb_id is None or state.at != state.upto:
        return html.Listing(state.store.query_known(work, []), "fact")
    return html.Listing(work(view.session, view.kb_id), "fact")

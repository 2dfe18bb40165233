"""The difference of two states: complete, and by pages."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, and_, case, func, or_, select, union_all

from .. import html
from ..knowledge.definitions import Definitions
from ..knowledge.sayings import COMMITTED
from ..moment_text import When
from ..sql.changes import (
    ASSERTED,
    BY_OWNER,
    RETRACTED,
    Change,
    ChangeEnd,
    ChangesPage,
    ends_of,
    page_of,
    paged,
    unsortable,
)
from ..sql.definition_rows import last_definitions, read_ends
from ..sql.dialects.base import Session
from ..sql.intervals import forks_at, held_by
from ..sql.places import Place, place_text, read_places
from ..sql.query import Query, constant, first_rows, in_list, integer
from ..sql.rows import (
    FACT,
    GOAL,
    KB,
    KIND_TABLES,
    PROPOSITION,
    THEN,
    VALUE,
    VERSION_COLUMNS,
    held_at,
)
from ..sql.tables import HeadRow
from ..sql.valid_periods import ValidRange
from ..sql.valid_time import ValidTime, read_said
from ..store.snapshot import View, read_position, refuse_archived
from ..store.state import State
from ..store.valid_store import ValidStore
from .moments import (
    MICROSECOND,
    clamped,
    find_valid_range,
    is_valid_clock,
    state_at,
    states_at,
    valid_times,
)
from .revisions import LARGEST

_WORD = re.compile(r"[^\s()]+")
# Up to this many revisions apart, states are compared by versions that began or ended between them.
NARROW = 20_000
# Differences of a kind that pages show; they omit the rest.
COMPARED = 20_000

_BEFORE, _AFTER = integer("before"), integer("after")


def _text_then(name: str, owner: Any, at: ColumnElement[int]) -> ColumnElement[Any]:
    """Return the content of an element in a state, empty for a fact; NULL if it does not hold."""
    source = VERSION_COLUMNS[name]
    other = source.version.kb_id.table.alias("other")
    holds = or_(other.c.until.is_(None), other.c.until > at)
    said = constant("") if name == PROPOSITION else other.c.text
    same = other.c[source.owner.key] == owner
    last = select(case((holds, said))).where(other.c.kb_id == KB, same, other.c.since <= at)
    last = first_rows(last.order_by(other.c.since.desc()), 1)
    return last.correlate(owner.table).scalar_subquery()


def _differs(name: str, end: ChangeEnd, is_narrow: bool) -> ColumnElement[bool]:
    """Return whether a version that begins or ends between two states holds in only one."""
    # With many revisions between, it is found among the live versions; an expression uses no index.
    version, number = end.source.version, end.revision
    at, other = (_BEFORE, _AFTER) if end.retracted else (_AFTER, _BEFORE)
    if not is_narrow:
        number = number + constant(0)
    held = held_at(version, at) if is_narrow else held_by(name, version, at)
    text = constant("") if name == PROPOSITION else version.text
    there = _text_then(name, end.source.owner, other)
    changed = func.coalesce(there, constant(" ")) != text
    return and_(number > _BEFORE, number <= _AFTER, held, changed)


def _whole(names: Iterable[str]) -> Query:
    # In the same statement: archived versions are missing in the rest.
    none = constant("")
    columns: tuple[Any, ...] = HeadRow.archived_revision, constant(0), none, none
    archived = select(*columns).where(HeadRow.kb_id == KB)
    ends = ((name, end) for name in names for end in ends_of(VERSION_COLUMNS[name]))
    return Query(union_all(archived, *(end.line(_differs(name, end, True)) for name, end in ends)))


# Keyed by whether definitions may also differ.
_DIFFERENCES = {
    True: _whole(VERSION_COLUMNS),
    False: _whole(name for name in VERSION_COLUMNS if name not in KIND_TABLES),
}


# Whether only the earlier state has it, kind and text.
_Line = tuple[int, str, str]
_ATOMS = {PROPOSITION: FACT, VALUE: VALUE}


@cache
def _plain() -> Query:
    """Select the contents of facts and values in one of two states, up to a limit."""
    ends = [(name, end) for name in _ATOMS for end in ends_of(VERSION_COLUMNS[name])]
    lines = (first_rows(end.line(_differs(name, end, True)), integer("most")) for name, end in ends)
    return Query(union_all(*(select(line.subquery()) for line in lines)))


@cache
def _plain_of_ids() -> Query:
    """Select the contents of facts and values in the later of two states, and in the earlier."""
    parts = []
    for name, kind in _ATOMS.items():
        own: Any = VERSION_COLUMNS[name].identity
        texts = [_text_then(name, own.id, at) for at in (_AFTER, _BEFORE)]
        said = [own.text.concat(text) for text in texts] if name == PROPOSITION else texts
        columns: tuple[Any, ...] = constant(kind), own.id, *said
        parts.append(select(*columns).where(own.kb_id == KB, in_list(own.id, "ids")))
    return Query(union_all(*parts))


@cache
def _page(is_narrow: bool, side: int, key: tuple[type, ...]) -> Query:
    """Select elements that only the later of two states has, or, for side 1, only the earlier."""
    parts = []
    for name, source in VERSION_COLUMNS.items():
        end = ends_of(source)[side]
        line = end.short_line(constant(0), _differs(name, end, is_narrow))
        parts.append(select(first_rows(line, COMPARED).subquery()))
    return paged(parts, key)


def _state(at: ColumnElement[int] | None) -> Query:
    """Select kind and text of all elements of a state."""
    parts = []
    for name, source in VERSION_COLUMNS.items():
        columns: tuple[Any, ...] = source.kind, source.text
        held = held_by(name, source.version, at)
        parts.append(select(*columns).where(source.version.kb_id == KB, held))
    return Query(union_all(*parts))


# Keyed by whether it is about the past.
_STATES = {True: _state(THEN), False: _state(None)}


def state_lines(state: State) -> list[tuple[str, str]]:
    """Read kind and text of all elements of a state, in one statement."""

    def work(view: View) -> list[tuple[str, str]]:
        return [(kind, text) for kind, text in view.rows(_STATES)]

    return state.store.read_in_snapshot(work, state.at)


def diff_states(here: State, there: State) -> list[Change]:
    """Return the changes from one state to another, also of two knowledge bases."""
    store = here.store
    if store is there.store and not isinstance(store, ValidStore) and store.current() is None:
        # Two reads would see two names of what is erased between them.
        return diff(State(store), *("now" if at is None else at for _, at in (here, there)))
    return diff_lines(state_lines(here), state_lines(there))


def diff_lines(here: list[tuple[str, str]], there: list[tuple[str, str]]) -> list[Change]:
    """Return the changes from one state to another, from their lines."""
    own, others = set(here), set(there)
    changes = [Change(ASSERTED, *line) for line in others - own]
    changes += [Change(RETRACTED, *line) for line in own - others]
    try:
        return html.Listing(sorted(changes), "change")
    except TypeError as error:
        raise unsortable(((kind, text) for _, kind, text in changes), "now", error) from error


def diff(state: State, a: When, b: When) -> list[Change]:
    """Compare two revisions, like `KnowledgeBase.diff`."""
    states, stand = states_at(state, (a, b))
    before, after = sorted(states)
    signs = (ASSERTED, RETRACTED) if before == states[0] else (RETRACTED, ASSERTED)

    def work(session: Session, kb_id: int) -> list[Change]:
        if before == after:
            return []
        query = _DIFFERENCES[before < stand.redefined]
        rows = session.rows(query, kb=kb_id, before=before, after=after)
        refuse_archived(session, kb_id, before, sum(row[0] for row in rows if row[2] == ""))
        try:
            return sorted(Change(signs[row[1]], *row[2:]) for row in rows if row[2] != "")
        except TypeError as error:
            said = ((kind, text) for _, _, kind, text in rows)
            raise unsortable(said, f"revisions {before} to {after}", error) from error

    return html.Listing(state.store.query_known(work, [], in_snapshot=False), "change")


def valid_diff(state: State, a: When, b: When) -> list[Change]:
    """Compare the states that were true at two times, like `KnowledgeBase.diff`."""
    changes, _ = _valid_differences(state, a, b, LARGEST)
    return html.Listing(changes, "change")


def _valid_differences(
    state: State, a: When, b: When, most: int
) -> tuple[list[Change], tuple[ValidRange, bool]]:
    """Read the changes from one time to another, and whether there are more."""
    times = valid_times(state, (a, b))
    begin, end = sorted(map(clamped, times))
    # A change at the earlier time is already true then.
    after = begin if begin == end else begin + MICROSECOND
    span = find_valid_range(state, after, end)
    if begin == end:
        return [], (span, False)

    def work(session: Session, kb_id: int) -> tuple[set[_Line], bool]:
        ends = (end, span.high), (begin, span.before)
        views = [ValidTime(time, span.known, at) for time, at in ends]
        archived = read_position(session, kb_id).archived
        refuse_archived(session, kb_id, views[-1].oldest, archived)
        lines, is_cut = _valid_lines(session, kb_id, views, most)
        lost, redefined = read_ends(session, kb_id, span.before, span.known)
        if redefined:
            definitions = last_definitions(session, kb_id, span.before, span.known)
            lines = {line for line in lines if _fits(definitions, *line[1:])}
        lines.update((1, one.kind, one.text) for one in lost if one.revision <= span.high)
        return lines, is_cut

    nothing: tuple[set[_Line], bool] = set(), False
    lines, is_cut = state.store.query_known(work, nothing)
    signs = (ASSERTED, RETRACTED) if times[0] <= times[1] else (RETRACTED, ASSERTED)
    return sorted(Change(signs[side], *line) for side, *line in lines), (span, is_cut)


def _valid_lines(
    session: Session, kb_id: int, views: list[ValidTime], most: int
) -> tuple[set[_Line], bool]:
    """Read facts and values that hold only at the later of two times (0), or the earlier (1)."""
    after, before = (view.state for view in views)
    bounds = {"kb": kb_id, "before": before, "after": after}
    rows = session.rows(_plain(), **bounds, most=most)
    lines = {(side, kind, text) for _, side, kind, text in rows if kind != GOAL}
    is_cut = most <= max(Counter(line[:2] for line in lines).values(), default=0)
    # Sayings about one of the times override the versions.
    said = [read_said(session, kb_id, view) for view in views]
    ids = session.list_value(sorted({id_ for of_time in said for _, id_ in of_time}))
    for kind, id_, *plain in session.rows(_plain_of_ids(), **bounds, ids=ids):
        lines.difference_update((side, kind, text) for side, text in enumerate(plain))
        texts = [own.get((kind, id_), text) for own, text in zip(said, plain, strict=True)]
        if texts[0] != texts[1]:
            lines.update((side, kind, text) for side, text in enumerate(texts) if text is not None)
    return lines, is_cut


def _fits(definitions: Definitions, kind: str, text: str) -> bool:
    """Return whether a fact or a value fits the definition of its predicate or function."""
    name, *words = _WORD.findall(text.removeprefix("(= "))
    ids = [one.id for one in map(definitions.objects.named, words) if one is not None]
    owners: Any = definitions.predicates if kind == FACT else definitions.functions
    owner = owners.named(name)
    return owner is not None and definitions.admits(owner, ids)


class ChangesOfKind(NamedTuple):
    """Texts of one kind."""

    kind: str
    texts: list[str]


class Difference(NamedTuple):
    """A page of elements that hold in only one of two states.

    Attributes:
        a: the revision of the first state.
        b: the revision of the second state.
        head: the last revision.
        changes: as `kant-sql diff` shows them: `+` for elements that only `b` has.
        only_a: elements that only `a` has, by kind.
        only_b: elements that only `b` has, by kind.
        offset: the number of elements before the page, on each side.
        next: the value of `after` for the next page; None after the last.
        is_cut: whether more elements differ than the pages show.
    """

    a: int
    b: int
    head: int
    changes: list[Change]
    only_a: list[ChangesOfKind]
    only_b: list[ChangesOfKind]
    offset: int
    next: str | None
    is_cut: bool


def read_difference(
    state: State,
    a: When,
    b: When,
    after: str | None = None,
    limit: int = 200,
    clock: str = COMMITTED,
) -> Difference:
    """Read a page of the difference of two states, known or true."""
    if is_valid_clock(clock):
        return _valid_page(state, a, b, after, limit)
    (one, other), stand = states_at(state, (a, b))
    before, later = sorted((one, other))
    places = read_places(after, 2, BY_OWNER)

    def work(session: Session, kb_id: int | None) -> list[ChangesPage]:
        if kb_id is None or before == later:
            return [ChangesPage([], None)] * 2
        refuse_archived(session, kb_id, before, read_position(session, kb_id).archived)
        own: dict[str, Any] = {"kb": kb_id, "before": before, "after": later}
        pages = []
        for side, (at, place) in enumerate(zip((later, before), places, strict=True)):
            if place is None:
                pages.append(ChangesPage([], None))
                continue
            own["forks"] = session.list_value(forks_at(at))
            query = _page(later - before <= NARROW, side, place.types)
            pages.append(page_of(session, query, place, limit, **own))
        return pages

    came, went = state.store.query_in_snapshot(work)
    sides = [(ASSERTED, came), (RETRACTED, went)]
    if one != before:
        sides = [(ASSERTED, went), (RETRACTED, came)]
    changes = [change._replace(sign=sign) for sign, page in sides for _, change in page.changes]
    counts = [0 if place is None else place.passed for place in places]
    return Difference(
        one,
        other,
        stand.head if state.at is None else state.at,
        changes,
        _by_kind(changes, RETRACTED),
        _by_kind(changes, ASSERTED),
        max(counts),
        place_text(came.next, went.next),
        any(
            page.next is None and count + len(page.changes) >= COMPARED
            for count, page in zip(counts, (came, went), strict=True)
        ),
    )


def _valid_page(state: State, a: When, b: When, after: str | None, limit: int) -> Difference:
    changes, (span, is_cut) = _valid_differences(state, a, b, COMPARED)
    (place,) = read_places(after, 1, ())
    passed = 0 if place is None else place.passed
    page = changes[passed : passed + limit]
    following = Place(passed + limit) if passed + limit < len(changes) else None
    return Difference(
        state_at(state, a),
        state_at(state, b),
        span.known,
        page,
        _by_kind(page, RETRACTED),
        _by_kind(page, ASSERTED),
        passed,
        place_text(following),
        is_cut,
    )


def _by_kind(changes: list[Change], sign: str) -> list[ChangesOfKind]:
    found: dict[str, list[str]] = {}
    for one, kind, text in sorted(changes):
        if one == sign:
            found.setdefault(kind, []).append(text)
    return [ChangesOfKind(*each) for each in found.items()]

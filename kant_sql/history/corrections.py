"""Corrections: sayings that differ from the earlier belief about the same time."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import case, func, or_, select, text, union_all

from .. import html
from ..dto.lexical import is_same_number
from ..knowledge.sayings import last_said
from ..moment_text import When
from ..sql import tables as t
from ..sql.changes import last_until
from ..sql.dialects.base import Session
from ..sql.dialects.words import NestedLoops, Walk
from ..sql.lanes import LANE_SOURCES, LaneSource, value_of
from ..sql.places import Place, place_text, read_place
from ..sql.query import Query, constant, first_rows, integer
from ..sql.rows import FACT, KB, VALUE, looked_up, table_of
from ..store.snapshot import read_position
from ..store.state import State
from .moments import find_bounds
from .revisions import LARGEST, LAST_MOMENT, Revision, at_most, read_numbered

SAYING, VERSION = "saying", "version"
HELD, NOT_HELD, NO_VALUE, ARCHIVED = "held", "not held", "no value", "archived"
# Sayings per batch that are compared with earlier beliefs.
BATCH = 200
# Batches per page at most.
MOST_BATCHES = 5


@dataclass(frozen=True)
class Belief:
    """A belief about an element, and who reported it.

    Attributes:
        content: `held` or `not held` for a fact; for a fluent its value, or `no value`; `archived`
            if an archive has the belief, if any.
        revision: the revision that recorded it, with its actor and reason; None if there is none,
            or if it is in an archive.
    """

    content: str
    revision: Revision | None


@dataclass(frozen=True)
class Correction:
    """A saying about a period that differs from the earlier belief.

    Attributes:
        kind: `fact` or `value`.
        text: the fact, or the fluent.
        valid_from: the beginning of the period, in UTC.
        valid_until: its end.
        believed: the belief until then.
        said: the saying.
    """

    kind: str
    text: str
    valid_from: datetime
    valid_until: datetime
    believed: Belief
    said: Belief

    def _html_row_(self) -> html.Row:
        revisions = self.believed.revision, self.said.revision
        actors = [None if one is None else one.actor for one in revisions]
        return {
            "element": self.text,
            "from": self.valid_from,
            "until": self.valid_until,
            "believed": self.believed.content,
            "by": actors[0],
            "said": self.said.content,
            "said by": actors[1],
        }


class _Layer(NamedTuple):
    """A statement about a period: a saying, or an assertion or retraction from a commit on."""

    since: int
    begin: datetime
    end: datetime
    content: str  # empty: it did not hold, or had no value


_ATOM, _SAID = table_of(t.PropositionRow).c, table_of(t.PropositionSayingRow).c
_FLUENT, _VALUE = table_of(t.FunctionValueRow).c, table_of(t.FunctionValueSayingRow).c
_OBJECT = t.TABLES["object"].c


def _content(row: Any) -> Any:
    """Select the value of a row, or an empty text."""
    name = looked_up(_OBJECT.name, _OBJECT.id, row.object_id)
    return func.coalesce(row.value, name, constant(NO_VALUE))


def _sayings() -> Any:
    held = case((_SAID.holds, constant(HELD)), else_=constant(NOT_HELD))
    parts = [
        select(
            constant(kind).label("kind"),
            owner.label("owner"),
            row.since,
            row.valid_from,
            row.valid_until,
            content.label("content"),
        ).where(row.kb_id == KB)
        for kind, row, owner, content in (
            ("fact", _SAID, _SAID.proposition_id, held),
            ("value", _VALUE, _VALUE.function_value_id, _content(_VALUE)),
        )
    ]
    return union_all(*parts).subquery("said").c


@cache
def _newest() -> Query:
    """Select the newest sayings of a range of revisions, after a position.

    Each comes with its element's text, and the last revisions up to the ends of its period.
    """
    said = _sayings()
    behind = or_(said.since < integer("high"), said.owner > integer("behind"))
    rows = select(*said).where(said.since >= integer("low"), said.since <= integer("high"), behind)
    rows = first_rows(rows.order_by(said.since.desc(), said.owner), integer("size"))
    said = rows.subquery("few")
    few = said.c
    texts = (looked_up(row.text, row.id, few.owner) for row in (_ATOM, _FLUENT))
    ends = (last_until(end, said) for end in (few.valid_from, few.valid_until))
    columns = func.coalesce(*texts), *ends
    return Query(select(*few, *columns).order_by(few.since.desc(), few.owner))


def _earlier(loops: NestedLoops, source: LaneSource) -> str:
    """Select earlier sayings and versions about the periods of some sayings.

    A saying is given by its element, the revisions of its period, and its own revision.
    """
    wanted = f"SELECT w.place, {{}} FROM {loops.rows('said', 4)} AS w{{}}"
    own, earlier = (
        Walk(alias, f"{source.identity}_saying", source.owner, "w.c0") for alias in ("o", "s")
    )
    before = loops.last(source.walk("l", "w.c0"), "w.c1", "l.since")
    versions = loops.range(source.walk("v", "w.c0"), f"coalesce({before}, 0)", "w.c2")
    sayings = loops.range(own, "w.c3", "w.c3") + loops.range(earlier, "0", "w.c3 - 1")
    begin, end = (
        f"(SELECT r.committed_at FROM revision AS r WHERE r.kb_id = :kb AND r.number = v.{number}"
        " ORDER BY r.number LIMIT 1)"
        for number in ("since", "until")
    )
    said, held = f"CASE WHEN s.holds THEN '{HELD}' ELSE '{NOT_HELD}' END", f"'{HELD}'"
    if source.has_values:
        said, held = (f"coalesce({value_of(alias)}, '{NO_VALUE}')" for alias in "sv")
    of_saying = f"'{SAYING}', s.since, s.valid_from, s.valid_until, {said}, CAST(NULL AS bigint)"
    of_version = f"'{VERSION}', v.since, {begin}, {end}, {held}, v.until"
    overlap = " WHERE s.valid_from < o.valid_until AND s.valid_until > o.valid_from"
    return (
        f"{wanted.format(of_saying, sayings)}{overlap}"
        f" UNION ALL {wanted.format(of_version, versions)}"
    )


@cache
def _before(loops: NestedLoops) -> Query:
    # No id belongs to both a fact and a value.
    parts = (_earlier(loops, LANE_SOURCES[kind]) for kind in (FACT, VALUE))
    return Query(text(" UNION ALL ".join(parts)))


def corrections(
    state: State,
    *,
    since: When | None = None,
    until: When | None = None,
    limit: int | None = None,
) -> list[Correction]:
    """List the sayings that differ from the earlier belief about their time.

    Args:
        since: only sayings from this revision or time on.
        until: only sayings up to this revision or time.
        limit: the maximum number of corrections; None for all.

    Returns:
        The corrections, the latest saying first.

    Raises:
        UnknownRevisionError: a bound lies in the future, or is a time without zone.

    Examples:
        >>> kb.corrections()
        []
    """
    page = read_corrections_page(state, since, until, None, at_most(limit), LARGEST)
    return html.Listing(page.corrections, "correction")


class CorrectionsPage(NamedTuple):
    """A page of corrections, the latest saying first, and the position of the next page."""

    corrections: list[Correction]
    next: str | None


def read_corrections_page(
    state: State,
    since: When | None,
    until: When | None,
    after: str | None,
    limit: int,
    most: int = MOST_BATCHES,
) -> CorrectionsPage:
    """Read a page: up to `limit` corrections from a few batches of sayings, perhaps none."""
    # A position is the beginning of a batch, and how many of its corrections to skip.
    low, high, *_ = find_bounds(state, since, until)
    begin = read_place(after, (int, int), ())

    def work(session: Session, kb_id: int) -> CorrectionsPage:
        found: list[Correction] = []
        archived = _archived_layers(session, kb_id)
        place: Place | None = begin if begin.key else Place(key=(high, 0))
        for _ in range(most):
            if place is None or len(found) == limit:
                break
            top, behind = (int(one or 0) for one in place.key)
            made, following = _batch(session, kb_id, archived, low, top, behind)
            fitting = made[place.skip :][: limit - len(found)]
            found += fitting
            place = place._replace(skip=place.skip + len(fitting))
            if place.skip >= len(made):
                place = None if following is None else Place(key=following)
        return CorrectionsPage(found, place_text(place))

    return state.store.query_known(work, CorrectionsPage([], None))


def _archived_layers(session: Session, kb_id: int) -> list[_Layer]:
    """Return the weakest layers: the time of revisions whose versions are in an archive."""
    upto = read_position(session, kb_id).archived
    of = read_numbered(session, kb_id, {1, upto} if upto else ())
    times = sorted(each.committed_at for each in of.values())
    return [_Layer(0, times[0], times[-1], ARCHIVED)] if times else []


def _batch(
    session: Session, kb_id: int, archived: Sequence[_Layer], low: int, high: int, behind: int
) -> tuple[list[Correction], tuple[int, int] | None]:
    """Compare some sayings with earlier beliefs; return the position of the next batch."""
    rows = session.rows(_newest(), kb=kb_id, low=low, high=high, behind=behind, size=BATCH)
    if not rows:
        return [], None
    spans = [
        (owner, first or 0, min(last or 0, number - 1), number)
        for _, owner, number, *_, first, last in rows
    ]
    compared = []
    for row, layers in zip(rows, _read_layers(session, kb_id, spans), strict=True):
        said = _layer(session, *row[2:6])
        for part in _differing(row[0], said, [*archived, *layers]):
            compared.append((row[0], row[6], said, *part))
    numbers = {said.since for _, _, said, *_ in compared}
    numbers |= {part[-1] for part in compared if part[-1] is not None}
    revisions = read_numbered(session, kb_id, numbers)
    made = [
        Correction(
            *(kind, shown, begin, end),
            Belief(content, None if number is None else revisions.get(number)),
            Belief(said.content, revisions.get(said.since)),
        )
        for kind, shown, said, begin, end, content, number in compared
    ]
    return made, None if len(rows) < BATCH else (rows[-1][2], rows[-1][1])


def _read_layers(
    session: Session, kb_id: int, spans: Sequence[tuple[int, int, int, int]]
) -> list[list[_Layer]]:
    """Read the earlier layers under each of some sayings; later ones override."""
    found: list[list[tuple[tuple[bool, int, bool], _Layer]]] = [[] for _ in spans]
    query = _before(session.loops)
    for place, kind, *said, until in session.rows(query, kb=kb_id, said=json.dumps(spans)):
        layer, is_saying = _layer(session, *said), kind == SAYING
        if until is not None:
            retracted = _Layer(until, layer.end, LAST_MOMENT, "")
            found[place].append(((False, until, False), retracted))
        # A saying overrides a plain write, whichever came first.
        found[place].append(((is_saying, layer.since, True), layer))
    return [[layer for _, layer in sorted(each, key=itemgetter(0))] for each in found]


def _layer(session: Session, since: int, begin: Any, end: Any, content: Any) -> _Layer:
    ended = LAST_MOMENT if end is None else session.to_time(end)
    return _Layer(since, session.to_time(begin), ended, str(content))


def _differing(
    kind: str, said: _Layer, layers: Iterable[_Layer]
) -> Iterator[tuple[datetime, datetime, str, int | None]]:
    """Yield the parts of a saying's period for which the earlier belief differs."""
    nothing = NO_VALUE if kind == VALUE else NOT_HELD
    parts: list[tuple[datetime, str, int | None]] = []
    for begin, last in last_said(said.begin, said.end, layers):
        believed = (nothing, None) if last is None else (last.content or nothing, last.since)
        if not parts or parts[-1][1:] != believed:
            parts.append((begin, *believed))
    ends = [*(begin for begin, *_ in parts[1:]), said.end]
    for (begin, content, number), end in zip(parts, ends, strict=True):
        is_number = kind == VALUE and is_same_number(said.content, content)
        if content != said.content and not is_number:
            yield begin, end, content, number

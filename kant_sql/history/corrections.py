"""What was later said differently of a time: what was believed of it, and what was true."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from decimal import Decimal
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import case, func, literal_column, or_, select, text, union_all

from .. import html
from ..moment_text import When
from ..sql import tables as t
from ..sql.changes import last_until
from ..sql.dialects.base import Session
from ..sql.dialects.words import NESTED_LOOPS, NestedLoops, Walk
from ..sql.lanes import LANE_SOURCES, LaneSource
from ..sql.places import Place, place_text, read_place
from ..sql.query import Query, first_rows, integer
from ..sql.rows import FACT, KB, VALUE, looked_up, table_of
from ..store.state import State
from .moments import find_bounds
from .revisions import Revision, at_most, read_numbered

SAYING, VERSION = "saying", "version"
HELD, NOT_HELD, NO_VALUE = "held", "not held", "no value"
# So many sayings are compared at once with what was believed before.
BATCH = 200
# A page goes through so many batches at most.
MOST_BATCHES = 5


@dataclass(frozen=True)
class Belief:
    """What was believed of an element, and who said so.

    Attributes:
        content: `held` or `not held` of a fact; of a fluent its value, or `no value`.
        revision: the revision that said so, with its actor and reason; None: nobody had.
    """

    content: str
    revision: Revision | None

    def _html_row_(self) -> html.Row:
        by = None if self.revision is None else self.revision.actor
        return {"content": self.content, "by": by}


@dataclass(frozen=True)
class Correction:
    """A saying about a period that differs from the earlier belief.

    Attributes:
        kind: `fact` or `value`.
        text: the fact, or the fluent.
        valid_from: where the period begins, in UTC.
        valid_until: where it is over.
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
        return {
            "element": self.text,
            "from": self.valid_from,
            "until": self.valid_until,
            "believed": self.believed.content,
            "by": self.believed._html_row_()["by"],
            "said": self.said.content,
            "said by": self.said._html_row_()["by"],
        }


class _Layer(NamedTuple):
    """What was said of a period: by a saying, or by a version from its revision to another."""

    kind: str
    since: int
    begin: datetime
    end: datetime | None
    content: str
    until: int | None = None

    def covers(self, moment: datetime) -> bool:
        return self.begin <= moment and (self.end is None or moment < self.end)


_ATOM, _SAID = table_of(t.PropositionRow).c, table_of(t.PropositionSayingRow).c
_FLUENT, _VALUE = table_of(t.FunctionValueRow).c, table_of(t.FunctionValueSayingRow).c
_OBJECT = t.TABLES["object"].c


def _content(row: Any) -> Any:
    """Select the value of a row; nothing of one without."""
    name = looked_up(_OBJECT.name, _OBJECT.id, row.object_id)
    return func.coalesce(row.value, name, literal_column(f"'{NO_VALUE}'"))


def _sayings() -> Any:
    held = case((_SAID.holds, literal_column(f"'{HELD}'")), else_=literal_column(f"'{NOT_HELD}'"))
    parts = [
        select(
            literal_column(f"'{kind}'").label("kind"),
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
    """Select the newest sayings of a range of revisions, behind a place.

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


_SHOWN = (
    "coalesce({0}.value, (SELECT n.name FROM object AS n WHERE n.kb_id = :kb"
    f" AND n.id = {{0}}.object_id), '{NO_VALUE}')"
)


def _earlier(loops: NestedLoops, source: LaneSource) -> str:
    """Select what was said before some sayings of their periods, by sayings and by versions.

    A saying is given by its element, the revisions of its period, and its own revision.
    """
    wanted = f"SELECT w.place, {{}} FROM {loops.rows('said', 4)} AS w{{}}"
    own, earlier = (
        Walk(alias, f"{source.identity}_saying", source.owner, "w.id0") for alias in ("o", "s")
    )
    before = loops.last(source.walk("l", "w.id0"), "w.id1", "l.since")
    versions = loops.range(source.walk("v", "w.id0"), f"coalesce({before}, 0)", "w.id2")
    sayings = loops.range(own, "w.id3", "w.id3") + loops.range(earlier, "0", "w.id3 - 1")
    begin, end = (
        f"(SELECT r.committed_at FROM revision AS r WHERE r.kb_id = :kb AND r.number = v.{number}"
        " ORDER BY r.number LIMIT 1)"
        for number in ("since", "until")
    )
    said, held = f"CASE WHEN s.holds THEN '{HELD}' ELSE '{NOT_HELD}' END", f"'{HELD}'"
    if source.has_values:
        said, held = map(_SHOWN.format, "sv")
    of_saying = f"'{SAYING}', s.since, s.valid_from, s.valid_until, {said}, CAST(NULL AS bigint)"
    of_version = f"'{VERSION}', v.since, {begin}, {end}, {held}, v.until"
    overlap = " WHERE s.valid_from < o.valid_until AND s.valid_until > o.valid_from"
    return (
        f"{wanted.format(of_saying, sayings)}{overlap}"
        f" UNION ALL {wanted.format(of_version, versions)}"
    )


@cache
def _before(dialect: str) -> Query:
    # No id is that of a fact and of a value.
    parts = (_earlier(NESTED_LOOPS[dialect], LANE_SOURCES[kind]) for kind in (FACT, VALUE))
    return Query(text(" UNION ALL ".join(parts)))


def corrections(
    state: State,
    *,
    since: When | None = None,
    until: When | None = None,
    limit: int | None = None,
) -> list[Correction]:
    """List the sayings that differ from what was believed of their time.

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
    low, high, *_ = find_bounds(state.store, since, until, state.at)
    size = at_most(limit)

    def work(session: Session, kb_id: int | None) -> list[Correction]:
        found: list[Correction] = []
        place: tuple[int, int] | None = (high, 0)
        while kb_id is not None and place is not None and len(found) < size:
            made, place = _batch(session, kb_id, low, *place)
            found += made
        return found[:size]

    return html.Listing(state.store.query_in_snapshot(work), "correction")


class CorrectionsPage(NamedTuple):
    """A page of corrections, what was said last first, and the place of the next one."""

    corrections: list[Correction]
    next: str | None


def read_corrections_page(
    state: State, since: When | None, until: When | None, after: str | None, limit: int
) -> CorrectionsPage:
    """Read a page: up to `limit` corrections among so many sayings, perhaps none."""
    # A place is where a batch begins, and how many corrections of it come before.
    low, high, *_ = find_bounds(state.store, since, until, state.at)
    begin = read_place(after, (int, int), ())

    def work(session: Session, kb_id: int | None) -> CorrectionsPage:
        found: list[Correction] = []
        place: Place | None = begin if begin.key else Place(key=(high, 0))
        for _ in range(MOST_BATCHES if kb_id is not None else 0):
            assert place is not None
            top, behind = (int(one or 0) for one in place.key)
            made, following = _batch(session, kb_id or 0, low, top, behind)
            fitting = made[place.skip :][: limit - len(found)]
            found += fitting
            skip = place.skip + len(fitting)
            if skip < len(made):
                return CorrectionsPage(found, place_text(place._replace(skip=skip)))
            place = None if following is None else Place(key=following)
            if place is None or len(found) == limit:
                break
        return CorrectionsPage(found, None if kb_id is None else place_text(place))

    return state.store.query_in_snapshot(work)


def _batch(
    session: Session, kb_id: int, low: int, high: int, behind: int
) -> tuple[list[Correction], tuple[int, int] | None]:
    """Compare some sayings with what was believed; return where the next ones begin."""
    rows = session.rows(_newest(), kb=kb_id, low=low, high=high, behind=behind, size=BATCH)
    if not rows:
        return [], None
    said = [_layer(session, row[0], *row[2:6]) for row in rows]
    spans = [
        (row[1], row[7] or 0, min(row[8] or 0, one.since - 1), one.since)
        for one, row in zip(said, rows, strict=True)
    ]
    known: list[list[_Layer]] = [[] for _ in rows]
    before = _before(session.backend.dialect.name)
    for place, *layer in session.rows(before, kb=kb_id, said=json.dumps(spans)):
        known[place].append(_layer(session, *layer))
    compared = [
        (one, row[6], *part)
        for one, row, layers in zip(said, rows, known, strict=True)
        for part in _differing(one, layers)
    ]
    numbers = {one.since for one, *_ in compared} | {part[-1] for part in compared if part[-1]}
    revisions = read_numbered(session, kb_id, numbers)
    made = [
        Correction(
            *(one.kind, shown, begin, end),
            Belief(content, revisions.get(number) if number else None),
            Belief(one.content, revisions.get(one.since)),
        )
        for one, shown, begin, end, content, number in compared
    ]
    return made, None if len(rows) < BATCH else (rows[-1][2], rows[-1][1])


def _layer(session: Session, kind: str, since: int, begin: Any, end: Any, *said: Any) -> _Layer:
    ended = None if end is None else session.to_time(end)
    return _Layer(kind, since, session.to_time(begin), ended, *said)


def _differing(
    said: _Layer, layers: list[_Layer]
) -> Iterator[tuple[datetime, datetime, str, int | None]]:
    """Give the parts of a saying's period of which something else was believed before."""
    assert said.end is not None
    ends = {end for one in layers for end in (one.begin, one.end) if end is not None}
    cuts = sorted({said.begin, *(end for end in ends if said.begin < end < said.end)})
    parts: list[tuple[datetime, datetime, str, int | None]] = []
    for cut, end in zip(cuts, [*cuts[1:], said.end], strict=True):
        content, number = _believed(said, layers, cut)
        is_next = bool(parts) and parts[-1][2:] == (content, number)
        parts.append((parts.pop()[0] if is_next else cut, end, content, number))
    return (part for part in parts if not _is_same(said, part[2]))


def _believed(said: _Layer, layers: list[_Layer], moment: datetime) -> tuple[str, int | None]:
    """Return what was believed of a moment before a saying, and which revision said so."""
    sayings = [one for one in layers if one.kind == SAYING and one.covers(moment)]
    versions = [one for one in layers if one.kind == VERSION and one.begin <= moment]
    last = max(sayings, key=lambda one: one.since, default=None)
    if last is None:
        last = max(versions, key=lambda one: one.since, default=None)
    if last is not None and last.covers(moment):
        return last.content, last.since
    return NO_VALUE if said.kind == "value" else NOT_HELD, None if last is None else last.until


def _is_same(said: _Layer, believed: str) -> bool:
    """Return whether a belief is what was said: 10 and 10.0 are the same number."""
    if said.content == believed or said.kind == "fact":
        return said.content == believed
    try:
        return Decimal(said.content) == Decimal(believed)
    except ArithmeticError:
        return False

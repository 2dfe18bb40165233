"""Lanes of a timeline: what has a version in a window, its versions there, and how many in a slice.

However many versions there are, each statement walks a bounded part of an index: versions of one
fact do not overlap, so what held at a revision is the last one that began up to there, and what
began in a range of revisions is one range of the primary key (kb_id, owner, since).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import literal_column, select, text, union_all

from ..knowledge.canonical import time_text
from .changes import last_until
from .dialects.base import Row, Session
from .dialects.containing import pattern_of
from .dialects.words import NestedLoops, Walk, id_rows
from .intervals import ANY_FUNCTION, ANY_PREDICATE, held_then, then
from .query import Query, constant, first_rows, integer
from .rows import FACT, GOAL, KB, VALUE
from .tables import FunctionValueVersionRow, PropositionVersionRow
from .valid_periods import ValidRange

# Lanes with an object, or of a window of few revisions, are listed up to here. Where there are
# more, they are met soon enough among all.
MOST_LISTED = 2_000
FEW_REVISIONS = 5_000
_ENDLESS = str(2**63 - 1)

Ids = list[int] | None


class LaneSource(NamedTuple):
    """Where the lanes of one kind are stored; `only` is a further condition on the identity `p`."""

    identity: str
    owner: str
    group: str
    named: str
    only: str = ""

    @property
    def version(self) -> str:
        """The table of versions."""
        return f"{self.identity}_version"

    def walk(self, alias: str, identity: str) -> Walk:
        """The versions of one lane."""
        return Walk(alias, self.version, self.owner, identity)

    @property
    def has_values(self) -> bool:
        """Whether versions have values."""
        return self.identity == "function_value"

    @property
    def relation(self) -> str:
        """What has an id, a group, arguments and a text: the table, or a query."""
        if self.identity != "formula":
            return self.identity
        # There are as many formulas as somebody wrote, which are few.
        return (
            "(SELECT v.kb_id, v.formula_id AS id, v.formula_id, '' AS arguments,"
            " min(v.text) AS text FROM formula_version AS v WHERE v.kb_id = :kb"
            " AND v.section = 'goal' GROUP BY v.kb_id, v.formula_id)"
        )

    def is_of(self) -> str:
        """Write the condition that a predicate or a function of a name is meant."""
        if self.identity != "formula":
            return f"p.{self.group} = {_named(self.named, 'predicate')}"
        one = (f"n.{kind}_id = {_named(kind, 'predicate')}" for kind in ("predicate", "function"))
        return (
            "EXISTS (SELECT 1 FROM formula_node AS n WHERE n.kb_id = :kb AND n.formula_id = p.id"
            f" AND ({' OR '.join(one)}))"
        )

    def has_object(self) -> str:
        """Write the condition that an object of a name is among the arguments."""
        return f"EXISTS (SELECT 1 FROM {self.arguments()} AND a.{self.owner} = p.id)"

    def arguments(self) -> str:
        """Write the rows of an object of a name as an argument."""
        table = "formula_term" if self.identity == "formula" else f"{self.identity}_argument"
        return f"{table} AS a WHERE a.kb_id = :kb AND a.object_id = {_named('object', 'object')}"


def _named(table: str, parameter: str) -> str:
    conditions = f"named.kb_id = :kb AND named.key = :{parameter}"
    return f"(SELECT named.id FROM {table} AS named WHERE {conditions})"


# Goals of another form than an atom.
FORMULA = "formula"
_PROPOSITION = "proposition", "proposition_id", "predicate_id", "predicate"
LANE_SOURCES = {
    FACT: LaneSource(*_PROPOSITION, only=" AND p.is_goal = FALSE"),
    GOAL: LaneSource(*_PROPOSITION, only=" AND p.is_goal = TRUE"),
    FORMULA: LaneSource(FORMULA, "formula_id", "formula_id", "predicate"),
    VALUE: LaneSource("function_value", "function_value_id", "function_id", "function"),
}


class LaneFilter(NamedTuple):
    """The keys of a predicate or function and of an argument, and a part of the text; or None."""

    predicate: str | None = None
    object: str | None = None
    text: str | None = None


class LanePlace(NamedTuple):
    """The place of a lane among those of its kind."""

    group: int = 0
    arguments: str = ""


class FoundLane(NamedTuple):
    """A lane that has a version in a window; `began` is how many began there, up to a limit.

    On the clock of valid times, `said` is how much was said of times up to the end of the window.
    """

    id: int
    place: LanePlace
    text: str
    began: int
    said: int = 0


def _began(loops: NestedLoops, source: LaneSource, owner: str, after: str, upto: str) -> str:
    """Write how many versions began after a revision, up to another one and up to a limit."""
    part = loops.part(source.walk("v", owner), after, upto, ":enough", "v.since")
    return f"(SELECT count(*) FROM ({part}) AS few)"


def _is_said(source: LaneSource, alias: str) -> str:
    """Write whether something was said of a time of the window."""
    return (
        f"EXISTS (SELECT 1 FROM {source.identity}_saying AS s WHERE s.kb_id = :kb"
        f" AND s.{source.owner} = {alias}.id AND s.since <= :known"
        " AND s.valid_from <= :until AND s.valid_until >= :begin)"
    )


def _has_sayings(kind: str) -> bool:
    return kind in (FACT, VALUE)


def _until(loops: NestedLoops, source: LaneSource, identity: str, is_changed: bool) -> str:
    """Write until when the last version of a window holds; 0 if it holds through the window."""
    until = f"coalesce(l.until, {_ENDLESS})"
    if is_changed:
        earlier = loops.part(source.walk("e", identity), "0", "l.since - 1", "1", "1")
        is_first = f"l.since <= :settled AND NOT EXISTS ({earlier})"
        is_same = f"{until} > :high AND (l.since <= :low OR {is_first})"
        until = f"CASE WHEN {is_same} THEN 0 ELSE {until} END"
    return loops.last(source.walk("l", identity), ":high", until)


def _places_text(loops: NestedLoops, source: LaneSource, wanted: LaneFilter) -> str:
    """Write the conditions of which lanes are wanted."""
    conditions = f"p.kb_id = :kb{source.only}"
    if wanted.predicate is not None:
        conditions += f" AND {source.is_of()}"
    if wanted.text is not None:
        conditions += f" AND p.text {loops.contains} :text"
    if wanted.object is not None:
        conditions += f" AND {source.has_object()}"
    return conditions


@cache
def _lanes(
    loops: NestedLoops, kind: str, has: LaneFilter, by_ids: bool, is_changed: bool, is_valid: bool
) -> Query:
    source = LANE_SOURCES[kind]
    place = f"p.{source.group}, p.arguments"
    last = _until(loops, source, "p.id", is_changed)
    conditions = f"{_places_text(loops, source, has)} AND ({place}) > (:group, :arguments)"
    tables = f"{source.relation} AS p"
    if by_ids:
        tables = f"{loops.rows('ids', 1)} AS listed"
        tables += loops.loop("p", source.identity, "p.kb_id = :kb AND p.id = listed.c0")
    is_there, said = f"{last} > :low", "0"
    if is_valid:
        is_there = f"({is_there} OR {_is_said(source, 'p')})"
        said = (
            f"(SELECT count(*) FROM (SELECT 1 FROM {source.identity}_saying AS s"
            f" WHERE s.kb_id = :kb AND s.{source.owner} = found.id AND s.since <= :known"
            " AND s.valid_from <= :until LIMIT :enough) AS few)"
        )
    found = (
        f"SELECT p.id, {place}, p.text FROM {tables}"
        f" WHERE {conditions} AND {is_there} ORDER BY {place} LIMIT :most"
    )
    began = _began(loops, source, "found.id", ":low", ":high")
    return Query(text(f"SELECT found.*, {began}, {said} FROM ({found}) AS found"))


# The conditions of `_few`: something was said of a time of the window, or an object is named.
_SAID_IN = "one.since <= :known AND one.valid_from <= :until AND one.valid_until >= :begin"
_WITH_OBJECT = f"one.object_id = {_named('object', 'object')}"


@cache
def _few(kind: str, of: str, conditions: str) -> Query:
    """Build the query of what has rows in one of its tables, among so many of them."""
    source = LANE_SOURCES[kind]
    return Query(
        text(
            f"SELECT DISTINCT {source.owner} FROM (SELECT one.{source.owner}"
            f" FROM {source.identity}_{of} AS one WHERE one.kb_id = :kb AND {conditions}"
            f" LIMIT {MOST_LISTED + 1}) AS few"
        )
    )


_FIRST_SAID = Query(
    text(
        "SELECT min(first) FROM (SELECT min(valid_from) AS first FROM proposition_saying"
        " WHERE kb_id = :kb AND since <= :known UNION ALL SELECT min(valid_from)"
        " FROM function_value_saying WHERE kb_id = :kb AND since <= :known) AS each"
    )
)


def first_said(session: Session, kb_id: int, known: int) -> datetime | None:
    """Read the first time of which something was said; None if nothing was."""
    row = session.first(_FIRST_SAID, kb=kb_id, known=known)
    return None if row is None or row[0] is None else session.to_time(row[0])


@cache
def _unchanged(
    loops: NestedLoops, kinds: tuple[str, ...], has: LaneFilter, is_valid: bool
) -> Query:
    """Build the query of how many lanes never changed, among so many of each kind."""
    counts = []
    for kind in kinds:
        source = LANE_SOURCES[kind]
        tables, place = f"{source.relation} AS p", f"p.{source.group}, p.arguments"
        if has.object is not None:
            tables = f"(SELECT DISTINCT a.{source.owner} AS id FROM {source.arguments()}) AS owner"
            tables += loops.loop("p", source.relation, "p.kb_id = :kb AND p.id = owner.id")
        wanted = _places_text(loops, source, has._replace(object=None))
        few = f"SELECT p.id FROM {tables} WHERE {wanted} ORDER BY {place} LIMIT :most"
        same = f"{_until(loops, source, 'few.id', True)} = 0"
        if is_valid and _has_sayings(kind):
            same += f" AND NOT {_is_said(source, 'few')}"
        counts.append(
            f"SELECT count(*) AS looked, sum(CASE WHEN {same} THEN 1 ELSE 0 END) AS same"
            f" FROM ({few}) AS few"
        )
    return Query(text(f"SELECT sum(same), max(looked) FROM ({' UNION ALL '.join(counts)}) AS each"))


@cache
def _in_window(kind: str, is_changed: bool) -> Query:
    """Build the query of what held when a window began, or ended in it, and of what began in it."""
    version: Any = FunctionValueVersionRow if kind == VALUE else PropositionVersionRow
    owner = version.function_value_id if kind == VALUE else version.proposition_id
    own = [version.kb_id == KB]
    if kind != VALUE:
        own.append(version.is_goal == constant(kind == GOAL))
    held = [*own, ANY_FUNCTION if kind == VALUE else ANY_PREDICATE, held_then(version)]
    ended = [*own, version.until > integer("at"), version.until <= integer("high")]
    began = [*own, version.since > integer("begin"), version.since <= integer("high")]
    parts = (
        first_rows(
            select(constant(n).label("part"), owner).where(*conditions), MOST_LISTED + 1
        ).subquery()
        for n, conditions in enumerate((ended if is_changed else held, began))
    )
    return Query(union_all(*(select(part) for part in parts)))


class LaneSpan(NamedTuple):
    """A part of a lane: the version that held at a revision, and those that began up to another."""

    id: int
    at: int
    upto: int


class FoundVersion(NamedTuple):
    """A version of a lane, with its value as text and as a number, for a span by its place."""

    span: int
    since: int
    until: int | None
    value: str | None = None
    number: float | None = None


def value_of(alias: str) -> str:
    """Write the text of a value: a number, or the name of an object."""
    named = f"named.kb_id = :kb AND named.id = {alias}.object_id"
    return f"coalesce({alias}.value, (SELECT named.name FROM object AS named WHERE {named}))"


@cache
def _spans(loops: NestedLoops, kind: str) -> Query:
    source = LANE_SOURCES[kind]
    before = loops.last(source.walk("l", "wanted.c0"), "wanted.c1", "l.since")
    walked = loops.walk(source.walk("v", "wanted.c0"), f"coalesce({before}, 0)", "wanted.c2")
    values = f", {value_of('v')}, v.number"
    columns = f"wanted.place, v.since, v.until{values if source.has_values else ''}"
    tables = f"{loops.rows('spans', 3)} AS wanted{walked}"
    held = "v.until IS NULL OR v.until > wanted.c1"
    return Query(text(f"SELECT {columns} FROM {tables} WHERE {held}"))


class Cell(NamedTuple):
    """What began of a lane in a slice, as far as it was counted; the last number is at its end."""

    lane: int
    slice: int
    began: int
    least: float | None = None
    largest: float | None = None
    last: float | None = None


def _number_of(source: LaneSource, loops: NestedLoops) -> str:
    """Write the least, the largest and the last number of a cell."""
    own = source.walk("v", "wanted.c0")
    part = loops.part(own, "slice.c0", "slice.c1", ":enough", "v.number")
    few = f"(SELECT {{}}(few.number) FROM ({part}) AS few)"
    last = loops.last(source.walk("l", "wanted.c0"), "slice.c1", "l.number")
    return f", {few.format('min')}, {few.format('max')}, {last}"


@cache
def _cells(loops: NestedLoops, kind: str) -> Query:
    source = LANE_SOURCES[kind]
    began = _began(loops, source, "wanted.c0", "slice.c0", "slice.c1")
    numbers = _number_of(source, loops) if source.has_values else ""
    return Query(
        text(
            f"WITH wanted AS MATERIALIZED (SELECT * FROM {loops.rows('lanes', 1)} AS listed),"
            f" slice AS MATERIALIZED (SELECT * FROM {loops.rows('slices', 2)} AS listed)"
            f" SELECT wanted.place, slice.place, {began}{numbers}"
            " FROM wanted CROSS JOIN slice"
        )
    )


def _has(wanted: LaneFilter) -> LaneFilter:
    return LaneFilter(*("" if value is not None else None for value in wanted))


@dataclass(eq=False)
class LaneReader:
    """Reads the lanes of a window that a filter leaves, a statement or a few at a time."""

    _session: Session
    _kb_id: int
    _wanted: LaneFilter
    _bounds: tuple[int, int]  # the state that the window begins with, and its last revision
    _valid: ValidRange | None = None  # the window on the clock of valid times, if that is asked for

    def __post_init__(self) -> None:
        self._loops = self._session.loops
        low, high = self._bounds
        self._window = {"kb": self._kb_id, "low": low, "high": high}

    def count_unchanged(self, kinds: Iterable[str], settled: int, most: int) -> tuple[int, bool]:
        """Count the lanes that `settled` of `find` leaves out, in one statement.

        At most `most` lanes of each kind are looked at; the flag says whether there were more.
        """
        query = _unchanged(self._loops, (*kinds,), _has(self._wanted), self._valid is not None)
        given = {**self._given(), **self._times(), "settled": settled, "most": most + 1}
        row = self._session.first(query, **self._window, **given)
        return (0, False) if row is None else (int(row[0] or 0), (row[1] or 0) > most)

    def find(
        self, kind: str, after: LanePlace, most: int, enough: int, settled: int | None
    ) -> list[FoundLane]:
        """Find the lanes of a kind that have a version in the window, in three statements at most.

        Args:
            enough: how many versions of a lane are counted.
            settled: leave out what held through the window, or was there by this revision for the
                first time and held to the end; None for nothing.
        """
        wanted, given = self._wanted, self._given()
        if settled is not None:
            given["settled"] = settled
        times = self._times() if _has_sayings(kind) else {}
        ids = self._in_window(kind, settled, times)
        if ids is None and wanted.object is not None:
            ids = self._with_object(kind)
            if ids is not None:
                wanted = wanted._replace(object=None)
                del given["object"]
        if ids is not None:
            if not ids:
                return []
            given["ids"] = id_rows(ids)
        shape = ids is not None, settled is not None, bool(times)
        given |= {**times, **after._asdict(), "most": most, "enough": enough}
        query = _lanes(self._loops, kind, _has(wanted), *shape)
        rows = self._session.rows(query, **self._window, **given)
        return [
            FoundLane(id_, LanePlace(group, arguments), *rest)
            for id_, group, arguments, *rest in rows
        ]

    def _in_window(self, kind: str, settled: int | None, times: Mapping[str, Any]) -> Ids:
        """List what has a version in a window of few revisions; None if it is too much."""
        low, high = self._bounds
        if kind == FORMULA or high - low > FEW_REVISIONS:
            return None
        session, kb_id, is_changed = self._session, self._kb_id, settled is not None
        given = {"at": low} if is_changed else then(session, low)
        # Of what there was nothing before, all that changed has ended or has begun later than that.
        begin = settled if is_changed and not low else low
        query = _in_window(kind, is_changed)
        rows = session.rows(query, kb=kb_id, high=high, begin=begin, **given)
        if times:
            said = session.rows(_few(kind, "saying", _SAID_IN), kb=kb_id, **times)
            rows = [*rows, *((2, id_) for (id_,) in said)]
        is_much = any(sum(row[0] == n for row in rows) > MOST_LISTED for n in (0, 1, 2))
        return None if is_much else sorted({id_ for _, id_ in rows})

    def _with_object(self, kind: str) -> Ids:
        """List what has the object among its arguments; None if it is too much."""
        if kind == FORMULA:
            return None
        query, own = _few(kind, "argument", _WITH_OBJECT), {"object": self._wanted.object}
        rows = self._session.rows(query, kb=self._kb_id, **own)
        return None if len(rows) > MOST_LISTED else [id_ for (id_,) in rows]

    def _given(self) -> dict[str, Any]:
        wanted = self._wanted
        given = {name: value for name, value in wanted._asdict().items() if value is not None}
        if wanted.text is not None:
            given["text"] = pattern_of(self._session, wanted.text)
        return given

    def _times(self) -> dict[str, Any]:
        span = self._valid
        if span is None:
            return {}
        begin, until = map(self._session.from_time, (span.since, span.until))
        return {"begin": begin, "until": until, "known": span.known}

    def spans(self, kind: str, spans: Sequence[LaneSpan]) -> list[FoundVersion]:
        """Read the versions of some spans, in one statement; in order within each span."""
        query, listed = _spans(self._loops, kind), json.dumps(spans)
        rows: list[Row] = self._session.rows(query, kb=self._kb_id, spans=listed)
        return sorted((FoundVersion(*row) for row in rows), key=lambda found: found[:2])

    def cells(
        self, kind: str, lanes: Sequence[int], slices: Sequence[tuple[int, int]], enough: int
    ) -> list[Cell]:
        """Count what began of some lanes in each of some slices, in one statement.

        A slice is the revision before it, and its last one.
        """
        given = {"lanes": id_rows(lanes), "slices": json.dumps(slices), "enough": enough}
        query = _cells(self._loops, kind)
        return [Cell(*row) for row in self._session.rows(query, kb=self._kb_id, **given)]


@cache
def _numbers_at(loops: NestedLoops) -> Query:
    found = last_until(literal_column("wanted.moment"))
    wanted = text(f"{loops.times('moments')} AS wanted")
    return Query(select(literal_column("wanted.place"), found).select_from(wanted))


def revisions_at(session: Session, kb_id: int, moments: Sequence[datetime]) -> list[int]:
    """Read the last revision up to each of some times, in one statement; 0 before the first."""
    texts = json.dumps([time_text(moment) for moment in moments])
    rows = session.rows(_numbers_at(session.loops), kb=kb_id, moments=texts)
    return [number or 0 for _, number in sorted(rows)]

"""When facts held, and what a range of revisions changed of them and of what they mean.

The versions of one proposition do not overlap, so those that meet an interval are the last one that
began up to its beginning, and those that began within it: each loop of a join walks one range of
the primary key (kb_id, proposition_id, since).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Select,
    and_,
    bindparam,
    desc,
    literal_column,
    or_,
    select,
    text,
    union,
    union_all,
)

from ..errors import reading_rows
from ..knowledge.definitions import DECLARED, DERIVED_PREDICATE, Definitions
from .dialects.base import Row, Session
from .dialects.words import NestedLoops, Walk, id_rows
from .intervals import forks_at
from .query import Query, found_rows, in_list, in_rows, integer
from .rows import KB, held_at
from .tables import TABLES, RevisionRow

AFTER, LOW, HIGH = integer("after"), integer("low"), integer("high")


class Pattern(NamedTuple):
    """The facts of a predicate, or the values of a function, with objects at some positions."""

    owner: int
    objects: tuple[int | None, ...]

    @property
    def is_ground(self) -> bool:
        """Whether it is one fact or fluent."""
        return None not in self.objects

    @property
    def is_restricted(self) -> bool:
        """Whether it is not all of the predicate or the function."""
        return self.is_ground or any(id_ is not None for id_ in self.objects)

    def matches(self, arguments: Sequence[int]) -> bool:
        """Return whether a fact has the objects."""
        return len(arguments) == len(self.objects) and all(
            wanted is None or wanted == own
            for wanted, own in zip(self.objects, arguments, strict=True)
        )


class FoundFact(NamedTuple):
    """A proposition, or a fluent; of a ground pattern, how often it was asserted in the range."""

    id: int
    objects: tuple[int, ...]
    versions: int


_GROUND, _SOME, _ALL = "ground", "some", "all"


def _shape(pattern: Pattern) -> str:
    if pattern.is_ground:
        return _GROUND
    return _SOME if pattern.is_restricted else _ALL


def _facts_text(loops: NestedLoops, shape: str, place: int, are_facts: bool) -> str:
    """Select what matches one pattern; positions but the first known one are compared later."""
    table, owner = ("proposition", "predicate") if are_facts else ("function_value", "function")
    count = "0"
    # As a sum, the owner is not a condition of an index: without statistics planners read all that
    # it ever had, to find those few that have the object.
    is_owner = f"i.{owner}_id{' + 0' if shape == _SOME else ''} = :owner{place}"
    where = f"i.kb_id = :kb AND {is_owner}" + (" AND i.is_goal = :is_goal" if are_facts else "")
    tables = f"{table} AS i WHERE {where}"
    if shape == _GROUND:
        tables += f" AND i.arguments = :arguments{place}"
        count = (
            f"(SELECT count(*) FROM {table}_version AS v WHERE v.kb_id = :kb"
            f" AND v.{table}_id = i.id AND v.since BETWEEN :low AND :high)"
        )
    elif shape == _SOME:
        found = (
            f"(SELECT a.{table}_id AS id FROM {table}_argument AS a WHERE a.kb_id = :kb"
            f" AND a.object_id = :object{place} AND a.position = :position{place}) AS found"
        )
        tables = found + loops.loop("i", table, f"{where} AND i.id = found.id")
    return f"SELECT {place}, i.id, i.arguments, {count} FROM {tables}"


@cache
def _facts(loops: NestedLoops, shapes: tuple[str, ...], are_facts: bool) -> Query:
    parts = [_facts_text(loops, shape, place, are_facts) for place, shape in enumerate(shapes)]
    return Query(text(" UNION ALL ".join(parts)))


def find_facts(
    session: Session,
    kb_id: int,
    patterns: Sequence[Pattern],
    low: int,
    high: int,
    are_facts: bool = True,
) -> list[list[FoundFact]]:
    """Find the propositions, or the fluents, of each of some patterns, in one statement."""
    parameters: dict[str, Any] = {"kb": kb_id, "is_goal": False, "low": low, "high": high}
    for place, (owner, objects) in enumerate(patterns):
        parameters[f"owner{place}"] = owner
        known = [id_ for id_ in objects if id_ is not None]
        if len(known) == len(objects):
            parameters[f"arguments{place}"] = " ".join(map(str, known))
        elif known:
            parameters[f"object{place}"] = known[0]
            parameters[f"position{place}"] = objects.index(known[0])
    found: list[list[FoundFact]] = [[] for _ in patterns]
    query = _facts(session.loops, tuple(map(_shape, patterns)), are_facts)
    for place, id_, arguments, versions in session.rows(query, **parameters):
        own = tuple([int(one) for one in arguments.split()])
        if patterns[place].matches(own):
            found[place].append(FoundFact(id_, own, versions))
    return found


class Overlap(NamedTuple):
    """An interval in which the facts of a combination, by its place, held together.

    Its bounds are outside of the range, by one, where they held beyond it.
    """

    place: int
    since: int
    until: int


@cache
def _overlaps(loops: NestedLoops, count: int) -> Query:
    since, until = ":before", ":after"
    tables, where = f"{loops.rows('facts', count)} AS wanted", []
    for n in range(count):
        one = Walk(f"v{n}", "proposition_version", "proposition_id", f"wanted.c{n}")
        last = loops.last(one._replace(alias=f"l{n}"), since, f"l{n}.since")
        tables += loops.range(one, f"coalesce({last}, 0)", f"{until} - 1")
        where.append(f"(v{n}.until IS NULL OR v{n}.until > {loops.larger}({since}, :low))")
        since = f"{loops.larger}({since}, v{n}.since)"
        until = f"{loops.smaller}({until}, coalesce(v{n}.until, :after))"
    found = f"wanted.place, {since}, {until} FROM {tables}"
    return Query(text(f"SELECT {found} WHERE {' AND '.join(where)}"))


def find_overlaps(
    session: Session, kb_id: int, facts: Sequence[Sequence[int]], low: int, high: int
) -> list[Overlap]:
    """Find the intervals in which combinations of as many facts held together in a range."""
    query = _overlaps(session.loops, len(facts[0]))
    bounds = {"before": low - 1, "low": low, "after": high + 1}
    rows = session.rows(query, kb=kb_id, facts=json.dumps(facts), **bounds)
    return [Overlap(*row) for row in rows]


# What was defined in a range.

_PREDICATE, _FORMULA = TABLES["predicate_version"].c, TABLES["formula_version"].c


def _within(version: Any) -> Any:
    return and_(version.since <= HIGH, or_(version.until.is_(None), version.until > LOW))


_OF_IDS = in_list(_PREDICATE.predicate_id, "ids", bounded=_PREDICATE.since)
_MEANINGS = Query(
    union_all(
        select(_PREDICATE.predicate_id, _PREDICATE.text).where(
            _PREDICATE.kb_id == KB, _OF_IDS, _within(_PREDICATE)
        ),
        select(literal_column("0"), _FORMULA.text).where(
            _FORMULA.kb_id == KB, _FORMULA.section == bindparam("section"), _within(_FORMULA)
        ),
    )
)


def read_meanings(
    session: Session, kb_id: int, predicates: Sequence[int], low: int, high: int
) -> tuple[dict[int, set[str]], list[str]]:
    """Read the definitions of predicates, and all rules of derived ones, within a range."""
    rows: list[Row] = session.rows(
        _MEANINGS,
        kb=kb_id,
        ids=session.list_value(predicates),
        section=DERIVED_PREDICATE,
        low=low,
        high=high,
    )
    meanings: dict[int, set[str]] = {id_: set() for id_ in predicates}
    for id_, definition in rows:
        if id_:
            meanings[id_].add(definition)
    return meanings, [definition for id_, definition in rows if not id_]


_ENDS = {kind: (TABLES[kind].c, TABLES[f"{kind}_version"].c) for kind in DECLARED}
_LAST_REVISIONS = Query(
    union(
        *(
            select((version.until - literal_column("1")).label("revision")).where(
                version.kb_id == KB,
                version.until > LOW,
                version.until <= HIGH,
                in_rows(
                    version[f"{kind}_id"],
                    select(identity.id).where(identity.kb_id == KB, in_list(identity.key, "keys")),
                ),
            )
            for kind, (identity, version) in _ENDS.items()
        )
    ).order_by(desc("revision"))
)


def read_last_revisions(
    session: Session, kb_id: int, keys: Sequence[str], low: int, high: int
) -> list[int]:
    """Read the last revisions of definitions of some names that ended in a range, newest first."""
    rows = session.rows(
        _LAST_REVISIONS, kb=kb_id, keys=session.list_value(keys), low=low, high=high
    )
    return [revision for (revision,) in rows]


_OBJECT = TABLES["object"].c
_EVERY_NAME = select(_OBJECT.id, _OBJECT.name).where(_OBJECT.kb_id == KB)
_NAMES = Query(select(*found_rows(_EVERY_NAME, _OBJECT.id, "ids").c))


def read_names(session: Session, kb_id: int, ids: Sequence[int]) -> dict[int, str]:
    """Read the names of objects, also of past ones."""
    return dict(session.rows(_NAMES, kb=kb_id, ids=session.list_value(ids)))


# A range is narrow if the past has this many of it.
NARROW = 10


class Touch(NamedTuple):
    """A fact or a value (a number as text, or an object's id) that began or ended to hold.

    Its revision is the one that said so.
    """

    revision: int
    is_end: bool
    is_fact: bool
    owner: int
    objects: tuple[int, ...]
    value: str | int | None


class Subjects(NamedTuple):
    """Predicates and functions of which everything matters, and the ids of what else does."""

    predicates: tuple[int, ...] = ()
    facts: tuple[int, ...] = ()
    functions: tuple[int, ...] = ()
    values: tuple[int, ...] = ()


def subjects_of(
    session: Session,
    kb_id: int,
    facts: Sequence[Pattern],
    values: Sequence[Pattern],
    low: int,
    high: int,
) -> Subjects:
    """Find what matches some patterns, in two statements at most."""
    whole: list[tuple[int, ...]] = []
    ids: list[tuple[int, ...]] = []
    for is_fact, patterns in ((True, facts), (False, values)):
        groups = {one.owner for one in patterns if not one.is_restricted}
        rest = [one for one in dict.fromkeys(patterns) if one.owner not in groups]
        found = find_facts(session, kb_id, rest, low, high, is_fact) if rest else []
        whole.append(tuple(sorted(groups)))
        ids.append(tuple(sorted({fact.id for facts_ in found for fact in facts_})))
    return Subjects(whole[0], ids[0], whole[1], ids[1])


class _Part(NamedTuple):
    """The versions of facts or of values, with their columns and condition, by owner or by id."""

    table: str
    identity: str
    id: str
    owner: str
    columns: str
    condition: str
    by_owner: bool

    @property
    def key(self) -> str:
        """The column by which they are found."""
        return self.owner if self.by_owner else self.id

    def select(self, leading: str, time: str = "") -> str:
        """Select the versions of the alias `v`, without its table; `time` is another column."""
        arguments = (
            f"(SELECT i.arguments FROM {self.identity} AS i"
            f" WHERE i.kb_id = :kb AND i.id BETWEEN v.{self.id} AND v.{self.id}"
            " ORDER BY i.id LIMIT 1)"
        )
        return (
            f"SELECT {leading}, {self.columns.format(owner=f'v.{self.owner} AS owner')}"
            f", {arguments} AS arguments{time}"
        )


_NONE = "CAST(NULL AS text) AS value, CAST(NULL AS bigint) AS object_id"
_FACTS = (
    "proposition_version",
    "proposition",
    "proposition_id",
    "predicate_id",
    f"1 AS is_fact, {{owner}}, {_NONE}",
    " AND v.is_goal = :is_goal",
)
_VALUES = (
    "function_value_version",
    "function_value",
    "function_value_id",
    "function_id",
    "0 AS is_fact, {owner}, v.value, v.object_id",
    "",
)
# In the order of `Subjects`.
PARTS = (
    _Part(*_FACTS, True),
    _Part(*_FACTS, False),
    _Part(*_VALUES, True),
    _Part(*_VALUES, False),
)


_TIME = (
    ", (SELECT r.committed_at FROM revision AS r WHERE r.kb_id = :kb"
    " AND r.number BETWEEN v.{0} AND v.{0} ORDER BY r.number LIMIT 1) AS committed_at"
)


@cache
def _touches(loops: NestedLoops, places: tuple[int, ...], is_narrow: bool, is_timed: bool) -> Query:
    parts = []
    for place in places:
        part, wanted = PARTS[place], f"{loops.rows(f'which{place}', 1)} AS wanted"
        for is_end, end in (("0", "since"), ("1", "until")):
            time = _TIME.format(end) if is_timed else ""
            leading = part.select(f"v.{end} AS revision, {is_end} AS is_end", time)
            # An expression has no index, so that the other one is used.
            own = f"v.{end} > :after AND v.{end} <= :high{part.condition}"
            if is_narrow and part.by_owner:
                which = f"v.{part.key} + 0 IN (SELECT c0 FROM {wanted})"
                tables = f"{part.table} AS v WHERE v.kb_id = :kb AND {own} AND {which}"
            else:
                own = own.replace(f"v.{end} ", f"v.{end} + 0 ")
                which = f"v.kb_id = :kb AND v.{part.key} = wanted.c0 AND {own}"
                tables = wanted + loops.loop("v", part.table, which)
            parts.append(f"{leading} FROM {tables}")
    # What ends comes first: a value ends where the next one begins.
    return Query(text(f"{' UNION ALL '.join(parts)} ORDER BY revision, is_end DESC"))


@cache
def _state(loops: NestedLoops, places: tuple[int, ...]) -> Query:
    parts = []
    for place in places:
        part, tables = PARTS[place], f"{loops.rows(f'which{place}', 1)} AS wanted"
        which = f"v.kb_id = :kb AND v.{part.key} = wanted.c0{part.condition}"
        if part.by_owner:
            # See `intervals.py`: the index of an owner's versions goes on with the fork.
            tables += f" CROSS JOIN {loops.rows('forks', 1)} AS forked"
            which += " AND v.fork = forked.c0"
        began = f"{loops.unsought if part.by_owner else ''}v.since <= :at"
        which += f" AND {began} AND (v.until IS NULL OR v.until > :at)"
        leading = part.select("v.since AS revision, 0 AS is_end")
        parts.append(f"{leading} FROM {tables}{loops.loop('v', part.table, which)}")
    return Query(text(" UNION ALL ".join(parts)))


def parameters_of(kb_id: int, which: Subjects) -> tuple[tuple[int, ...], dict[str, Any]]:
    """Return which parts are asked for, and what they are given."""
    places = tuple([place for place, ids in enumerate(which) if ids])
    values: dict[str, Any] = {"kb": kb_id}
    values |= {f"which{place}": id_rows(which[place]) for place in places}
    if not {0, 1}.isdisjoint(places):
        values["is_goal"] = False
    return places, values


def state_of(session: Session, kb_id: int, which: Subjects, at: int) -> Iterator[Touch]:
    """Read what held at a revision, of what matters, in one statement."""
    places, values = parameters_of(kb_id, which)
    if not places:
        return iter(())
    if not {0, 2}.isdisjoint(places):
        values["forks"] = id_rows(forks_at(at))
    query = _state(session.loops, places)
    return map(touch_of, session.rows(query, **values, at=at))


def stream_touches(
    session: Session, kb_id: int, which: Subjects, after: int, high: int
) -> Iterator[Touch]:
    """Read what began and ended after a revision, in order, in constant memory."""
    return map(touch_of, _stream(session, kb_id, which, after, high, False))


def stream_timed_touches(
    session: Session, kb_id: int, which: Subjects, after: int, high: int
) -> Iterator[tuple[datetime, Touch]]:
    """Read them with the times at which their revisions were committed."""
    for row in _stream(session, kb_id, which, after, high, True):
        with reading_rows("revision", f"revision {row[0]!r}"):
            time = session.to_time(row[7])
        yield time, touch_of(row[:7])


def _stream(
    session: Session, kb_id: int, which: Subjects, after: int, high: int, is_timed: bool
) -> Iterator[Row]:
    places, values = parameters_of(kb_id, which)
    if not places or after >= high:
        return iter(())
    # Changes of a short range are found by revision, those of most of the past by predicate.
    is_narrow = (high - after) * NARROW < high
    query = _touches(session.loops, places, is_narrow, is_timed)
    return session.stream(query, **values, after=after, high=high)


def touch_of(row: Any) -> Touch:
    """Read a row."""
    revision, is_end, is_fact, owner, value, object_id, arguments = row
    objects = tuple([int(one) for one in arguments.split()])
    held = value if object_id is None else object_id
    return Touch(revision, bool(is_end), bool(is_fact), owner, objects, held)


def fits(definitions: Definitions, touch: Touch) -> bool:
    """Return whether a fact or a value is one by the definition of its predicate or function."""
    owners: Any = definitions.predicates if touch.is_fact else definitions.functions
    value = (touch.value,) if isinstance(touch.value, int) else ()
    return definitions.admits(owners.live(touch.owner), touch.objects + value)


# Where definitions changed.


class Meaning(NamedTuple):
    """The ids of definitions that matter; None for all objects."""

    predicates: tuple[int, ...]
    functions: tuple[int, ...]
    objects: tuple[int, ...] | None
    has_rules: bool


def _ends(kind: str, *conditions: ColumnElement[bool]) -> Iterator[Select[Any]]:
    version = TABLES[f"{kind}_version"].c
    for end in (version.since, version.until):
        yield select(end.label("revision")).where(
            version.kb_id == KB, end > AFTER, end <= HIGH, *conditions
        )


def _of(kind: str) -> ColumnElement[bool]:
    return in_list(TABLES[f"{kind}_version"].c[f"{kind}_id"], f"{kind}s")


@cache
def _redefinitions(all_objects: bool, has_rules: bool) -> Query:
    parts = [*_ends("type"), *_ends("predicate", _of("predicate"))]
    parts += _ends("function", _of("function"))
    parts += _ends("object") if all_objects else _ends("object", _of("object"))
    if has_rules:
        section = TABLES["formula_version"].c.section
        parts += _ends("formula", section == bindparam("section"))
    return Query(union(*parts).order_by("revision"))


def read_redefinitions(
    session: Session, kb_id: int, meaning: Meaning, after: int, high: int
) -> list[int]:
    """Read the revisions that changed definitions, in order."""
    values: dict[str, Any] = {
        "predicates": session.list_value(meaning.predicates),
        "functions": session.list_value(meaning.functions),
    }
    if meaning.objects is not None:
        values["objects"] = session.list_value(meaning.objects)
    if meaning.has_rules:
        values["section"] = DERIVED_PREDICATE
    query = _redefinitions(meaning.objects is None, meaning.has_rules)
    rows = session.rows(query, kb=kb_id, after=after, high=high, **values)
    return [revision for (revision,) in rows]


_RULE = TABLES["rule_version"].c
_KEPT = Query(
    select(_RULE.rule_id, _RULE.since, _RULE.text)
    .where(_RULE.kb_id == KB, held_at(_RULE))
    .order_by(_RULE.rule_id)
)


def read_kept_rules(session: Session, kb_id: int, at: int) -> list[Row]:
    """Read the rules that were kept at a revision: which, since when, and their texts."""
    return session.rows(_KEPT, kb=kb_id, at=at)


_ENDED = Query(
    select(_RULE.until)
    .distinct()
    .where(_RULE.kb_id == KB, _RULE.until > AFTER, _RULE.until <= HIGH)
    .order_by(_RULE.until)
)


def read_ends_of_rules(session: Session, kb_id: int, after: int, high: int) -> list[int]:
    """Read the revisions that redefined or deleted rules, in order."""
    return [number for (number,) in session.rows(_ENDED, kb=kb_id, after=after, high=high)]


_TIMES = Query(
    select(RevisionRow.number, RevisionRow.committed_at, RevisionRow.observed_at)
    .where(
        RevisionRow.kb_id == KB, RevisionRow.number >= integer("low"), RevisionRow.number <= HIGH
    )
    .order_by(RevisionRow.number)
)


def stream_times(
    session: Session, kb_id: int, low: int, high: int
) -> Iterator[tuple[int, datetime, datetime | None]]:
    """Read when revisions were committed, and when their knowledge was observed, in order."""
    for number, committed_at, observed_at in session.stream(_TIMES, kb=kb_id, low=low, high=high):
        with reading_rows("revision", f"revision {number!r}"):
            observed = None if observed_at is None else session.to_time(observed_at)
            committed = session.to_time(committed_at)
        yield number, committed, observed

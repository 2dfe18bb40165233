"""When facts held: interval joins over versions, and what a range of revisions did to some facts.

The versions of one proposition do not overlap, so those that meet an interval are the last one that
began up to its beginning, and those that began within it: each loop of a join walks one range of
the primary key (kb_id, proposition_id, since).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import (
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

from ..knowledge.definitions import DERIVED_PREDICATE
from .dialects.base import Row, Session
from .dialects.nested import NESTED_LOOPS, NestedLoops
from .query import Query, found_rows, in_list, in_rows, integer
from .rows import KB
from .tables import (
    TABLES,
)

LOW, HIGH = integer("low"), integer("high")


class Pattern(NamedTuple):
    """The facts of a predicate, or the values of a function, with objects at some positions.

    Attributes:
        owner: the id of the predicate or the function.
        objects: the id of the object at each position; None for any.
    """

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
    """A proposition, or a fluent, that was known at some time.

    Attributes:
        objects: the ids of its objects.
        versions: how often it was asserted in the range, where the pattern is ground; else 0.
    """

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
def _facts(dialect: str, shapes: tuple[str, ...], are_facts: bool) -> Query:
    loops = NESTED_LOOPS[dialect]
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
    query = _facts(session.backend.dialect.name, tuple(map(_shape, patterns)), are_facts)
    for place, id_, arguments, versions in session.rows(query, **parameters):
        own = tuple([int(one) for one in arguments.split()])
        if patterns[place].matches(own):
            found[place].append(FoundFact(id_, own, versions))
    return found


class Overlap(NamedTuple):
    """An interval in which some facts held together.

    Attributes:
        place: which of the combinations of facts.
        since: its first revision; the one before the range if they held there, too.
        until: the first revision after it; the one after the range if they held to its end.
    """

    place: int
    since: int
    until: int


_VERSION = "proposition_version"


def _overlaps_text(loops: NestedLoops, count: int) -> str:
    since, until = ":before", ":after"
    tables, where = f"{loops.rows('facts', count)} AS wanted", []
    for n in range(count):
        one = f"v{n}", _VERSION, "proposition_id", f"wanted.id{n}"
        last = loops.last(f"l{n}", *one[1:], since, f"l{n}.since")
        tables += loops.range(*one, f"coalesce({last}, 0)", f"{until} - 1")
        where.append(f"(v{n}.until IS NULL OR v{n}.until > {loops.larger}({since}, :low))")
        since = f"{loops.larger}({since}, v{n}.since)"
        until = f"{loops.smaller}({until}, coalesce(v{n}.until, :after))"
    return f"SELECT wanted.place, {since}, {until} FROM {tables} WHERE {' AND '.join(where)}"


@cache
def _overlaps(dialect: str, count: int) -> Query:
    return Query(text(_overlaps_text(NESTED_LOOPS[dialect], count)))


def find_overlaps(
    session: Session, kb_id: int, facts: Sequence[Sequence[int]], low: int, high: int
) -> list[Overlap]:
    """Find the intervals in which facts held together, within a range, in one statement.

    Args:
        kb_id: the knowledge base.
        facts: combinations of as many propositions, by their ids.
        low: the first revision of the range.
        high: its last one.
    """
    query = _overlaps(session.backend.dialect.name, len(facts[0]))
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


_ENDS = {
    kind: (TABLES[kind].c, TABLES[f"{kind}_version"].c)
    for kind in ("type", "object", "predicate", "function")
}
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

"""What a range of revisions did to some facts and values, and where it changed what they mean."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, bindparam, select, text, union

from ..errors import reading_rows
from ..knowledge.definitions import DERIVED_PREDICATE
from .dialects.base import Session
from .dialects.nested import NESTED_LOOPS
from .intervals import forks_at
from .periods import Pattern, find_facts
from .query import Query, in_list, integer
from .rows import KB
from .tables import (
    TABLES,
    RevisionRow,
)

AFTER, HIGH = integer("after"), integer("high")
# A range is narrow if the past has this many of it.
NARROW = 10


class Touch(NamedTuple):
    """A fact or a value that began or ended to hold.

    Attributes:
        is_end: whether it ended there.
        is_fact: whether it is a fact.
        owner: the id of its predicate or function.
        objects: the ids of its objects.
        value: the number as text, or the id of the object, that a fluent is.
    """

    revision: int
    is_end: bool
    is_fact: bool
    owner: int
    objects: tuple[int, ...]
    value: str | int | None


class Subjects(NamedTuple):
    """The facts and values that matter.

    Attributes:
        predicates: the predicates of which all facts matter.
        facts: the ids of further propositions.
        functions: the functions of which all values matter.
        values: the ids of further fluents.
    """

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
    """The versions of facts or of values, by owner or by id.

    Attributes:
        table: the table of versions.
        identity: the table of identities.
        id: the column of the identity.
        owner: the column of the predicate or the function.
        columns: whether they are facts, and the columns of values.
        condition: on which versions count.
        by_owner: whether they are found by owner.
    """

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

    def select(self, leading: str) -> str:
        """Select the versions of the alias `v`, without its table."""
        arguments = (
            f"(SELECT i.arguments FROM {self.identity} AS i"
            f" WHERE i.kb_id = :kb AND i.id BETWEEN v.{self.id} AND v.{self.id}"
            " ORDER BY i.id LIMIT 1)"
        )
        return (
            f"SELECT {leading}, {self.columns.format(owner=f'v.{self.owner} AS owner')}"
            f", {arguments} AS arguments"
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
_PARTS = (
    _Part(*_FACTS, True),
    _Part(*_FACTS, False),
    _Part(*_VALUES, True),
    _Part(*_VALUES, False),
)


@cache
def _touches(dialect: str, places: tuple[int, ...], is_narrow: bool) -> Query:
    loops = NESTED_LOOPS[dialect]
    parts = []
    for place in places:
        part, wanted = _PARTS[place], f"{loops.rows(f'which{place}', 1)} AS wanted"
        for is_end, end in (("0", "since"), ("1", "until")):
            leading = part.select(f"v.{end} AS revision, {is_end} AS is_end")
            # An expression has no index, so that the other one is used.
            own = f"v.{end} > :after AND v.{end} <= :high{part.condition}"
            if is_narrow and part.by_owner:
                which = f"v.{part.key} + 0 IN (SELECT id0 FROM {wanted})"
                tables = f"{part.table} AS v WHERE v.kb_id = :kb AND {own} AND {which}"
            else:
                own = own.replace(f"v.{end} ", f"v.{end} + 0 ")
                which = f"v.kb_id = :kb AND v.{part.key} = wanted.id0 AND {own}"
                tables = wanted + loops.loop("v", part.table, which)
            parts.append(f"{leading} FROM {tables}")
    # What ends comes first: a value ends where the next one begins.
    return Query(text(f"{' UNION ALL '.join(parts)} ORDER BY revision, is_end DESC"))


@cache
def _state(dialect: str, places: tuple[int, ...]) -> Query:
    loops = NESTED_LOOPS[dialect]
    parts = []
    for place in places:
        part, tables = _PARTS[place], f"{loops.rows(f'which{place}', 1)} AS wanted"
        which = f"v.kb_id = :kb AND v.{part.key} = wanted.id0{part.condition}"
        if part.by_owner:
            # See `intervals.py`: the index of an owner's versions goes on with the fork.
            tables += f" CROSS JOIN {loops.rows('forks', 1)} AS forked"
            which += " AND v.fork = forked.id0"
        which += " AND v.since <= :at AND (v.until IS NULL OR v.until > :at)"
        leading = part.select("0 AS revision, 0 AS is_end")
        parts.append(f"{leading} FROM {tables}{loops.loop('v', part.table, which)}")
    return Query(text(" UNION ALL ".join(parts)))


def _parameters(kb_id: int, which: Subjects) -> tuple[tuple[int, ...], dict[str, Any]]:
    places = tuple([place for place, ids in enumerate(which) if ids])
    values: dict[str, Any] = {"kb": kb_id}
    values |= {f"which{place}": _rows(which[place]) for place in places}
    if not {0, 1}.isdisjoint(places):
        values["is_goal"] = False
    return places, values


def _rows(ids: Sequence[int]) -> str:
    return json.dumps([[id_] for id_ in ids])


def state_of(session: Session, kb_id: int, which: Subjects, at: int) -> Iterator[Touch]:
    """Read what held at a revision, of what matters, in one statement."""
    places, values = _parameters(kb_id, which)
    if not places:
        return iter(())
    if not {0, 2}.isdisjoint(places):
        values["forks"] = _rows(forks_at(at))
    query = _state(session.backend.dialect.name, places)
    return map(_touch, session.rows(query, **values, at=at))


def stream_touches(
    session: Session, kb_id: int, which: Subjects, after: int, high: int
) -> Iterator[Touch]:
    """Read what began and ended after a revision, in order, in constant memory."""
    places, values = _parameters(kb_id, which)
    if not places:
        return iter(())
    # Changes of a short range are found by revision, those of most of the past by predicate.
    query = _touches(session.backend.dialect.name, places, (high - after) * NARROW < high)
    return map(_touch, session.stream(query, **values, after=after, high=high))


def _touch(row: Any) -> Touch:
    revision, is_end, is_fact, owner, value, object_id, arguments = row
    objects = tuple([int(one) for one in arguments.split()])
    held = value if object_id is None else object_id
    return Touch(revision, bool(is_end), bool(is_fact), owner, objects, held)


# Where definitions changed.


class Meaning(NamedTuple):
    """The definitions that matter.

    Attributes:
        predicates: the ids of predicates.
        functions: the ids of functions.
        objects: the ids of objects; None for all.
        has_rules: whether rules of derived predicates matter.
    """

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

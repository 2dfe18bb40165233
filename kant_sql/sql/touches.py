"""What a range of revisions did to some facts and values, and where it changed what they mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Select,
    bindparam,
    literal_column,
    select,
    union,
    union_all,
)

from ..errors import reading_rows
from ..knowledge.definitions import DERIVED_PREDICATE
from .dialects.base import Session
from .held import Pattern, find_facts
from .intervals import held_then, then
from .query import Query, in_list, integer
from .rows import KB, held_at
from .tables import (
    TABLES,
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionRow,
    PropositionVersionRow,
    RevisionRow,
)

AFTER, HIGH = integer("after"), integer("high")


class Touch(NamedTuple):
    """A fact or a value that began or ended to hold.

    Attributes:
        revision: the revision.
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


class _Source(NamedTuple):
    """The tables of facts, or of values."""

    version: Any
    identity: Any
    id: Any
    owner: Any
    columns: tuple[Any, Any, Any]
    conditions: tuple[ColumnElement[bool], ...]


_FACTS = _Source(
    PropositionVersionRow,
    PropositionRow,
    PropositionVersionRow.proposition_id,
    PropositionVersionRow.predicate_id,
    (
        literal_column("1"),
        literal_column("CAST(NULL AS text)"),
        literal_column("CAST(NULL AS bigint)"),
    ),
    (PropositionVersionRow.is_goal == bindparam("is_goal"),),
)
_VALUES = _Source(
    FunctionValueVersionRow,
    FunctionValueRow,
    FunctionValueVersionRow.function_value_id,
    FunctionValueVersionRow.function_id,
    (literal_column("0"), FunctionValueVersionRow.value, FunctionValueVersionRow.object_id),
    (),
)
# In the order of `Subjects`: by owner, and by id.
_PARTS = ((_FACTS, True), (_FACTS, False), (_VALUES, True), (_VALUES, False))


def _select(source: _Source, *leading: ColumnElement[Any]) -> Select[Any]:
    version, identity = source.version, source.identity
    arguments = (
        select(identity.arguments)
        .where(identity.kb_id == version.kb_id, identity.id == source.id)
        .scalar_subquery()
    )
    is_fact, value, object_id = source.columns
    columns = (*leading, is_fact.label("is_fact"), source.owner.label("owner"))
    return select(*columns, arguments.label("arguments"), value, object_id).where(
        version.kb_id == KB, *source.conditions
    )


def _which(source: _Source, by_owner: bool, place: int) -> ColumnElement[bool]:
    return in_list(source.owner if by_owner else source.id, f"which{place}")


@cache
def _touches(places: tuple[int, ...]) -> Query:
    parts = []
    for place in places:
        source, by_owner = _PARTS[place]
        for is_end, end in (("0", source.version.since), ("1", source.version.until)):
            sign: ColumnElement[int] = literal_column(is_end)
            leading = end.label("revision"), sign.label("is_end")
            parts.append(
                _select(source, *leading).where(
                    _which(source, by_owner, place), end > AFTER, end <= HIGH
                )
            )
    # What ends comes first: a value ends where the next one begins.
    return Query(union_all(*parts).order_by("revision", literal_column("is_end").desc()))


@cache
def _state(places: tuple[int, ...]) -> Query:
    parts = []
    for place in places:
        source, by_owner = _PARTS[place]
        held = held_then(source.version) if by_owner else held_at(source.version)
        found = _select(source, literal_column("0"), literal_column("0"))
        parts.append(found.where(_which(source, by_owner, place), held))
    return Query(union_all(*parts))


def _parameters(session: Session, kb_id: int, which: Subjects) -> tuple[tuple[int, ...], Any]:
    places = tuple([place for place, ids in enumerate(which) if ids])
    values: dict[str, Any] = {"kb": kb_id, "is_goal": False}
    values |= {f"which{place}": session.list_value(which[place]) for place in places}
    return places, values


def state_of(session: Session, kb_id: int, which: Subjects, at: int) -> Iterator[Touch]:
    """Read what held at a revision, of what matters, in one statement."""
    places, values = _parameters(session, kb_id, which)
    if not places:
        return iter(())
    if not {0, 2}.isdisjoint(places):
        values |= then(session, at)
    return map(_touch, session.rows(_state(places), **values, **{"at": at}))


def stream_touches(
    session: Session, kb_id: int, which: Subjects, after: int, high: int
) -> Iterator[Touch]:
    """Read what began and ended after a revision, in order, in constant memory."""
    places, values = _parameters(session, kb_id, which)
    if not places:
        return iter(())
    return map(_touch, session.stream(_touches(places), **values, after=after, high=high))


def _touch(row: Any) -> Touch:
    revision, is_end, is_fact, owner, arguments, value, object_id = row
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

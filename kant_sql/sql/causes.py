"""Statements about causes: possible acts, the state right before them, and their changes.

All statements take rows of ids, so their number depends on neither acts nor facts; each row reads a
bounded part of an index.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import text

from ..knowledge.definitions import Definitions
from .dialects.base import Row, Session
from .dialects.words import NestedLoops, Walk, id_rows
from .executions import Key
from .intervals import FIND, FIND_VALUE, forks_at
from .query import Query

# Above this number, executions of an action or object are searched by revision; and the number of
# revisions to search.
FEW = 2_000
# Revisions to search first, for each wanted execution.
NEAR = 4
_ALL = 2**62
# A predicate (True) or a function, its id, and the ids of objects.
Atom = tuple[bool, int, tuple[int, ...]]
_OBJECTS = "first_object_id", "second_object_id"
_ATOMS = {True: ("proposition", "predicate"), False: ("function_value", "function")}


class WantedActs(NamedTuple):
    """Executions of an action with up to two objects, whose outcome was set in a range.

    Attributes:
        action: the action's id.
        object: the id of an object; 0 for any.
        argument: its place among the arguments.
        low: the first revision.
        high: the last revision.
        other: the id of another object; 0 for any.
        place: its place.
    """

    action: int
    object: int
    argument: int
    low: int
    high: int
    other: int = 0
    place: int = 0


class FoundAct(NamedTuple):
    """An execution, and the revision of an outcome; of a plan's step, that it was planned from."""

    key: Key
    revision: int
    is_planned: bool


@cache
def _counts(loops: NestedLoops) -> Query:
    of_action, of_object = (
        f"(SELECT count(*) FROM (SELECT 1 FROM {table} AS c WHERE c.kb_id = :kb "
        f"AND c.{column} = w.c1 LIMIT {FEW + 1}) AS few)"
        for table, column in (("execution", "action_id"), ("execution_argument", "object_id"))
    )
    counted = f"CASE WHEN w.c0 = 1 THEN {of_action} ELSE {of_object} END"
    rows = loops.rows("ids", 2)
    return Query(text(f"SELECT w.c0, w.c1, {counted} FROM {rows} AS w"))


# By an object, by the action, or by the revision and then the object, if there is one.
_OBJECT, _ACTION, _RANGE, _BOTH = "object", "action", "range", "both"
_SAME = "{0}.kb_id = :kb AND {0}.plan_id = {1}.plan_id AND {0}.position = {1}.position"


def _found_by(loops: NestedLoops, by: str, is_planned: bool) -> str:
    """Select the executions, or the steps of plans, by one access path."""
    has_object = by in (_OBJECT, _BOTH)
    # Without statistics, PostgreSQL would read all executions of the action for each joined row.
    execution = f"{_SAME.format('x', 'a' if has_object else 'v')} AND x.action_id + 0 = w.c0"
    span = "BETWEEN w.c3 AND w.c4"
    # Without statistics, PostgreSQL would read all versions of these revisions for each act.
    end, last = "v.since", f"{_SAME.format('v', 'x')} AND v.since + 0 {span}"
    table, at = "execution_version", f"v.kb_id = :kb AND v.since {span}"
    if is_planned:
        table, end = "plan", "v.revision"
        last = f"v.kb_id = :kb AND v.id = x.plan_id AND v.revision {span}"
    if by == _OBJECT:
        argument = "a.kb_id = :kb AND a.object_id = w.c1 AND a.argument = w.c2"
        found = loops.loop("a", "execution_argument", argument)
        found += loops.loop("x", "execution", execution) + loops.loop("v", table, last)
    elif by == _ACTION:
        own = "x.kb_id = :kb AND x.action_id = w.c0"
        found = loops.loop("x", "execution", own) + loops.loop("v", table, last)
    else:
        own = f"{_SAME.format('a', 'v')} AND a.argument = w.c2 AND a.object_id + 0 = w.c1"
        found = loops.loop("v", table, at)
        found += loops.loop("a", "execution_argument", own) if has_object else ""
        found += loops.loop("x", "execution", execution)
    rest = "1 = 1" if is_planned else "v.outcome <> 'refused'"
    for object_, place in (("c5", "c6"),) if has_object else (("c1", "c2"), ("c5", "c6")):
        named = f"{_SAME.format('n', 'x')} AND n.argument = w.{place}"
        named = f"SELECT 1 FROM execution_argument AS n WHERE {named} AND n.object_id + 0"
        rest += f" AND (w.{object_} = 0 OR EXISTS ({named} = w.{object_}))"
    wanted = f"SELECT {end} AS revision, x.plan_id, x.position, {int(is_planned)} AS planned"
    return f"{wanted}, w.place FROM {loops.rows('given', 7)} AS w{found} WHERE {rest}"


@cache
def _acts(loops: NestedLoops, by: str) -> Query:
    order = "v.since DESC, x.plan_id DESC, x.position DESC"
    if by in (_RANGE, _BOTH):
        return Query(text(f"{_found_by(loops, by, False)} ORDER BY {order} LIMIT :size"))
    # Plans from a state have their own index, apart from that of revisions.
    parts = [_found_by(loops, by, is_planned) for is_planned in (False, True)]
    return Query(text(" UNION ALL ".join(parts)))


_Acts = Collection[WantedActs]
# Access path -> the wanted executions, with their ranges of revisions.
_Wanted = dict[str, dict[WantedActs, list[tuple[int, int]]]]


def _accesses(
    session: Session, kb_id: int, definitions: Definitions, wanted: _Acts
) -> tuple[_Wanted, int]:
    """Choose the access paths by counts; also return the first revision of ranges."""
    ids = {(1, one.action) for one in wanted}
    ids |= {(0, id_) for one in wanted for id_ in (one.object, one.other)}
    # Large counts stay large: the record only grows.
    many = definitions.derived.setdefault(_accesses, {(0, 0): FEW + 1})
    counts = dict(many)
    if rest := [*ids - many.keys()]:
        query = _counts(session.loops)
        for is_action, id_, number in session.rows(query, kb=kb_id, ids=json.dumps(rest)):
            counts[is_action, id_] = number
    many.update((key, number) for key, number in counts.items() if number > FEW)
    by: _Wanted = {}
    searched = 0
    for each in wanted:
        one, low = each, each.low
        if counts[0, one.other] < counts[0, one.object]:
            other = {"other": one.object, "place": one.argument}
            one = one._replace(object=one.other, argument=one.place, **other)
        key = one._replace(low=0, high=0)
        if counts[0, one.object] <= FEW:
            access = _OBJECT
        elif counts[1, one.action] <= FEW:
            access = _ACTION
        else:
            access, key, low = _BOTH if one.object else _RANGE, one, max(low, one.high - FEW)
            searched = max(searched, low if low > one.low else 0)
        by.setdefault(access, {}).setdefault(key, []).append((low, one.high))
    return by, searched


def find_acts(
    session: Session, kb_id: int, definitions: Definitions, wanted: _Acts, size: int
) -> tuple[list[FoundAct], int]:
    """Find executions, the newest first, and steps of plans behind, in a few statements.

    Returns:
        The executions, and the first completely searched revision.
    """
    by, searched = _accesses(session, kb_id, definitions, wanted)

    def newest(near: int) -> tuple[list[FoundAct], int]:
        found, first = set[FoundAct](), 0
        for access, keys in by.items():
            is_range, ranges, given = access in (_RANGE, _BOTH), [*keys.values()], []
            for key, own in keys.items():
                low, high = min(own)[0], max(one[1] for one in own)
                if is_range and high - near > low:
                    low = high - near
                    first = max(first, low)
                given.append(key._replace(low=low, high=high))
            most = {"size": min(size * len(keys), _ALL)} if is_range else {}
            query = _acts(session.loops, access)
            rows = session.rows(query, kb=kb_id, given=json.dumps(given), **most)
            found |= {
                FoundAct((row[1], row[2]), row[0], bool(row[3]))
                for row in rows
                if any(low <= row[0] <= high for low, high in ranges[row[4]])
            }
        order = sorted(found, key=lambda one: (not one.is_planned, one.revision, one.key))
        return order[: -size - 1 : -1], first

    # Frequent acts are in the newest revisions; otherwise read again.
    found, first = newest(NEAR * size)
    if first and (len(found) < size or found[-1].is_planned or found[-1].revision < first):
        found, _ = newest(_ALL)
    return found, searched


class HeldVersion(NamedTuple):
    """The last version up to a revision: its ends (None: open), and the value of a fluent."""

    since: int
    until: int | None
    value: str | int | None = None


@cache
def _versions(loops: NestedLoops, is_fact: bool) -> Query:
    """Read the last version of each identity up to a revision."""
    identity, _ = _ATOMS[is_fact]
    table, own = f"{identity}_version", f"{identity}_id"
    found = loops.latest(Walk("v", table, own, "w.c0"), "w.c1")
    wanted = f"w.c0, w.c1, v.since, v.until, {_VALUE[is_fact]}"
    return Query(text(f"SELECT {wanted} FROM {loops.rows('wanted', 2)} AS w{found}"))


_VALUE = {True: "NULL, NULL", False: "v.value, v.object_id"}


@cache
def _held(loops: NestedLoops, is_fact: bool, by: str) -> Query:
    """Read the versions of owners at revisions; `by` is a column with an object."""
    identity, owner = _ATOMS[is_fact]
    own = f"v.kb_id = :kb AND v.{owner}_id = w.c0 AND v.fork = w.c1"
    own += f" AND v.{by} = w.c3" if by else ""
    own += " AND v.since + 0 <= w.c2 AND (v.until IS NULL OR v.until > w.c2)"
    own += " AND v.is_goal = :is_goal" if is_fact else ""
    found = loops.ordered("v", f"{identity}_version", own, "v.since" if by else f"v.{owner}_id")
    found += loops.loop("i", identity, f"i.kb_id = :kb AND i.id = v.{identity}_id")
    wanted = f"w.c0, w.c2, i.arguments, {_VALUE[is_fact]}"
    return Query(text(f"SELECT {wanted} FROM {loops.rows('wanted', 4)} AS w{found}"))


class PastReader:
    """Reads the versions of facts and values at many revisions at once."""

    def __init__(self, session: Session, kb_id: int, head: int) -> None:
        self._session = session
        self._kb_id = kb_id
        self._head = head
        self._ids: dict[Atom, int | None] = {}
        # The read versions; None: there is none.
        self._held: dict[tuple[Atom, int], HeldVersion | None] = {}

    def versions(self, wanted: Collection[tuple[Atom, int]]) -> dict[tuple[Atom, int], HeldVersion]:
        """Read the last version of each atom up to a revision, which may have ended before."""
        missing = [one for one in wanted if one not in self._held]
        self._held |= dict.fromkeys(missing)
        self._find({atom for atom, _ in missing})
        for is_fact in (True, False):
            places: defaultdict[tuple[int, int], list[Atom]] = defaultdict(list)
            for atom, at in missing:
                id_ = self._ids[atom] if atom[0] == is_fact else None
                if id_ is not None:
                    places[id_, at].append(atom)
            for id_, at, since, until, *value in self._rows(_versions, places, is_fact):
                held = HeldVersion(since, until, _value(*value))
                self._held |= {(atom, at): held for atom in places[id_, at]}
        return {one: last for one in wanted if (last := self._held[one]) is not None}

    def fitting(self, wanted: Collection[tuple[Any, int]]) -> Iterator[tuple[Atom, int, Any]]:
        """Yield the facts and values of patterns at revisions; None in a pattern is any object."""
        asked: defaultdict[tuple[bool, str], set[tuple[int, int, int]]] = defaultdict(set)
        for (is_fact, owner, row), at in wanted:
            # Values have no index by object.
            given = zip(_OBJECTS, row[: 2 * is_fact], strict=False)
            by, object_ = next((one for one in given if one[1] is not None), ("", 0))
            asked[is_fact, by].add((owner, at, object_))
        for (is_fact, by), rows in asked.items():
            if by:
                rows -= {one for one in rows if (*one[:2], 0) in asked.get((True, ""), ())}
            places = [
                (owner, fork, at, object_)
                for owner, at, object_ in rows
                for fork in forks_at(at)
                if fork <= self._head
            ]
            goal = {"is_goal": False} if is_fact else {}
            for owner, at, arguments, *value in self._rows(_held, places, is_fact, by, **goal):
                yield (is_fact, owner, _objects(arguments)), at, _value(*value)

    def _rows(
        self, query: Callable[..., Query], asked: Iterable[Sequence[int]], *how: Any, **given: Any
    ) -> list[Row]:
        rows = [*asked]
        if not rows:
            return []
        written = query(self._session.loops, *how)
        return self._session.rows(written, kb=self._kb_id, wanted=json.dumps(rows), **given)

    def _find(self, atoms: set[Atom]) -> None:
        """Find the identities of atoms, in one statement for each predicate and function."""
        heads: defaultdict[tuple[bool, int], dict[str, Atom]] = defaultdict(dict)
        for atom in atoms - self._ids.keys():
            self._ids[atom] = None
            heads[atom[:2]][" ".join(map(str, atom[2]))] = atom
        for (is_fact, owner), own in heads.items():
            given = {"predicate": owner, "is_goal": False} if is_fact else {"function": owner}
            listed = self._session.list_value([*own])
            query = FIND if is_fact else FIND_VALUE
            for row in self._session.rows(query, kb=self._kb_id, arguments=listed, **given):
                self._ids[own[row[1]]] = row[0]


def _value(value: str | None, object_id: int | None) -> str | int | None:
    return value if object_id is None else object_id


def _objects(arguments: str) -> tuple[int, ...]:
    return tuple([int(one) for one in arguments.split()])


class ChangedAtom(NamedTuple):
    """A change of a fact or a value, until the next one; its text has no value."""

    revision: int
    atom: Atom
    holds: bool
    until: int | None
    text: str


@cache
def _changed(loops: NestedLoops) -> Query:
    parts = []
    for is_fact, (identity, owner) in _ATOMS.items():
        table, id_ = f"{identity}_version", f"{identity}_id"
        after = Walk("n", table, id_, f"v.{id_}")
        following = loops.part(after, "v.until - 1", "9223372036854775806", "1", "n.since")
        for end, until in (("since", "v.until"), ("until", f"({following})")):
            found = loops.loop("v", table, f"v.kb_id = :kb AND v.{end} BETWEEN w.c0 AND w.c0")
            found += loops.loop("i", identity, f"i.kb_id = :kb AND i.id = v.{id_}")
            rest = " WHERE NOT v.is_goal" if is_fact else ""
            wanted = f"w.c0, {int(is_fact)}, i.{owner}_id, i.arguments, {int(end == 'since')}"
            rows = loops.rows("wanted", 1)
            parts.append(f"SELECT {wanted}, {until}, i.text FROM {rows} AS w{found}{rest}")
    return Query(text(" UNION ALL ".join(parts)))


def changed_atoms(session: Session, kb_id: int, revisions: Iterable[int]) -> list[ChangedAtom]:
    """Read the changes of facts and values in revisions."""
    query = _changed(session.loops)
    rows = session.rows(query, kb=kb_id, wanted=id_rows(revisions))
    found = [
        ChangedAtom(number, (bool(fact), owner, _objects(arguments)), bool(began), *rest)
        for number, fact, owner, arguments, began, *rest in rows
    ]
    found.sort(key=lambda one: (one.revision, not one.atom[0], not one.holds, one.atom))
    set_again = {(one.revision, one.atom) for one in found if one.holds}
    # A replaced value ends where the next one begins.
    return [one for one in found if one.holds or (one.revision, one.atom) not in set_again]


@cache
def _origins(loops: NestedLoops) -> Query:
    rows = loops.rows("wanted", 1)
    # With an equality, SQLite prefers the primary key, and reads the whole knowledge base.
    acts = loops.loop("v", "execution_version", "v.kb_id = :kb AND v.since BETWEEN w.c0 AND w.c0")
    loads = loops.loop("v", "document_version", "v.kb_id = :kb AND v.since BETWEEN w.c0 AND w.c0")
    said = loops.loop("v", "revision_execution", "v.kb_id = :kb AND v.number BETWEEN w.c0 AND w.c0")
    found = f"SELECT w.c0, v.plan_id, v.position, NULL FROM {rows} AS w"
    loaded = f"SELECT w.c0, NULL, NULL, v.text FROM {rows} AS w{loads}"
    parts = f"{found}{acts} WHERE v.outcome <> 'refused' UNION {found}{said}"
    return Query(text(f"{parts} UNION ALL {loaded}"))


def find_origins(
    session: Session, kb_id: int, revisions: Collection[int]
) -> tuple[list[tuple[int, Key]], dict[int, str]]:
    """Find the executions that revisions name or record, and the documents they load."""
    query = _origins(session.loops)
    rows = session.rows(query, kb=kb_id, wanted=id_rows(revisions))
    acts = [(row[0], (row[1], row[2])) for row in rows if row[1] is not None]
    return acts, {row[0]: row[3] for row in rows if row[1] is None}

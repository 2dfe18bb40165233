"""What an act may have used: executions that may have, what held right before, what they changed.

All statements take rows of ids, so that their number depends on neither acts nor facts; each row
walks a bounded part of an index.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import text

from .dialects.base import Row, Session
from .dialects.words import NESTED_LOOPS, UNSOUGHT, NestedLoops, Walk, id_rows
from .executions import Key
from .intervals import FIND, FIND_VALUE, forks_at
from .query import Query

# Executions of an action or with an object, beyond which they are looked for by revision, and how
# many revisions that searches.
FEW = 2_000
# How many revisions for each execution that is wanted are searched before those.
NEAR = 4
# A predicate (True) or a function, its id, and the ids of objects.
Atom = tuple[bool, int, tuple[int, ...]]
_ATOMS = {True: ("proposition", "predicate"), False: ("function_value", "function")}


class WantedActs(NamedTuple):
    """Executions of an action with objects in two places, whose outcome was set in a range.

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
def _counts(dialect: str) -> Query:
    rows = NESTED_LOOPS[dialect].rows("ids", 2)
    some = (
        f"SELECT 1 FROM {table} AS c WHERE c.kb_id = :kb AND c.{column} = w.id{n} LIMIT {FEW + 1}"
        for n, (table, column) in enumerate(
            (("execution", "action_id"), ("execution_argument", "object_id"))
        )
    )
    counts = ", ".join(f"(SELECT count(*) FROM ({each}) AS few)" for each in some)
    return Query(text(f"SELECT w.id0, w.id1, {counts} FROM {rows} AS w"))


_OBJECT, _ACTION, _RANGE = "object", "action", "range"
_SAME = "{0}.kb_id = :kb AND {0}.plan_id = {1}.plan_id AND {0}.position = {1}.position"


def _found_by(loops: NestedLoops, by: str, is_planned: bool) -> str:
    """Select the executions, or the steps of plans, that one access finds."""
    execution = f"{_SAME.format('x', 'a' if by == _OBJECT else 'v')} AND x.action_id = w.id0"
    span = "BETWEEN w.id3 AND w.id4"
    end, last = "v.since", f"{_SAME.format('v', 'x')} AND v.since {span}"
    table, at = "execution_version", f"v.kb_id = :kb AND v.since {span}"
    if is_planned:
        table, end = "plan", "v.revision"
        last = f"v.kb_id = :kb AND v.id = x.plan_id AND v.revision {span}"
    if by == _OBJECT:
        argument = "a.kb_id = :kb AND a.object_id = w.id1 AND a.argument = w.id2"
        found = loops.loop("a", "execution_argument", argument)
        found += loops.loop("x", "execution", execution) + loops.loop("v", table, last)
    elif by == _ACTION:
        own = "x.kb_id = :kb AND x.action_id = w.id0"
        found = loops.loop("x", "execution", own) + loops.loop("v", table, last)
    else:
        found = loops.loop("v", table, at) + loops.loop("x", "execution", execution)
    rest = "1 = 1" if is_planned else "v.outcome <> 'refused'"
    for object_, place in (("id5", "id6"),) if by == _OBJECT else (("id1", "id2"), ("id5", "id6")):
        named = f"{_SAME.format('n', 'x')} AND n.argument = w.{place}"
        named = f"SELECT 1 FROM execution_argument AS n WHERE {named} AND n.object_id + 0"
        rest += f" AND (w.{object_} = 0 OR EXISTS ({named} = w.{object_}))"
    wanted = f"SELECT x.plan_id, x.position, {end} AS revision, {int(is_planned)} AS planned"
    return f"{wanted} FROM {loops.rows(f'by_{by}', 7)} AS w{found} WHERE {rest}"


@cache
def _acts(dialect: str, accesses: tuple[str, ...]) -> Query:
    loops = NESTED_LOOPS[dialect]
    parts = [_found_by(loops, by, False) for by in accesses]
    # What was planned from a state is found by the plan's own index, not by that of revisions.
    parts += [_found_by(loops, by, True) for by in accesses if by != _RANGE]
    rows = f"SELECT DISTINCT * FROM ({' UNION ALL '.join(parts)}) AS found"
    order = "planned, revision DESC, plan_id DESC, position DESC"
    return Query(text(f"{rows} ORDER BY {order} LIMIT :size"))


def find_acts(
    session: Session, kb_id: int, wanted: Collection[WantedActs], size: int
) -> tuple[list[FoundAct], int]:
    """Find executions, the newest first, and steps of plans behind, in two or three statements.

    Returns:
        What was found, and the first revision from which on all of it is.
    """
    dialect, searched = session.backend.dialect.name, 0
    pairs = {(one.action, id_) for one in wanted for id_ in (one.object, one.other)}
    counts = {
        (row[0], row[1]): (row[2], row[3] if row[1] else FEW + 1)
        for row in session.rows(_counts(dialect), kb=kb_id, ids=json.dumps([*pairs]))
    }
    by: defaultdict[str, list[WantedActs]] = defaultdict(list)
    for each in wanted:
        one = each
        if counts[one.action, one.other][1] < counts[one.action, one.object][1]:
            rest = {"other": one.object, "place": one.argument}
            one = one._replace(object=one.other, argument=one.place, **rest)
        of_action, of_object = counts[one.action, one.object]
        if of_object <= FEW:
            by[_OBJECT].append(one)
        elif of_action <= FEW:
            by[_ACTION].append(one)
        else:
            low = max(one.low, one.high - FEW)
            searched = max(searched, low if low > one.low else 0)
            by[_RANGE].append(one._replace(low=low))
    if not by:
        return [], searched
    lists = {f"by_{access}": json.dumps(rows) for access, rows in by.items()}
    query, ranges = _acts(dialect, tuple(sorted(by))), by[_RANGE]
    # Where acts are frequent, the newest are in a few revisions: a statement more where not.
    near = [one._replace(low=max(one.low, one.high - NEAR * size)) for one in ranges]
    rows: list[Row] = []
    if near != ranges:
        given = {**lists, f"by_{_RANGE}": json.dumps(near)}
        rows = session.rows(query, kb=kb_id, size=size, **given)
        low = max(one.low for one in near)
    if len(rows) < size or rows[-1][3] or rows[-1][2] < low:
        rows = session.rows(query, kb=kb_id, size=size, **lists)
    return [FoundAct((row[0], row[1]), row[2], bool(row[3])) for row in rows], searched


class HeldVersion(NamedTuple):
    """The last version up to a revision: its ends (None: open), and its value, if it is one."""

    since: int
    until: int | None
    value: str | int | None = None


@cache
def _versions(dialect: str, is_fact: bool, is_whole: bool) -> Query:
    """Read the last version of each identity up to a revision; or what held of each owner."""
    loops, (identity, owner) = NESTED_LOOPS[dialect], _ATOMS[is_fact]
    value = "NULL, NULL" if is_fact else "v.value, v.object_id"
    table, goal = f"{identity}_version", " AND v.is_goal = :is_goal" if is_fact else ""
    if not is_whole:
        walk = Walk("l", table, f"{identity}_id", "w.id0")
        last = loops.last(walk, "w.id1", "l.since")
        found = loops.loop("v", table, f"v.kb_id = :kb AND v.{identity}_id = w.id0"
                           f" AND v.since = {last}")  # fmt: skip
        wanted = f"w.id0, w.id1, v.since, v.until, {value}"
        return Query(text(f"SELECT {wanted} FROM {loops.rows('wanted', 2)} AS w{found}"))
    held = f"{UNSOUGHT[dialect]}v.since <= w.id2 AND (v.until IS NULL OR v.until > w.id2){goal}"
    found = loops.loop(
        "v", table, f"v.kb_id = :kb AND v.{owner}_id = w.id0 AND v.fork = w.id1 AND {held}"
    )
    found += loops.loop("i", identity, f"i.kb_id = :kb AND i.id = v.{identity}_id")
    wanted = f"w.id0, w.id2, i.arguments, v.since, v.until, {value}"
    return Query(text(f"SELECT {wanted} FROM {loops.rows('wanted', 3)} AS w{found}"))


class PastReader:
    """Reads which versions of facts and values there were at many revisions at once."""

    def __init__(self, session: Session, kb_id: int) -> None:
        self._session = session
        self._kb_id = kb_id
        self._ids: dict[Atom, int | None] = {}
        # What was read; None: nothing.
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
            for id_, at, since, until, *value in self._rows(is_fact, False, places):
                held = HeldVersion(since, until, _value(*value))
                self._held |= {(atom, at): held for atom in places[id_, at]}
        return {one: last for one in wanted if (last := self._held[one]) is not None}

    def whole(self, wanted: Collection[tuple[bool, int, int]]) -> Iterator[tuple[Atom, int, Any]]:
        """Yield all that held of predicates and functions at revisions, with those and values."""
        for is_fact in (True, False):
            asked = [
                (owner, fork, at)
                for is_own, owner, at in wanted
                if is_own == is_fact
                for fork in forks_at(at)
            ]
            for owner, at, arguments, _, _, *value in self._rows(is_fact, True, asked):
                yield (is_fact, owner, _objects(arguments)), at, _value(*value)

    def _rows(self, is_fact: bool, is_whole: bool, asked: Iterable[Sequence[int]]) -> list[Row]:
        rows = [*asked]
        if not rows:
            return []
        query = _versions(self._session.backend.dialect.name, is_fact, is_whole)
        goal = {"is_goal": False} if is_fact and is_whole else {}
        return self._session.rows(query, kb=self._kb_id, wanted=json.dumps(rows), **goal)

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
    """What a revision made of a fact or a value, until the next one; its text has no value."""

    revision: int
    atom: Atom
    holds: bool
    until: int | None
    text: str


@cache
def _changed(dialect: str) -> Query:
    loops, parts = NESTED_LOOPS[dialect], []
    for is_fact, (identity, owner) in _ATOMS.items():
        table, id_ = f"{identity}_version", f"{identity}_id"
        after = Walk("n", table, id_, f"v.{id_}")
        following = loops.part(after, "v.until - 1", "9223372036854775806", "1", "n.since")
        for end, until in (("since", "v.until"), ("until", f"({following})")):
            found = loops.loop("v", table, f"v.kb_id = :kb AND v.{end} BETWEEN w.id0 AND w.id0")
            found += loops.loop("i", identity, f"i.kb_id = :kb AND i.id = v.{id_}")
            rest = " WHERE NOT v.is_goal" if is_fact else ""
            wanted = f"w.id0, {int(is_fact)}, i.{owner}_id, i.arguments, {int(end == 'since')}"
            rows = loops.rows("wanted", 1)
            parts.append(f"SELECT {wanted}, {until}, i.text FROM {rows} AS w{found}{rest}")
    return Query(text(" UNION ALL ".join(parts)))


def changed_atoms(session: Session, kb_id: int, revisions: Iterable[int]) -> list[ChangedAtom]:
    """Read which facts and values revisions changed."""
    query = _changed(session.backend.dialect.name)
    rows = session.rows(query, kb=kb_id, wanted=id_rows(revisions))
    found = [
        ChangedAtom(number, (bool(fact), owner, _objects(arguments)), bool(began), *rest)
        for number, fact, owner, arguments, began, *rest in rows
    ]
    set_again = {(one.revision, one.atom) for one in found if one.holds}
    # A value that is replaced ends where the next one begins.
    return [one for one in found if one.holds or (one.revision, one.atom) not in set_again]


@cache
def _origins(dialect: str) -> Query:
    loops, rows = NESTED_LOOPS[dialect], NESTED_LOOPS[dialect].rows("wanted", 1)
    # As an equality, SQLite prefers the primary key, and reads all of the knowledge base.
    acts = loops.loop("v", "execution_version", "v.kb_id = :kb AND v.since BETWEEN w.id0 AND w.id0")
    loads = loops.loop("v", "document_version", "v.kb_id = :kb AND v.since BETWEEN w.id0 AND w.id0")
    found = f"SELECT w.id0, v.plan_id, v.position, NULL FROM {rows} AS w{acts}"
    loaded = f"SELECT w.id0, NULL, NULL, v.text FROM {rows} AS w{loads}"
    return Query(text(f"{found} WHERE v.outcome <> 'refused' UNION ALL {loaded}"))


def find_origins(
    session: Session, kb_id: int, revisions: Collection[int]
) -> tuple[list[tuple[int, Key]], dict[int, str]]:
    """Find the executions whose outcomes revisions set, and the documents that they loaded."""
    query = _origins(session.backend.dialect.name)
    rows = session.rows(query, kb=kb_id, wanted=id_rows(revisions))
    acts = [(row[0], (row[1], row[2])) for row in rows if row[1] is not None]
    return acts, {row[0]: row[3] for row in rows if row[1] is None}

"""A store of a fleet's past, generated in bulk: many knowledge bases, millions of changes.

In each knowledge base ten robots move between 200 waypoints, 300 things are put down elsewhere, 40
doors open and close, and each robot's battery level changes. So facts come and go all the time,
and what holds at any moment is about as much as at any other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime, timedelta
from random import Random
from typing import Any, NamedTuple

import kant_sql
from kant_sql.knowledge.canonical import FORM, time_text
from kant_sql.sql.intervals import fork
from tests.benchmarks.drivers import Driver, Row, bare

START = datetime(2024, 1, 1, tzinfo=UTC)
STEP = timedelta(seconds=10)
ROBOTS, WAYPOINTS, THINGS, DOORS = 10, 200, 300, 40
# Of 100 revisions, so many are of each sort; a revision retracts one fact and asserts another.
SORTS = (("robot_at", 50), ("thing_at", 20), ("door_open", 10), ("level", 20))
DOMAIN = """
(define (domain fleet) (:requirements :strips :typing :numeric-fluents)
  (:types robot wp thing door)
  (:predicates (robot_at ?r - robot ?w - wp) (thing_at ?t - thing ?w - wp)
               (door_open ?d - door) (door_closed ?d - door))
  (:functions (level ?r - robot)))
"""
# So many facts are written at once.
CHUNK = 100_000
# The predicate or the function, and what it is of; of a value, the value is last.
Key = tuple[Any, ...]


def problem() -> str:
    """Write the first state: what there is, and where."""
    names = {"robot": ROBOTS, "wp": WAYPOINTS, "thing": THINGS, "door": DOORS}
    objects = " ".join(
        f"{' '.join(f'{type_}{n}' for n in range(count))} - {type_}"
        for type_, count in names.items()
    )
    return f"(define (problem now) (:domain fleet) (:objects {objects}) (:init) (:goal (and)))"


class Version(NamedTuple):
    """A fact, or a value, from one revision until another."""

    key: Key
    since: int
    until: int | None


def simulate(changes: int, seed: int, first: int) -> Iterator[Version]:
    """Give the versions of a history of so many changes, as they end; then those that hold."""
    random = Random(seed)
    sorts = [sort for sort, share in SORTS for _ in range(share)]
    held: dict[tuple[str, int], tuple[int, int]] = {}
    subjects = {"robot_at": ROBOTS, "thing_at": THINGS, "door_open": DOORS, "level": ROBOTS}
    targets = {"robot_at": WAYPOINTS, "thing_at": WAYPOINTS, "door_open": 2, "level": 100}
    for sort, count in subjects.items():
        for subject in range(count):
            held[sort, subject] = (random.randrange(targets[sort]), first)
    for number in range(first + 1, first + 1 + changes // 2):
        sort = random.choice(sorts)
        subject = random.randrange(subjects[sort])
        target, since = held[sort, subject]
        yield Version((sort, subject, target), since, number)
        other = (target + random.randrange(1, targets[sort])) % targets[sort]
        held[sort, subject] = (other, number)
    for (sort, subject), (target, since) in held.items():
        yield Version((sort, subject, target), since, None)


def ids_of(store: Driver, kb: int) -> dict[tuple[str, str], int]:
    """Read the ids of what a knowledge base knows, by kind and name."""
    return {
        (kind, key): id_
        for kind in ("object", "predicate", "function")
        for key, id_ in store.execute(f"SELECT key, id FROM {kind} WHERE kb_id = ?", (kb,))
    }


class Writer:
    """Writes one knowledge base's past with the bare driver: the library would take hours."""

    level_of = "robot"  # what has levels

    def __init__(self, store: Driver, name: str) -> None:
        self.store = store
        ((self.kb,),) = store.execute("SELECT id FROM knowledge_base WHERE name = ?", (name,))
        head = "SELECT revision, next_id FROM head WHERE kb_id = ?"
        self.revision: int
        self.next_id: int
        ((self.revision, self.next_id),) = store.execute(head, (self.kb,))
        self.ids = ids_of(store, self.kb)
        self.atoms: dict[Key, int] = {}

    def write(self, versions: Iterable[Version], last: int) -> int:
        """Write versions after what there is, up to a last revision; gives that."""
        first = self.revision + 1
        facts: list[Row] = []
        values: list[Row] = []
        for key, since, until in versions:
            if key[0] == "level":
                values.append(self.value(key, since, until))
            else:
                facts.append(self.fact(key, since, until))
            if len(facts) == CHUNK:
                self.store.insert("proposition_version", len(facts[0]), facts)
                facts = []
        # What was written just now begins before what was generated.
        began = "UPDATE revision SET committed_at = ? WHERE kb_id = ? AND number < ?"
        self.store.execute(began, (self.moment(0), self.kb, first))
        self.store.insert("revision", 10, self.revisions(first, last))
        self.identities()
        for table, rows in (("proposition_version", facts), ("function_value_version", values)):
            if rows:
                self.store.insert(table, len(rows[0]), rows)
        self.store.execute(
            "UPDATE head SET revision = ?, next_id = ?, hash = ?, committed_at = ? WHERE kb_id = ?",
            (last, self.next_id, f"{last:064x}", self.moment(last), self.kb),
        )
        return last

    @staticmethod
    def moment(number: int) -> str:
        return time_text(START + number * STEP)

    def revisions(self, first: int, last: int) -> Iterator[Row]:
        for number in range(first, last + 1):
            actor = ("perception", "executive", "operator")[number % 3]
            said = None, None, FORM, f"{number:064x}", None, number.to_bytes(16)
            yield self.kb, number, self.moment(number), actor, *said

    def atom(self, key: Key) -> int:
        if key not in self.atoms:
            self.atoms[key] = self.next_id
            self.next_id += 1
        return self.atoms[key]

    def fact(self, key: Key, since: int, until: int | None) -> Row:
        predicate, names = self.parts(key)
        objects = (*(self.ids["object", name] for name in names), None)
        return (
            self.kb,
            self.atom(key),
            since,
            until,
            self.ids["predicate", predicate],
            False,
            fork(since, until),
            *objects[:2],
        )

    def value(self, key: Key, since: int, until: int | None) -> Row:
        _, subject, level = key
        fluent, function = self.atom(("level", subject, 0)), self.ids["function", "level"]
        text = f"(= (level {self.level_of}{subject}) {level})"
        value = (str(level), float(level), None, text, fork(since, until))
        return self.kb, fluent, since, until, function, *value

    @staticmethod
    def parts(key: Key) -> tuple[str, list[str]]:
        sort, subject, target = key
        if sort == "door_open":
            return ("door_open", "door_closed")[target], [f"door{subject}"]
        return sort, [f"{sort.removesuffix('_at')}{subject}", f"wp{target}"]

    def identities(self) -> None:
        propositions, arguments = [], []
        fluents, fluent_arguments = [], []
        for key, id_ in self.atoms.items():
            if key[0] == "level":
                name, function = f"{self.level_of}{key[1]}", self.ids["function", "level"]
                owner = self.ids["object", name]
                fluents.append((self.kb, id_, function, str(owner), f"(level {name})"))
                fluent_arguments.append((self.kb, id_, 0, owner))
                continue
            predicate, names = self.parts(key)
            objects = [self.ids["object", name] for name in names]
            text = f"({' '.join([predicate, *names])})"
            ids = " ".join(map(str, objects))
            own = self.ids["predicate", predicate], False, ids, text
            propositions.append((self.kb, id_, *own))
            arguments += [(self.kb, id_, n, object_) for n, object_ in enumerate(objects)]
        self.store.insert("proposition", 6, propositions)
        self.store.insert("proposition_argument", 4, arguments)
        self.store.insert("function_value", 5, fluents)
        self.store.insert("function_value_argument", 4, fluent_arguments)


def fill(url: str, changes: int, knowledge_bases: int = 10) -> int:
    """Fill `robot0` and so on with so many changes in all; gives the last revision of each."""
    last = 0
    for number in range(knowledge_bases):
        with kant_sql.connect(url, knowledge_base=f"robot{number}") as kb:
            kb.load_domain(DOMAIN)
            kb.load_problem(problem())
    store = bare(url)
    store.without_checks()
    for number in range(knowledge_bases):
        store.execute("BEGIN")
        writer = Writer(store, f"robot{number}")
        first, own = writer.revision + 1, changes // knowledge_bases
        last = writer.write(simulate(own, number, first), first + own // 2)
        store.execute("COMMIT")
    store.settle()
    store.close()
    return last

"""Reads of the present, beside the bare driver.

    python -m tests.benchmarks.present [--repeat 25] [--backends sqlite-file ...]

Both sides read one store, or equal ones in memory: what the coffee shop's robot knows after an
iteration, and a predicate with 300 facts. The bare driver does what a program of one's own would
do: it runs one SELECT, on a connection that it keeps, and makes tuples of its rows that say what
the DTOs say, with the names and types of objects and predicates that it has cached for good. So it
checks neither that these are still right, which the library does in each read, nor that the rows
make sense, and its results share what is immutable, where the library's DTOs are the caller's own.
Calls alternate; the table has medians. Aim: at most 3 times the bare driver.
"""

from __future__ import annotations

import argparse
import sqlite3
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from statistics import median
from typing import Any

import kant_sql
from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.benchmarks.coffee_shop import library_steps, play
from tests.benchmarks.drivers import Driver, PsycopgDriver, Row, SqliteDriver
from tests.benchmarks.recording import KNOWLEDGE_BASE, record
from tests.benchmarks.support import alternate, print_table
from tests.support.servers import Server

BACKENDS = ("sqlite-file", "sqlite-memory", "postgresql")
REPEAT = 25
# A call is repeated so often in each of its turns.
CALLS = 200
MANY = 300
PROPOSITIONS = """
    SELECT p.predicate_id, p.arguments, p.is_goal FROM proposition_version v
    JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
    WHERE v.kb_id = 1 AND v.until IS NULL
"""
OF_PREDICATE = f"{PROPOSITIONS} AND v.predicate_id = ? AND v.is_goal = 0"
# As the condition of the index says it, which SQLite takes by the letter.
GOALS = f"{PROPOSITIONS} AND v.is_goal = 1"
OBJECT = """
    SELECT o.name, v.type_id FROM object o
    JOIN object_version v ON v.kb_id = o.kb_id AND v.object_id = o.id
    WHERE o.kb_id = 1 AND o.key = ? AND v.until IS NULL
"""
# All of an action but its parameters, a row for each term; a robot's actions are flat lists.
ACTION = """
    SELECT e.id, v.since, n.section, n.position, n.operator, n.predicate_id, n.value,
      t.parameter, t.object_id
    FROM action e
    JOIN action_version v ON v.kb_id = e.kb_id AND v.action_id = e.id
    JOIN action_node n ON n.kb_id = v.kb_id AND n.action_id = v.action_id AND n.since = v.since
    LEFT JOIN action_term t ON t.kb_id = n.kb_id AND t.action_id = n.action_id
      AND t.since = n.since AND t.section = n.section AND t.position = n.position
    WHERE e.kb_id = 1 AND e.key = ? AND v.until IS NULL
    ORDER BY n.section, n.position, t.term
"""
PARAMETERS = """
    SELECT p.name, t.type_id FROM action_parameter p
    JOIN action_parameter_type t ON t.kb_id = p.kb_id AND t.action_id = p.action_id
      AND t.since = p.since AND t.position = p.position
    WHERE p.kb_id = 1 AND p.action_id = ? AND p.since = ? ORDER BY p.position
"""
TYPES = """
    SELECT e.id, e.name, v.parent_id FROM type e
    JOIN type_version v ON v.kb_id = e.kb_id AND v.type_id = e.id
    WHERE e.kb_id = 1 AND v.until IS NULL
"""
OBJECTS = """
    SELECT e.id, e.name, v.type_id FROM object e
    JOIN object_version v ON v.kb_id = e.kb_id AND v.object_id = e.id
    WHERE e.kb_id = 1 AND v.until IS NULL
"""
PREDICATES = """
    SELECT e.id, e.name, t.type_id FROM predicate e
    JOIN predicate_version v ON v.kb_id = e.kb_id AND v.predicate_id = e.id
    LEFT JOIN predicate_parameter_type t
      ON t.kb_id = v.kb_id AND t.predicate_id = v.predicate_id AND t.since = v.since
    WHERE e.kb_id = 1 AND v.until IS NULL ORDER BY e.id, t.position
"""


class BareReader:
    """A program of one's own: a connection, and what it has cached of names and types."""

    def __init__(self, driver: Driver) -> None:
        self.run = driver.run
        is_sqlite = isinstance(driver, SqliteDriver)
        self.goals = GOALS if is_sqlite else GOALS.replace("is_goal = 1", "is_goal = true")
        self.facts = (
            OF_PREDICATE if is_sqlite else OF_PREDICATE.replace("v.is_goal = 0", "NOT v.is_goal")
        )
        rows: list[Row] = self.run(TYPES).fetchall()
        self.types: dict[int, Row] = {}
        above = {id_: (name, parent) for id_, name, parent in rows}
        for id_ in above:
            self.types[id_] = self.type(id_, above)
        self.objects: dict[int, Row] = {
            id_: (self.types[type_id], name) for id_, name, type_id in self.run(OBJECTS).fetchall()
        }
        self.predicates: dict[int, Row] = {}
        rows = self.run(PREDICATES).fetchall()
        for (id_, name), group in groupby(rows, key=lambda row: row[:2]):
            types = tuple(self.types[type_id] for *_, type_id in group if type_id is not None)
            self.predicates[id_] = (name, types)
        self.ids = {name.lower(): id_ for id_, (name, _) in self.predicates.items()}

    def type(self, id_: int, above: dict[int, tuple[str, int | None]]) -> Row:
        """Make a type, with the types above it."""
        name, parent = above[id_]
        return (name, None if parent is None else self.type(parent, above))

    def propositions(self, rows: list[Row]) -> list[Row]:
        """Make propositions of rows."""
        predicates, objects = self.predicates, self.objects
        return [
            (predicates[id_], tuple([objects[int(one)] for one in ids.split()]), bool(is_goal))
            for id_, ids, is_goal in rows
        ]

    def get_by_predicate(self, name: str) -> list[Row]:
        """Read the facts of a predicate."""
        return self.propositions(self.run(self.facts, (self.ids[name.lower()],)).fetchall())

    def get_goals(self) -> list[Row]:
        """Read the goals."""
        return self.propositions(self.run(self.goals).fetchall())

    def get_object(self, name: str) -> Row:
        """Read an object."""
        row: Any = self.run(OBJECT, (name.lower(),)).fetchone()
        return (self.types[row[1]], row[0])

    def get_action(self, name: str) -> Row:
        """Read a durative action of literals."""
        rows: list[Row] = self.run(ACTION, (name.lower(),)).fetchall()
        parameters = [
            (self.types[type_id], parameter)
            for parameter, type_id in self.run(PARAMETERS, rows[0][:2]).fetchall()
        ]
        duration = 0
        literals: dict[str, list[Row]] = {"condition": [], "effect": []}
        for (section, _, operator, predicate_id, value), group in groupby(
            rows, key=lambda row: row[2:7]
        ):
            if operator == "number":
                duration = int(value)
            elif operator.startswith(("at ", "over ")):
                time, is_negative = operator, False
            elif operator == "not":
                is_negative = True
            elif operator == "predicate":
                terms = tuple(
                    [
                        self.objects[object_id] if parameter is None else parameters[parameter]
                        for *_, parameter, object_id in group
                    ]
                )
                predicate = self.predicates[predicate_id]
                literals[section].append((predicate, terms, time, is_negative))
        return (name, parameters, duration, literals["condition"], literals["effect"])


def as_tuple(dto: Any) -> Any:
    """Say what a DTO says as the bare reader does."""
    match dto:
        case PddlTypeDto():
            return (dto.name, None if dto.parent is None else as_tuple(dto.parent))
        case PddlObjectDto():
            return (as_tuple(dto.type), dto.name)
        case PddlPredicateDto():
            return (dto.name, tuple(map(as_tuple, dto.types)))
        case PddlPropositionDto():
            return (as_tuple(dto.predicate), tuple(map(as_tuple, dto.objects)), dto.is_goal)
        case PddlConditionEffectDto():
            atom = as_tuple(dto.predicate), tuple(map(as_tuple, dto.objects))
            return (*atom, dto.time, dto.is_negative)
        case PddlActionDto():
            parts = ([*map(as_tuple, each)] for each in (dto.conditions, dto.effects))
            return (dto.name, [*map(as_tuple, dto.parameters)], dto.duration, *parts)
        case _:
            return [*map(as_tuple, dto)]


@contextmanager
def open_sides(backend: str, folder: Path) -> Iterator[tuple[KnowledgeBase, BareReader]]:
    """Fill a store, and open it twice."""
    if backend == "postgresql":
        server = Server(folder / "pg")
        try:
            url = server.new_database()
            kant_sql.upgrade(url)
            with filled(url) as kb:
                driver = PsycopgDriver(url)
                # The bare join is slow before the database has statistics.
                driver.run("ANALYZE")
                yield kb, BareReader(driver)
        finally:
            server._server.cleanup()
        return
    file = folder / f"{backend}.db"
    with filled(f"sqlite:///{file}") as kb:
        connection = sqlite3.connect(file)
        if backend == "sqlite-file":
            yield kb, BareReader(SqliteDriver(connection))
        else:
            memory = sqlite3.connect(":memory:")
            connection.backup(memory)
            with filled("sqlite://") as kb_in_memory:
                yield kb_in_memory, BareReader(SqliteDriver(memory))
            memory.close()
        connection.close()


@contextmanager
def filled(url: str) -> Iterator[KnowledgeBase]:
    """Fill a store with what the robot knows after an iteration, and more."""
    with (
        tempfile.TemporaryDirectory(prefix="kantbench") as folder,
        kant_sql.connect(url, knowledge_base=KNOWLEDGE_BASE) as kb,
    ):
        steps = [step for part in record(Path(folder)) for step in part]
        play(library_steps(steps, defaultdict(lambda: kb)))
        thing, place = PddlTypeDto("thing"), PddlTypeDto("place")
        seen = PddlPredicateDto("seen", [thing, place])
        kb.propositions.save_all(
            PddlPropositionDto(
                seen, [PddlObjectDto(thing, f"thing{n}"), PddlObjectDto(place, f"place{n % 20}")]
            )
            for n in range(MANY)
        )
        goal = PddlPropositionDto(
            seen, [PddlObjectDto(thing, "thing0"), PddlObjectDto(place, "place0")]
        )
        kb.goals.save(goal)
        yield kb


Read = tuple[str, Sequence[str], Callable[[str], Any], Callable[[str], Any], int]


def reads(kb: KnowledgeBase, bare: BareReader) -> list[Read]:
    """Give what is measured: the names that are asked for in turn, and how each side is asked."""
    counts = {name: len(kb.propositions.get_by_predicate(name)) for name in sorted(bare.ids)}
    few = [name for name, count in counts.items() if count < MANY]
    actions = [action.name for action in kb.actions.get_all()]
    objects = [object_.name for object_ in kb.objects.get_all()]
    by_predicate = kb.propositions.get_by_predicate, bare.get_by_predicate
    facts = sum(counts[name] for name in few) / len(few)
    return [
        (f"get_by_predicate, {facts:.1f} facts", few, *by_predicate, CALLS),
        (f"get_by_predicate, {MANY} facts", ["seen"], *by_predicate, CALLS // 20),
        (
            "get_goals",
            [""],
            lambda _: kb.goals.get_propositions(),
            lambda _: bare.get_goals(),
            CALLS,
        ),
        ("actions.get", actions, kb.actions.get, bare.get_action, CALLS),
        ("objects.get", objects, kb.objects.get, bare.get_object, CALLS),
    ]


def measure(read: Read, repeat: int) -> tuple[float, float]:
    """Measure one kind of read; gives seconds for each call, bare and by the library."""
    _, names, library, bare, calls = read
    for name in names:
        expected, found = bare(name), as_tuple(library(name))
        assert found == expected or sorted(map(str, found)) == sorted(map(str, expected)), name
    asked = (list(names) * calls)[:calls]

    def all_of(call: Callable[[str], Any]) -> Callable[[], None]:
        def run() -> None:
            for name in asked:
                call(name)

        return run

    taken = alternate(repeat, lambda _: all_of(bare), lambda _: all_of(library), clean=True)
    return median(taken[0]) / calls, median(taken[1]) / calls


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--repeat", type=int, default=REPEAT)
    parser.add_argument("--backends", nargs="+", choices=BACKENDS, default=BACKENDS)
    options = parser.parse_args(argv)
    lines: dict[str, list[str]] = {}
    for backend in options.backends:
        with (
            tempfile.TemporaryDirectory(prefix="kantbench", ignore_cleanup_errors=True) as folder,
            open_sides(backend, Path(folder)) as sides,
        ):
            for read in reads(*sides):
                bare, library = measure(read, options.repeat)
                cell = f"{1e6 * bare:.0f} {1e6 * library:6.0f} {library / bare:6.2f}"
                lines.setdefault(read[0], []).append(cell)
    title = "Reads of the present: bare us, kant_sql us, ratio"
    print_table(title, ["", *options.backends], [[name, *cells] for name, cells in lines.items()])
    return 0


if __name__ == "__main__":
    sys.exit(main())

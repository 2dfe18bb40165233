"""What a million closed rows of history cost those who only want the present.

    python -m tests.benchmarks.history [--rows 1000000] [--backend sqlite]

One store has the present only; the others have the same present with a past behind it:

- hot: 200 facts came and went in turn, one a revision, 5,000 times each;
- dead: a million different facts, each held once, for one revision;
- goals: the same with goals.

The past is loaded by the bare driver, for the library would take an hour. On PostgreSQL, VACUUM
ANALYZE follows, as autovacuum would have done long before, and commits do not wait for the disk;
SQLite has no statistics, as always with the library. Calls on the stores alternate; the table has
lower quartiles, for what else the machine does only ever adds to a time, and how often the time of
the store without a past they are. Aim: at most 1.2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice, product
from typing import Any, NamedTuple

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from tests.benchmarks.drivers import Driver, bare
from tests.benchmarks.support import alternate, print_table, read_options, seconds, stores
from tests.benchmarks.years import Key, Version, Writer

SIDE = 1_000
HOT = 200
PER_REVISION = 100
NEAR, LIT, GOALS = 2_000, 100, 20
PLACE = PddlTypeDto("place")
PREDICATES = {
    name: PddlPredicateDto(name, [PLACE] * arity)
    for name, arity in (("near", 2), ("lit", 1), ("visited", 2), ("fresh", 2))
}
Call = Callable[[], Any]


def fact(predicate: str, *places: int, is_goal: bool = False) -> PddlPropositionDto:
    objects = [PddlObjectDto(PLACE, f"p{place}") for place in places]
    return PddlPropositionDto(PREDICATES[predicate], objects, is_goal)


def define(kb: KnowledgeBase) -> None:
    """Save what facts are made of."""
    kb.objects.save_all(PddlObjectDto(PLACE, f"p{number}") for number in range(SIDE))
    kb.predicates.save_all(PREDICATES.values())


def save_present(kb: KnowledgeBase) -> None:
    """Save what holds now: of the past's facts, too, every tenth of the first ones."""
    near = islice(product(range(SIDE), range(50)), NEAR)
    kb.propositions.save_all(fact("near", *places) for places in near)
    kb.propositions.save_all(fact("lit", place) for place in range(LIT))
    kb.propositions.save_all(fact("visited", 0, place) for place in range(0, HOT, 10))
    kb.goals.save_all(fact("visited", 0, place, is_goal=True) for place in range(GOALS))


class Past(NamedTuple):
    """A history to be loaded."""

    name: str  # its name in the table
    atoms: int  # how many facts or goals there were
    is_goal: bool  # whether they were goals
    at_once: int  # how many came, and went, in one revision


def pasts(rows: int) -> tuple[Past, ...]:
    """Give the histories of so many rows each."""
    return (
        Past("hot", HOT, False, 1),
        Past("dead", rows, False, PER_REVISION),
        Past("goals", rows, True, PER_REVISION),
    )


class Visits(Writer):
    """Writes facts and goals of two places."""

    @staticmethod
    def parts(key: Key) -> tuple[str, list[str]]:
        return "visited", [f"p{place}" for place in key]


def load(store: Driver, past: Past, rows: int) -> None:
    """Load a history behind the last revision."""
    store.without_checks()
    store.execute("BEGIN")
    writer = Visits(store, "default")
    writer.is_goal = past.is_goal
    first = writer.revision + 1

    def versions() -> Iterator[Version]:
        for number in range(rows):
            since = first + number // past.at_once
            yield Version(divmod(number % past.atoms, SIDE), since, since + 1)

    writer.write(versions(), first + -(-rows // past.at_once))
    store.execute("COMMIT")


class Subject:
    """A store that is measured, by two knowledge bases on it, as two processes would have."""

    def __init__(self, url: str, past: Past | None, rows: int) -> None:
        self.url = url
        with kant_sql.connect(url) as kb:
            define(kb)
        store = bare(url)
        self.loading = seconds(lambda: load(store, past, rows)) if past is not None else 0.0
        store.close()
        with kant_sql.connect(url) as kb:
            save_present(kb)
        store = bare(url)
        store.settle()
        store.do_not_wait()
        store.close()
        self.kb = kant_sql.connect(url)
        self.other = kant_sql.connect(url)
        self.kb.propositions.get_all()
        self.other.propositions.get_all()

    def close(self) -> None:
        self.kb.close()
        self.other.close()


def open_and_read(subject: Subject) -> None:
    with kant_sql.connect(subject.url) as kb:
        kb.propositions.get_by_predicate("lit")


def move(subject: Subject, number: int) -> None:
    """Let a fact go and come again that has come and gone before."""
    hot = fact("visited", 0, 10 * (number % (HOT // 10)))
    assert subject.kb.propositions.delete(hot)
    assert subject.kb.propositions.insert(hot)


def move_in_turn(subject: Subject, number: int) -> None:
    """The same by two writers, so that neither may trust its cache."""
    hot = fact("visited", 0, 10 * (number % (HOT // 10)))
    assert subject.kb.propositions.delete(hot)
    assert subject.other.propositions.insert(hot)


def save_goal(subject: Subject, number: int) -> None:
    goal = fact("visited", 0, number % GOALS, is_goal=True)
    assert subject.kb.goals.delete(goal)
    assert subject.kb.goals.insert(goal)


def save_new(subject: Subject, number: int) -> None:
    places = (number // SIDE, number % SIDE)
    assert subject.kb.propositions.insert(fact("fresh", *places))


def delete_object(subject: Subject, number: int) -> None:
    """Delete an object that the past has facts of, and save it and its facts again."""
    place = PddlObjectDto(PLACE, f"p{number % LIT}")
    held = [dto for dto in subject.kb.propositions.get_all() if place in dto.objects]
    with subject.kb.transaction():
        assert subject.kb.objects.delete(place)
        subject.kb.objects.save(place)
        subject.kb.propositions.save_all(held)


OPERATIONS: dict[str, tuple[int, Callable[[Subject, int], Any]]] = {
    "get_all": (40, lambda subject, _: subject.kb.propositions.get_all()),
    "get_by_predicate, 2,000 facts": (
        40,
        lambda subject, _: subject.kb.propositions.get_by_predicate("near"),
    ),
    "get_by_predicate, 40 with a past": (
        200,
        lambda subject, _: subject.kb.propositions.get_by_predicate("visited"),
    ),
    "get_goals": (200, lambda subject, _: subject.kb.goals.get_propositions()),
    "open and get_by_predicate": (20, lambda subject, _: open_and_read(subject)),
    "delete and insert a fact": (300, move),
    "the same, two writers in turn": (300, move_in_turn),
    "delete and insert a goal": (300, save_goal),
    "insert a new fact": (600, save_new),
    "delete and restore an object": (20, delete_object),
}


def measure(subjects: dict[str, Subject]) -> Iterator[list[str]]:
    """Give the lines of the table."""
    for name, (repeat, operation) in OPERATIONS.items():

        def make(subject: Subject, operation: Any = operation) -> Callable[[int], Call]:
            return lambda number: lambda: operation(subject, number)

        times = alternate(repeat, *(make(subject) for subject in subjects.values()))
        first, *others = (taken[len(taken) // 4] for taken in times)
        ratios = [f"{1e3 * time:.2f}  {time / first:.2f}x" for time in others]
        yield [name, f"{1e3 * first:.2f}", *ratios]


def run(backend: str, new: Callable[[], str], rows: int) -> None:
    subjects = {"none": Subject(new(), None, 0)}
    for past in pasts(rows):
        subjects[past.name] = subject = Subject(new(), past, rows)
        print(f"{backend}, {past.name}: {rows:,} closed rows loaded in {subject.loading:.0f} s")
    header = [f"{backend}, ms", "no past", *list(subjects)[1:]]
    print_table(f"The present with {rows:,} closed rows behind it", header, measure(subjects))
    for subject in subjects.values():
        subject.close()


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(__doc__, argv, rows=1_000_000)
    with stores(options.backend) as places:
        for backend, new in places.items():
            run(backend, new, options.rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

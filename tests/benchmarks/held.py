"""When conditions held, in years of a fleet's past: how long that takes beside SQL by hand.

    python -m tests.benchmarks.held [--changes 5000000] [--small 50000] [--backend sqlite]

The stores are those of `asof.py`: 10 knowledge bases, one of which is asked. The SQL by hand begins
with the names in the condition, and gives each period with who began and ended it, when and why. It
walks the versions of the first fact, and looks up those of the other that overlap, as the library
does: a plain join on overlapping intervals reads all pairs. A condition with a negation, and a
rule, are evaluated at the revisions that touched their facts; nobody writes that by hand.

Calls alternate; the table has medians. The time by age shows one point in the past: whether a
condition held at a revision. Aims: a conjunction of two facts at 5 million changes below 50 ms, at
any past revision the same as now.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from statistics import median
from typing import Any, NamedTuple

import kant_sql
from tests.benchmarks.asof import AGES, NAME
from tests.benchmarks.support import Bare, alternate, bare, print_table, stores
from tests.benchmarks.years import DOORS, ROBOTS, THINGS, WAYPOINTS, fill

REPEAT = 31
Call = Callable[[], Any]
Make = Callable[[int], Call]

ID = "(SELECT id FROM {kind} WHERE kb_id = ? AND key = ?)"
FACT = (
    "(SELECT id FROM proposition WHERE kb_id = ? AND is_goal = false AND predicate_id = "
    + ID.format(kind="predicate")
    + " AND arguments = {arguments})"
)
NAMED = ID.format(kind="object")
ARGUMENTS = {1: f"CAST({NAMED} AS text)", 2: f"{NAMED} || ' ' || {NAMED}"}
ENDS = (
    "s.number, s.committed_at, s.actor, s.reason, u.number, u.committed_at, u.actor, u.reason"
    " FROM found LEFT JOIN revision s ON s.kb_id = found.kb_id AND s.number = found.since"
    " LEFT JOIN revision u ON u.kb_id = found.kb_id AND u.number = found.until ORDER BY found.since"
)
# {larger} and {smaller} of two numbers: the functions' names differ.
BOTH = (
    "WITH found AS (SELECT a.kb_id, {larger}(a.since, b.since) AS since,"
    " {smaller}(coalesce(a.until, b.until), coalesce(b.until, a.until)) AS until"
    " FROM proposition_version a CROSS JOIN proposition_version b"
    # That all begin after 0 tells SQLite which index to take.
    " WHERE a.kb_id = ? AND a.proposition_id = {first} AND a.since > 0 AND b.kb_id = a.kb_id"
    " AND b.proposition_id = {second} AND b.since >= coalesce((SELECT l.since"
    " FROM proposition_version l WHERE l.kb_id = a.kb_id AND l.proposition_id = b.proposition_id"
    " AND l.since <= a.since ORDER BY l.since DESC LIMIT 1), 0)"
    " AND b.since < coalesce(a.until, 9000000000000000000)"
    " AND (b.until IS NULL OR b.until > a.since)) SELECT " + ENDS
)


class Text(NamedTuple):
    """A ground fact by its names."""

    predicate: str
    objects: tuple[str, ...]

    def __str__(self) -> str:
        return f"({' '.join([self.predicate, *self.objects])})"


class Questions:
    """The questions; the n-th time that one is asked, it is about other facts."""

    def __init__(self, kb: kant_sql.KnowledgeBase, store: Bare, last: int) -> None:
        self.kb = kb
        self.store = store
        self.last = last
        self.is_sqlite = type(store).__name__ == "BareSqlite"
        ((self.kb_id,),) = store.execute("SELECT id FROM knowledge_base WHERE name = ?", (NAME,))

    def all(self) -> Iterator[tuple[str, Make, Make | None]]:
        """Give name, and what answers: the library, and the SQL by hand, if there is any."""
        for name, pair in (
            ("a fact and a door, both by name", self.door),
            ("two doors, often open", self.doors),
            ("two facts, seldom together", self.things),
        ):
            yield f"when: {name}", self.when(pair), self.by_hand(pair)
        yield "when: any robot where a thing is", self.free, None
        yield "when: one door and not another", self.negated, None
        yield "check_rules: never two doors", self.rule, None
        for age, part in AGES.items():
            yield (
                f"holds of two facts, {age}",
                self.point(max(int(self.last * part), 2 * REPEAT)),
                None,
            )

    @staticmethod
    def door(n: int) -> tuple[Text, Text]:
        at = Text("robot_at", (f"robot{n % ROBOTS}", f"wp{7 * n % WAYPOINTS}"))
        return at, Text("door_open", (f"door{n % DOORS}",))

    @staticmethod
    def doors(n: int) -> tuple[Text, Text]:
        first, second = n % DOORS, (n + 1) % DOORS
        return Text("door_open", (f"door{first}",)), Text("door_open", (f"door{second}",))

    @staticmethod
    def things(n: int) -> tuple[Text, Text]:
        waypoint = f"wp{11 * n % WAYPOINTS}"
        at = Text("robot_at", (f"robot{n % ROBOTS}", waypoint))
        return at, Text("thing_at", (f"thing{n % THINGS}", waypoint))

    def when(self, pair: Callable[[int], tuple[Text, Text]]) -> Make:
        def make(n: int) -> Call:
            first, second = pair(n)
            text = f"(and {first} {second})"
            return lambda: [*self.kb.when(text)]

        return make

    def by_hand(self, pair: Callable[[int], tuple[Text, Text]]) -> Make:
        larger, smaller = ("max", "min") if self.is_sqlite else ("greatest", "least")

        def make(n: int) -> Call:
            first, second = pair(n)
            sql = BOTH.format(
                larger=larger,
                smaller=smaller,
                first=FACT.format(arguments=ARGUMENTS[len(first.objects)]),
                second=FACT.format(arguments=ARGUMENTS[len(second.objects)]),
            )
            values: list[Any] = [self.kb_id]
            for text in (first, second):
                values += [self.kb_id, self.kb_id, text.predicate]
                for name in text.objects:
                    values += [self.kb_id, name]
            return lambda: self.store.execute(sql, tuple(values))

        return make

    def free(self, n: int) -> Call:
        text = f"(and (robot_at ?r ?w) (thing_at thing{n % THINGS} ?w))"
        return lambda: [*self.kb.when(text)]

    def negated(self, n: int) -> Call:
        first, second = self.doors(n)
        return lambda: [*self.kb.when(f"(and {first} (not {second}))")]

    def rule(self, n: int) -> Call:
        first, second = self.doors(n)
        return lambda: self.kb.check_rules(f"(always (not (and {first} {second})))")

    def point(self, at: int) -> Make:
        def make(n: int) -> Call:
            first, second = self.doors(n)
            return lambda: self.kb.at(at - n).holds(f"(and {first} {second})")

        return make


def check(kb: kant_sql.KnowledgeBase, questions: Questions) -> None:
    """See that the SQL by hand finds the same periods."""
    for pair in (questions.door, questions.doors, questions.things):
        for n in range(3):
            found = questions.when(pair)(n)()
            own = [
                (held.since and held.since.number, held.until and held.until.number)
                for held in found
            ]
            assert own == [(row[0], row[4]) for row in questions.by_hand(pair)(n)()]


def measure(url: str, last: int) -> Iterator[tuple[str, float, float | None]]:
    """Give each question with the seconds of the library and of the SQL by hand."""
    store = bare(url)
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        questions = Questions(kb, store, last)
        check(kb, questions)
        for name, library, by_hand in questions.all():
            makes = [library] if by_hand is None else [library, by_hand]
            for make in makes:
                make(0)()
            taken = alternate(REPEAT, *makes)
            yield name, median(taken[0]), median(taken[1]) if by_hand else None
    store.close()


def run(backend: str, new: Callable[[], str], sizes: Sequence[int]) -> None:
    found: dict[str, list[tuple[float, float | None]]] = {}
    for changes in sizes:
        url = new()
        last = fill(url, changes)
        for name, library, by_hand in measure(url, last):
            found.setdefault(name, []).append((library, by_hand))
    header = [f"{backend}, ms"]
    for changes in sizes:
        header += [f"{changes:,} changes", "by hand", "ratio"]
    rows = []
    for name, times in found.items():
        row = [name]
        for library, by_hand in times:
            row.append(f"{1e3 * library:.2f}")
            row += (
                ["", ""]
                if by_hand is None
                else [
                    f"{1e3 * by_hand:.2f}",
                    f"{library / by_hand:.2f}x",
                ]
            )
        rows.append(row)
    print_table("When conditions held, median", header, rows)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--changes", type=int, default=5_000_000, help="of the large store")
    parser.add_argument("--small", type=int, default=50_000, help="of the small one")
    parser.add_argument("--backend", choices=["sqlite", "postgresql"], action="append")
    options = parser.parse_args(argv)
    with stores(options.backend or ["sqlite", "postgresql"]) as places:
        for backend, new in places.items():
            run(backend, new, [options.small, options.changes])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

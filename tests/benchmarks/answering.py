"""Questions to what holds now, beside the best SQL by hand: literals, conjunctions, closures.

    python -m tests.benchmarks.answering [--facts 100000 1000000] [--edges 10000] [--backend sqlite]

Both sides read one store, loaded a moment ago, of which the database has no statistics. By hand is
what somebody writes for just this question and this store: one prepared statement on a connection
that is kept, over the ids of names that are known for good, in the join order that is best for
these facts; on PostgreSQL the planner is kept to that order, which it could not find without
statistics. Its rows become tuples of names, as those of the library. It checks nothing: not that
the names are still those, nor that the condition is well-formed.

Calls alternate; the table has medians. Aims: a ground literal below 0.15 ms on SQLite, and in at
most 1.5 times the time by hand; a conjunction in at most 1.3 times that plus 0.3 ms; a closure in
at most 1.5 times that of a recursive statement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from random import Random
from statistics import median
from typing import Any, NamedTuple

import kant_sql
from tests.benchmarks import warehouse
from tests.benchmarks.drivers import Row, bare
from tests.benchmarks.support import alternate, print_table, read_options, stores
from tests.benchmarks.years import ids_of

ROUNDS, PREPARED = 25, 12
# A literal is asked for so often in each of its turns.
CALLS = 200
GRAPHS = """
(define (domain graphs) (:requirements :strips :typing :derived-predicates)
  (:types node)
  (:predicates (edge ?a ?b - node) (reach ?a ?b - node))
  (:derived (reach ?a ?b - node)
    (or (edge ?a ?b) (exists (?c - node) (and (edge ?a ?c) (reach ?c ?b))))))
"""


class Measured(NamedTuple):
    """One question.

    Attributes:
        name: what it is.
        library: the seconds of the library.
        by_hand: the seconds of the SQL by hand.
        aim: by how much the library may be slower, and how many seconds more.
    """

    name: str
    library: float
    by_hand: float
    aim: tuple[float, float]

    def row(self) -> list[str]:
        """Write it as a row of the table."""
        factor, more = self.aim
        is_met = self.library <= factor * self.by_hand + more
        aim = f"{factor:g}x" + (f" + {1e3 * more:g} ms" if more else "")
        ratio = self.library / self.by_hand
        numbers = [f"{1e3 * self.library:.3f}", f"{1e3 * self.by_hand:.3f}", f"{ratio:.2f}x"]
        return [self.name, *numbers, aim, "yes" if is_met else "no"]


class Conjunction(NamedTuple):
    """A conjunction, and how somebody joins it by hand.

    Attributes:
        name: what it is.
        text: the condition.
        objects: the variables that are given an object in each call, with their types.
        columns: the variables to select, as columns.
        tables: the predicates in the order of the join, each with what it is joined by; `?` stands
            for a given object.
        negated: the predicate that must not hold, and of which column.
    """

    name: str
    text: str
    objects: tuple[tuple[str, str], ...]
    columns: str
    tables: tuple[tuple[str, str], ...]
    negated: tuple[str, str]

    def given(self, number: int) -> dict[str, str]:
        """Give the objects of a call."""
        return {name: f"{kind}{number % warehouse.ZONES}" for name, kind in self.objects}


CONJUNCTIONS = (
    Conjunction(
        "of one robot",
        "(and (robot_at ?r ?p) (stock ?a ?p) (fetches ?r ?a) (not (reserved ?a)))",
        (("r", "robot"),),
        "a.second, b.first",
        (
            ("robot_at", "first = ?"),
            ("stock", "second = a.second"),
            ("fetches", "first = a.first AND second = b.first"),
        ),
        ("reserved", "b.first"),
    ),
    Conjunction(
        "of one article",
        "(and (stock ?a ?p) (robot_at ?r ?p) (fetches ?r ?a) (not (blocked ?p)))",
        (("a", "article"),),
        "a.second, b.first",
        (
            ("stock", "first = ?"),
            ("robot_at", "second = a.second"),
            ("fetches", "first = b.first AND second = a.first"),
        ),
        ("blocked", "a.second"),
    ),
    Conjunction(
        "of one zone",
        "(and (robot_at ?r ?p) (next_to ?p ?q) (in_zone ?q ?z) (not (blocked ?q)))",
        (("z", "zone"),),
        "c.first, b.first, a.first",
        (
            ("in_zone", "second = ?"),
            ("next_to", "second = a.first"),
            ("robot_at", "second = b.first"),
        ),
        ("blocked", "a.first"),
    ),
    Conjunction(
        "of all robots",
        "(and (stock ?a ?p) (fetches ?r ?a) (robot_at ?r ?p) (not (reserved ?a)))",
        (),
        "b.first, a.second, a.first",
        (
            ("robot_at", ""),
            ("stock", "second = a.second"),
            ("fetches", "first = a.first AND second = b.first"),
        ),
        ("reserved", "b.first"),
    ),
    Conjunction(
        "of all places",
        "(and (in_zone ?p ?z) (next_to ?p ?q) (in_zone ?q ?z) (not (blocked ?q)))",
        (),
        "a.first, a.second, b.second",
        (
            ("in_zone", ""),
            ("next_to", "first = a.first"),
            ("in_zone", "first = b.second AND second = a.second"),
        ),
        ("blocked", "b.second"),
    ),
)


class ByHand:
    """Questions on the bare driver."""

    def __init__(self, url: str) -> None:
        self.driver = bare(url)
        self.is_sqlite = url.startswith("sqlite")
        self.ids = ids_of(self.driver, 1)
        rows = self.driver.run("SELECT id, name FROM object WHERE kb_id = 1").fetchall()
        self.names: dict[int, str] = dict(rows)

    def live(self, alias: str, predicate: str, more: str = "") -> str:
        """Write that a version is that of a fact of a predicate, which holds now."""
        is_fact = f"{alias}.is_goal = 0" if self.is_sqlite else f"NOT {alias}.is_goal"
        found = (
            f"{alias}.kb_id = 1 AND {alias}.predicate_id = {self.ids['predicate', predicate]}"
            f" AND {is_fact} AND {alias}.until IS NULL"
        )
        for condition in more.split(" AND ") if more else ():
            found += f" AND {alias}.{condition}"
        return found

    def join(self, asked: Conjunction) -> str:
        """Write the join of a conjunction, in its order."""
        tables, where = [], []
        for alias, (predicate, more) in zip("abc", asked.tables, strict=False):
            held = self.live(alias, predicate, more)
            table = f"proposition_version AS {alias}"
            if self.is_sqlite:
                where.append(held)
            else:
                # No other way keeps the planner to an order, and to the index for each table.
                table = f"LATERAL (SELECT {alias}.* FROM {table} WHERE {held} OFFSET 0) AS {alias}"
            tables.append(table)
        predicate, column = asked.negated
        held = self.live("n", predicate, f"first = {column}")
        end = "" if self.is_sqlite else " OFFSET 0"
        where.append(f"NOT EXISTS (SELECT 1 FROM proposition_version AS n WHERE {held}{end})")
        order = ", ".join(str(n + 1) for n in range(len(asked.columns.split(","))))
        return self.written(
            f"SELECT {asked.columns} FROM {' CROSS JOIN '.join(tables)}"
            f" WHERE {' AND '.join(where)} ORDER BY {order}"
        )

    @staticmethod
    def written(sql: str) -> str:
        """Write the names of columns out."""
        return sql.replace(".first", ".first_object_id").replace(".second", ".second_object_id")

    def answers(self, sql: str, names: Iterable[str]) -> list[Row]:
        """Run a statement; return names."""
        values = [self.ids["object", name] for name in names]
        called = self.names
        return [
            tuple([called[id_] for id_ in row]) for row in self.driver.run(sql, values).fetchall()
        ]

    def holds(self, sql: str, names: Iterable[str]) -> bool:
        """Tell whether a statement has a row."""
        values = [self.ids["object", name] for name in names]
        return bool(self.driver.run(sql, values).fetchone())


def literals(
    kb: kant_sql.KnowledgeBase, hand: ByHand, facts: int, rounds: int
) -> Iterator[Measured]:
    """Ask for one ground literal after the other."""
    random = Random(2)
    held = [each[1:] for each in warehouse.situation(facts) if each[0] == "stock"]
    articles, places = warehouse.articles(facts), warehouse.PLACES
    missing = [
        (f"article{random.randrange(articles)}", f"place{random.randrange(places)}")
        for _ in range(CALLS)
    ]
    held_now = hand.live("a", "stock", "first = ? AND second = ?")
    sql = hand.written(f"SELECT 1 FROM proposition_version AS a WHERE {held_now}")
    for name, chosen in (("that hold", random.sample(held, CALLS)), ("at random", missing)):
        texts = [f"(stock {' '.join(names)})" for names in chosen]
        assert [kb.holds(text) for text in texts] == [hand.holds(sql, names) for names in chosen]

        def ask(_: int, texts: list[str] = texts) -> Callable[[], Any]:
            return lambda: [kb.holds(text) for text in texts]

        def ask_by_hand(_: int, chosen: Sequence[Sequence[str]] = chosen) -> Callable[[], Any]:
            return lambda: [hand.holds(sql, names) for names in chosen]

        library, by_hand = (median(each) / CALLS for each in alternate(rounds, ask, ask_by_hand))
        yield Measured(f"literals {name}, {facts:,} facts", library, by_hand, (1.5, 0))


def conjunctions(
    kb: kant_sql.KnowledgeBase, hand: ByHand, facts: int, rounds: int
) -> Iterator[Measured]:
    """Ask for the answers to conjunctions of three atoms and a negation."""
    for each in CONJUNCTIONS:

        def ask(number: int, each: Conjunction = each) -> Callable[[], Any]:
            given: dict[str, Any] = each.given(number)
            return lambda: list(kb.query(each.text, **given))

        def ask_by_hand(
            number: int, each: Conjunction = each, sql: str = hand.join(each)
        ) -> Callable[[], Any]:
            names = list(each.given(number).values())
            return lambda: hand.answers(sql, names)

        # So often that a driver and a server have prepared it for good.
        for number in range(PREPARED):
            found, wanted = ask(number)(), ask_by_hand(number)()
            assert sorted(map(sorted, found)) == sorted(map(sorted, wanted))
        library, by_hand = map(median, alternate(rounds, ask, ask_by_hand))
        name = f"conjunction {each.name}, {len(found):,} answers, {facts:,} facts"
        yield Measured(name, library, by_hand, (1.3, 0.0003))


def graph(edges: int) -> tuple[list[tuple[str, str]], dict[str, str]]:
    """Give the edges of a chain, a tree and a random graph, and where to begin in each."""
    random = Random(3)
    third = edges // 3
    found = [(f"c{n}", f"c{n + 1}") for n in range(third)]
    found += [(f"t{(n - 1) // 3}", f"t{n}") for n in range(1, third + 1)]
    nodes = third // 2
    numbers = {(random.randrange(nodes), random.randrange(nodes)) for _ in range(third)}
    found += [(f"g{one}", f"g{other}") for one, other in sorted(numbers)]
    return found, {
        "a chain": f"c{third // 10}",
        "a tree": "t1",
        "a random graph": found[2 * third][0],
    }


def reached(hand: ByHand, known: str, wanted: str) -> str:
    """Write what can be reached along edges, from the known end of each to the wanted one."""
    first = hand.live("a", "edge", f"{known} = ?")
    more = hand.live("b", "edge", f"{known} = reached.id")
    table = f"proposition_version AS b WHERE {more}"
    if hand.is_sqlite:
        step = f"SELECT b.{wanted} FROM reached CROSS JOIN {table}"
    else:
        step = f"SELECT b.{wanted} FROM reached CROSS JOIN LATERAL (SELECT b.* FROM {table}"
        step += " OFFSET 0) AS b"
    return hand.written(
        f"WITH RECURSIVE reached (id) AS (SELECT a.{wanted} FROM proposition_version AS a"
        f" WHERE {first} UNION {step}) SELECT id FROM reached ORDER BY id"
    )


def write_graph(url: str, edges: Sequence[tuple[str, str]]) -> None:
    """Load a graph."""
    nodes = dict.fromkeys(node for edge in edges for node in edge)
    facts = " ".join(f"(edge {one} {other})" for one, other in edges)
    with kant_sql.connect(url, knowledge_base=warehouse.NAME, actor="bench") as kb:
        kb.load_domain(GRAPHS)
        kb.load_problem(
            f"(define (problem p) (:domain graphs) (:objects {' '.join(nodes)} - node)"
            f" (:init {facts}) (:goal (and)))"
        )


def closures(url: str, starts: Mapping[str, str], rounds: int) -> Iterator[Measured]:
    """Ask what can be reached in a graph, and from where something can be reached."""
    hand = ByHand(url)
    onwards, back = reached(hand, "first", "second"), reached(hand, "second", "first")
    with closing(hand.driver), kant_sql.connect(url, knowledge_base=warehouse.NAME) as kb:
        for name, start in starts.items():
            for text, sql, said in (
                (f"(reach {start} ?x)", onwards, "from"),
                (f"(reach ?x {start})", back, "back from"),
            ):
                found, wanted = list(kb.query(text)), hand.answers(sql, [start])
                assert found == wanted
                for _ in range(PREPARED):
                    list(kb.query(text)), hand.answers(sql, [start])

                def ask(_: int, text: str = text) -> Callable[[], Any]:
                    return lambda: list(kb.query(text))

                def ask_by_hand(_: int, sql: str = sql, node: str = start) -> Callable[[], Any]:
                    return lambda: hand.answers(sql, [node])

                library, by_hand = map(median, alternate(rounds, ask, ask_by_hand))
                title = f"reached {said} a node of {name}, {len(found):,} answers"
                yield Measured(title, library, by_hand, (1.5, 0))


def run(
    backend: str, new: Callable[[], str], sizes: Sequence[int], edges: int, rounds: int
) -> None:
    """Measure one backend."""
    rows = []
    for facts in sizes:
        url = new()
        warehouse.fill(url, facts)
        hand = ByHand(url)
        with closing(hand.driver), kant_sql.connect(url, knowledge_base=warehouse.NAME) as kb:
            rows += [each.row() for each in literals(kb, hand, facts, rounds)]
            rows += [each.row() for each in conjunctions(kb, hand, facts, rounds)]
    written, starts = graph(edges)
    url = new()
    write_graph(url, written)
    rows += [each.row() for each in closures(url, starts, rounds)]
    header = [f"{backend}, ms", "kant_sql", "by hand", "ratio", "aim", "met"]
    print_table("Questions to what holds now, median", header, rows)


def main(argv: Sequence[str] | None = None) -> int:
    """Run it."""
    options = read_options(__doc__, argv, facts=[100_000, 1_000_000], edges=10_000, rounds=ROUNDS)
    with stores(options.backend) as places:
        for backend, new in places.items():
            run(backend, new, options.facts, options.edges, options.rounds)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

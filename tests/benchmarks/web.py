"""The pages of a store of a million revisions: how long the server takes for each of them.

    python -m tests.benchmarks.web [--changes 2000000] [--backend sqlite] [--requests 10000]

`kant-sql serve` runs as a process of its own, and is asked over one connection; each request of a
page is about another moment, element or part, so that no cache answers. The table has the median
and the slowest answer, HTTP included. Aims: 150 ms for each page, 300 ms for the first window of
the timeline. Then so many requests are made of all pages in turn, while the memory of the server is
measured: it is flat after the first of them.
"""

from __future__ import annotations

import http.client
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import NamedTuple
from urllib.parse import urlencode, urlsplit

import psutil

import kant_sql
from kant_sql import PddlPropositionDto, Plan, PlanStep
from tests.benchmarks.support import print_table, read_options, seconds, stores
from tests.benchmarks.years import START, STEP, fill
from tests.support.browsing import Serving
from tests.support.processes.commands import PROGRAM

NAME = "robot0"
AIM, AIM_OF_TIMELINE = 0.150, 0.300
PLANS, STEPS = 20, 50
ACTION = "(define (domain fleet) (:action wait :parameters (?r - robot) :effect (and)))"
Address = Callable[[int], str]


def plans(url: str) -> None:
    """Record what the generated history has not: plans, goals, reasons, an action."""
    with kant_sql.connect(url, knowledge_base=NAME, actor="planner") as kb:
        kb.load_domain(ACTION, mode="merge")
        robot_at = kb.predicates.get("robot_at")
        robot, place = kb.objects.get("robot1"), kb.objects.get("wp1")
        assert robot_at is not None
        assert robot is not None
        assert place is not None
        kb.goals.save(PddlPropositionDto(robot_at, [robot, place], is_goal=True))
        for number in range(PLANS):
            steps = [PlanStep(None, "wait", (f"robot{n % 10}",), None) for n in range(STEPS)]
            with kb.transaction(reason=f"goal {number}"):
                kb.plans.record(Plan(tuple(steps), "by hand", "solved_satisficing"))


def moment(number: int) -> str:
    """When a revision was made."""
    return (START + number * STEP).isoformat().replace("+00:00", "Z")


def address(path: str, **query: object) -> str:
    return f"{path}?{urlencode({'kb': NAME, **query})}"


class Known(NamedTuple):
    """What a store has that is asked for.

    Attributes:
        last: its last revision.
        facts: facts that held at one time or another.
        plans: the ids of its plans.
    """

    last: int
    facts: list[str]
    plans: list[int]


def known(url: str) -> Known:
    """Look up what there is to ask for."""
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        last = kb.revision
        facts = {
            str(fact)
            for part in range(1, 21)
            for fact in kb.at(last * part // 20).propositions.get_by_predicate("robot_at")
        }
        return Known(last, sorted(facts), [plan.id for plan in kb.plans.get_all()])


def pages(store: Known) -> dict[str, Address]:
    """Give the n-th address of each page."""
    last = store.last

    def at(n: int) -> int:
        # Over all of the past after the objects, and never twice.
        return 10 + (n + 1) * 618_033 % (last - 10)

    def fact(n: int) -> str:
        return store.facts[n * 7 % len(store.facts)]

    def plan(n: int) -> int:
        return store.plans[n % len(store.plans)]

    return {
        "/": lambda n: f"/?n={n}",
        "/api": lambda n: f"/api?n={n}",
        "/state": lambda n: address("/state", at=at(n)),
        "/state now": lambda n: address("/state", n=n),
        "/state of an object": lambda n: address("/state", at=at(n), object=f"robot{n % 10}"),
        "/difference, 100 revisions": lambda n: address("/difference", a=at(n), b=at(n) + 100),
        "/difference, everything": lambda n: address("/difference", a=1 + n, b=last),
        "/log": lambda n: address("/log", n=n),
        "/log of an actor": lambda n: address("/log", actor="operator", n=n),
        "/log of an element": lambda n: address("/log", element=fact(n)),
        "/log of a text": lambda n: address("/log", text=f"goal {n}"),
        "/revision": lambda n: address("/revision", number=at(n)),
        "/fact": lambda n: address("/fact", text=fact(n)),
        "/object": lambda n: address("/object", name=f"robot{n % 10}"),
        "/action": lambda n: address("/action", name="wait", n=n),
        "/plans": lambda n: address("/plans", n=n),
        "/plan": lambda n: address("/plan", id=plan(n)),
        "/given": lambda n: address("/given", id=plan(n)),
        "/type": lambda n: address("/type", name="robot", n=n),
        "/predicate": lambda n: address("/predicate", name="robot_at", n=n),
        "/function": lambda n: address("/function", name="level", n=n),
        "/search": lambda n: address("/search", q=f"robot{n % 10}"),
        "/search of a fact": lambda n: address("/search", q=f"robot_at robot{n % 10}"),
        "/ask": lambda n: address("/ask", condition=f"(robot_at robot{n % 10} ?w)", at=at(n)),
        "/ask when": lambda n: address(
            "/ask", condition=fact(n), mode="when", since=moment(at(n)), until=moment(at(n) + 5000)
        ),
        "/verify": lambda n: address("/verify", n=n),
        "/timeline": lambda n: address("/timeline", predicate="robot_at", n=n),
        "/timeline of everything": lambda n: address("/timeline", n=n),
        "/timeline of an object": lambda n: address("/timeline", object=f"robot{n % 10}"),
        "/timeline of an hour": lambda n: address(
            "/timeline", predicate="robot_at", since=moment(at(n)), until=moment(at(n) + 360)
        ),
    }


class Reader:
    """Asks a server over one connection, as a browser does."""

    def __init__(self, served: Serving) -> None:
        self._connection = http.client.HTTPConnection(urlsplit(served.address).netloc)

    def ask(self, path: str) -> None:
        """Ask for a page."""
        self._connection.request("GET", path)
        answer = self._connection.getresponse()
        text = answer.read()
        assert answer.status == 200, (path, answer.status, text[:500])

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


@contextmanager
def serving(url: str) -> Iterator[tuple[Serving, Reader]]:
    """Serve a store."""
    with tempfile.TemporaryDirectory() as folder:
        served = Serving(url, Path(folder), program=PROGRAM)
        try:
            with closing(Reader(served)) as reader:
                yield served, reader
        finally:
            served.stop()


def measure(reader: Reader, store: Known, repeat: int) -> Iterator[tuple[str, float, list[float]]]:
    """Give each page, its first answer, and the sorted times of further ones."""
    for name, give in pages(store).items():
        times = [seconds(partial(reader.ask, give(n))) for n in range(repeat + 1)]
        yield name, times[0], sorted(times[1:])


def aim_of(name: str) -> float:
    """How long a page may take."""
    return AIM_OF_TIMELINE if name.startswith("/timeline") else AIM


def memory(served: Serving, reader: Reader, store: Known, requests: int) -> list[tuple[int, float]]:
    """Make requests, and give the memory of the server in MB after more and more of them."""
    process = psutil.Process(served.process.pid)
    gives = list(pages(store).values())
    found = []
    marks = {requests * part // 10 for part in range(1, 11)}
    for number in range(1, requests + 1):
        # Every page as often, each time at another address.
        reader.ask(gives[number % len(gives)](number // len(gives)))
        if number in marks:
            found.append((number, process.memory_info().rss / 1e6))
    return found


def run(backend: str, url: str, repeat: int, requests: int) -> None:
    store = known(url)
    with serving(url) as (served, reader):
        rows = []
        for name, first, times in measure(reader, store, repeat):
            row = [name, *(f"{1e3 * each:.1f}" for each in (first, median(times), times[-1]))]
            rows.append([*row, "" if median(times) < aim_of(name) else "misses its aim"])
        header = [f"{backend}, ms", "first", "median", "slowest", ""]
        print_table(f"Pages of a store of {store.last:,} revisions", header, rows)
        if requests:
            found = [(f"{n:,}", f"{mb:.1f}") for n, mb in memory(served, reader, store, requests)]
            print_table("Memory of the server", [f"{backend}, requests", "MB"], found)


def main(argv: Sequence[str] | None = None) -> int:
    # `url` is that of a store that this benchmark has filled before.
    options = read_options(__doc__, argv, changes=2_000_000, repeat=15, requests=10_000, url="")
    if options.url:
        run("given", options.url, options.repeat, options.requests)
        return 0
    with stores(options.backend) as places:
        for backend, new in places.items():
            url = new()
            fill(url, options.changes, 1)
            plans(url)
            run(backend, url, options.repeat, options.requests)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

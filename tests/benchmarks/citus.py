"""A distributed store beside a plain one: latency of each kind of call, and throughput of writers.

Run it with `KANT_SQL_TEST_CITUS_URL` set:

    python -m tests.benchmarks.citus [--calls 200] [--seconds 5]

The plain store is a database of the same server as the coordinator, so that both have the same
processors and settings. Each call is made in turn on the plain store, through the coordinator, and
through the knowledge base's own worker; the medians are compared.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from typing import NamedTuple

import kant_sql
from kant_sql import KnowledgeBase, PddlPropositionDto
from tests.benchmarks.support import seconds
from tests.support.citus import Cluster, citus_url
from tests.support.worlds.robots import RB1, robot_at, waypoint

FACTS = 300
KNOWLEDGE_BASES = 64
WRITERS = (1, 2, 4, 8, 16)
_NUMBERS = itertools.count(1)
Call = Callable[[KnowledgeBase, int], object]


class Places(NamedTuple):
    """The same knowledge base in three places: plain, by the coordinator, by its own worker."""

    plain: KnowledgeBase
    coordinator: KnowledgeBase
    worker: KnowledgeBase


def one_fact(number: int) -> PddlPropositionDto:
    """A fact that is new for each number."""
    return robot_at(place=waypoint(10_000 + number))


def save_in_a_transaction(kb: KnowledgeBase, number: int) -> None:
    """Retract a fact and assert another in one revision."""
    with kb.transaction(reason="benchmark"):
        kb.propositions.delete(one_fact(2 * number))
        kb.propositions.save(one_fact(2 * number + 1))


CALLS: dict[str, Call] = {
    "save one fact": lambda kb, number: kb.propositions.save(one_fact(number)),
    "two changes in a transaction": save_in_a_transaction,
    "revision": lambda kb, _: kb.revision,
    "get one object": lambda kb, _: kb.at(kb.revision).objects.get(RB1.name),
    "facts of a predicate": lambda kb, _: kb.propositions.get_by_predicate("robot_at"),
    "facts of the past": lambda kb, _: kb.at(1).propositions.get_all(),
    "blame": lambda kb, _: kb.blame(str(robot_at(place=waypoint(7)))),
    "log of ten": lambda kb, _: list(kb.log(limit=10)),
    "save 1,000 facts": lambda kb, number: kb.propositions.save_all(
        robot_at(place=waypoint(1_000_000 + 1_000 * number + each)) for each in range(1_000)
    ),
}
# What takes long is called less often.
FEW = {"save 1,000 facts": 20, "facts of a predicate": 10, "facts of the past": 10}


def median_ms(call: Call, kb: KnowledgeBase, numbers: range) -> float:
    return 1e3 * statistics.median(seconds(partial(call, kb, number)) for number in numbers)


def compare(places: Places, calls: int) -> dict[str, tuple[float, float, float]]:
    """Measure each kind of call in each place, in turn."""
    found = {}
    start = 0
    for name, call in CALLS.items():
        times: list[list[float]] = [[], [], []]
        each = max(1, calls // 5 // FEW.get(name, 1))
        for _ in range(5):
            for place, kb in enumerate(places):
                times[place].append(median_ms(call, kb, range(start, start + each)))
                start += each
        plain, coordinator, worker = map(statistics.median, times)
        found[name] = (plain, coordinator, worker)
    return found


def throughput(url: str, writers: int, duration: float) -> float:
    """Commits a second of some writers, each over its share of the knowledge bases."""
    counts = [0] * writers

    def write(number: int) -> None:
        own = kbs[number::writers]
        while time.monotonic() < end:
            for kb in own:
                counts[number] += 1
                kb.propositions.save(one_fact(next(_NUMBERS)))

    with kant_sql.open_store(url, connections=max(WRITERS)) as store:
        kbs = [store.knowledge_base(f"robot {each}") for each in range(KNOWLEDGE_BASES)]
        for kb in kbs:
            kb.propositions.save(robot_at())
        end = time.monotonic() + duration
        threads = [threading.Thread(target=write, args=[number]) for number in range(writers)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    return sum(counts) / duration


def own_node(cluster: Cluster, url: str, kb_id: int) -> str:
    """The URL of the node that has a knowledge base."""
    ((port,),) = cluster.run(
        "SELECT nodeport FROM citus_shards WHERE table_name = 'head'::regclass "
        f"AND shardid = get_shard_id_for_distribution_column('head', {kb_id})",
        url,
    )
    group = next(number for number, _, node_port in cluster.nodes if node_port == port)
    return cluster.at_node(url, group)


def plain_store(cluster: Cluster) -> str:
    """Create a store in a database without the extension."""
    name = "kant_sql_benchmark_plain"
    cluster.run(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)")
    cluster.run(f"CREATE DATABASE {name}")
    url = cluster.url.set(database=name).render_as_string(hide_password=False)
    kant_sql.upgrade(url)
    return url


def run(cluster: Cluster, calls: int, duration: float) -> None:
    plain, distributed = plain_store(cluster), cluster.new_store(shards=32)
    for url in (plain, distributed):
        with kant_sql.connect(url, knowledge_base="tiago") as kb:
            kb.propositions.save_all(robot_at(place=waypoint(each)) for each in range(FACTS))
    worker = own_node(cluster, distributed, 1)
    with ExitStack() as stack:
        urls = (plain, distributed, worker)
        opened = [closing(kant_sql.connect(url, knowledge_base="tiago")) for url in urls]
        places = Places(*map(stack.enter_context, opened))
        print(f"{'call':30} {'plain':>9} {'coordinator':>17} {'own worker':>17}")
        for name, (bare, through, direct) in compare(places, calls).items():
            print(
                f"{name:30} {bare:7.2f}ms {through:7.2f}ms ({through / bare:4.2f}x) "
                f"{direct:7.2f}ms ({direct / bare:4.2f}x)"
            )
    print(f"{'writers':30} {'plain':>9} {'coordinator':>17}")
    for writers in WRITERS:
        bare, through = (throughput(url, writers, duration) for url in (plain, distributed))
        print(f"{writers:<30} {bare:7.0f}/s {through:9.0f}/s ({through / bare:4.2f}x)")
    cluster.run("DROP DATABASE kant_sql_benchmark_plain WITH (FORCE)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=5)
    given = parser.parse_args()
    url = citus_url()
    if url is None:
        parser.error("set KANT_SQL_TEST_CITUS_URL")
    cluster = Cluster(url)
    try:
        run(cluster, given.calls, given.seconds)
    finally:
        cluster.drop()


if __name__ == "__main__":
    main()

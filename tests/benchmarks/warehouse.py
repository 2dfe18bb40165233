"""A store of facts that hold now, generated in bulk: robots, goods and places of a warehouse.

Most of the facts say what is in stock where, which robot may fetch what, and which places are next
to each other; a few say what is blocked or reserved. Nothing of it has a past, and the database has
no statistics of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import kant_sql
from tests.benchmarks.drivers import bare
from tests.benchmarks.years import Key, Version, Writer

NAME = "warehouse"
ROBOTS, PLACES, ZONES = 100, 2_000, 20
# Each article is in stock at so many places; each place has that many neighbours of 1,000 facts.
STOCKED = 60
DOMAIN = """
(define (domain warehouse) (:requirements :strips :typing :negative-preconditions)
  (:types robot article place zone)
  (:predicates (robot_at ?r - robot ?p - place) (in_zone ?p - place ?z - zone)
               (stock ?a - article ?p - place) (fetches ?r - robot ?a - article)
               (next_to ?p ?q - place) (blocked ?p - place) (reserved ?a - article)))
"""
Fact = tuple[str, ...]


def articles(facts: int) -> int:
    """How many articles a warehouse of so many facts has."""
    return facts // 100


def problem(facts: int) -> str:
    """Write what there is."""
    counts = {"robot": ROBOTS, "article": articles(facts), "place": PLACES, "zone": ZONES}
    objects = " ".join(
        f"{' '.join(f'{kind}{n}' for n in range(count))} - {kind}" for kind, count in counts.items()
    )
    return f"(define (problem now) (:domain warehouse) (:objects {objects}) (:init) (:goal (and)))"


def situation(facts: int) -> Iterator[Fact]:
    """Give so many facts, or a few more or less."""
    random = Random(1)
    kinds = articles(facts)
    for robot in range(ROBOTS):
        yield "robot_at", f"robot{robot}", f"place{random.randrange(PLACES)}"
        for article in random.sample(range(kinds), kinds // 5):
            yield "fetches", f"robot{robot}", f"article{article}"
    for place in range(PLACES):
        yield "in_zone", f"place{place}", f"zone{random.randrange(ZONES)}"
        if place % 10 == 0:
            yield "blocked", f"place{place}"
        for other in random.sample(range(PLACES), max(facts // 11_000, 1)):
            yield "next_to", f"place{place}", f"place{other}"
    for article in range(kinds):
        if article % 5 == 0:
            yield "reserved", f"article{article}"
        for place in random.sample(range(PLACES), STOCKED):
            yield "stock", f"article{article}", f"place{place}"


class Facts(Writer):
    """Writes facts that are given by their names."""

    @staticmethod
    def parts(key: Key) -> tuple[str, list[str]]:
        return key[0], list(key[1:])


def fill(url: str, facts: int) -> None:
    """Fill an empty store with its tables with about so many facts that hold now."""
    with kant_sql.connect(url, knowledge_base=NAME, actor="bench") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(problem(facts))
    store = bare(url)
    store.without_checks()
    store.execute("BEGIN")
    writer = Facts(store, NAME)
    now = writer.revision
    writer.write((Version(each, now, None) for each in situation(facts)), now)
    store.execute("COMMIT")
    store.close()

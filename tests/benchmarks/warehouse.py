"""A store of facts that hold now, generated in bulk: robots, goods and places of a warehouse.

Most of the facts say what is in stock where, which robot may fetch what, and which places are next
to each other; a few say what is blocked or reserved. Nothing of it has a past, and the database has
no statistics of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import kant_sql
from tests.benchmarks.support import Row, bare

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


class Identities:
    """The ids of what a knowledge base knows, by its names."""

    def __init__(self, url: str) -> None:
        store = bare(url)
        ((self.kb,),) = store.execute("SELECT id FROM knowledge_base WHERE name = ?", (NAME,))
        names: dict[tuple[str, str], int] = {}
        for kind in ("object", "predicate"):
            rows = store.execute(f"SELECT key, id FROM {kind} WHERE kb_id = ?", (self.kb,))
            names |= {(kind, key): id_ for key, id_ in rows}
        store.close()
        self._names = names

    def object(self, name: str) -> int:
        """Return an object's id."""
        return self._names["object", name]

    def predicate(self, name: str) -> int:
        """Return a predicate's id."""
        return self._names["predicate", name]


def fill(url: str, facts: int) -> None:
    """Fill an empty store with its tables with about so many facts that hold now."""
    with kant_sql.connect(url, knowledge_base=NAME, actor="bench") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(problem(facts))
    known = Identities(url)
    store = bare(url)
    store.without_checks()
    ((since, next_id),) = store.execute(
        "SELECT revision, next_id FROM head WHERE kb_id = ?", (known.kb,)
    )
    propositions: list[Row] = []
    arguments: list[Row] = []
    versions: list[Row] = []
    for id_, (name, *terms) in enumerate(situation(facts), next_id):
        predicate = known.predicate(name)
        objects = [known.object(term) for term in terms]
        text = f"({' '.join([name, *terms])})"
        key = " ".join(map(str, objects))
        propositions.append((known.kb, id_, predicate, False, key, text))
        arguments += [(known.kb, id_, place, object_) for place, object_ in enumerate(objects)]
        first, second = (*objects, None)[:2]
        versions.append((known.kb, id_, since, None, predicate, False, 0, first, second))
    store.execute("BEGIN")
    store.insert("proposition", 6, propositions)
    store.insert("proposition_argument", 4, arguments)
    store.insert("proposition_version", 9, versions)
    store.execute(
        "UPDATE head SET next_id = ? WHERE kb_id = ?", (next_id + len(versions), known.kb)
    )
    store.execute("COMMIT")
    store.close()

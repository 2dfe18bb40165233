"""The order of a join follows how many facts there are, in whatever order it is written."""

from __future__ import annotations

from typing import Any

import pytest

from kant_sql import KnowledgeBase
from kant_sql.knowledge.definitions import Definitions
from kant_sql.sql import estimates

DOMAIN = """
(define (domain stock) (:requirements :strips :typing)
  (:types robot place article)
  (:predicates (robot_at ?r - robot ?p - place) (stock ?a - article ?p - place)))
"""
CONDITION = "(and (stock ?a ?p) (robot_at ?r ?p))"


def load(kb: KnowledgeBase, articles: int, places: int) -> None:
    """Load a store of articles at each place, and one robot."""
    kinds = {"article": articles, "place": places}
    objects = " ".join(f"{k}{n} - {k}" for k, count in kinds.items() for n in range(count))
    kb.load_domain(DOMAIN)
    kb.load_problem(
        f"(define (problem p) (:domain stock) (:objects rb - robot {objects})"
        " (:init (robot_at rb place1)) (:goal (and)))"
    )


def fill(kb: KnowledgeBase, articles: int, places: int) -> None:
    """Put every article at every place."""
    kb.propositions.save_all(
        f"(stock article{a} place{p})" for a in range(articles) for p in range(places)
    )


def definitions(kb: KnowledgeBase) -> Definitions:
    """Return the definitions that a knowledge base has in memory."""
    factory: Any = kb.store.factory
    found: Definitions = factory._store.check_definitions(lambda known: known)
    return found


def predicates_in_order(kb: KnowledgeBase) -> list[str]:
    """Return the predicates in the order in which the statement joins them."""
    sql = kb.query(CONDITION).sql
    ids = {each.id: each.name for each in definitions(kb).predicates}
    found = [part.split()[0] for part in sql.split("predicate_id = ")[1:]]
    return [ids[int(number)] for number in found]


def test_few_facts_come_before_many(fresh_kb: KnowledgeBase) -> None:
    load(fresh_kb, 30, 10)
    fill(fresh_kb, 30, 10)
    assert predicates_in_order(fresh_kb) == ["robot_at", "stock"]
    assert len(fresh_kb.query(CONDITION)) == 30


def test_an_order_changes_with_the_facts(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    load(fresh_kb, 30, 10)
    assert predicates_in_order(fresh_kb) == ["stock", "robot_at"]
    assert len(fresh_kb.query(CONDITION)) == 0
    fill(fresh_kb, 30, 10)
    # Facts are not counted at each question ...
    assert predicates_in_order(fresh_kb) == ["stock", "robot_at"]
    monkeypatch.setattr(estimates, "COUNTED_FOR", -1.0)
    # ... but again when some time has passed.
    assert len(fresh_kb.query(CONDITION)) == 30
    assert predicates_in_order(fresh_kb) == ["robot_at", "stock"]


def test_facts_are_counted_up_to_a_limit(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimates, "COUNTED", 5)
    load(fresh_kb, 3, 10)
    fill(fresh_kb, 3, 10)
    fresh_kb.query(CONDITION)[:]

    known = definitions(fresh_kb)
    counted = estimates.estimates_of(known).sizes
    assert {each.name: counted[each.id][0] for each in known.predicates} == {
        "robot_at": 1,
        "stock": 5,
    }

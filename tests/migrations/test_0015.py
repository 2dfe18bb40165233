"""Migration 0015 adds a view of erasures; rows and what other views say stay as they were."""

from __future__ import annotations

import kant_sql
from tests.migrations.stores import Make, answers, record, rows_of, views
from tests.migrations.test_golden import digest_of
from tests.support.pages import ask

VIEW = "audit_erasure"
SAID = f"SELECT since, revision, kind, pseudonym, parts, asserted_by, asserted_reason FROM {VIEW}"


def write_erased(url: str) -> None:
    """Create a store in which a name and a reason were erased."""
    kant_sql.upgrade(url)
    with kant_sql.connect(url, actor="clerk") as kb:
        kb.load_domain("(define (domain d) (:predicates (in ?x)))")
        with kb.transaction(reason="saw maria"):
            kb.load_problem("(define (problem p) (:domain d) (:objects maria) (:init (in maria)))")
        kb.erase("maria", reason="on request", also=["reason"])
    kant_sql.operations.downgrade(url, revision="0014")


def test_erasures_of_before_are_in_the_view_until_it_is_gone(make: Make) -> None:
    url = make(write_erased)
    names, before = views(url), rows_of(url)
    said = answers(url, names)
    kant_sql.upgrade(url, revision="0015")
    assert (rows_of(url), digest_of(url)) == (before, record("0015", url))
    assert ask(url, SAID) == ["3 | 2 | object | erased-1 | 4 | clerk | on request"]
    assert answers(url, names) == said
    kant_sql.operations.downgrade(url, revision="0014")
    assert (rows_of(url), digest_of(url)) == (before, record("0014", url))
    assert (views(url), answers(url, names)) == (names, said)

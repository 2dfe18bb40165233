"""Documents that threads and processes load and read at the same time."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from kant_sql import KnowledgeBase
from kant_sql.documents import exchange
from kant_sql.errors import PddlError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.store import transaction as propositions
from tests.support.chain import check_chain
from tests.support.processes.sharing import (
    OTHER_DOMAIN,
    change_domain,
    load_often,
    load_often_with,
    read_often,
    read_often_with,
)
from tests.support.processes.workers import in_processes
from tests.support.reading import loaded, undone
from tests.support.stores import Connect
from tests.support.worlds.depot import DOMAIN, PROBLEM, check_text, load

TIMES = 8


def test_threads_read_whole_documents_while_others_load(kb: KnowledgeBase) -> None:
    load(kb)
    with ThreadPoolExecutor(4) as pool:
        loading = pool.submit(load_often_with, kb, TIMES)
        reading = [pool.submit(read_often_with, kb, TIMES) for _ in range(2)]
        loading.result()
        assert [future.result() for future in reading] == [TIMES, TIMES]


@pytest.mark.more
def test_processes_read_whole_documents_while_others_load(
    shared_url: str, connect: Connect
) -> None:
    load(connect(shared_url, knowledge_base="tiago"))
    in_processes(
        (load_often, shared_url, TIMES),
        (load_often, shared_url, TIMES),
        (read_often, shared_url, TIMES),
    )
    check_chain(shared_url)


@pytest.mark.more
def test_processes_load_domains_and_problems_at_once(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    load(kb)
    in_processes((change_domain, shared_url, TIMES), (load_often, shared_url, TIMES))
    for revision in range(1, kb.revision + 1):
        check_text(kb.at(revision))
    check_chain(shared_url)


@pytest.mark.parametrize("fits", [True, False])
def test_a_problem_is_checked_against_the_domain_that_it_is_stored_with(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch, fits: bool
) -> None:
    kb, other = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    load(kb)
    text = PROBLEM if fits else PROBLEM.replace("(at t1 p1)", "(open p1)")
    calls = []

    def read_while_another_writes(*arguments: Any, **options: Any) -> Any:
        calls.append(arguments)
        read = read_problem(*arguments, **options)
        if len(calls) == 1:
            other.load_domain(OTHER_DOMAIN)
        return read

    monkeypatch.setattr(exchange, "read_problem", read_while_another_writes)
    if fits:
        kb.load_problem(text)
        assert kb.pddl.problem() == read_problem(text, domain=read_domain(OTHER_DOMAIN))
    else:
        with pytest.raises(PddlError, match="open"):
            kb.load_problem(text)
        assert kb.revision == 2
    assert len(calls) == 2
    assert kb.pddl.domain() == read_domain(OTHER_DOMAIN)
    check_text(kb)


def test_a_problem_and_its_domain_are_of_one_state(shared_url: str, connect: Connect) -> None:
    kb, other = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    load(kb)
    before = kb.pddl.problem()
    with other.transaction():
        loaded(other, OTHER_DOMAIN, PROBLEM.replace("monday", "tuesday"))
        # Nothing of it is seen before it is committed.
        assert kb.pddl.problem() == before
        assert kb.pddl.domain() == read_domain(DOMAIN)
    assert kb.pddl.problem().name == "tuesday"
    assert kb.pddl.domain() == read_domain(OTHER_DOMAIN)


# Several problems in one transaction.


SMALL_DOMAIN = """(define (domain d) (:predicates (p ?x ?y) (q ?x)) (:functions (f ?x))
  (:action a :parameters (?x) :precondition (q ?x) :effect (not (q ?x))))"""
FIRST = """(define (problem one) (:domain d) (:objects a b c)
  (:init (p a b) (p b c) (q a) (= (f a) 1) (= (f b) 2)) (:goal (q c)))"""
SECOND = """(define (problem one) (:domain d) (:objects a b c e)
  (:init (p a b) (p b c) (p c e) (q b) (= (f a) 1) (= (f b) 3)) (:goal (and (q c) (q c) (q e))))"""


@pytest.mark.parametrize("spill_at", [1, 3, 10_000])
@pytest.mark.parametrize("mode", ["replace", "merge"])
def test_a_problem_that_was_just_loaded_is_loaded_again(
    connect: Connect, url: str, monkeypatch: pytest.MonkeyPatch, spill_at: int, mode: str
) -> None:
    monkeypatch.setattr(propositions, "SPILL_AT", spill_at)
    second = SECOND if mode == "replace" else SECOND.replace("(= (f b) 3)", "(= (f b) 2)")
    kb = connect(url)
    with kb.transaction():
        loaded(kb, SMALL_DOMAIN, FIRST)
        kb.load_problem(second, mode=mode)  # type: ignore[arg-type]
    facts = {str(fact) for fact in kb.propositions.get_all()}
    merged = {"(q a)"} if mode == "merge" else set()
    assert facts == {"(p a b)", "(p b c)", "(p c e)", "(q b)"} | merged
    assert {str(goal) for goal in kb.goals.get_propositions()} == {"(q c)", "(q e)"}
    values = {str(value) for value in kb.function_values.get_all()}
    assert values == {"(= (f a) 1)", "(= (f b) 3)" if mode == "replace" else "(= (f b) 2)"}


def test_a_load_that_fails_leaves_nothing_for_the_next(connect: Connect, url: str) -> None:
    kb = connect(url)
    kb.load_domain(SMALL_DOMAIN)
    with kb.transaction():
        with undone(kb):
            kb.load_problem(FIRST)
        kb.load_problem(SECOND)
    assert {str(fact) for fact in kb.propositions.get_all()} == {
        *("(p a b)", "(p b c)", "(p c e)", "(q b)")
    }

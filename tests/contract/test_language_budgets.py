"""How many statements reading the language takes, however much of it there is."""

from __future__ import annotations

from functools import partial

import pytest

from kant_sql import KnowledgeBase
from kant_sql.dto.formulas import Comparison, Derived, Exists, Modal, Not, TimedLiteral
from tests.support.statements import Call, count
from tests.support.stores import Connect
from tests.support.worlds.depot import DOMAIN, IDLE, PLACE, TRUCK, P, T, at, fuel, number

SIZES = (1, 300)
READ = 2
# One for the facts and goals, one for the values, one for their fluents; one for definitions.
DOCUMENT = 5

READS: dict[str, Call] = {
    "goals.get_all": lambda kb: kb.goals.get_all(),
    "derived_predicates.get_all": lambda kb: kb.pddl.derived_predicates.get_all(),
    "timed_initial_literals.get_all": lambda kb: kb.pddl.timed_initial_literals.get_all(),
    "initial_literals.get_all": lambda kb: kb.pddl.initial_literals.get_all(),
    "constraints.get_all": lambda kb: kb.pddl.constraints.get_all(),
    "domain_constraints.get_all": lambda kb: kb.pddl.domain_constraints.get_all(),
    "metric.get": lambda kb: kb.pddl.metric.get(),
    "processes.get_all": lambda kb: kb.pddl.processes.get_all(),
    "events.get": lambda kb: kb.pddl.events.get("nothing"),
    "domain": lambda kb: kb.pddl.domain(),
    "domain_pddl": lambda kb: kb.domain_pddl(),
}
DOCUMENTS: dict[str, Call] = {
    "problem": lambda kb: kb.pddl.problem(),
    "problem_pddl": lambda kb: kb.problem_pddl(),
    "requirements": lambda kb: kb.pddl.requirements(),
}


def fill(kb: KnowledgeBase, size: int) -> None:
    """Give a knowledge base so much of everything."""
    trucks = " ".join(f"t{number}" for number in range(1, size + 2))
    init = " ".join(
        f"(at t{number} p1) (= (fuel t{number}) {number}) (= (home t{number}) p1)"
        for number in range(1, size + 1)
    )
    with kb.transaction():
        kb.load_domain(DOMAIN)
        kb.load_problem(
            f"(define (problem many) (:domain depot) (:objects {trucks} - truck p1 p2 - place) "
            f"(:init {init}) (:goal (at t1 p2)))"
        )
        for each in range(size):
            bound = number(str(each))
            kb.goals.save(Comparison(">", fuel(), bound))
            kb.pddl.timed_initial_literals.save(TimedLiteral(bound, at()))
            kb.pddl.constraints.save(Modal("within", (bound,), (IDLE,)))
        kb.pddl.initial_literals.save(Not(IDLE))
        kb.pddl.derived_predicates.save(Derived("reachable", (PLACE,), Exists((TRUCK,), at(T, P))))


@pytest.mark.parametrize("size", SIZES)
def test_a_warm_read_takes_as_many_statements_however_much_it_gives(
    kb: KnowledgeBase, size: int
) -> None:
    fill(kb, size)
    kb.pddl.problem()
    taken = {name: count(partial(read, kb)) for name, read in READS.items()}
    assert max(taken.values()) <= READ, taken
    taken = {name: count(partial(read, kb)) for name, read in DOCUMENTS.items()}
    assert max(taken.values()) <= DOCUMENT, taken
    assert len(kb.pddl.problem().timed) == size


@pytest.mark.parametrize("size", SIZES)
def test_a_cold_read_and_one_of_the_past_take_as_many(
    shared_url: str, connect: Connect, size: int
) -> None:
    kb = connect(shared_url)
    fill(kb, size)
    text = kb.problem_pddl()
    kb.load_problem("(define (problem none) (:domain depot) (:init) (:goal (and)))")
    for name in ("goals.get_all", "domain_pddl", *DOCUMENTS):
        read = (READS | DOCUMENTS)[name]
        most = READ + 1 if name in READS else DOCUMENT + 1
        cold = connect(shared_url)
        assert count(partial(read, cold)) <= most, name
        past = connect(shared_url).at(1)
        # Which definitions were those of then is asked, too.
        assert count(partial(read, past)) <= most + 1, name
    assert kb.at(1).problem_pddl() == text


def test_a_load_takes_as_many_statements_for_many_facts_as_for_some(
    shared_url: str, connect: Connect
) -> None:
    taken = []
    for size in (60, 600):
        kb = connect(shared_url, knowledge_base=f"robot {size}")
        init = " ".join(f"(at t{n} p1) (= (fuel t{n}) 1)" for n in range(size))
        trucks = " ".join(f"t{n}" for n in range(size))
        text = (
            f"(define (problem many) (:domain depot) (:objects {trucks} - truck p1 - place) "
            f"(:init {init}) (:goal (and)))"
        )
        kb.load_domain(DOMAIN)
        taken.append(count(partial(kb.load_problem, text)))
        assert count(partial(kb.load_problem, text)) <= max(taken)
    assert taken[0] == taken[1]


def test_a_formula_takes_few_statements_to_save_and_to_delete(kb: KnowledgeBase) -> None:
    fill(kb, 1)
    goal = Comparison("<", fuel(), number("77"))
    # Lock, identity, its row, revision, head, and version, nodes and terms.
    assert count(lambda: kb.goals.save(goal)) <= 8
    assert count(lambda: kb.goals.save(goal)) == 1
    assert count(lambda: kb.goals.delete(goal)) <= 4
    assert count(lambda: kb.goals.delete(goal)) <= 2

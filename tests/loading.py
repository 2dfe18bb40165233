"""What threads and processes do with whole documents at the same time."""

from __future__ import annotations

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.pddl import read_problem
from tests.language import DOMAIN, PROBLEM, check_text

OTHER_DOMAIN = DOMAIN.replace("(open ?w - (either place crane))", "(busy)")
# In each state, the truck is where its fuel says.
PROBLEMS = [
    PROBLEM,
    PROBLEM.replace("(at t1 p1) (= (fuel t1) 7.50)", "(at t1 p2) (= (fuel t1) 2) (ready c1)"),
]
STATES = {frozenset(read_problem(text).facts): text for text in PROBLEMS}


def load_often(url: str, times: int) -> None:
    """Open the knowledge base, and load one problem and the other."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="loading") as kb:
        load_often_with(kb, times)


def load_often_with(kb: KnowledgeBase, times: int) -> None:
    for number in range(times):
        kb.load_problem(PROBLEMS[number % 2])


def read_often(url: str, times: int) -> int:
    """Open the knowledge base, and read problems; give how often that was."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="reading") as kb:
        return read_often_with(kb, times)


def read_often_with(kb: KnowledgeBase, times: int) -> int:
    for number in range(times):
        check_whole(kb, number % 2 == 0)
    return times


def check_whole(kb: KnowledgeBase, as_text: bool) -> None:
    """Check that a problem is just what some load has made of it."""
    domain = kb.at(1).domain()
    problem = read_problem(kb.problem_pddl(), domain=domain) if as_text else kb.problem()
    assert problem == read_problem(STATES[frozenset(problem.facts)], domain=domain)


def change_domain(url: str, times: int) -> None:
    """Open the knowledge base, and load one domain and the other."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="changing") as kb:
        for number in range(times):
            kb.load_domain((OTHER_DOMAIN, DOMAIN)[number % 2])
            check_text_of_head(kb)


def check_text_of_head(kb: KnowledgeBase) -> None:
    """Check what is written at one revision, whatever others do meanwhile."""
    check_text(kb.at(kb.revision))

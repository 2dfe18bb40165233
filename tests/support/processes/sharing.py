"""What processes do that open one store, and read and write it at the same time."""

from __future__ import annotations

import os

import pytest

import kant_sql
import kant_sql.sql.dialects.sqlite
from kant_sql import KantSqlError, KnowledgeBase
from kant_sql.errors import ReadOnlyStoreError
from kant_sql.pddl import read_problem
from tests.support.worlds.depot import DOMAIN, PROBLEM, check_text
from tests.support.worlds.robots import robot_at, waypoint

NOBODY = 65534


def connect_and_write(url: str, number: int, name: str = "tiago") -> int:
    """Open a store, which may have to be created, and write once; give the revision."""
    with kant_sql.connect(url, knowledge_base=name) as kb:
        assert kb.propositions.insert(robot_at(place=waypoint(number)))
        mine = f"(robot_at rb1 wp{number})"
        for entry in kb.log():
            if any(change.text == mine for change in entry.changes):
                return entry.revision.number
        raise AssertionError(f"{mine} is not in the log")


def upgrade_and_write(url: str, number: int) -> int:
    """Create the tables of a store, if need be, and write once; give the revision."""
    kant_sql.upgrade(url)
    return connect_and_write(url, number)


def _give_up_rights() -> None:
    """Become a user whom permissions bind."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)


def read_but_not_write(url: str) -> None:
    """Read a store with one fact in it, and be refused to write."""
    _give_up_rights()
    with kant_sql.connect(url) as kb:
        assert kb.propositions.get_all() == [robot_at()]
        with pytest.raises(ReadOnlyStoreError, match="cannot be written"):
            kb.goals.save(robot_at(is_goal=True))
        assert kb.propositions.get_all() == [robot_at()]


def refused(url: str, error: type[KantSqlError]) -> str:
    """Be refused to open a store; give what the error says."""
    _give_up_rights()
    with pytest.raises(error) as caught:
        kant_sql.connect(url)
    return str(caught.value)


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
    domain = kb.at(1).pddl.domain()
    problem = read_problem(kb.problem_pddl(), domain=domain) if as_text else kb.pddl.problem()
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

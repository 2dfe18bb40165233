"""Processes that open one store, and read and write it at the same time."""

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
    """Open a store, create it if needed, and write once; return the revision."""
    with kant_sql.connect(url, knowledge_base=name) as kb:
        assert kb.propositions.insert(robot_at(place=waypoint(number)))
        mine = f"(robot_at rb1 wp{number})"
        for entry in kb.log():
            if any(change.text == mine for change in entry.changes):
                return entry.revision.number
        raise AssertionError(f"{mine} is not in the log")


def upgrade_and_write(url: str, number: int) -> int:
    """Create the tables of a store if needed, and write once; return the revision."""
    kant_sql.upgrade(url)
    return connect_and_write(url, number)


def _give_up_rights() -> None:
    """Become a user to whom permissions apply."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)


def read_but_not_write(url: str) -> None:
    """Read a store with one fact, and check that it refuses a write."""
    _give_up_rights()
    with kant_sql.connect(url) as kb:
        assert kb.propositions.get_all() == [robot_at()]
        with pytest.raises(ReadOnlyStoreError, match="cannot be written"):
            kb.goals.save(robot_at(is_goal=True))
        assert kb.propositions.get_all() == [robot_at()]


def refused(url: str, error: type[KantSqlError]) -> str:
    """Check that opening a store raises an error; return its text."""
    _give_up_rights()
    with pytest.raises(error) as caught:
        kant_sql.connect(url)
    return str(caught.value)


OTHER_DOMAIN = DOMAIN.replace("(open ?w - (either place crane))", "(busy)")
# In each state, the truck is where its fuel requires.
PROBLEMS = [
    PROBLEM,
    PROBLEM.replace("(at t1 p1) (= (fuel t1) 7.50)", "(at t1 p2) (= (fuel t1) 2) (ready c1)"),
]
STATES = {frozenset(read_problem(text).facts): text for text in PROBLEMS}


def load_often(url: str, times: int) -> None:
    """Open the knowledge base, and load two problems in turn."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="loading") as kb:
        load_often_with(kb, times)


def load_often_with(kb: KnowledgeBase, times: int) -> None:
    for number in range(times):
        kb.load_problem(PROBLEMS[number % 2])


def read_often(url: str, times: int) -> int:
    """Open the knowledge base, and read problems; return how often."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="reading") as kb:
        return read_often_with(kb, times)


def read_often_with(kb: KnowledgeBase, times: int) -> int:
    for number in range(times):
        check_whole(kb, number % 2 == 0)
    return times


def check_whole(kb: KnowledgeBase, as_text: bool) -> None:
    """Check that a problem is exactly one that was loaded."""
    domain = kb.at(1).pddl.domain()
    problem = read_problem(kb.problem_pddl(), domain=domain) if as_text else kb.pddl.problem()
    assert problem == read_problem(STATES[frozenset(problem.facts)], domain=domain)


def change_domain(url: str, times: int) -> None:
    """Open the knowledge base, and load two domains in turn."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="changing") as kb:
        for number in range(times):
            kb.load_domain((OTHER_DOMAIN, DOMAIN)[number % 2])
            check_text_of_head(kb)


def check_text_of_head(kb: KnowledgeBase) -> None:
    """Check the texts of one revision, whatever others do meanwhile."""
    check_text(kb.at(kb.revision))

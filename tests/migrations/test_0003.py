"""Migration 0003 copies the first two arguments of each fact and goal to its versions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from sqlalchemy import Connection, text

import kant_sql
from kant_sql import KnowledgeBase
from tests.migrations.stores import ADDED, Make, as_before, in_form_1, record, rows_of, write_story
from tests.migrations.test_golden import connected, digest_of
from tests.support.atoms import Atoms
from tests.support.chain import check_chain
from tests.support.reading import findings
from tests.support.stores import Connect

# A migration that has landed is frozen.
pytestmark = pytest.mark.more

TABLE = "proposition_version"
DOMAIN = """(define (domain d) (:requirements :typing) (:types robot wp)
 (:predicates (idle) (moving ?r - robot) (robot_at ?r - robot ?w - wp)
  (between ?r - robot ?a ?b - wp)))"""
PROBLEM = """(define (problem p) (:domain d) (:objects rb1 - robot wp1 wp2 - wp)
 (:init (idle) (moving rb1) (robot_at rb1 wp1) (between rb1 wp1 wp2))
 (:goal (and (idle) (moving rb1) (robot_at rb1 wp2) (between rb1 wp2 wp1))))"""
# Each fact and goal, and its first two arguments.
ARGUMENTS = {
    "(idle)": (None, None),
    "(moving rb1)": ("rb1", None),
    "(robot_at rb1 wp1)": ("rb1", "wp1"),
    "(robot_at rb1 wp2)": ("rb1", "wp2"),
    "(between rb1 wp1 wp2)": ("rb1", "wp1"),
    "(between rb1 wp2 wp1)": ("rb1", "wp2"),
}
SIZE = 20_000

# Versions, and the objects that their columns are.
VERSIONS = f"""
SELECT p.text, v.is_goal, v.until, one.name, other.name FROM {TABLE} AS v
JOIN proposition AS p ON p.kb_id = v.kb_id AND p.id = v.proposition_id
LEFT JOIN object AS one ON one.kb_id = v.kb_id AND one.id = v.first_object_id
LEFT JOIN object AS other ON other.kb_id = v.kb_id AND other.id = v.second_object_id
"""


def come_and_go(kb: KnowledgeBase) -> None:
    """Let every fact and goal have a past, and some of both hold."""
    with in_form_1():
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        atoms = Atoms(kb)
        every = atoms.get_all()
        atoms.delete_all()
        atoms.save_all(every[::2])


def write_old(url: str) -> None:
    """Write it, and bring the tables to version 0002."""
    kant_sql.upgrade(url)
    for name in ("tiago", "other"):
        with kant_sql.connect(url, knowledge_base=name, actor="test") as kb:
            come_and_go(kb)
    kant_sql.operations.downgrade(url, revision="0002")


@pytest.fixture
def old_url(make: Make) -> str:
    """The URL of a store of version 0002 with facts and goals of 0 to 3 arguments."""
    return make(write_old)


def arguments(url: str) -> list[Any]:
    with connected(url) as connection:
        return [*connection.execute(text(VERSIONS))]


def test_facts_and_goals_of_each_arity_are_carried_up_and_down(old_url: str) -> None:
    before = rows_of(old_url)
    assert ADDED[0] not in before[TABLE][0]
    assert digest_of(old_url) == record("0002", old_url)
    kant_sql.upgrade(old_url, revision="0003")
    assert digest_of(old_url) == record("0003", old_url)
    assert as_before(old_url) == before
    found = arguments(old_url)
    assert {(said, *own) for said, _, _, *own in found} == {
        (said, *own) for said, own in ARGUMENTS.items()
    }
    kinds = {(bool(is_goal), until is None) for _, is_goal, until, *_ in found}
    assert kinds == {(False, False), (False, True), (True, False), (True, True)}
    kant_sql.upgrade(old_url)
    assert findings(old_url) == []
    check_chain(old_url)
    kant_sql.operations.downgrade(old_url, revision="0002")
    assert (rows_of(old_url), digest_of(old_url)) == (before, record("0002", old_url))


def test_the_library_writes_what_the_migration_writes(old_url: str, connect: Connect) -> None:
    kant_sql.upgrade(old_url)
    migrated = rows_of(old_url)
    come_and_go(connect(old_url, knowledge_base="third"))
    written = rows_of(old_url)
    kant_sql.operations.downgrade(old_url, revision="0002")
    kant_sql.upgrade(old_url)
    assert rows_of(old_url) == written
    assert len(written[TABLE]) == len(migrated[TABLE]) * 3 // 2


def test_a_store_that_the_first_version_wrote_has_them(make: Make) -> None:
    url = make(write_story)
    kant_sql.upgrade(url)
    found = arguments(url)
    assert ("(at rb1 wp1)", "rb1", "wp1") in {(row[0], *row[3:]) for row in found}
    for said, _, _, *own in found:
        names = [*said.strip("()").split()[1:], None, None]
        assert own == names[:2]
    assert findings(url) == []


# What is asked of the facts that hold, and the index that finds it without any statistics.
NOW = f"FROM {TABLE} WHERE kb_id = 1 AND until IS NULL"
FACT = "AND NOT is_goal", "AND is_goal = 0"
QUESTIONS = {
    f"SELECT second_object_id {NOW} AND predicate_id = 5 AND first_object_id = 7 IS_FACT": "now",
    f"SELECT proposition_id {NOW} AND predicate_id = 5 AND second_object_id = 7 IS_FACT": "second",
    f"SELECT first_object_id {NOW} AND predicate_id = 5 AND second_object_id = 7 IS_FACT": "second",
    f"SELECT proposition_id {NOW} AND predicate_id = 5": "now",
    f"SELECT proposition_id {NOW} AND IS_GOAL": "goal",
}


@pytest.fixture
def large(empty_url: str) -> Iterator[Connection]:
    """A connection to a store with many live facts of which the database has no statistics."""
    kant_sql.upgrade(empty_url)
    columns = "kb_id, proposition_id, since, predicate_id, is_goal, first_object_id"
    numbers = (
        "WITH RECURSIVE t (n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM t WHERE n < :size)"
        f" INSERT INTO {TABLE} ({columns}, second_object_id)"
        " SELECT 1, n, 1, 1 + n % 10, CAST(:is_goal AS BOOLEAN), 1 + n % 200, 1 + n / 200 FROM t"
    )
    with connected(empty_url) as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SET session_replication_role = replica"))
        connection.execute(text(numbers), {"size": SIZE, "is_goal": False})
        yield connection
        connection.rollback()


@pytest.mark.parametrize("question", QUESTIONS)
def test_facts_are_found_by_their_arguments(large: Connection, question: str) -> None:
    is_sqlite = large.dialect.name == "sqlite"
    sql = question.replace("IS_FACT", FACT[is_sqlite])
    sql = sql.replace("IS_GOAL", "is_goal = 1" if is_sqlite else "is_goal")
    index = f"ix_{TABLE}_{QUESTIONS[question]}"
    if is_sqlite:
        (step,) = large.execute(text(f"EXPLAIN QUERY PLAN {sql}")).all()
        assert f"USING COVERING INDEX {index} (" in step[3]
        return
    plan = "\n".join(row[0] for row in large.execute(text(f"EXPLAIN {sql}")))
    assert f" {index} " in plan, plan

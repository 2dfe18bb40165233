"""Migration 0005 tells of each version that has ended where it is found, and forgets it again."""

from __future__ import annotations

from pathlib import Path

import pytest
from sqlalchemy import text

import kant_sql
from kant_sql.knowledge.past import fork
from tests.chain import check_chain
from tests.conftest import Connect
from tests.migrations.test_golden import FOLDER, connected, dump_of
from tests.worlds import WP2, robot_at

VERSIONS = ("proposition_version", "function_value_version")
Ends = list[tuple[int, int | None, int]]


def ends(url: str, table: str) -> Ends:
    """The ends of each version, and its fork."""
    with connected(url) as connection:
        rows = connection.execute(text(f"SELECT since, until, fork FROM {table} ORDER BY 1, 2"))
        return [(since, until, place) for since, until, place in rows]


def write_history(url: str, connect: Connect) -> None:
    """Let facts, a goal and values come and go, in versions of many lengths."""
    kb = connect(url, knowledge_base="tiago", actor="test")
    kb.load_domain(
        "(define (domain d) (:requirements :typing :numeric-fluents) (:types robot wp)"
        " (:predicates (robot_at ?r - robot ?w - wp)) (:functions (level ?r - robot)))"
    )
    kb.load_problem(
        "(define (problem p) (:domain d) (:objects rb1 - robot wp1 wp2 - wp)"
        " (:init (robot_at rb1 wp1) (= (level rb1) 1)) (:goal (and)))"
    )
    for number in range(20):
        kb.function_values.increase("level", objects=["rb1"], by=1)
        if number % 3 == 0:
            kb.propositions.delete(robot_at())
            kb.propositions.save(robot_at())
        if number % 7 == 0:
            kb.propositions.save(robot_at(place=WP2, is_goal=True))
            kb.propositions.delete(robot_at(place=WP2, is_goal=True))
    kb.close()


def test_forks_survive_down_and_up(empty_url: str, connect: Connect) -> None:
    kant_sql.upgrade(empty_url)
    write_history(empty_url, connect)
    before = {table: ends(empty_url, table) for table in VERSIONS}
    for table in VERSIONS:
        assert len(before[table]) > 10
        for since, until, place in before[table]:
            assert place == fork(since, until), (table, since, until)
    states = read_states(empty_url, connect)
    kant_sql.downgrade(empty_url, revision="0004")
    assert dump_of(empty_url) == record("0004", empty_url)
    kant_sql.upgrade(empty_url)
    assert {table: ends(empty_url, table) for table in VERSIONS} == before
    assert read_states(empty_url, connect) == states
    check_chain(empty_url)


def read_states(url: str, connect: Connect) -> list[str]:
    """Every state that there ever was."""
    kb = connect(url, knowledge_base="tiago")
    states = [kb.at(number).problem_pddl() for number in range(kb.revision + 1)]
    kb.close()
    return states


def record(version: str, url: str) -> str:
    dialect = "sqlite" if url.startswith("sqlite") else "postgresql"
    return Path(FOLDER / f"{dialect}-{version}.sql").read_text(encoding="utf-8")


@pytest.mark.parametrize("table", VERSIONS)
def test_sqlite_finds_the_past_by_forks(tmp_path: Path, table: str) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    kant_sql.upgrade(url)
    owner = "predicate_id" if table.startswith("proposition") else "function_id"
    query = (
        f"SELECT since FROM {table} WHERE kb_id = 1 AND {owner} = 2 AND fork IN (0, 4, 6, 7, 8)"
        " AND since <= 7 AND (until IS NULL OR until > 7)"
    )
    with connected(url) as connection:
        plan = connection.execute(text(f"EXPLAIN QUERY PLAN {query}")).all()
    used = f"ix_{table}_history (kb_id=? AND {owner}=? AND fork=? AND since<?)"
    assert used in plan[0][3]

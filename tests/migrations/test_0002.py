"""Migration 0002 replaces the audit's views, and loses neither data nor answers on the way."""

from __future__ import annotations

import io

import pytest
from alembic import command
from sqlalchemy import make_url

import kant_sql
from kant_sql.errors import KantSqlError
from kant_sql.sql.intervals import fork
from kant_sql.sql.schema import alembic_config, current, upgrade_sql
from tests.migrations import stores
from tests.support.chain import check_chain
from tests.support.pages import ask
from tests.support.stores import Connect
from tests.support.worlds.robots import WP2, robot_at

# A migration that has landed is frozen.
pytestmark = pytest.mark.more

NEW = "audit_knowledge_base"
VIEWS = {
    *("audit_revision", "audit_change", "audit_fact", "audit_goal", "audit_fact_argument"),
    *("audit_value", "audit_value_argument", "audit_object", "audit_definition", "audit_action"),
    *("audit_action_literal", "audit_plan", "audit_plan_step", "audit_plan_step_status"),
    *("audit_plan_step_argument", "audit_archive"),
}
LATER = {"audit_promotion", "audit_execution", "audit_effect", "audit_confirmation"}
LATER |= {"audit_statistics", "audit_fact_valid", "audit_value_valid", "audit_erasure"}
FACTS = "proposition_version"
FORKED = (FACTS, "function_value_version")


@pytest.fixture
def old_url(make: stores.Make) -> str:
    """The URL of a store with a story in it, as version 0001 of the tables has it."""
    return make(stores.written("store", "0001"))


def test_views_come_and_go(old_url: str) -> None:
    assert stores.views(old_url) == VIEWS
    kant_sql.upgrade(old_url, revision="0002")
    assert stores.views(old_url) == {*VIEWS, NEW}
    assert len(ask(old_url, "SELECT * FROM audit_change")) > 20
    kant_sql.operations.downgrade(old_url, revision="base")
    assert (stores.views(old_url), stores.rows_of(old_url), current(old_url)) == (set(), {}, None)


def test_the_new_view_says_where_a_knowledge_base_stands(old_url: str) -> None:
    kant_sql.upgrade(old_url, revision="0002")
    assert current(old_url) == "0002"
    last = "2026-11-24T00:24:41.018902Z"
    assert ask(old_url, f"SELECT * FROM {NEW}") == [f"rounds | 16 | {last} | 1795479881.018902"]


def test_a_view_of_somebody_elses_on_these_is_not_dropped_by_the_way(old_url: str) -> None:
    kant_sql.upgrade(old_url)
    stores.run_script(old_url, "CREATE VIEW theirs AS SELECT text FROM audit_fact")
    if make_url(old_url).get_backend_name() == "sqlite":
        kant_sql.operations.downgrade(old_url, revision="0001")
        assert stores.views(old_url) == {*VIEWS, "theirs"}
        kant_sql.upgrade(old_url)
    else:
        before = current(old_url)
        with pytest.raises(KantSqlError, match="other objects depend on it"):
            kant_sql.operations.downgrade(old_url, revision="0001")
        assert current(old_url) == before
    assert stores.views(old_url) == {*VIEWS, NEW, *LATER, "theirs"}
    assert len(ask(old_url, "SELECT * FROM theirs")) == len(
        ask(old_url, "SELECT 1 FROM audit_fact")
    )


@pytest.mark.parametrize(
    ("down", "left"), [("0002:0001", VIEWS), ("0002:base", set[str]()), ("0001:base", set[str]())]
)
def test_the_sql_that_is_written_offline_has_them(dialect: str, down: str, left: set[str]) -> None:
    out = io.StringIO()
    upgrade_sql(f"{dialect}://", out)
    assert names(out, "CREATE VIEW") - LATER == {*VIEWS, NEW}
    out = io.StringIO()
    config = alembic_config(out)
    config.attributes["url"] = f"{dialect}://"
    command.downgrade(config, down, sql=True)
    dropped = VIEWS if down.startswith("0001") else {*VIEWS, NEW}
    assert names(out, "DROP VIEW") == dropped
    assert names(out, "CREATE VIEW") == ({*VIEWS} if down.startswith("0002") else set())
    assert ("DROP TABLE knowledge_base" in out.getvalue()) == (not left)


def names(out: io.StringIO, verb: str) -> set[str]:
    """The views that statements with a verb name."""
    lines = [line for line in out.getvalue().splitlines() if line.startswith(verb)]
    return {line.split()[2].strip(";") for line in lines}


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
            kb.goals.save(robot_at(place=WP2, is_goal=True))
            kb.goals.delete(robot_at(place=WP2, is_goal=True))
    kb.close()


def read_states(url: str, connect: Connect) -> list[str]:
    """Every state that there ever was."""
    kb = connect(url, knowledge_base="tiago")
    states = [kb.at(number).problem_pddl() for number in range(kb.revision + 1)]
    kb.close()
    return states


def test_every_past_state_survives_down_and_up(empty_url: str, connect: Connect) -> None:
    kant_sql.upgrade(empty_url)
    with stores.in_form_1():
        write_history(empty_url, connect)
    before = stores.rows_of(empty_url)
    for table in FORKED:
        assert len(before[table]) > 10
        for row in before[table]:
            assert row["fork"] == fork(row["since"], row["until"]), (table, row)
    states = read_states(empty_url, connect)
    assert len(set(states)) > 10
    kant_sql.operations.downgrade(empty_url, revision="0001")
    assert stores.rows_of(empty_url) == {
        table: stores.without(before[table], *stores.ADDED) for table in before
    }
    kant_sql.upgrade(empty_url)
    assert stores.rows_of(empty_url) == before
    assert read_states(empty_url, connect) == states
    check_chain(empty_url)

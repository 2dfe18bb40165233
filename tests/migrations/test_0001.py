"""What version 0001 of the tables wrote: the migrations carry it on, and the library reads it."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.planning import Plan, PlanStep
from kant_sql.sql.audit_views import AUDIT_VIEWS
from kant_sql.sql.schema import VERSIONS
from tests.migrations import stores
from tests.migrations.test_golden import connected, digest_of
from tests.support.chain import check_chain
from tests.support.pages import ask
from tests.support.reading import findings
from tests.support.stores import Connect

# A migration that has landed is frozen.
pytestmark = pytest.mark.more

OF_STEPS = {"audit_plan_step", "audit_plan_step_status"}


@pytest.fixture
def old_url(make: stores.Make) -> str:
    """The URL of a store as version 0001 of the tables had it."""
    return make(stores.write_story)


@pytest.fixture
def new_url(make: stores.Make) -> str:
    """The URL of that store after all migrations: the library reads no other."""
    return make(stores.write_migrated_story)


def open_tiago(url: str, connect: Connect) -> KnowledgeBase:
    return connect(url, knowledge_base="tiago", actor="test")


def said(url: str, columns: dict[str, str]) -> dict[str, list[str]]:
    """All that columns of views say."""
    with connected(url) as connection:
        return {
            view: sorted(map(repr, connection.exec_driver_sql(f"SELECT {names} FROM {view}")))
            for view, names in columns.items()
        }


def check_kept(version: str, before: stores.Rows, after: stores.Rows) -> None:
    """Check that the tables that stay have the same rows, with new columns that say nothing."""
    for table in before.keys() & after.keys():
        added = after[table][0].keys() - before[table][0].keys()
        assert stores.without(after[table], *added) == before[table], table
        # Migration 0003 copies arguments.
        assert version == "0003" or {row[name] for row in after[table] for name in added} <= {None}


@pytest.mark.parametrize(
    "fill", [stores.write_story, stores.written("store", "0001")], ids=["story", "rounds"]
)
def test_rows_and_answers_survive_each_step_up_and_down(
    make: stores.Make, fill: stores.Fill
) -> None:
    url = make(fill)
    before, rows, columns = stores.as_before(url), stores.rows_of(url), stores.columns_of(url)
    assert len(before) > 25
    known = [(rows, said(url, columns), digest_of(url))]
    for version in VERSIONS[1:]:
        if version == "0008":
            # They show executions of any kind from then on.
            columns = {view: columns[view] for view in columns.keys() - OF_STEPS}
        answers = {view: known[-1][1][view] for view in columns}
        kant_sql.upgrade(url, revision=version)
        assert (stores.as_before(url), digest_of(url)) == (before, stores.record(version, url))
        assert said(url, columns) == answers
        check_kept(version, rows, rows := stores.rows_of(url))
        columns = stores.columns_of(url)
        known.append((rows, said(url, columns), digest_of(url)))
    assert columns.keys() == AUDIT_VIEWS.keys()
    assert findings(url) == []
    for version, expected in zip(VERSIONS[-2::-1], known[-2::-1], strict=True):
        kant_sql.operations.downgrade(url, revision=version)
        columns = stores.columns_of(url)
        assert (stores.rows_of(url), said(url, columns), digest_of(url)) == expected, version


def test_the_library_reads_what_the_older_one_wrote(new_url: str, connect: Connect) -> None:
    kb = open_tiago(new_url, connect)
    assert [str(dto) for dto in kb.at(2).propositions.get_all()] == ["(at rb1 wp1)"]
    assert [str(dto) for dto in kb.at(4).goals.get_propositions()] == ["(at rb1 wp2)"]
    assert [str(dto) for dto in kb.propositions.get_all()] == ["(at rb1 wp2)"]
    assert [str(dto) for dto in kb.types.get_all()] == ["place", "robot", "dock - place"]
    assert [str(goal) for goal in kb.goals.get_all()] == ["(or (idle) (at rb1 Home))"]
    assert "(= (battery rb1) 79.5)" in kb.problem_pddl()
    texts = {row["text"] for row in stores.rows_of(new_url)["action_version"]}
    written = [*kb.actions.get_all(), *kb.pddl.processes.get_all()]
    assert {str(dto) for dto in written} == texts
    seen = datetime(2026, 5, 4, 9, 31, 58, 500_000, tzinfo=UTC)
    assert kb.store.revisions()[1].observed_at == seen
    (plan,) = kb.plans.get_all()
    assert [str(step) for step in plan.steps] == ["(move rb1 wp1 wp2)", "(rest rb1)"]
    assert plan.problem_pddl() == kb.at(2).problem_pddl()
    assert [revision.number for revision in kb.store.revisions() if revision.execution] == [8]
    assert connect(new_url, knowledge_base="Küche 🤖").objects.get("rb1") is not None


def test_it_can_be_planned_from(new_url: str, connect: Connect) -> None:
    kb = open_tiago(new_url, connect)
    step = PlanStep(None, "move", ("rb1", "wp1", "wp2"))
    plan = kb.plans.record(Plan((step,), "hand", "", 2))
    assert (plan.objective, str(plan.steps[0])) == ("minimize (total-cost)", "(move rb1 wp1 wp2)")
    assert plan.problem_pddl() == kb.at(2).problem_pddl()


def test_the_hashes_recompute_and_the_chain_goes_on(new_url: str, connect: Connect) -> None:
    assert check_chain(new_url) == stores.REVISIONS
    kb = open_tiago(new_url, connect)
    with kb.transaction(observed_at=datetime(2026, 5, 4, 10, tzinfo=UTC)):
        kb.objects.save(PddlObjectDto(PddlTypeDto("dock"), "d1"))
    kb.plans.record(Plan((), "hand", ""))
    kb.propositions.delete_all()
    assert check_chain(new_url) == {**stores.REVISIONS, "tiago": stores.REVISIONS["tiago"] + 3}
    assert findings(new_url) == []
    forms = {
        (row["form"], row["number"] > stores.REVISIONS["tiago"])
        for row in stores.rows_of(new_url)["revision"]
    }
    assert forms == {(1, False), (2, True)}


def test_to_save_what_the_older_library_wrote_changes_nothing(
    new_url: str, connect: Connect
) -> None:
    kb = open_tiago(new_url, connect)
    daos: list[Any] = [
        *(kb.types, kb.objects, kb.predicates, kb.functions, kb.actions, kb.pddl.processes),
        *(kb.propositions, kb.goals),
    ]
    for dao in daos:
        dao.save_all(dao.get_all())
    assert kb.revision == stores.REVISIONS["tiago"]


def test_the_views_of_each_version_show_it(old_url: str) -> None:
    for version in VERSIONS:
        kant_sql.upgrade(old_url, revision=version) if version != VERSIONS[0] else None
        facts = "SELECT kind, text, since, until FROM audit_fact WHERE knowledge_base = 'tiago'"
        assert sorted(ask(old_url, facts)) == [
            "fact | (at rb1 wp1) | 2 | 3",
            "fact | (at rb1 wp2) | 3 | 5",
            "fact | (at rb1 wp2) | 8 | NULL",
            "goal | (at rb1 wp2) | 2 | 5",
        ]
        literals = (
            "SELECT role, literal, time FROM audit_action_literal WHERE knowledge_base = 'tiago' "
            "AND action = 'move' AND until IS NULL ORDER BY section, position"
        )
        assert ask(old_url, literals) == [
            "needs | (at ?r ?from) | at start",
            "deletes | (at ?r ?from) | at start",
            "adds | (at ?r ?to) | at end",
        ]
        revisions = (
            "SELECT count(*), count(observed_at), count(plan_id), max(form) FROM audit_revision"
        )
        assert ask(old_url, revisions) == ["10 | 2 | 1 | 1"]

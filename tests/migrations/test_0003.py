"""Migration 0003 carries what version 0002 wrote, up and down, and never drops a part of it."""

from __future__ import annotations

import io
from datetime import UTC, datetime
from pathlib import Path

import pytest
from alembic import command
from alembic.util import CommandError
from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.errors import SchemaError
from kant_sql.planning import Plan, PlanStep
from kant_sql.schema import alembic_config, current
from tests.chain import check_chain
from tests.conftest import Connect
from tests.migrations.test_0002 import rows_of, run_script, without
from tests.migrations.test_golden import FOLDER, dump_of
from tests.verifying import findings

STORY = (Path(__file__).parent / "store-0002.sql").read_text(encoding="utf-8")
REVISIONS = {"tiago": 5, "Küche 🤖": 1}
NEW_COLUMNS: dict[str, dict[str, int | None]] = {
    "head": {"archived_revision": 0},
    "revision": {"observed_at": None},
}


@pytest.fixture
def old_url(empty_url: str) -> str:
    """The URL of a store as version 0002 of the tables had it."""
    kant_sql.upgrade(empty_url, revision="0002")
    run_script(empty_url, STORY)
    return empty_url


@pytest.fixture
def new_url(old_url: str) -> str:
    """The URL of that store, after this migration and those that followed."""
    kant_sql.upgrade(old_url)
    return old_url


def open_tiago(url: str, connect: Connect) -> KnowledgeBase:
    return connect(url, knowledge_base="tiago", actor="test")


def test_every_row_stays_as_it_was(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0003")
    after = rows_of(old_url)
    assert after.keys() == before.keys()
    for table, rows in before.items():
        new = NEW_COLUMNS.get(table, {})
        assert without(after[table], *new) == rows, table
        assert all(row[column] == value for row in after[table] for column, value in new.items())


def test_down_and_up_again_gives_the_very_same_rows(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0003")
    between = rows_of(old_url)
    kant_sql.downgrade(old_url, revision="0002")
    assert rows_of(old_url) == before
    record = f"{make_url(old_url).get_backend_name()}-0002.sql"
    assert dump_of(old_url) == (FOLDER / record).read_text(encoding="utf-8")
    kant_sql.upgrade(old_url, revision="0003")
    assert rows_of(old_url) == between


def test_the_library_reads_what_the_older_one_wrote(new_url: str, connect: Connect) -> None:
    kb = open_tiago(new_url, connect)
    assert [str(dto) for dto in kb.at(2).propositions.get_no_goals()] == ["(at rb1 wp1)"]
    assert next(str(dto) for dto in kb.actions.get_all()).startswith("(:durative-action move")
    assert [str(goal) for goal in kb.goals.get_all()] == ["(or (idle) (at rb1 Home))"]
    assert "(= (battery rb1) 79.5)" in kb.problem_pddl()
    assert {revision.observed_at for revision in kb.revisions()} == {None}
    assert {revision.plan_step for revision in kb.revisions()} == {None}
    assert kb.plans.get_all() == []
    assert connect(new_url, knowledge_base="Küche 🤖").objects.get("rb1") is not None


def test_what_the_older_library_wrote_can_be_planned_from(new_url: str, connect: Connect) -> None:
    kb = open_tiago(new_url, connect)
    step = PlanStep(None, "move", ("rb1", "wp1", "wp2"))
    plan = kb.plans.record(Plan((step,), "hand", "", 2))
    assert (plan.objective, str(plan.steps[0])) == ("minimize (total-cost)", "(move rb1 wp1 wp2)")
    assert plan.problem_pddl() == kb.at(2).problem_pddl()


def test_the_chain_goes_on_in_a_new_form(new_url: str, connect: Connect) -> None:
    assert check_chain(new_url) == REVISIONS
    kb = open_tiago(new_url, connect)
    with kb.transaction(observed_at=datetime(2026, 5, 4, 10, tzinfo=UTC)):
        kb.objects.save(PddlObjectDto(PddlTypeDto("dock"), "d1"))
    kb.plans.record(Plan((), "hand", ""))
    assert check_chain(new_url) == {**REVISIONS, "tiago": 7}
    assert findings(new_url) == []
    forms = [row["form"] for row in rows_of(new_url)["revision"] if row["kb_id"] == 1]
    assert sorted(forms) == [1] * 5 + [2] * 2


def test_what_0002_has_no_place_for_is_not_dropped(new_url: str, connect: Connect) -> None:
    kb = open_tiago(new_url, connect)
    with kb.transaction(observed_at=datetime(2026, 5, 4, 10, tzinfo=UTC)):
        kb.propositions.save_all(kb.at(2).propositions.get_all())
    assert refusal(new_url).startswith("revisions that say when things were observed (1)")
    for _ in range(2):
        kb.plans.record(Plan((), "hand", ""))
    run_script(new_url, "INSERT INTO archive VALUES (2, 3, 1, 1, 'sqlite:///a.db', 0, 'ab', 'ab')")
    found = refusal(new_url)
    for what in ("plans (2)", "archives (1)", "revisions that say when things were observed (1)"):
        assert what in found
    kb.close()
    kant_sql.downgrade(new_url, revision="base")
    assert (rows_of(new_url), current(new_url)) == ({}, None)


def refusal(url: str) -> str:
    """What a downgrade is refused for, that changes nothing."""
    rows, schema, version = rows_of(url), dump_of(url), current(url)
    with pytest.raises(SchemaError, match="is or was in this store: ") as caught:
        kant_sql.downgrade(url, revision="0002")
    assert (rows_of(url), dump_of(url), current(url)) == (rows, schema, version)
    message = str(caught.value)
    assert "\n" not in message
    return message.partition("in this store: ")[2].partition("; nothing was changed")[0]


def test_a_downgrade_as_sql_cannot_look_and_is_refused(dialect: str) -> None:
    out = io.StringIO()
    config = alembic_config(out)
    config.attributes["url"] = f"{dialect}://"
    with pytest.raises(CommandError, match="run it on the database, without --sql"):
        command.downgrade(config, "0003:0002", sql=True)
    command.downgrade(config, "0003:base", sql=True)
    assert "DROP TABLE plan" in out.getvalue()

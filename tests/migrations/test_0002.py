"""Migration 0002 carries what version 0001 wrote, up and down, and never drops a part of it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.util import CommandError
from sqlalchemy import ColumnElement, inspect, make_url, select, text

import kant_sql
from kant_sql import KnowledgeBase, PddlActionDto, PddlConditionEffectDto, PddlPropositionDto
from kant_sql.errors import SchemaError
from kant_sql.schema import VERSION_TABLE, alembic_config, current
from kant_sql.tables import PropositionVersionRow as VERSION
from tests.chain import check_chain
from tests.conftest import Connect
from tests.migrations.test_golden import FOLDER, connected, dump_of
from tests.verifying import findings

STORY = (Path(__file__).parent / "store-0001.sql").read_text(encoding="utf-8")
REVISIONS = {"tiago": 6, "Küche 🤖": 2}
RENAMED = {"action_node": "action_expression", "action_term": "action_expression_term"}

Rows = dict[str, list[dict[str, Any]]]


@pytest.fixture
def old_url(empty_url: str) -> str:
    """The URL of a store as version 0001 of the tables had it."""
    kant_sql.upgrade(empty_url, revision="0001")
    run_script(empty_url, STORY)
    return empty_url


@pytest.fixture
def new_url(old_url: str) -> str:
    """The URL of that store, after the migration."""
    kant_sql.upgrade(old_url, revision="0002")
    return old_url


@pytest.fixture
def newest_url(new_url: str) -> str:
    """The URL of that store, after all migrations: the library reads no other."""
    kant_sql.upgrade(new_url)
    return new_url


def run_script(url: str, script: str) -> None:
    with connected(url) as connection:
        driver: Any = connection.connection.driver_connection
        if connection.dialect.name == "sqlite":
            driver.executescript(f"PRAGMA foreign_keys=ON; BEGIN; {script}; COMMIT")
        else:
            driver.execute(script)


def rows_of(url: str) -> Rows:
    """All rows of all tables that have any."""
    with connected(url) as connection:
        tables = set(inspect(connection).get_table_names()) - {VERSION_TABLE}
        found = {
            table: [
                dict(row) for row in connection.execute(text(f"SELECT * FROM {table}")).mappings()
            ]
            for table in tables
        }
    return {table: sorted(rows, key=repr) for table, rows in found.items() if rows}


def without(rows: list[dict[str, Any]], *columns: str) -> list[dict[str, Any]]:
    kept = [{name: row[name] for name in row if name not in columns} for row in rows]
    return sorted(kept, key=repr)


def open_tiago(url: str, connect: Connect) -> KnowledgeBase:
    return connect(url, knowledge_base="tiago", actor="test")


def test_what_did_not_change_its_table_stays_as_it_was(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0002")
    after = rows_of(old_url)
    changed = {"action_version", "object_version", "proposition_version"}
    for table in before.keys() - changed - set(RENAMED.values()):
        assert after[table] == before[table], table
    assert after.keys() - before.keys() == RENAMED.keys()


def test_trees_are_carried_node_by_node(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0002")
    after = rows_of(old_url)
    new = {"action_node": ["function_id"], "action_term": ["quantifier", "variable", "child"]}
    for table, columns in new.items():
        assert without(after[table], *columns) == before[RENAMED[table]]
        assert {row[column] for row in after[table] for column in columns} == {None}
    durations = {row["value"] for row in after["action_node"] if row["section"] == "duration"}
    assert durations == {None, "?duration", "10", "12.5"}


def test_versions_get_their_new_columns(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0002")
    after = rows_of(old_url)
    for table, gone, new in (
        ("action_version", ["durative"], ["kind"]),
        ("object_version", [], ["is_constant"]),
        ("proposition_version", [], ["is_goal"]),
    ):
        assert without(after[table], *new) == without(before[table], *gone)
    durative = {(row["kb_id"], row["action_id"]): row for row in before["action_version"]}
    for row in after["action_version"]:
        was_durative = durative[row["kb_id"], row["action_id"]]["durative"]
        assert row["kind"] == ("durative-action" if was_durative else "action")
    assert not any(row["is_constant"] for row in after["object_version"])
    goals = {(row["kb_id"], row["id"]) for row in after["proposition"] if row["is_goal"]}
    marked = [row for row in after["proposition_version"] if row["is_goal"]]
    assert {(row["kb_id"], row["proposition_id"]) for row in marked} == goals
    assert len(marked) == 3


def test_the_library_reads_what_the_older_one_wrote(newest_url: str, connect: Connect) -> None:
    kb = open_tiago(newest_url, connect)
    assert [str(dto) for dto in kb.propositions.get_no_goals()] == ["(robot_at rb1 wp2)"]
    assert [str(dto) for dto in kb.propositions.get_goals()] == ["(robot_at rb1 dock)"]
    assert [str(dto) for dto in kb.at(3).propositions.get_goals()] == ["(robot_at rb1 wp2)"]
    assert [str(dto) for dto in kb.types.get_all()] == ["robot", "place", "wp - place"]
    texts = {row["text"] for row in rows_of(newest_url)["action_version"] if row["kb_id"] == 1}
    found = {str(dto) for at in (2, 6) for dto in kb.at(at).actions.get_all()}
    assert found == texts
    (navigation,) = kb.actions.get_all()
    assert (navigation.duration, len(navigation.conditions)) == (12.5, 3)
    assert [revision.reason for revision in kb.revisions()][3] == "it's there\nat last"
    assert connect(newest_url, knowledge_base="Küche 🤖").actions.get("rest") is not None


def test_the_hashes_still_recompute_and_the_chain_goes_on(
    newest_url: str, connect: Connect
) -> None:
    assert check_chain(newest_url) == REVISIONS
    kb = open_tiago(newest_url, connect)
    kb.propositions.delete_all()
    kb.actions.delete(PddlActionDto("navigation"))
    assert check_chain(newest_url) == {**REVISIONS, "tiago": 8}
    assert findings(newest_url) == []


def test_to_save_what_the_older_library_wrote_changes_nothing(
    newest_url: str, connect: Connect
) -> None:
    kb = open_tiago(newest_url, connect)
    daos: list[Any] = [kb.types, kb.objects, kb.predicates, kb.actions, kb.propositions]
    for dao in daos:
        dao.save_all(dao.get_all())
    assert kb.revision == REVISIONS["tiago"]


def test_down_and_up_again_gives_the_very_same_rows(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0002")
    between = rows_of(old_url)
    kant_sql.downgrade(old_url, revision="0001")
    assert rows_of(old_url) == before
    record = f"{make_url(old_url).get_backend_name()}-0001.sql"
    assert dump_of(old_url) == (FOLDER / record).read_text(encoding="utf-8")
    kant_sql.upgrade(old_url, revision="0002")
    assert rows_of(old_url) == between


def test_what_was_written_since_goes_down_when_0001_can_hold_it(
    newest_url: str, connect: Connect
) -> None:
    kb = open_tiago(newest_url, connect)
    (fact,) = kb.propositions.get_no_goals()
    kb.propositions.save(PddlPropositionDto(fact.predicate, fact.objects, is_goal=True))
    navigation = kb.actions.get("navigation")
    assert navigation is not None
    navigation.duration = 3
    kb.actions.save(navigation)
    literal = PddlConditionEffectDto(fact.predicate, navigation.parameters[:2])
    kb.actions.save(PddlActionDto("stay", navigation.parameters[:2], [literal], durative=False))
    kb.close()
    between = rows_of(newest_url)
    kant_sql.downgrade(newest_url, revision="0001")
    after = rows_of(newest_url)
    flags = {
        (row["action_id"], row["since"]): bool(row["durative"]) for row in after["action_version"]
    }
    kinds = {(row["action_id"], row["since"]): row["kind"] for row in between["action_version"]}
    assert flags == {key: kind == "durative-action" for key, kind in kinds.items()}
    assert len(after["action_expression"]) == len(between["action_node"])
    assert after["revision"] == without(between["revision"], "observed_at")
    kant_sql.upgrade(newest_url)
    assert rows_of(newest_url) == between


STRANGE = {
    "INSERT INTO function VALUES (1, 100, 'fuel', 'fuel')": "functions (1)",
    "INSERT INTO function_value VALUES (1, 101, 100, '', '(fuel)')": "values of functions (1)",
    "INSERT INTO formula VALUES (1, 102, 'ab', 'ab')": "formulas (1)",
    "INSERT INTO document VALUES (2, 100, 'domain', 'domain')": "documents (1)",
    "INSERT INTO type_parent VALUES (1, 5, 1, 1, 1)": "further parents of types (1)",
    "INSERT INTO object_type VALUES (1, 4, 1, 1, 2)": "further types of objects (1)",
    "UPDATE object_version SET is_constant = true WHERE kb_id = 1": "constants (4)",
    "UPDATE action_version SET kind = 'process' WHERE action_id = 11": "processes (2)",
    "UPDATE action_version SET kind = 'event' WHERE action_id = 13": "events (1)",
}
ANOTHER = "INSERT INTO action_node VALUES"
OPERATOR = "UPDATE action_node SET operator = '{}' WHERE kb_id = 1 AND action_id = 13"
DURATION = "WHERE kb_id = 2 AND action_id = 6 AND section = 'duration'"
TREES = {
    "a disjunction": f"{OPERATOR.format('or')} AND section = 'condition' AND position = 0",
    "an inner conjunction": f"{ANOTHER} (1, 13, 2, 'effect', 3, 0, 'and', NULL, NULL, NULL)",
    "a double negation": f"{ANOTHER} (1, 13, 2, 'effect', 3, 1, 'not', NULL, NULL, NULL)",
    "a time too many": f"{OPERATOR.format('at end')} AND section = 'effect' AND position = 1",
    "no time": "UPDATE action_node SET parent = 0 WHERE kb_id = 2 AND operator = 'predicate'",
    "no duration": f"DELETE FROM action_node {DURATION}",
    "an inequality": f"UPDATE action_node SET operator = '<=' {DURATION} AND position = 0",
    "two durations": f"{ANOTHER} (2, 6, 2, 'duration', 3, 0, 'number', NULL, NULL, '7')",
    "a bound variable": "INSERT INTO action_variable VALUES (1, 13, 2, 'effect', 0, 0, 'x'); "
    "UPDATE action_term SET parameter = NULL, quantifier = 0, variable = 0 "
    "WHERE action_id = 13 AND section = 'effect'",
}


def refusal(url: str) -> str:
    """What a downgrade is refused for, that changes nothing."""
    rows, schema = rows_of(url), dump_of(url)
    with pytest.raises(SchemaError, match="is or was in this store: ") as caught:
        kant_sql.downgrade(url, revision="0001")
    assert (rows_of(url), dump_of(url), current(url)) == (rows, schema, "0002")
    message = str(caught.value)
    assert "\n" not in message
    return message.partition("in this store: ")[2].partition("; nothing was changed")[0]


def test_elements_that_0001_has_no_tables_for_are_not_dropped(new_url: str) -> None:
    named: list[str] = []
    for change, what in STRANGE.items():
        run_script(new_url, change)
        named.append(what)
        assert refusal(new_url) == ", ".join(named)
    kant_sql.downgrade(new_url, revision="base")
    assert (rows_of(new_url), current(new_url)) == ({}, None)


@pytest.mark.parametrize("tree", TREES)
def test_trees_that_0001_would_misread_are_not_carried_down(new_url: str, tree: str) -> None:
    run_script(new_url, TREES[tree])
    assert refusal(new_url) == "actions of more than literals and a fixed duration (1)"
    kant_sql.downgrade(new_url, revision="base")
    assert (rows_of(new_url), current(new_url)) == ({}, None)


def test_a_downgrade_as_sql_cannot_look_and_is_refused(dialect: str) -> None:
    out = io.StringIO()
    config = alembic_config(out)
    config.attributes["url"] = f"{dialect}://"
    with pytest.raises(CommandError, match="run it on the database, without --sql"):
        command.downgrade(config, "0002:0001", sql=True)
    command.downgrade(config, "0002:base", sql=True)
    assert "DROP TABLE knowledge_base" in out.getvalue()


@pytest.mark.parametrize(
    ("held", "index"),
    [
        (VERSION.until.is_(None), "ix_proposition_version_goal (kb_id=? AND until=?)"),
        (
            (VERSION.since <= 7) & (VERSION.until.is_(None) | (VERSION.until > 7)),
            "ix_proposition_version_goal_history (kb_id=? AND since<?)",
        ),
    ],
    ids=["now", "then"],
)
def test_sqlite_finds_goals_by_their_indexes(
    tmp_path: Path, held: ColumnElement[bool], index: str
) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    kant_sql.upgrade(url, revision="0002")
    goals = select(VERSION.proposition_id).where(VERSION.kb_id == 1, held, VERSION.is_goal)
    with connected(url) as connection:
        sql = goals.compile(connection, compile_kwargs={"literal_binds": True})
        plan = connection.execute(text(f"EXPLAIN QUERY PLAN {sql}")).all()
    assert f"INDEX {index}" in plan[0][3]

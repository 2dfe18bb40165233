"""Views for auditors and answers as Arrow tables, on every backend."""

from __future__ import annotations

import sys
from collections.abc import Callable
from datetime import UTC, datetime
from decimal import Decimal

import pyarrow
import pytest

from kant_sql import (
    InvalidArgumentError,
    KnowledgeBase,
    PddlObjectDto,
    PddlPropositionDto,
    ReadOnlyError,
    aio,
)
from kant_sql.errors import ExtraMissingError, StoreIntegrityError
from kant_sql.sql.audit_views import AUDIT_VIEWS, arrow_schema
from tests.support.citus import is_distributed
from tests.support.pages import opened
from tests.support.reading import beside
from tests.support.statements import count
from tests.support.stores import Connect
from tests.support.worlds.robots import BATTERY, RB1, ROBOT_AT, WAYPOINT, WP2, navigation, robot_at

pytestmark = pytest.mark.every_backend

OBSERVED = datetime(2026, 3, 2, 14, 3, 0, 1, UTC)


def fill(kb: KnowledgeBase) -> None:
    """Let a fact come and go, with and without what a writer may say."""
    kb.actions.save(navigation())
    with kb.transaction(
        actor="perception", reason="seen", source={"camera": 4}, observed_at=OBSERVED
    ):
        kb.propositions.save(robot_at())
    with kb.transaction(actor="executive"):
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(place=WP2))


@pytest.mark.parametrize("view", AUDIT_VIEWS)
def test_every_view_has_its_types_also_without_rows(kb: KnowledgeBase, view: str) -> None:
    empty = kb.store.to_arrow(view)
    assert empty.num_rows == 0
    kb.propositions.save(robot_at())
    table = kb.store.to_arrow(view.removeprefix("audit_"))
    assert table.schema == empty.schema == arrow_schema(AUDIT_VIEWS[view])
    assert all(field.nullable for field in table.schema)
    assert bool(table.num_rows) == (view in FILLED)


FILLED = {
    *("audit_knowledge_base", "audit_revision", "audit_change", "audit_definition"),
    *("audit_fact", "audit_fact_valid", "audit_fact_argument", "audit_object"),
}


def test_values_have_types_and_are_those_of_the_history(kb: KnowledgeBase) -> None:
    fill(kb)
    first, second = kb.store.to_arrow("fact").to_pylist()
    (kept,) = kb.history("(robot_at rb1 wp1)")
    assert first["since"] == kept.since.number == 2
    assert first["since_at"] == kept.since.committed_at
    assert first["since_observed_at"] == OBSERVED
    assert first["asserted_by"] == "perception"
    assert first["until"] == 3
    assert first["duration"] > 0
    assert [second[name] for name in ("until", "until_at", "duration")] == [None] * 3
    revision = kb.store.to_arrow("revision").to_pylist()[1]
    assert revision["source"] == '{"camera":4}'
    assert revision["committed_epoch"] == revision["committed_at"].timestamp()
    objects = kb.store.to_arrow("object").to_pylist()
    assert [row["is_constant"] for row in objects] == [False] * 3
    needs = kb.store.to_arrow("action_literal")
    assert needs.schema.field("is_conditional").type == pyarrow.bool_()
    assert needs.num_rows


def test_rows_are_of_this_knowledge_base_and_sorted(kb: KnowledgeBase) -> None:
    fill(kb)
    fill(beside(kb, "other"))
    for name, view in AUDIT_VIEWS.items():
        table = kb.store.to_arrow(name)
        assert set(table["knowledge_base"].to_pylist()) <= {"tiago"}
        keys = [tuple(row.values()) for row in table.select([*view.order]).to_pylist()]
        assert keys == sorted(keys)


def test_unicode_and_numbers_of_any_size_are_kept(kb: KnowledgeBase) -> None:
    great = Decimal(f"1{0:039}1")
    name = "küche-🤖"
    with kb.transaction(reason="x" * 10_000 + "\u202e🤖\n\t\"',"):
        kb.function_values.set(BATTERY, objects=[RB1], value=great)
        kb.propositions.save(PddlPropositionDto(ROBOT_AT, [RB1, PddlObjectDto(WAYPOINT, name)]))
    (value,) = kb.store.to_arrow("value").to_pylist()
    assert value["value"] == str(great)
    assert value["number"] == float(great)
    (fact,) = kb.store.to_arrow("fact").to_pylist()
    assert fact["arguments"] == f"rb1 {name}"
    assert fact["asserted_reason"] == kb.store.revisions()[0].reason


def test_what_was_archived_is_in_the_tables_of_the_archive(
    kb: KnowledgeBase, connect: Connect, tmp_path_factory: pytest.TempPathFactory
) -> None:
    fill(kb)
    kb.goals.save(robot_at(is_goal=True))
    target = f"sqlite:///{tmp_path_factory.mktemp('archive') / 'old.db'}"
    before = kb.store.to_arrow("fact")
    kb.store.archive(4, to=target)
    assert kb.store.to_arrow("fact")["since"].to_pylist() == [3, 4]
    (row,) = kb.store.to_arrow("archive").to_pylist()
    assert row["revision"] == 3
    assert kb.store.to_arrow("revision").num_rows == kb.revision
    moved = connect(target, knowledge_base="tiago").store.to_arrow("fact")
    assert moved.slice(0, 1).drop(["proposition_id"]) == before.slice(0, 1).drop(["proposition_id"])


def test_two_statements_however_many_rows(kb: KnowledgeBase, url: str) -> None:
    fill(kb)
    few = count(lambda: kb.store.to_arrow("change"))
    for _ in range(5):
        kb.propositions.delete_all()
        kb.propositions.save(robot_at())
    # On a cluster, one more reads what the view is.
    assert count(lambda: kb.store.to_arrow("change")) == few <= (3 if is_distributed(url) else 2)


def test_the_past_and_pending_changes_are_refused(kb: KnowledgeBase) -> None:
    fill(kb)
    with pytest.raises(ReadOnlyError, match="since <= 2 and"):
        kb.at(2).store.to_arrow("fact")
    with kb.transaction(), pytest.raises(ReadOnlyError, match="a transaction"):
        kb.store.to_arrow("fact")


@pytest.mark.parametrize("view", ["facts", "", "audit_", "revision; --", 3, None, b"fact"])
def test_a_view_that_is_none_is_refused(kb: KnowledgeBase, view: str) -> None:
    with pytest.raises(InvalidArgumentError) as caught:
        kb.store.to_arrow(view)
    if isinstance(view, str):
        assert "choose one of: knowledge_base, revision, change, fact" in str(caught.value)


def test_without_pyarrow_the_extra_is_named(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    fill(kb)
    answers = kb.query("(robot_at ?r ?w)")
    calls: list[Callable[[], object]] = [lambda: kb.store.to_arrow("fact"), answers.to_arrow]
    for call in calls:
        with pytest.raises(ExtraMissingError, match=r"pip install 'kant-sql\[data\]'"):
            call()


def test_answers_are_columns_of_names(kb: KnowledgeBase) -> None:
    fill(kb)
    found = kb.query("(robot_at ?r ?w)")
    table = found.to_arrow()
    assert table.to_pydict() == {"r": ["rb1"], "w": ["wp2"]}
    assert table.schema == pyarrow.schema({"r": pyarrow.string(), "w": pyarrow.string()})
    none = kb.query("(robot_at ?r wp1)").to_arrow()
    assert (none.num_rows, none.column_names) == (0, ["r"])
    assert none.schema.field("r").type == pyarrow.string()


@pytest.mark.parametrize(
    ("condition", "rows"), [("(robot_at rb1 wp2)", 1), ("(robot_at rb1 wp1)", 0)]
)
def test_answers_without_columns_are_counted(kb: KnowledgeBase, condition: str, rows: int) -> None:
    fill(kb)
    kb.propositions.delete(robot_at())
    table = kb.query(condition).to_arrow()
    assert (table.num_rows, table.num_columns) == (rows, 0)


async def test_tasks_await_tables(url: str) -> None:
    async with aio.connect(url, knowledge_base="tiago") as kb:
        await kb.propositions.save(robot_at())
        answers = await kb.query("(robot_at ?r ?w)")
        assert answers.to_arrow().num_rows == 1
        table = await kb.store.to_arrow("fact")
    assert table["text"].to_pylist() == ["(robot_at rb1 wp1)"]


def test_a_time_that_is_none_is_found(url: str, connect: Connect) -> None:
    """Nobody but SQLite would keep it."""
    kb = connect(url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    if not url.startswith("sqlite:///"):
        pytest.skip("the database keeps no other times, or nobody else can reach it")
    with opened(url) as store:
        store.execute("UPDATE revision SET committed_at = 'yesterday'", {})
    with pytest.raises(StoreIntegrityError, match="audit_fact"):
        kb.store.to_arrow("fact")

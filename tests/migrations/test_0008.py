"""Migration 0008 makes executions of the steps of plans, which go on and are verified."""

from __future__ import annotations

from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import PlanError
from tests.contract.test_hash import last_hash
from tests.migrations import stores
from tests.support.chain import check_chain
from tests.support.pages import ask
from tests.support.reading import findings
from tests.support.stores import Connect

NEW = ("execution", "execution_argument", "execution_version", "revision_execution")
NAME = "rounds"


@pytest.fixture
def old_url(make: stores.Make) -> str:
    """The URL of a store with plans, whose steps have every status."""
    return make(stores.written("store"))


def open_rounds(url: str, connect: Connect) -> KnowledgeBase:
    return connect(url, knowledge_base=NAME, actor="test")


def test_every_status_is_an_outcome(old_url: str, connect: Connect) -> None:
    kant_sql.upgrade(old_url)
    kb = open_rounds(old_url, connect)
    plans = {plan.id: [step.outcome for step in plan.steps] for plan in kb.plans.get_all()}
    assert plans == {
        1: ["succeeded", "succeeded"],
        2: ["succeeded"],
        3: ["succeeded", "failed", "running", "aborted", None],
        4: ["running"],
    }
    failed = kb.plans.get_all()[2].steps[1]
    assert (failed.id, failed.outcomes[0].text) == ("3.1", "(:plan 3 :step 1 started)")
    assert failed.outcomes[0].kind == "plan step"
    assert [each.id for each in kb.executions.get_all(outcome="running")] == ["4.0", "3.2"]
    lone = kb.executions.get("4.0")
    assert lone is not None
    assert (lone.reason, str(lone)) == ("a second look", "(scan rb2 lab)")
    assert "3.1 | 3 | 1 | move | rb1 hall lab" in " ".join(
        ask(old_url, "SELECT execution, plan_id, position, action, arguments FROM audit_execution")
    )


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE execution_version SET kind = 'execution' WHERE since = 15",
        "UPDATE execution_version SET outcome = 'failed' WHERE outcome = 'running'",
        "UPDATE execution_version SET code = 'E4' WHERE since = 15",
        "UPDATE execution_version SET message = '' WHERE since = 15",
        "UPDATE execution_version SET started_at = (SELECT max(committed_at) FROM revision)",
        "UPDATE execution_version SET ended_at = (SELECT max(committed_at) FROM revision)",
        "UPDATE execution_version SET text = '(:plan 3 :step 4 aborted)' WHERE since = 15",
        "DELETE FROM execution_version WHERE since = 15",
        "UPDATE execution SET since = since + 1 WHERE plan_id = 3",
        "UPDATE execution SET name = 'x', action_id = NULL WHERE plan_id = 3 AND position = 4",
    ],
)
@pytest.mark.more
def test_what_was_carried_is_verified(old_url: str, change: str) -> None:
    kant_sql.upgrade(old_url)
    stores.run_script(old_url, change)
    assert findings(old_url)


def test_what_runs_goes_on(old_url: str, connect: Connect) -> None:
    kant_sql.upgrade(old_url)
    kb = open_rounds(old_url, connect)
    assert kb.end("(scan rb2 lab)").id == "4.0"
    step = kb.plans.get_all()[2].steps[2]
    ended = kb.end(step)
    assert [(each.kind, each.text) for each in ended.outcomes] == [
        ("plan step", "(:plan 3 :step 2 started)"),
        ("execution", "(:execution 3.2 (scan rb1 lab) succeeded)"),
    ]
    kb.apply("(move rb2 lab hall)")
    with pytest.raises(PlanError, match="has failed"):
        kb.apply(kb.plans.get_all()[2].steps[1])
    kb.close()
    assert findings(old_url) == []
    assert "revisions of form 2 (3)" in stores.refusal(old_url, "0007")
    # As the library of version 0008 writes them, which has form 1 only.
    stores.run_script(old_url, "UPDATE revision SET form = 1, seed = NULL")
    assert "outcomes of executions (3)" in stores.refusal(old_url, "0007")
    kant_sql.operations.downgrade(old_url, revision="base")
    assert stores.rows_of(old_url) == {}


@pytest.mark.more
def test_an_archive_and_its_store_go_on_together(
    make: stores.Make, old_url: str, connect: Connect, tmp_path: Path
) -> None:
    archive = make(stores.written("archive"))
    for url in (old_url, archive):
        kant_sql.upgrade(url)
        assert findings(url) == []
    # The archive has all changes of its revisions, with the lines of the version before.
    assert check_chain(archive) == {NAME: 7}
    assert last_hash(archive, NAME) is not None
    assert [str(each) for each in open_rounds(archive, connect).executions.get_all()] == [
        "(scan rb2 lab)",
        "(scan rb1 lab)",
        "(move rb1 hall lab)",
    ]


def test_a_replica_goes_on_from_where_it_was(
    make: stores.Make, old_url: str, connect: Connect, tmp_path: Path
) -> None:
    """Both are migrated by themselves, and have the same keys."""
    replica = f"sqlite:///{tmp_path / 'replica.db'}"
    stores.written("store")(replica)
    stores.run_script(replica, "UPDATE head SET origin = 'elsewhere', heard_at = committed_at")
    for url in (old_url, replica):
        kant_sql.upgrade(url)
    kb = open_rounds(old_url, connect)
    kb.end("(scan rb2 lab)")
    kb.start("(scan rb1 lab)") if kb.why_not("(scan rb1 lab)") == [] else None
    kb.store.push(replica)
    kb.close()
    for table in NEW:
        assert ask(replica, f"SELECT * FROM {table}") == ask(old_url, f"SELECT * FROM {table}")
    assert findings(replica) == []

"""`kant-sql merge`: a branch comes back at the prompt."""

from __future__ import annotations

from pathlib import Path

import pytest

import kant_sql
from tests.support.processes.commands import document, run

AT_WP1, AT_WP2 = "(robot_at rb1 wp1)", "(robot_at rb1 wp2)"


@pytest.fixture
def trial(own_store: str) -> str:
    """A store with a branch that retracts a fact, and asserts another."""
    with kant_sql.connect(own_store, knowledge_base="tiago", actor="driver") as kb:
        kb.propositions.save(AT_WP1)
        branch = kb.branch("trial")
        with branch, branch.transaction(actor="planner", reason="shorter\nway"):
            branch.propositions.delete(AT_WP2)
            branch.propositions.delete(AT_WP1)
        kb.propositions.delete(AT_WP1)
        kb.propositions.save(AT_WP1)
    return own_store


def test_without_yes_it_lists_what_would_change(trial: str) -> None:
    result = run("merge", trial, "trial", "--kb", "tiago")
    assert result.exit_code == 1
    assert result.stdout.splitlines()[0] == (
        "knowledge base tiago: 1 change of trial at revision 2 since revision 4"
    )
    assert f"- fact {AT_WP2}" in result.stdout
    assert f"conflict: fact {AT_WP1}\n  ours: {AT_WP1} (revision 6, driver)" in result.stdout
    assert "  theirs: nothing (revision 2, planner, shorter\\nway)" in result.stdout
    assert result.stdout.splitlines()[-1] == (
        "Nothing was changed; add --yes, and --ours or --theirs for each conflict."
    )
    decided = run("merge", trial, "trial", "--kb", "tiago", "--theirs", AT_WP1)
    assert decided.stdout.splitlines()[-1] == "Nothing was changed; add --yes."
    found = document("merge", trial, "trial", "--kb", "tiago", "--ours", AT_WP1)
    assert [each["decided"] for each in found["conflicts"]] == ["ours"]
    assert (found["knowledge_base"], found["head"], found["revision"]) == ("tiago", 6, None)
    assert found["conflicts"][0]["theirs"]["revision"]["actor"] == "planner"


def test_with_yes_it_merges_what_is_decided(trial: str) -> None:
    refused = run("merge", trial, "trial", "--kb", "tiago", "--yes")
    assert refused.exit_code == 1
    assert "1 open conflict" in refused.stderr
    words = ("merge", trial, "trial", "--kb", "tiago", "--yes", "--actor", "operator")
    result = run(*words, "--theirs", f"fact {AT_WP1}", "--reason", "it works")
    assert result.exit_code == 0
    assert result.stdout.startswith(
        "knowledge base tiago, revision 7: merged trial at revision 2\n"
        f"- fact {AT_WP1}\n- fact {AT_WP2}\n"
    )
    with kant_sql.connect(trial, knowledge_base="tiago") as kb:
        last = kb.store.revisions()[-1]
        assert (last.actor, last.reason) == ("operator", "it works")
    again = run("merge", trial, "trial", "--kb", "tiago")
    assert again.stdout == (
        "knowledge base tiago: nothing is new in trial at revision 2 since revision 7\n"
    )


def test_a_rule_that_the_result_would_break_is_decided(trial: str) -> None:
    with kant_sql.connect(trial, knowledge_base="tiago") as kb:
        kb.rules.save("stay", f"(always {AT_WP2})", on_violation="refuse")
    words = "merge", trial, "trial", "--kb", "tiago", "--ours", AT_WP1
    result = run(*words)
    rule = f"rule stay (always {AT_WP2})"
    assert f"\nconflict: {rule}\n  ours: (:rule stay " in result.stdout
    assert f"\n  theirs: (not {AT_WP2}) (revision 2, planner, shorter\\nway)\n" in result.stdout
    assert result.exit_code == 1
    left = document(*words, "--ours", rule)
    assert ([each["decided"] for each in left["conflicts"]], left["changes"]) == (["ours"] * 2, [])
    made = document(*words, "--theirs", rule, "--yes")
    assert [each["kind"] for each in made["changes"]] == ["fact", "rule"]


def test_of_another_store_and_a_past_state(own_store: str, tmp_path: Path) -> None:
    other = f"sqlite:///{tmp_path}/other.db"
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb, kb.branch(url=other) as branch:
        branch.propositions.delete(AT_WP2)
        branch.propositions.save(AT_WP2)
        branch.propositions.delete(AT_WP2)
        head = kb.revision
    kept = document("merge", own_store, "--kb", "tiago", "--url", other, "--at", "3")
    assert (kept["changes"], kept["branch_revision"]) == ([], 3)
    made = document("merge", own_store, "--kb", "tiago", "--url", other, "--yes")
    assert made["revision"] == head + 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "give a name, --url or both"),
        ("nobody", "there is no knowledge base 'nobody'"),
        ("trial --ours x --theirs x", "'x' is given twice"),
        ("trial --ours x", "'x' is not a conflict of this merge"),
        ("tiago", "is not a branch of 'tiago'"),
    ],
)
def test_what_cannot_be_merged(trial: str, words: str, message: str) -> None:
    result = run("merge", trial, *words.split(), "--kb", "tiago")
    assert result.exit_code in (1, 2)
    assert message in " ".join(result.stderr.split())

"""`kant-sql log`, `diff`, `history`, `blame` and `restore`: the past at the prompt."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

import kant_sql
from kant_sql.knowledge.canonical import time_text
from tests.support.processes.commands import document, documents, run

AT_WP1, AT_WP2 = "(robot_at rb1 wp1)", "(robot_at rb1 wp2)"


def numbers(*words: str) -> list[int]:
    """The revisions that `log --json` writes."""
    return [each["number"] for each in documents("log", *words)]


def times(store: str) -> list[datetime]:
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        return [revision.committed_at for revision in kb.store.revisions()]


def test_the_log_is_bounded_by_revisions_and_times(store: str) -> None:
    first, second, third = times(store)
    assert numbers(store, "--since", "2") == [3, 2]
    assert numbers(store, "--until", "2") == [2, 1]
    assert numbers(store, "--since", time_text(second), "--until", time_text(second)) == [2]
    assert numbers(store, "--since", "a day ago") == [3, 2, 1]
    assert numbers(store, "--limit", "0") == []
    assert numbers(store, "--limit", "1") == [3]
    assert numbers(store, "--limit", "2") == [3, 2]
    assert numbers(store, "--limit", "9" * 30) == [3, 2, 1]
    assert first <= third


def test_the_log_of_an_actor_and_of_an_element(store: str) -> None:
    assert numbers(store, "--actor", "executive") == [2]
    assert numbers(store, "--element", AT_WP2) == [2]
    result = run("log", store, "--element", AT_WP1, "--since", "2")
    lines = result.stdout.splitlines()
    assert [line for line in lines if line.startswith(("  + ", "  - "))] == [
        f"  + goal {AT_WP1}",
        f"  - fact {AT_WP1}",
    ]


def test_now_is_the_present_state(own_store: str) -> None:
    assert run("show", own_store, "--at", "now").stdout == run("show", own_store).stdout
    assert run("diff", own_store, "1", "now").stdout == run("diff", own_store, "1", "3").stdout
    assert numbers(own_store, "--until", "now", "--since", "yesterday") == [3, 2, 1]
    assert document("restore", own_store, "now") == {
        "knowledge_base": "tiago",
        "restored": 3,
        "revision": None,
        "changes": [],
    }


def test_diff_writes_what_came_and_what_went(store: str) -> None:
    result = run("diff", store, "1", "2")
    assert result.stdout == f"+ fact {AT_WP2}\n+ object wp2 - wp\n- fact {AT_WP1}\n"
    result = run("diff", "2", "1", url=store)
    assert result.stdout == f"+ fact {AT_WP1}\n- fact {AT_WP2}\n- object wp2 - wp\n"
    found = document("diff", store, "1", "2")
    assert (found["knowledge_base"], found["a"], found["b"]) == ("tiago", 1, 2)
    assert found["changes"][0] == {"sign": "+", "kind": "fact", "text": AT_WP2}


def test_diff_of_a_state_with_itself_is_empty(store: str) -> None:
    result = run("diff", store, "3", "3")
    assert (result.exit_code, result.stdout) == (0, "")


@pytest.mark.parametrize(
    ("short", "whole"),
    [
        (["diff", "1"], ["diff", "1", "3"]),
        (["diff", "1..2"], ["diff", "1", "2"]),
        (["diff", "3..1"], ["diff", "3", "1"]),
        (["diff", "2.."], ["diff", "2", "now"]),
        (["diff", "..2"], ["diff", "now", "2"]),
        (["show", "2"], ["log", "--since", "2", "--until", "2"]),
        (["show", "now"], ["log", "--limit", "1"]),
    ],
)
def test_revisions_are_written_as_for_git(store: str, short: list[str], whole: list[str]) -> None:
    (command, *words), (other, *more) = short, whole
    expected = run(other, store, *more)
    assert run(command, store, *words).stdout == expected.stdout != ""
    assert run(command, *words, url=store).stdout == expected.stdout
    assert run(command, store, *words, "--json").stdout == run(other, store, *more, "--json").stdout


def test_history_tells_both_ends_of_each_version(store: str) -> None:
    first, second, _ = (time_text(moment) for moment in times(store))
    assert run("history", store, AT_WP1, "--at", "2").stdout == (
        f"fact {AT_WP1}\n"
        f"  asserted in revision 1  {first}\n"
        "    actor: perception\n"
        f"  retracted in revision 2  {second}\n"
        "    actor: executive\n"
        "    reason: navigation finished\n"
        '    source: {"step": 3}\n'
    )
    found = document("history", store, AT_WP1, "--at", "2")
    assert (found["kind"], found["text"]) == ("fact", AT_WP1)
    assert found["since"]["number"] == 1
    assert found["until"]["reason"] == "navigation finished"


def test_history_of_a_name_is_that_of_its_definitions(store: str) -> None:
    assert "object wp2 - wp" in run("history", store, "WP2").stdout
    assert "holds now" in run("history", store, "drone").stdout


def test_history_at_a_revision_knows_no_later_one(store: str) -> None:
    assert "holds now" in run("history", store, AT_WP1, "--at", "1").stdout


def test_blame_names_who_asserted_what_holds(store: str) -> None:
    result = run("blame", store, "(ROBOT_AT rb1 wp2)")
    assert "actor: executive" in result.stdout
    assert "reason: navigation finished" in result.stdout
    found = document("blame", store, AT_WP2)
    assert found["since"]["number"] == 2
    assert found["until"] is None


def test_restore_makes_a_revision_that_can_be_undone(own_store: str) -> None:
    before = run("show", own_store).stdout.partition("\n")[2]
    result = run("restore", own_store, "1", "--actor", "operator", "--reason", "tried too much")
    assert result.exit_code == 0, result.stderr
    head, *changes = result.stdout.splitlines()
    assert head == "knowledge base tiago, revision 4: the state of revision 1"
    assert f"+ fact {AT_WP1}" in changes
    assert f"- fact {AT_WP2}" in changes
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        (revision,) = kb.store.revisions(after=3)
        assert (revision.actor, revision.reason) == ("operator", "tried too much")
        assert kb.diff(1, 4) == []
    found = document("restore", own_store, "3")
    assert (found["restored"], found["revision"]) == (3, 5)
    assert run("show", own_store).stdout.partition("\n")[2] == before
    again = run("restore", own_store, "3")
    assert again.stdout == "knowledge base tiago: nothing is different from revision 3\n"


def test_times_of_the_past_are_in_utc(store: str) -> None:
    moment = datetime.now(UTC).isoformat()
    assert document("diff", store, "0", moment)["b"] == 3

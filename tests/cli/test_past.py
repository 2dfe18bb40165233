"""`kant-sql log`, `diff`, `history`, `blame` and `restore`: the past at the prompt."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import pytest

import kant_sql
from kant_sql.knowledge.canonical import time_text
from tests.support.processes.commands import child, one_line, run

AT_WP1, AT_WP2 = "(robot_at rb1 wp1)", "(robot_at rb1 wp2)"


def json_of(*words: str) -> Any:
    """The one JSON document that a command writes."""
    result = run(*words, "--json")
    assert result.exit_code == 0, result.stderr
    (line,) = result.stdout.splitlines()
    return json.loads(line)


def numbers(*words: str) -> list[int]:
    """The revisions that `log --json` writes."""
    result = run("log", *words, "--json")
    assert result.exit_code == 0, result.stderr
    return [json.loads(line)["number"] for line in result.stdout.splitlines()]


def times(store: str) -> list[datetime]:
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        return [revision.committed_at for revision in kb.store.revisions()]


def test_the_log_is_bounded_by_revisions_and_times(store: str) -> None:
    first, second, third = times(store)
    assert numbers(store, "--since", "2") == [3, 2]
    assert numbers(store, "--until", "2") == [2, 1]
    assert numbers(store, "--since", time_text(second), "--until", time_text(second)) == [2]
    assert numbers(store, "--since", "a day ago") == [3, 2, 1]
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
    assert json_of("restore", own_store, "now") == {
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
    document = json_of("diff", store, "1", "2")
    assert (document["knowledge_base"], document["a"], document["b"]) == ("tiago", 1, 2)
    assert document["changes"][0] == {"sign": "+", "kind": "fact", "text": AT_WP2}


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


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["diff", "1..2", "3"], 2, "give A B or A..B, not both"),
        (["diff", "1...2"], 2, "'.2'"),
        (["show", "4"], 1, "has no revision 4: it is at 3"),
        (["show", "0"], 1, "there was no revision of knowledge base 'tiago' yet"),
        (["show", "2", "--at", "1"], 2, "--at and its options show a state"),
        (["show", "2", "--facts"], 2, "--at and its options show a state"),
        (["show", "2", "3"], 2, "[REV|TIME]"),
        (["plans", "first"], 2, "'first': expected the number of one plan"),
        (["plans", "7", "--plan", "7"], 2, "'7': expected the number of one plan"),
        (["plans", "7"], 1, "there is no plan 7 in knowledge base 'tiago'"),
    ],
)
def test_what_is_written_otherwise_is_one_line(
    store: str, words: list[str], code: int, message: str
) -> None:
    result = run(words[0], store, *words[1:])
    assert message in one_line(result.stderr)
    assert (result.exit_code, result.stdout) == (code, "")


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
    document = json_of("history", store, AT_WP1, "--at", "2")
    assert (document["kind"], document["text"]) == ("fact", AT_WP1)
    assert document["since"]["number"] == 1
    assert document["until"]["reason"] == "navigation finished"


def test_history_of_a_name_is_that_of_its_definitions(store: str) -> None:
    assert "object wp2 - wp" in run("history", store, "WP2").stdout
    assert "holds now" in run("history", store, "drone").stdout


def test_history_at_a_revision_knows_no_later_one(store: str) -> None:
    assert "holds now" in run("history", store, AT_WP1, "--at", "1").stdout


def test_blame_names_who_asserted_what_holds(store: str) -> None:
    result = run("blame", store, "(ROBOT_AT rb1 wp2)")
    assert "actor: executive" in result.stdout
    assert "reason: navigation finished" in result.stdout
    document = json_of("blame", store, AT_WP2)
    assert document["since"]["number"] == 2
    assert document["until"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("blame", "wp9"), "knowledge base 'tiago' has never had an element 'wp9'"),
        (("blame", "(robot_at rb1 rb1)"), "it does not hold; see: kant-sql history"),
        (("history", "(robot_at rb1 nowhere)"), "has never had an object 'nowhere'"),
        (("history", "(robot_at rb11 wp1)"), "an object 'rb11' (did you mean rb1?)"),
        (("history", "(robot_at rb1 rb1)"), "it has never been there; see: kant-sql log"),
        (("diff", "1", "9"), "has no revision 9: it is at 3"),
        (("restore", "9"), "has no revision 9: it is at 3"),
        (("log", "--since", "2999-01-01T00:00:00Z"), "is in the future"),
    ],
)
def test_what_never_was_is_one_line_and_a_failure(
    store: str, words: tuple[str, ...], message: str
) -> None:
    command, *rest = words
    result = run(command, store, *rest)
    assert result.exit_code == 1
    assert message in one_line(result.stderr)


@pytest.mark.parametrize("command", ["diff", "history", "blame", "restore"])
def test_too_few_or_too_many_words_are_wrong_usage(store: str, command: str) -> None:
    for words in ((), ("1", "2", "3", "4")):
        result = run(command, store, *words)
        assert result.exit_code == 2
        assert "(or set KANT_SQL_URL) and" in one_line(result.stderr)


def test_restore_makes_a_revision_that_can_be_undone(own_store: str) -> None:
    before = run("show", own_store).stdout.partition("\n")[2]
    result = run("restore", own_store, "1", "--actor", "operator", "--reason", "tried too much")
    assert result.exit_code == 0, result.stderr
    head, *changes = result.stdout.splitlines()
    assert head == "knowledge base tiago, revision 4: as revision 1 was"
    assert f"+ fact {AT_WP1}" in changes
    assert f"- fact {AT_WP2}" in changes
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        (revision,) = kb.store.revisions(after=3)
        assert (revision.actor, revision.reason) == ("operator", "tried too much")
        assert kb.diff(1, 4) == []
    document = json_of("restore", own_store, "3")
    assert (document["restored"], document["revision"]) == (3, 5)
    assert run("show", own_store).stdout.partition("\n")[2] == before
    again = run("restore", own_store, "3")
    assert again.stdout == "knowledge base tiago: nothing is different from revision 3\n"


def test_no_command_of_the_past_creates_a_store(tmp_path: Any) -> None:
    url = f"sqlite:///{tmp_path / 'missing.db'}"
    for words in (("diff", url, "0", "0"), ("history", url, "x"), ("restore", url, "0")):
        assert child(*words).returncode == 1
    assert not list(tmp_path.iterdir())


def test_times_of_the_past_are_in_utc(store: str) -> None:
    moment = datetime.now(UTC).isoformat()
    assert json_of("diff", store, "0", moment)["b"] == 3

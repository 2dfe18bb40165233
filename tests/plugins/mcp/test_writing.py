"""Programs write to branches of their own, or where a kept rule refuses; to nothing else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import kant_sql
from kant_sql.errors import ReadOnlyError
from kant_sql.web import writing as web_writing
from kant_sql.web.stores import OpenStore
from tests.plugins.mcp.test_reading import asked, url
from tests.support.processes.commands import command, complaint

pytest.importorskip("mcp", reason="needs the extra mcp")
from mcp import Client, StdioServerParameters

from kant_sql_plugins.mcp import writing
from kant_sql_plugins.mcp.server import make_server
from kant_sql_plugins.mcp.writing import Writing

__all__ = ["url"]

BACK = "(move rb1 lab hall)"
RULE = "(forall (?r - robot) (at-most-one (?p - room) (at ?r ?p)))"
WRITERS = {"write_facts", "write_values", "apply_step"}


def state_of(url: str, name: str = "ward") -> tuple[int, list[str]]:
    """The last revision, and the facts."""
    with kant_sql.connect(url, knowledge_base=name) as kb:
        return kb.revision, sorted(map(str, kb.propositions.get_all()))


def write(url: str, target: Any, *calls: tuple[str, dict[str, Any]], actor: str = "mcp") -> Any:
    """Call tools of a server that writes, in this process; return their answers."""
    reading, written = OpenStore(url), OpenStore(url, read_only=False)

    async def work(client: Client) -> list[Any]:
        return [await client.call_tool(*one) for one in calls]

    try:
        server = make_server(reading, Writing(written, target, None, actor).tools())
        return asked(server, work)
    finally:
        reading.close()
        written.close()


def test_a_branch_is_written_to_over_standard_input_and_the_original_stays(url: str) -> None:
    before = state_of(url)
    program, *words = command()
    words += ["mcp", url, "--write", "branch", "--actor", "planner"]

    async def work(client: Client) -> list[Any]:
        hints = {one.name: one.annotations for one in (await client.list_tools()).tools}
        writers = {name for name, one in hints.items() if one and not one.read_only_hint}
        assert writers == {*WRITERS, "begin_branch"}
        given: dict[str, Any] = {"kb": "trial", "reason": "what if"}
        calls: list[tuple[str, dict[str, Any]]] = [
            ("begin_branch", {"kb": "ward", "name": "trial"}),
            ("apply_step", {**given, "step": BACK}),
            ("write_facts", {**given, "delete": ["(open)"]}),
            ("write_values", {**given, "set": {"(battery)": 7.5}}),
            ("known", {"kb": "trial", "kind": "fact"}),
            ("log", {"kb": "trial"}),
        ]
        return [await client.call_tool(*one) for one in calls]

    answers = asked(StdioServerParameters(command=program, args=words), work)
    assert not [one.content for one in answers if one.is_error]
    assert [one.structured_content["revision"] for one in answers[:4]] == [1, 2, 3, 4]
    (part,) = answers[4].structured_content["parts"]
    assert [one["text"] for one in part["elements"]] == ["(at rb1 hall)"]
    assert {one["actor"] for one in answers[5].structured_content["revisions"]} == {"planner"}
    assert state_of(url) == before
    with (
        kant_sql.connect(url, knowledge_base="ward") as kb,
        kant_sql.connect(url, knowledge_base="trial") as trial,
    ):
        changed = {(one.sign, one.text) for one in kb.diff(kb, trial) if one.kind == "fact"}
    assert changed == {("-", "(open)"), ("-", "(at rb1 lab)"), ("+", "(at rb1 hall)")}


@pytest.mark.parametrize("kb", [None, "ward", "theirs", "no-branch", "nobody"])
def test_what_the_actor_has_not_begun_is_not_written_to(url: str, kb: str | None) -> None:
    with kant_sql.connect(url, knowledge_base="ward", actor="somebody") as original:
        original.branch("theirs").close()
    with kant_sql.connect(url, knowledge_base="no-branch", actor="mcp") as own:
        # Begun by the actor, but no branch: nobody compares it with anything.
        own.load_domain("(define (domain empty))")
    before = state_of(url), state_of(url, "theirs"), state_of(url, "no-branch")
    given: dict[str, Any] = {"reason": "because", **({"kb": kb} if kb else {})}
    answers = write(
        url,
        "branch",
        ("write_facts", {**given, "delete": ["(open)"]}),
        ("write_values", {**given, "unset": ["(battery)"]}),
        ("apply_step", {**given, "step": BACK}),
        ("begin_branch", {"kb": "ward", "name": "theirs"}),
        ("begin_branch", {"kb": "nobody", "name": "new"}),
        ("begin_branch", {"kb": "ward", "name": "of-nothing", "at": 0}),
    )
    assert [one.is_error for one in answers] == [True] * 6
    assert "is empty" in answers[-1].content[0].text
    said = {None: "choose one with the parameter kb", "nobody": "has no knowledge base 'nobody'"}
    why = said.get(kb, "with the tool begin_branch")
    assert all(why in one.content[0].text for one in answers[:3])
    assert (state_of(url), state_of(url, "theirs"), state_of(url, "no-branch")) == before


def test_a_knowledge_base_is_written_to_where_a_rule_refuses(url: str) -> None:
    with kant_sql.connect(url, knowledge_base="ward") as kb:
        kb.rules.save("one-place", RULE, on_violation="refuse")
    revision, _ = state_of(url)
    both, moved, gone, unknown, nameless = write(
        url,
        "checked",
        ("write_facts", {"reason": "seen twice", "save": ["(at rb1 hall)"]}),
        ("apply_step", {"reason": "back", "step": BACK}),
        ("apply_step", {"reason": "again", "step": BACK}),
        ("write_facts", {"reason": "x", "save": ["(flies rb1)", "(open)"]}),
        ("write_facts", {"reason": "", "delete": ["(open)"]}),
    )
    assert "one-place" in both.content[0].text
    assert moved.structured_content["revision"] == revision + 1
    assert "(at rb1 lab)" in gone.content[0].text
    assert "flies" in unknown.content[0].text
    assert "reason" in nameless.content[0].text
    assert state_of(url) == (revision + 1, ["(at rb1 hall)", "(open)"])


def test_a_rule_that_goes_ends_writing(url: str) -> None:
    with kant_sql.connect(url, knowledge_base="ward") as kb:
        kb.rules.save("one-place", RULE, on_violation="refuse")
        written = OpenStore(url, read_only=False)
        server = Writing(written, "checked", None, "mcp")
        kb.rules.save("one-place", RULE, on_violation="report")
        with pytest.raises(ReadOnlyError, match="keeps no rule that refuses"):
            server.of_kb(None, lambda kb: kb.propositions.delete("(open)"))
        written.close()
        assert kb.holds("(open)")


def test_a_rule_that_goes_during_a_call_ends_it(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with kant_sql.connect(url, knowledge_base="ward") as kb:
        kb.rules.save("one-place", RULE, on_violation="refuse")
        revision, facts = state_of(url)

        def written(*given: Any) -> Any:
            kb.rules.delete("one-place")
            return begun(*given)

        begun = web_writing.write
        monkeypatch.setattr(writing, "write", written)
        (refused,) = write(url, "checked", ("write_facts", {"reason": "x", "delete": ["(open)"]}))
        assert "keeps no rule that refuses" in refused.content[0].text
    assert state_of(url) == (revision + 1, facts)


REFUSED: list[tuple[list[str], int, str]] = [
    (["--write", "checked"], 1, "keeps no rule that refuses"),
    (["--write"], 1, "keeps no rule that refuses"),
    (["--write", "--kb", "nobody"], 1, "has no knowledge base 'nobody'"),
    (["--write", "checked", "--kb", "nobody"], 1, "has no knowledge base 'nobody'"),
    (["--write", "everything"], 2, "expected branch or checked"),
    (["--kb", "ward"], 2, "needs --write checked"),
]


@pytest.mark.parametrize(("words", "code", "said"), REFUSED)
def test_what_cannot_be_checked_is_refused_at_the_start(
    url: str, words: list[str], code: int, said: str
) -> None:
    assert said in complaint("mcp", url, *words, code=code)


def test_without_the_option_nothing_writes(url: str) -> None:
    store = OpenStore(url)
    listed: Callable[[Client], Any] = lambda client: client.list_tools()  # noqa: E731
    names = {one.name for one in asked(make_server(store), listed).tools}
    assert not names & {*WRITERS, "begin_branch"}
    store.close()

"""`kant-sql log`: the revisions, newest first."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path

import pytest

import kant_sql
from tests.support.processes.commands import PROGRAM, child, documents, run
from tests.support.worlds.robots import robot_at

NEWEST_BUT_ONE = """\
  actor: executive
  reason: navigation finished
  source: {"step": 3}
  + fact (robot_at rb1 wp2)
  + object wp2 - wp
  - fact (robot_at rb1 wp1)
"""


def test_revisions_are_told_newest_first_with_what_they_changed(store: str) -> None:
    newest, second, oldest = child("log", store).stdout.split("\n\n")
    assert newest.startswith("revision 3  20")
    head, _, rest = f"{second}\n".partition("\n")
    assert head.startswith("revision 2  20")
    assert rest == NEWEST_BUT_ONE
    assert oldest.startswith("revision 1  20")
    assert "reason" not in oldest


def test_json_lines_say_all_of_each_revision(store: str) -> None:
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        entries = list(kb.log())
    assert documents("log", store) == [
        {
            "number": revision.number,
            "committed_at": revision.committed_at.isoformat(timespec="microseconds")[:26] + "Z",
            "observed_at": None,
            "actor": revision.actor,
            "reason": revision.reason,
            "source": revision.source,
            "execution": None,
            "hash": revision.hash,
            "changes": [
                {"sign": change.sign, "kind": change.kind, "text": change.text}
                for change in changes
            ],
        }
        for revision, changes in ((entry.revision, entry.changes) for entry in entries)
    ]
    assert [entry.revision.number for entry in entries] == [3, 2, 1]


def test_metadata_can_neither_break_lines_nor_steer_a_terminal(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'odd.db'}"
    odd = "a\nb\x1b[31m\x9b\x7f\u2028\u202eé[bold]"
    with kant_sql.connect(url) as kb, kb.transaction(actor=odd, reason=odd, source={"key": odd}):
        kb.propositions.save(robot_at())
    written = r"a\nb\u001b[31m\u009b\u007f\u2028\u202eé[bold]"
    lines = run("log", url).stdout.splitlines()
    assert lines[1:4] == [
        f"  actor: {written}",
        f"  reason: {written}",
        f'  source: {{"key": "{written}"}}',
    ]
    (line,) = run("log", url, "--json").stdout.splitlines()
    assert written in line
    entry = json.loads(line)
    assert (entry["actor"], entry["source"]) == (odd, {"key": odd})
    with kant_sql.connect(url, actor=odd) as kb:
        since = kb.store.revisions()[0].committed_at
        with kb.transaction(valid_from=since, valid_until=since + timedelta(microseconds=1)):
            kb.propositions.delete(robot_at())
    erased = "erase", url, "--revision", "1", "--parts", "reason,source", "--kb", "default"
    for words in (erased, ("corrections", url, "--kb", "default")):
        output = run(*words).stdout
        assert (written in output, "\nb" in output) == (True, False)


@pytest.mark.more
def test_output_that_cannot_take_all_letters_escapes_them(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'letters.db'}"
    with kant_sql.connect(url, actor="Zoë") as kb:
        kb.propositions.save(robot_at())
    assert r"actor: Zo\xeb" in child("log", url, program=PROGRAM, PYTHONIOENCODING="ascii").stdout
    done = child("log", url, "--json", program=PROGRAM, PYTHONIOENCODING="ascii")
    assert json.loads(done.stdout)["actor"] == "Zoë"


@pytest.mark.parametrize(
    "words",
    [
        ["--element", "navigation", "--until", "1"],
        ["--actor", "executive", "--until", "1"],
        ["--actor", "executive", "--element", "navigation"],
        ["--since", "yesterday", "--until", "yesterday"],
    ],
)
def test_what_was_at_another_time_is_no_error(store: str, words: list[str]) -> None:
    result = run("log", store, *words)
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")

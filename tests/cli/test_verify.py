"""`kant-sql verify` and `kant-sql anchor`."""

from __future__ import annotations

import json
import os
import pty
import sqlite3
import subprocess
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import PddlTypeDto
from tests.cli.conftest import write_history
from tests.support.pages import opened
from tests.support.processes.commands import child, command, environment, one_line, run
from tests.support.worlds.robots import robot_at

ALTER = "UPDATE revision SET reason = 'well done' WHERE number = 2"


@pytest.fixture
def own_file(tmp_path: Path) -> str:
    """The URL of a store with history that the test may change: one dialect will do."""
    url = f"sqlite:///{tmp_path / 'own.db'}"
    write_history(url)
    return url


def tamper(url: str, sql: str) -> None:
    with opened(url) as store:
        store.execute(sql, {})


def anchor_file(url: str, folder: Path) -> Path:
    """What `kant-sql anchor` writes of a store, as a file."""
    result = run("anchor", url)
    assert result.exit_code == 0, result.stderr
    path = folder / "anchor.json"
    path.write_text(result.stdout)
    return path


def test_an_intact_store_is_told_so(store: str) -> None:
    done = child("verify", store)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "tiago: intact (3 revisions, 13 changes)\n"


def test_findings_are_a_line_each_and_the_exit_code(own_store: str) -> None:
    tamper(own_store, ALTER)
    done = child("verify", own_store)
    assert (done.returncode, done.stderr) == (1, "")
    first, last = done.stdout.splitlines()
    assert first.startswith("tiago: revision 2: its contents differ from what was hashed")
    assert last == "tiago: 1 finding (3 revisions, 13 changes)"


def test_json_says_all_of_it(own_file: str) -> None:
    tamper(own_file, "UPDATE head SET next_id = 1")
    result = run("verify", own_file, "--json")
    document: dict[str, Any] = json.loads(result.stdout)
    (finding,) = document.pop("findings")
    assert result.exit_code == 1
    assert document == {
        "knowledge_base": "tiago",
        "revisions": 3,
        "changes": 13,
        "is_intact": False,
        "archives": [],
        "anchored": None,
    }
    assert (finding["revision"], finding["table"]) == (None, "head")
    assert finding["message"].startswith("next_id is 1, and ")


def test_all_knowledge_bases_or_one(own_file: str) -> None:
    with kant_sql.connect(own_file, knowledge_base="[bold]") as kb:
        kb.propositions.save(robot_at())
    assert "choose one with --kb" in one_line(run("verify", own_file).stderr)
    result = run("verify", own_file, "--kb", "[bold]")
    assert result.stdout == "[bold]: intact (1 revisions, 6 changes)\n"
    names = [line.split(":")[0] for line in run("verify", own_file, "--all").stdout.splitlines()]
    assert names == ["tiago", "[bold]"]
    result = run("verify", own_file, "--all", "--kb", "tiago")
    assert (result.exit_code, "not both" in one_line(result.stderr)) == (2, True)


def test_a_knowledge_base_without_a_head_is_not_passed_over(own_file: str) -> None:
    tamper(own_file, "DELETE FROM head")
    result = run("verify", own_file, "--all")
    assert result.exit_code == 1
    assert "head has 0 rows of the knowledge base, not one" in result.stdout


def test_an_anchor_is_one_small_document(store: str) -> None:
    document = json.loads(child("anchor", store).stdout)
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        last = kb.revisions()[-1]
    (head,) = document["heads"]
    assert document["format"] == 1
    assert document["made_at"].endswith("Z")
    moment = last.committed_at.isoformat(timespec="microseconds")[:26] + "Z"
    assert head == {
        "knowledge_base": "tiago",
        "revision": 3,
        "hash": last.hash,
        "committed_at": moment,
    }


def test_an_anchor_is_compared(own_store: str, tmp_path: Path) -> None:
    file = str(anchor_file(own_store, tmp_path))
    assert run("verify", own_store, "--anchor", file).exit_code == 0
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        kb.propositions.delete_all()
    assert run("verify", own_store, "--anchor", file).exit_code == 0
    document = json.loads(Path(file).read_text())
    document["heads"][0]["revision"] = 9
    Path(file).write_text(json.dumps(document))
    result = run("verify", own_store, "--anchor", file)
    assert result.exit_code == 1
    assert "revision 5: the history was cut off: it ends at revision 4" in result.stdout


@pytest.mark.parametrize("words", [(), ("--all",), ("--kb", "tiago"), ("--kb", "pepper")])
def test_a_knowledge_base_that_is_anchored_and_gone_is_a_finding(
    own_file: str, tmp_path: Path, words: tuple[str, ...]
) -> None:
    file = anchor_file(own_file, tmp_path)
    file.write_text(file.read_text().replace('"tiago"', '"pepper"'))
    result = run("verify", own_file, "--anchor", str(file), *words)
    assert result.exit_code == 1
    assert "knowledge base 'pepper' is missing" in result.stdout


def test_what_an_anchor_says_nothing_of_is_said(own_file: str, tmp_path: Path) -> None:
    file = anchor_file(own_file, tmp_path)
    with kant_sql.connect(own_file, knowledge_base="newer") as kb:
        kb.types.save(PddlTypeDto("late"))
    lines = run("verify", own_file, "--all", "--anchor", str(file)).stdout.splitlines()
    assert lines[-1] == "newer: the anchor says nothing of it"
    assert sum("anchor" in line for line in lines) == 1
    documents = run("verify", own_file, "--all", "--anchor", str(file), "--json").stdout
    assert [json.loads(line)["anchored"] for line in documents.splitlines()] == [3, None]


def test_what_cannot_be_a_name_is_a_finding_and_the_others_are_verified(own_file: str) -> None:
    with kant_sql.connect(own_file, knowledge_base="newer") as kb:
        kb.types.save(PddlTypeDto("late"))
    with sqlite3.connect(str(make_url(own_file).database)) as driver:
        driver.execute("UPDATE knowledge_base SET name = 'a' || char(10) WHERE name = 'tiago'")
    driver.close()
    result = run("verify", own_file, "--all")
    assert result.exit_code == 1
    first, _, last = result.stdout.splitlines()
    assert "cannot name a knowledge base" in first
    assert last.startswith("newer: intact")


def test_an_empty_store_has_an_empty_anchor(new_url: str, tmp_path: Path) -> None:
    kant_sql.upgrade(new_url)
    file = anchor_file(new_url, tmp_path)
    assert json.loads(file.read_text())["heads"] == []
    assert run("verify", new_url, "--all", "--anchor", str(file)).exit_code == 0
    assert "holds no knowledge base yet" in one_line(run("verify", new_url).stderr)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no anchor, because it is not JSON"),
        (b"\xff\xfe\xfd", "no anchor, because it is not JSON"),
        (b"[]", "this JSON document is no anchor"),
        (b'{"format": 1}', "this JSON document is no anchor"),
        (b'{"format": 7, "heads": []}', "is of format 7, and this version of kant_sql reads 1"),
        (b'{"format": 1, "heads": [{"revision": 1}]}', "head 0 of this anchor lacks"),
        (b'{"format": 1, "heads": [5]}', "head 0 of this anchor lacks"),
    ],
)
def test_a_file_that_is_no_anchor_is_refused(
    own_file: str, tmp_path: Path, content: bytes, message: str
) -> None:
    file = tmp_path / "anchor.json"
    file.write_bytes(content)
    result = run("verify", own_file, "--anchor", str(file))
    assert result.exit_code == 1
    assert message in one_line(result.stderr)


def test_an_anchor_that_names_a_knowledge_base_twice_is_refused(
    own_file: str, tmp_path: Path
) -> None:
    file = anchor_file(own_file, tmp_path)
    document = json.loads(file.read_text())
    document["heads"] *= 2
    file.write_text(json.dumps(document))
    error = one_line(run("verify", own_file, "--anchor", str(file)).stderr)
    assert "two heads of knowledge base 'tiago'" in error


def test_an_anchor_is_json_with_the_option_and_without(own_file: str) -> None:
    documents = [json.loads(run("anchor", own_file, *more).stdout) for more in ([], ["--json"])]
    assert documents[0]["heads"] == documents[1]["heads"]
    assert documents[1]["heads"][0]["revision"] == 3


def test_a_file_that_is_not_there_is_named(own_file: str) -> None:
    result = run("verify", own_file, "--anchor", "nowhere.json")
    assert result.exit_code == 2
    assert "nowhere.json" in one_line(result.stderr)


def test_nothing_is_created(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'none.db'}"
    for name in ("verify", "anchor"):
        assert run(name, url).exit_code == 1
    assert [*tmp_path.iterdir()] == []


def test_a_terminal_shows_how_far_it_is(sqlite_store: str) -> None:
    ours, theirs = pty.openpty()
    words = [*command(), "verify", sqlite_store]
    variables = environment(TERM="xterm-256color", COLUMNS="80")
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=theirs, env=variables) as process:
        os.close(theirs)
        shown = b""
        while chunk := _read(ours):
            shown += chunk
        assert process.stdout is not None
        told = process.stdout.read()
    os.close(ours)
    assert b"100%" in shown
    assert told == b"default: intact (1 revisions, 6004 changes)\n"


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, 10_000)
    except OSError:
        # Linux says so of a terminal whose other end is closed.
        return b""

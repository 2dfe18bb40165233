"""`kant-sql archive`: what ended is moved into another store."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

import kant_sql
from kant_sql import StoreError
from kant_sql.history.archive import archive as archiving
from kant_sql.knowledge.canonical import time_text
from tests.support.archives import target_url
from tests.support.processes.commands import one_line, run


def test_what_ended_is_moved_and_told(own_store: str, tmp_path: Path) -> None:
    to = target_url(tmp_path)
    words = ("archive", own_store, "--before", "3", "--to", to, "--actor", "cron")
    counted = run(*words, "--dry-run")
    assert counted.exit_code == 0, counted.stderr
    assert f"1 version that ended up to revision 2 would move to {to}" in counted.stdout
    assert not (tmp_path / "archive.db").exists()
    result = run(*words, "--reason", "retention")
    assert result.exit_code == 0, result.stderr
    first, *rest = result.stdout.splitlines()
    assert first == (
        f"knowledge base tiago: 1 version that ended up to revision 2 moved in revision 4 to {to}"
    )
    assert rest[-1].split() == ["proposition_version", "1"]
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        (revision,) = kb.store.revisions(after=3)
        assert (revision.actor, revision.reason) == ("cron", "retention")
    with kant_sql.connect(to, knowledge_base="tiago") as archive:
        assert [str(fact) for fact in archive.at(1).propositions.get_all()] == [
            "(robot_at rb1 wp1)"
        ]
    assert run("verify", own_store).exit_code == 0
    assert run("verify", to).exit_code == 0
    refused = run("show", own_store, "--at", "1")
    assert refused.exit_code == 1
    assert to in one_line(refused.stderr)


def test_json_says_the_same(own_store: str, tmp_path: Path) -> None:
    to = target_url(tmp_path)
    words = ("archive", own_store, "--before", "3", "--to", to, "--json")
    document = {
        "knowledge_base": "tiago",
        "dry_run": True,
        "upto": 2,
        "versions": {"proposition_version": 1},
        "target": to,
        "revision": None,
    }
    assert json.loads(run(*words, "--dry-run").stdout) == document
    document |= {"dry_run": False, "revision": 4}
    assert json.loads(run(*words).stdout) == document
    document |= {"versions": {}, "revision": None}
    assert json.loads(run(*words).stdout) == document


def test_a_time_says_before_when(own_store: str, tmp_path: Path) -> None:
    to = target_url(tmp_path)
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        third = time_text(kb.store.revisions()[2].committed_at)
    result = run("archive", own_store, "--before", third, "--to", to, "--dry-run")
    assert "up to revision 2" in result.stdout
    result = run("archive", own_store, "--before", "90 days ago", "--to", to)
    assert result.stdout == "knowledge base tiago: no version ended up to revision 0\n"
    result = run("archive", own_store, "--before", "soon", "--to", to)
    assert result.exit_code == 2


def test_errors_are_one_line(own_store: str, tmp_path: Path) -> None:
    result = run("archive", own_store, "--before", "3", "--to", "sqlite://")
    assert (result.exit_code, "in memory" in one_line(result.stderr)) == (1, True)
    result = run("archive", own_store, "--before", "9", "--to", target_url(tmp_path))
    assert "no revision 9" in one_line(result.stderr)


def test_an_archive_that_fails_leaves_no_new_file(
    own_store: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise StoreError("no")

    before = set(os.listdir(tmp_path))
    monkeypatch.setattr(archiving, "replicate", fail)
    to = f"sqlite:///{tmp_path}/archive.db"
    result = run("archive", own_store, "--before", "3", "--to", to)
    assert one_line(result.stderr) == "kant-sql: no"
    assert {name for name in os.listdir(tmp_path) if "archive" in name} == set()
    assert before <= set(os.listdir(tmp_path))

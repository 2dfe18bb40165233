"""Backups: the whole store at one moment, while others write; or nothing."""

from __future__ import annotations

import os
import stat
import threading
from itertools import count
from pathlib import Path

import pytest

import kant_sql
from kant_sql import InvalidArgumentError, PddlObjectDto, PddlTypeDto, SchemaError, StoreError
from kant_sql.sql.dialects import sqlite
from tests.support.processes.commands import run
from tests.support.processes.workers import PATIENCE
from tests.support.worlds.robots import WAYPOINT, robot_at, waypoint


def make_store(folder: Path) -> str:
    url = f"sqlite:///{folder / 'robot.db'}"
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        kb.objects.save_all(waypoint(number) for number in range(300))
        kb.propositions.save(robot_at())
    return url


def test_a_backup_below_a_writer_is_the_store_at_one_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sqlite, "COPIED_PAGES", 5)
    url, is_done, steps = make_store(tmp_path), threading.Event(), list[tuple[int, int]]()
    has_written = threading.Event()

    def write() -> None:
        with kant_sql.connect(url, knowledge_base="tiago") as kb:
            for number in count(1000):
                kb.objects.save(PddlObjectDto(WAYPOINT, f"wp{number}"))
                has_written.set()
                if is_done.is_set():
                    return

    def follow(done: int, whole: int) -> None:
        has_written.clear()
        assert has_written.wait(PATIENCE)
        steps.append((done, whole))

    writer = threading.Thread(target=write)
    writer.start()
    try:
        made = kant_sql.operations.backup(url, tmp_path / "copy.db", progress=follow)
    finally:
        is_done.set()
        writer.join()
    assert len(steps) > 5
    assert steps[-1][0] == steps[-1][1]
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        assert kb.revision > made.revisions["tiago"] + len(steps) // 2
        with kant_sql.connect(str(made.file), knowledge_base="tiago") as copy:
            assert copy.revision == made.revisions["tiago"]
            assert copy.store.verify().is_intact
            assert copy.diff(copy, kb.at(copy.revision)) == []
            copy.propositions.delete(robot_at())
    assert made.bytes > 0


def test_a_backup_that_fails_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = make_store(tmp_path)
    there = {*tmp_path.iterdir()}
    existing = tmp_path / "there"
    existing.write_text("precious")
    missing = f"sqlite:///{tmp_path / 'missing.db'}"
    for source, file, error, said in (
        (url, existing, InvalidArgumentError, "never overwrites a file"),
        (url, tmp_path / "nowhere" / "copy.db", StoreError, "No such file or directory"),
        (url, "a\0b.db", InvalidArgumentError, "cannot name a file: .*embedded null"),
        (url, "\ud800.db", InvalidArgumentError, "cannot name a file: 'utf-8' codec can't encode"),
        (missing, tmp_path / "copy.db", SchemaError, "no such file"),
        ("sqlite://", tmp_path / "copy.db", InvalidArgumentError, "in memory"),
        (
            "postgresql+psycopg://robot:secret@nowhere:99/fleet",
            tmp_path / "copy.db",
            InvalidArgumentError,
            "pg_dump --format=custom --file=FILE postgresql://robot@nowhere:99/fleet",
        ),
    ):
        with pytest.raises(error, match=said) as raised:
            kant_sql.operations.backup(source, file)
        assert "secret" not in str(raised.value)
    monkeypatch.setattr(sqlite, "COPIED_PAGES", 1)

    def interrupt(done: int, whole: int) -> None:
        # Somebody else was faster.
        if done == whole:
            (tmp_path / "copy.db").write_text("precious, too")
        elif not existing.exists():
            raise KeyboardInterrupt

    with pytest.raises(InvalidArgumentError, match="never overwrites a file"):
        kant_sql.operations.backup(url, tmp_path / "copy.db", progress=interrupt)
    assert (tmp_path / "copy.db").read_text() == "precious, too"
    assert existing.read_text() == "precious"
    existing.unlink()
    (tmp_path / "copy.db").unlink()
    with pytest.raises(KeyboardInterrupt):
        kant_sql.operations.backup(url, tmp_path / "copy.db", progress=interrupt)
    assert {*tmp_path.iterdir()} == there


def test_a_backup_is_durable_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, copy, synced = make_store(tmp_path), tmp_path / "copy.db", list[tuple[bool, bool]]()
    (tmp_path / "robot.db").chmod(0o640)
    sync = os.fsync

    def follow(descriptor: int) -> None:
        synced.append((stat.S_ISDIR(os.fstat(descriptor).st_mode), copy.exists()))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", follow)
    result = run("backup", url, str(copy))
    assert result.exit_code == 0, result.stderr
    assert synced == [(False, False), (True, True)]
    assert f"{copy}: " in result.stdout
    assert result.stdout.endswith("bytes; tiago at revision 2\n")
    assert stat.S_IMODE(copy.stat().st_mode) == 0o640
    assert run("verify", str(copy)).exit_code == 0
    with kant_sql.connect(url, knowledge_base="other") as kb:
        kb.types.save(PddlTypeDto("door"))
    monkeypatch.setattr(os, "link", lambda *_: (_ for _ in ()).throw(OSError("no links here")))
    made = kant_sql.operations.backup(url, tmp_path / "second.db")
    assert made.revisions == {"tiago": 2, "other": 1}
    assert (tmp_path / "second.db").stat().st_size == made.bytes

"""SQLite's write-ahead log does not stay as long as a reader has let it become."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from kant_sql import KnowledgeBase
from kant_sql.sql.dialects import sqlite, sqlite_file
from tests.support.statements import fact, fill
from tests.support.stores import Connect

LIMIT = 1 << 20


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for module in (sqlite, sqlite_file):
        monkeypatch.setattr(module, "WAL_LIMIT", LIMIT)
    monkeypatch.setattr(sqlite_file, "WAL_PATIENCE", 0)
    return tmp_path / "store.db"


@pytest.fixture
def kb(path: Path, connect: Connect) -> KnowledgeBase:
    kb = connect(f"sqlite:///{path}")
    fill(kb, 5)
    return kb


@pytest.fixture
def reader(kb: KnowledgeBase, path: Path) -> Iterator[sqlite3.Connection]:
    """Somebody who reads by other means, and keeps a transaction open."""
    with closing(sqlite3.connect(path, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM revision").fetchone()
        yield reader


def log_size(path: Path) -> int:
    return Path(f"{path}-wal").stat().st_size


def write_much(kb: KnowledgeBase, path: Path, size: int) -> None:
    """Write until the log is of a size."""
    number = 10
    while log_size(path) < size:
        kb.propositions.save_all(fact(number + offset) for offset in range(1_000))
        number += 1_000


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [
        record.getMessage()
        for record in caplog.records
        if record.name == "kant_sql.sqlite" and record.levelno == logging.WARNING
    ]


@pytest.mark.more
def test_a_read_cuts_the_log_when_the_reader_has_gone(
    kb: KnowledgeBase, path: Path, reader: sqlite3.Connection
) -> None:
    write_much(kb, path, 4 * LIMIT)
    kb.propositions.get_by_predicate("robot_at")
    assert log_size(path) >= 4 * LIMIT
    reader.execute("COMMIT")
    kb.propositions.get_by_predicate("robot_at")
    assert log_size(path) == 0


def test_a_write_cuts_the_log_when_the_reader_has_gone(
    kb: KnowledgeBase, path: Path, reader: sqlite3.Connection
) -> None:
    write_much(kb, path, 4 * LIMIT)
    reader.execute("COMMIT")
    kb.propositions.save(fact(6))
    assert log_size(path) <= LIMIT
    kb.propositions.save(fact(7))
    assert log_size(path) <= LIMIT


def test_another_process_s_write_cuts_it_too(
    kb: KnowledgeBase, path: Path, reader: sqlite3.Connection, connect: Connect
) -> None:
    write_much(kb, path, 5 * LIMIT)
    other = connect(f"sqlite:///{path}")
    reader.execute("COMMIT")
    other.propositions.save(fact(6))
    assert log_size(path) <= LIMIT


@pytest.mark.more
def test_a_large_transaction_does_not_leave_a_long_log(kb: KnowledgeBase, path: Path) -> None:
    write_much(kb, path, LIMIT // 2)
    kb.propositions.save_all(fact(number) for number in range(50_000, 60_000))
    assert log_size(path) <= LIMIT


@pytest.mark.more
def test_the_reader_is_warned_of_once_for_each_doubling(
    kb: KnowledgeBase, path: Path, reader: sqlite3.Connection, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "kant_sql")
    write_much(kb, path, LIMIT + 1)
    for _ in range(5):
        kb.propositions.get_by_predicate("robot_at")
    assert len(warnings(caplog)) == 1
    assert f"{path}: the write-ahead log is 1 MB long" in warnings(caplog)[0]
    assert "a reader's transaction is open" in warnings(caplog)[0]
    write_much(kb, path, 5 * LIMIT)
    assert 2 <= len(warnings(caplog)) <= 4
    reader.execute("COMMIT")
    kb.propositions.get_by_predicate("robot_at")
    assert "was cut back" in caplog.records[-1].getMessage()


def test_while_the_reader_stays_it_is_not_tried_at_each_call(
    kb: KnowledgeBase, path: Path, reader: sqlite3.Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_much(kb, path, 2 * LIMIT)
    monkeypatch.setattr(sqlite_file, "WAL_PATIENCE", 3600)
    reader.execute("COMMIT")
    kb.propositions.get_by_predicate("robot_at")
    assert log_size(path) >= 2 * LIMIT


def test_each_connection_bounds_the_log_that_sqlite_leaves(kb: KnowledgeBase) -> None:
    with kb.store.factory._store.backend.open_session() as session:  # type: ignore[attr-defined]
        session._execute("PRAGMA journal_size_limit")
        assert session._fetch() == [(LIMIT,)]

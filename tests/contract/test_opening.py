"""Opening a store: what is created, what is refused, and what the errors say."""

from __future__ import annotations

import os
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

import kant_sql
from kant_sql import (
    InvalidArgumentError,
    KnowledgeBase,
    ReadOnlyError,
    StoreError,
    StoreUnreachableError,
    aio,
)
from kant_sql.errors import (
    NotADatabaseError,
    ReadOnlyStoreError,
    SchemaMissingError,
    SchemaOutdatedError,
)
from kant_sql.factory import SqlDaoFactory
from kant_sql.sql import schema
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.dialects.sqlite import SqliteBackend
from kant_sql.sql.query import Query, raw
from kant_sql.sql.tables import KnowledgeBaseRow
from tests.support.chain import check_chain
from tests.support.pages import rows_of
from tests.support.processes import sharing
from tests.support.processes.workers import in_processes
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.robots import WP1, WP2, robot_at

migrates = pytest.mark.usefixtures("real_migrations")


def sqlite_url(path: Path, query: str = "") -> str:
    return f"sqlite:///{path}{query}"


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """A file with a store of some pages in it."""
    path = tmp_path / "store.db"
    with kant_sql.connect(sqlite_url(path)) as kb:
        kb.propositions.save(robot_at())
    return path


# The version of the tables.


@migrates
def test_a_database_without_tables_is_refused_with_what_makes_them(server: Server) -> None:
    url = server.new_database()
    for _ in range(2):
        with pytest.raises(SchemaMissingError, match="kant-sql db upgrade 'postgresql://"):
            kant_sql.connect(url)
    kant_sql.upgrade(url)
    kant_sql.connect(url).close()


@migrates
def test_outdated_tables_are_refused_with_the_command_that_updates_them(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect(shared_url).close()
    monkeypatch.setattr(schema, "VERSIONS", (*schema.VERSIONS, "9999"))
    with pytest.raises(SchemaOutdatedError, match=r"needs 9999; .*: kant-sql db upgrade '"):
        connect(shared_url)


@migrates
@pytest.mark.parametrize("is_there", [False, True], ids=["new", "empty"])
def test_a_new_or_empty_file_becomes_a_store(
    tmp_path: Path, connect: Connect, is_there: bool
) -> None:
    path = tmp_path / "with space, ü & 100%.db"
    if is_there:
        path.touch()
    connect(sqlite_url(path)).propositions.save(robot_at())
    assert check_chain(sqlite_url(path)) == {"default": 1}


@migrates
@pytest.mark.parametrize(("version", "is_refused"), [((3, 34, 1), True), ((3, 35, 0), False)])
def test_an_old_sqlite_is_refused_by_its_version(
    monkeypatch: pytest.MonkeyPatch, version: tuple[int, int, int], is_refused: bool
) -> None:
    monkeypatch.setattr(sqlite3, "sqlite_version_info", version)
    monkeypatch.setattr(sqlite3, "sqlite_version", "3.34.1")
    if is_refused:
        with pytest.raises(StoreError, match=r"uses SQLite 3\.34\.1, .* needs 3\.35\.0 or later"):
            kant_sql.connect("sqlite://")
    else:
        kant_sql.connect("sqlite://").close()


def test_tables_that_cannot_be_created_are_an_error_of_the_store(
    file_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = schema.recorded("sqlite")
    monkeypatch.setattr(schema, "recorded", lambda _: [*made, made[0]])
    with pytest.raises(StoreError, match="already exists"):
        connect(file_url)
    monkeypatch.undo()
    assert connect(file_url).revision == 0


def test_each_store_in_memory_is_new(connect: Connect) -> None:
    connect("sqlite://").propositions.save(robot_at())
    assert connect("sqlite://").revision == 0


@pytest.mark.parametrize("journal", ["delete", "wal"])
def test_a_database_of_somebody_else_is_refused_and_left_as_it_is(
    tmp_path: Path, connect: Connect, journal: str
) -> None:
    url = sqlite_url(tmp_path / "theirs.db")
    for statement in (f"PRAGMA journal_mode={journal}", "CREATE TABLE head (mine)"):
        rows_of(url, statement)
    before = contents(tmp_path)
    with pytest.raises(SchemaMissingError, match="no kant_sql tables"):
        connect(url)
    assert contents(tmp_path) == before


# Files.


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: b"This is a letter, not a database. " * 100,
        lambda whole: whole[:100],
        lambda whole: whole[:4096],
        lambda whole: whole[: len(whole) // 2],
        lambda whole: whole[:100] + b"\0" * (len(whole) - 100),
        lambda whole: whole[:4096] + b"\xa5" * (len(whole) - 4096),
        lambda whole: b"\xa5" * 16 + whole[16:],
    ],
    ids=["text", "header", "page", "half", "zeros", "garbage", "magic"],
)
def test_a_file_that_is_no_sound_database_is_refused(
    stored: Path, damage: Callable[[bytes], bytes]
) -> None:
    stored.write_bytes(damage(stored.read_bytes()))
    before = stored.read_bytes()

    def use() -> None:
        with kant_sql.connect(sqlite_url(stored)) as kb:
            kb.goals.save(robot_at(is_goal=True))
            kb.propositions.get_all()

    with pytest.raises(NotADatabaseError, match=f"{stored}: .*name an SQLite file") as caught:
        use()
    assert isinstance(caught.value.__cause__, sqlite3.DatabaseError)
    assert stored.read_bytes() == before


@migrates
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    url = f"sqlite:///{tmp_path / 'pipe'}"
    for refused in (
        lambda: kant_sql.connect(url),
        lambda: kant_sql.operations.knowledge_bases(url),
    ):
        with pytest.raises(StoreUnreachableError, match="not a regular file"):
            refused()


def test_tables_that_another_process_makes_at_this_moment_are_found(
    tmp_path: Path, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = sqlite_url(tmp_path / "new.db")
    is_empty = SqliteBackend.is_empty

    def too_late(backend: SqliteBackend, session: Session) -> bool:
        monkeypatch.undo()
        connect(url).propositions.save(robot_at())
        return is_empty(backend, session)

    monkeypatch.setattr(SqliteBackend, "is_empty", too_late)
    assert connect(url).propositions.get_all() == [robot_at()]


@pytest.mark.parametrize("name", [".", "missing/store.db", "store.db/store.db"])
@pytest.mark.parametrize("query", ["", "?mode=ro"])
def test_a_path_where_no_file_can_be_is_refused(stored: Path, name: str, query: str) -> None:
    with pytest.raises(StoreUnreachableError, match="the folder exists"):
        kant_sql.connect(sqlite_url(stored.parent / name, query))
    assert [path.name for path in stored.parent.iterdir()] == ["store.db"]


def test_a_missing_file_is_not_created_to_be_read_only(tmp_path: Path) -> None:
    with pytest.raises(StoreUnreachableError):
        kant_sql.connect(sqlite_url(tmp_path / "missing.db", "?mode=ro"))
    assert contents(tmp_path) == {}


@pytest.mark.parametrize("mode", ["ro", "immutable"])
def test_a_file_opened_read_only_can_be_read_and_not_written(
    stored: Path, connect: Connect, mode: str
) -> None:
    before = stored.read_bytes()
    kb = connect(sqlite_url(stored, f"?mode={mode}"))
    assert kb.propositions.get_all() == kb.at(1).propositions.get_all() == [robot_at()]
    assert [entry.revision.number for entry in kb.log()] == [1]
    with pytest.raises(ReadOnlyStoreError, match="cannot be written"):
        kb.goals.save(robot_at(is_goal=True))
    assert kb.propositions.get_all() == [robot_at()]
    assert stored.read_bytes() == before


@pytest.fixture
def public_store() -> Iterator[Path]:
    """A file with a fact in it, which nobody may write, in a folder that other users can reach."""
    with tempfile.TemporaryDirectory(prefix="kant_sql") as folder:
        path = Path(folder, "store.db")
        with kant_sql.connect(sqlite_url(path)) as kb:
            kb.propositions.save(robot_at())
        path.chmod(0o444)
        path.parent.chmod(0o755)
        yield path
        path.parent.chmod(0o755)


def test_a_file_without_the_right_to_write_can_be_read(public_store: Path) -> None:
    public_store.parent.chmod(0o777)
    in_processes((sharing.read_but_not_write, sqlite_url(public_store)))


def test_a_folder_without_the_right_to_write_says_how_to_read(public_store: Path) -> None:
    path = public_store
    path.parent.chmod(0o555)
    (message,) = in_processes((sharing.refused, sqlite_url(path), ReadOnlyStoreError))
    assert "?mode=immutable" in message
    assert "files -wal and -shm" in message
    in_processes((sharing.read_but_not_write, sqlite_url(path, "?mode=immutable")))


def test_a_file_without_the_right_to_read_is_refused(public_store: Path) -> None:
    public_store.chmod(0)
    in_processes((sharing.refused, sqlite_url(public_store), StoreUnreachableError))


# Competing creations.


@pytest.mark.more
@pytest.mark.parametrize("round_", range(3))
def test_processes_that_create_a_store_at_once_leave_one_good_store(
    server: Server, shared_url: str, tmp_path: Path, round_: int
) -> None:
    is_file = shared_url.startswith("sqlite")
    url = sqlite_url(tmp_path / "new.db") if is_file else server.new_database()
    create = sharing.connect_and_write if is_file else sharing.upgrade_and_write
    revisions = in_processes(*[(create, url, number) for number in range(4)])
    assert sorted(revisions) == [1, 2, 3, 4]
    assert check_chain(url) == {"tiago": 4}
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        assert len(kb.propositions.get_all()) == 4


@pytest.mark.more
@pytest.mark.parametrize("round_", range(3))
def test_processes_that_create_knowledge_bases_at_once_leave_one_of_each_name(
    shared_url: str, connect: Connect, round_: int
) -> None:
    connect(shared_url).close()
    names = ["same", "same", "same", f"other {round_}"]
    in_processes(
        *[(sharing.connect_and_write, shared_url, n, name) for n, name in enumerate(names)]
    )
    assert check_chain(shared_url) == {"same": 3, f"other {round_}": 1}


def test_rows_that_are_given_up_after_the_end_of_their_connection_are_no_error(
    shared_url: str, connect: Connect
) -> None:
    connect(shared_url, knowledge_base="tiago").propositions.save(robot_at())
    backend = create_backend(shared_url)
    session = backend.session()
    session.begin(write=False)
    rows: Any = session.stream(Query(select(KnowledgeBaseRow.name)))
    assert next(rows)[0] == "tiago"
    # As after Ctrl-C: what was being read is forgotten last.
    connection: Any = session._pooled.driver_connection
    connection.close()
    rows.close()
    session._pooled.invalidate()
    backend.close()


# Opened for reading only.


WRITES: dict[str, Callable[[KnowledgeBase], Any]] = {
    "save": lambda kb: kb.propositions.save(robot_at(place=WP2)),
    "save what is there": lambda kb: kb.propositions.save(robot_at()),
    "delete": lambda kb: kb.propositions.delete_all(),
    "objects": lambda kb: kb.objects.save(WP1),
    "load": lambda kb: kb.load_domain("(define (domain d))"),
    "restore": lambda kb: kb.restore(0),
    "branch": lambda kb: kb.branch("other"),
}


def in_transaction(kb: KnowledgeBase) -> None:
    with kb.transaction():
        pass


@pytest.mark.parametrize("write", [*WRITES.values(), in_transaction], ids=[*WRITES, "transaction"])
def test_writes_are_refused_and_reads_are_not(
    shared_url: str, connect: Connect, write: Callable[[KnowledgeBase], Any]
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    reader = connect(shared_url, read_only=True)
    with pytest.raises(ReadOnlyError, match="read_only=True"):
        write(reader)
    assert reader.propositions.get_all() == [robot_at()]
    assert (reader.revision, kb.revision) == (1, 1)
    kb.propositions.save(robot_at(place=WP2))
    assert len(reader.propositions.get_all()) == 2
    assert reader.at(1).propositions.get_all() == [robot_at()]
    assert reader.store.verify().findings == ()
    assert reader.watch(after=1, timeout=0) == 2


def test_an_archive_is_refused(shared_url: str, connect: Connect, tmp_path: Path) -> None:
    connect(shared_url).propositions.save(robot_at())
    reader = connect(shared_url, read_only=True)
    with pytest.raises(ReadOnlyError, match="read_only=True"):
        reader.store.archive(1, to=f"sqlite:///{tmp_path / 'archive.db'}")
    assert not (tmp_path / "archive.db").exists()


def test_a_branch_to_another_store_only_reads(shared_url: str, connect: Connect) -> None:
    connect(shared_url).propositions.save(robot_at())
    reader = connect(shared_url, read_only=True)
    with reader.branch() as trial:
        assert trial.propositions.save(robot_at(place=WP2))
    assert reader.propositions.get_all() == [robot_at()]


@pytest.mark.parametrize(
    "sql", ["DELETE FROM head", "CREATE TABLE mine (id INTEGER)", "UPDATE head SET revision = 7"]
)
def test_the_database_itself_refuses(shared_url: str, connect: Connect, sql: str) -> None:
    connect(shared_url).propositions.save(robot_at())
    factory = connect(shared_url, read_only=True).store.factory
    assert isinstance(factory, SqlDaoFactory)
    store = factory._store
    with pytest.raises(ReadOnlyStoreError):
        store.query(lambda session, _: session.run(raw(sql)))
    with pytest.raises(ReadOnlyStoreError):
        store.query_in_snapshot(lambda session, _: session.run(raw(sql)))


def test_a_file_that_is_missing_or_empty_stays_so(tmp_path: Path) -> None:
    path = tmp_path / "none.db"
    with pytest.raises(SchemaMissingError, match="no such file"):
        kant_sql.connect(f"sqlite:///{path}", read_only=True)
    assert not path.exists()
    path.touch()
    with pytest.raises(SchemaMissingError, match="no kant_sql tables"):
        kant_sql.connect(f"sqlite:///{path}", read_only=True)
    assert path.read_bytes() == b""
    assert [*tmp_path.iterdir()] == [path]


def test_a_store_in_memory_is_new_and_has_nothing_to_read() -> None:
    with pytest.raises(SchemaMissingError):
        kant_sql.connect("sqlite://", read_only=True)


def test_a_knowledge_base_never_written_is_empty(shared_url: str, connect: Connect) -> None:
    reader = connect(shared_url, knowledge_base="nobody", read_only=True)
    assert (reader.revision, reader.propositions.get_all()) == (0, [])


async def test_it_is_the_same_for_asyncio(shared_url: str, connect: Connect) -> None:
    connect(shared_url).propositions.save(robot_at())

    async with aio.connect(shared_url, read_only=True) as kb:
        assert await kb.propositions.get_all() == [robot_at()]
        with pytest.raises(ReadOnlyError):
            await kb.propositions.save(robot_at(place=WP2))


@pytest.mark.parametrize("junk", [None, 1, "yes"])
def test_read_only_is_true_or_false(junk: object) -> None:
    with pytest.raises(InvalidArgumentError, match="read_only"):
        kant_sql.connect("sqlite://", read_only=junk)  # type: ignore[arg-type]

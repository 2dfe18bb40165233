"""A file that is no longer the store's: noticed before a write to it is acknowledged."""

from __future__ import annotations

import os
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import StoreReplacedError
from kant_sql.sql.dialects import sqlite_file
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.dialects.sqlite_file import Contents, StoreFile
from kant_sql.sql.query import Query
from tests.support.processes.workers import PATIENCE
from tests.support.statements import fact, fill
from tests.support.stores import Connect
from tests.support.worlds.robots import waypoint

Attack = Callable[[Path], object]


def replace(path: Path) -> None:
    """Put a copy in its place, as a restore from a backup does."""
    shutil.copy(path, path.with_suffix(".copy"))
    path.with_suffix(".copy").replace(path)


def replace_by_a_new_file(path: Path) -> None:
    path.unlink()
    path.write_bytes(b"")


def into_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


FILE: dict[str, Attack] = {
    "deleted": lambda path: path.unlink(),
    "renamed": lambda path: path.rename(path.with_suffix(".old")),
    "replaced": replace,
    "replaced by a new file": replace_by_a_new_file,
    "emptied": lambda path: os.truncate(path, 0),
    "cut off": lambda path: os.truncate(path, path.stat().st_size // 2),
    "a folder": into_a_folder,
    "its folder moved": lambda path: path.parent.rename(path.parent.with_name("moved")),
}
LOG: dict[str, Attack] = {
    "log deleted": lambda path: Path(f"{path}-wal").unlink(),
    "log replaced": lambda path: replace_by_a_new_file(Path(f"{path}-wal")),
    "log emptied": lambda path: os.truncate(f"{path}-wal", 0),
    "shared memory deleted": lambda path: Path(f"{path}-shm").unlink(),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    folder = tmp_path / "folder"
    folder.mkdir()
    return folder / "store.db"


@pytest.fixture
def kb(path: Path) -> Iterator[KnowledgeBase]:
    with kant_sql.connect(f"sqlite:///{path}") as kb:
        fill(kb, 5)
        # All in the file itself, so that what is cut off is missed.
        checkpoint(path, "TRUNCATE")
        kb.propositions.delete(fact(1))
        yield kb


def checkpoint(path: Path, mode: str = "PASSIVE") -> None:
    """Write the log into the file, as another process may."""
    with closing(sqlite3.connect(path)) as other:
        other.execute(f"PRAGMA wal_checkpoint({mode})")


def attack_before_commit(patch: pytest.MonkeyPatch, attack: Attack, path: Path) -> None:
    """Attack between the last statement of a write and its COMMIT."""
    execute = Session._execute

    def spy(self: Session, statement: str | Query, parameters: object = ()) -> None:
        if statement == "COMMIT":
            patch.setattr(Session, "_execute", execute)
            attack(path)
        execute(self, statement, parameters)

    patch.setattr(Session, "_execute", spy)


@pytest.mark.parametrize("attack", FILE.values(), ids=FILE)
def test_neither_reads_nor_writes_go_on(kb: KnowledgeBase, path: Path, attack: Attack) -> None:
    past = kb.at(1)
    attack(path)
    for call in (
        lambda: kb.propositions.save(fact(1)),
        kb.propositions.get_all,
        past.propositions.get_all,
        lambda: kb.revision,
        kb.store.verify,
    ):
        with pytest.raises(StoreReplacedError, match=r"store\.db: .* since the store was opened"):
            call()


@pytest.mark.parametrize("attack", (FILE | LOG).values(), ids=FILE | LOG)
def test_what_is_committed_at_that_moment_is_not_acknowledged(
    kb: KnowledgeBase, path: Path, attack: Attack, monkeypatch: pytest.MonkeyPatch
) -> None:
    attack_before_commit(monkeypatch, attack, path)
    with pytest.raises(StoreReplacedError, match="The last commit went to the former file"):
        kb.propositions.save(fact(1))
    with pytest.raises(StoreReplacedError):
        kb.propositions.get_all()


@pytest.mark.parametrize("attack", LOG.values(), ids=LOG)
def test_a_log_that_is_gone_is_noticed_by_the_next_write(
    kb: KnowledgeBase, path: Path, attack: Attack
) -> None:
    attack(path)
    with pytest.raises(StoreReplacedError, match=r"store\.db-(wal|shm)"):
        kb.propositions.save(fact(1))


def test_a_backup_copied_over_the_open_file_is_noticed(kb: KnowledgeBase, path: Path) -> None:
    backup = path.with_suffix(".backup")
    shutil.copy(path, backup)
    with closing(sqlite3.connect(path)) as other:
        for number in range(3):
            kb.propositions.save(fact(number + 6))
            other.execute("PRAGMA wal_checkpoint(PASSIVE)")
            kb.propositions.get_all()
        # The same file, with the content of another.
        path.write_bytes(backup.read_bytes().ljust(path.stat().st_size, b"\0"))
        with pytest.raises(StoreReplacedError, match="overwritten with another state"):
            kb.propositions.save(fact(1))


def test_another_store_copied_over_the_open_file_is_noticed(
    kb: KnowledgeBase, path: Path, connect: Connect, tmp_path: Path
) -> None:
    checkpoint(path)
    kb.propositions.get_all()
    foreign = connect(f"sqlite:///{tmp_path / 'foreign.db'}")
    fill(foreign, 8)
    for number in (1, 2, 3):
        foreign.propositions.delete(fact(number))
    foreign.close()
    shutil.copyfile(tmp_path / "foreign.db", path)
    with pytest.raises(StoreReplacedError):
        kb.propositions.get_all()


def test_a_link_that_points_elsewhere_is_another_file(path: Path, connect: Connect) -> None:
    path.symlink_to(path.with_name("first.db"))
    kb = connect(f"sqlite:///{path}")
    fill(kb, 2)
    kb.propositions.delete(fact(1))
    path.unlink()
    path.symlink_to(path.with_name("second.db"))
    path.with_name("second.db").write_bytes(b"")
    with pytest.raises(StoreReplacedError, match="another file"):
        kb.propositions.save(fact(1))
    assert not path.with_name("second.db").stat().st_size


def test_a_second_name_of_the_file_may_go(kb: KnowledgeBase, path: Path) -> None:
    os.link(path, path.with_name("second.db"))
    path.with_name("second.db").unlink()
    assert kb.propositions.save(fact(1))


def test_who_connects_again_goes_on_with_what_is_there(
    kb: KnowledgeBase, path: Path, connect: Connect
) -> None:
    replace(path)
    with pytest.raises(StoreReplacedError):
        kb.propositions.save(fact(1))
    again = connect(f"sqlite:///{path}")
    again.propositions.save(fact(1))
    assert fact(1) in again.propositions.get_all()


def test_the_file_put_back_does_not_bring_connections_back(kb: KnowledgeBase, path: Path) -> None:
    away = path.with_suffix(".away")
    path.rename(away)
    with pytest.raises(StoreReplacedError):
        kb.propositions.get_all()
    away.rename(path)
    with pytest.raises(StoreReplacedError):
        kb.propositions.get_all()


def test_vacuum_and_checkpoints_of_others_are_no_replacement(kb: KnowledgeBase, path: Path) -> None:
    kb.propositions.save_all(fact(number) for number in range(6, 1_000))
    kb.propositions.delete_all()
    size = path.stat().st_size
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("CREATE TABLE filler AS SELECT randomblob(1000000) AS content")
        other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        kb.propositions.save(fact(1))
        size = path.stat().st_size
        other.execute("DROP TABLE filler")
        other.execute("VACUUM")
        other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        assert path.stat().st_size < size
        kb.propositions.save(fact(2))
        assert kb.propositions.get_all() == [fact(1), fact(2)]
        other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    assert kb.propositions.get_all() == [fact(1), fact(2)]


@pytest.mark.parametrize("part", [0.9, 0.1])
def test_a_log_that_is_cut_off_is_noticed_by_the_next_write(
    kb: KnowledgeBase, path: Path, part: float
) -> None:
    for number in range(6, 16):
        kb.propositions.save(fact(number))
    log = Path(f"{path}-wal")
    os.truncate(log, int(log.stat().st_size * part))
    with pytest.raises(StoreReplacedError, match=r"store\.db-wal was cut off"):
        kb.propositions.save(fact(1))


@pytest.mark.parametrize("mode", ["PASSIVE", "FULL", "RESTART", "TRUNCATE"])
def test_a_log_that_others_begin_again_is_whole(
    kb: KnowledgeBase, path: Path, connect: Connect, mode: str
) -> None:
    other = connect(f"sqlite:///{path}")
    log = Path(f"{path}-wal")
    for number in range(3):
        kb.propositions.save_all(fact(each) for each in range(6, 200))
        long = log.stat().st_size
        with closing(sqlite3.connect(path, isolation_level=None)) as bare:
            bare.execute(f"PRAGMA wal_checkpoint({mode})")
            if number == 1:
                other.propositions.save(fact(1))
                assert mode != "TRUNCATE" or log.stat().st_size < long
            if number == 2:
                bare.execute("PRAGMA journal_size_limit=4096")
                bare.execute("CREATE TABLE more (number INTEGER)")
        kb.propositions.delete_all()
        other.propositions.save(fact(2))
    kb.propositions.delete_all()
    assert other.propositions.get_all() == []


def test_a_change_of_folder_changes_no_file(
    tmp_path: Path, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    kb = connect("sqlite:///store.db")
    fill(kb, 2)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    kb.propositions.delete(fact(1))
    # A thread of its own has a connection of its own.
    with kb.transaction(reason="hold the first connection"), ThreadPoolExecutor(1) as pool:
        pool.submit(kb.at(1).propositions.get_all).result()
    assert not [*elsewhere.iterdir()]


def test_a_new_connection_does_not_open_another_file(kb: KnowledgeBase, path: Path) -> None:
    replace(path)
    begin = threading.Barrier(3)

    def read() -> object:
        # Each in a thread of its own.
        begin.wait(30)
        return kb.propositions.get_all()

    with ThreadPoolExecutor(3) as pool:
        for call in [pool.submit(read) for _ in range(3)]:
            assert isinstance(call.exception(), StoreReplacedError)


def test_who_waits_for_news_is_told(
    kb: KnowledgeBase, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    def rename(_: float) -> None:
        path.rename(f"{path}.old")

    monkeypatch.setattr("kant_sql.sql.dialects.sqlite.time.sleep", rename)
    with pytest.raises(StoreReplacedError):
        kb.watch(timeout=60)


def test_a_store_in_memory_has_no_file(connect: Connect) -> None:
    kb = connect("sqlite://")
    fill(kb, 2)
    assert (len(kb.propositions.get_all()), len(kb.goals.get_all())) == (2, 1)


@pytest.mark.parametrize("change", ["revision = revision - 1", f"hash = '{1:064d}'"])
def test_a_store_put_back_to_another_state_is_not_written_to(
    shared_url: str, connect: Connect, change: str
) -> None:
    kb, other = connect(shared_url), connect(shared_url)
    fill(kb, 3)
    kb.propositions.delete(fact(1))
    with other.store.factory._store.backend.open_session() as session:  # type: ignore[attr-defined]
        session._execute(f"UPDATE head SET {change}")
    with pytest.raises(StoreReplacedError, match="the store was restored to another state"):
        kb.propositions.save(fact(1))


@pytest.fixture
def overwrite(kb: KnowledgeBase, path: Path) -> Callable[[], object]:
    """Give what copies an older state over the open file, as no replacement of the file does."""
    backup = path.with_suffix(".backup")
    shutil.copy(path, backup)
    checkpoint(path)
    kb.propositions.get_all()
    return lambda: path.write_bytes(backup.read_bytes().ljust(path.stat().st_size, b"\0"))


def test_all_who_have_an_overwritten_file_open_notice(
    kb: KnowledgeBase, path: Path, connect: Connect, overwrite: Callable[[], object]
) -> None:
    other = connect(f"sqlite:///{path}")
    overwrite()
    for each in (kb, other):
        with pytest.raises(StoreReplacedError, match="overwritten with another state"):
            each.propositions.get_all()


def test_an_overwrite_within_a_commit_is_noticed_soon(
    kb: KnowledgeBase, overwrite: Callable[[], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    original = StoreFile.check_committed

    def check_committed(self: StoreFile) -> None:
        # After COMMIT, where a change of the file looks like a checkpoint of this process.
        overwrite()
        original(self)

    with monkeypatch.context() as patched:
        patched.setattr(sqlite_file, "COMPARE_AFTER", PATIENCE)
        patched.setattr(StoreFile, "check_committed", check_committed)
        kb.propositions.save(fact(1))
        kb.propositions.delete(fact(1))
    later = SimpleNamespace(monotonic=lambda: time.monotonic() + PATIENCE, sleep=time.sleep)
    monkeypatch.setattr(sqlite_file, "time", later)
    with pytest.raises(StoreReplacedError, match="overwritten with another state"):
        kb.propositions.get_all()


@pytest.mark.more
def test_checkpoints_of_this_process_are_compared_at_a_bounded_rate(
    kb: KnowledgeBase, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sqlite_file, "COMPARE_AFTER", 3600.0)
    compared: list[str] = []
    original = Contents.compare

    def compare(self: Contents, path: str) -> bool | None:
        compared.append(path)
        return original(self, path)

    monkeypatch.setattr(Contents, "compare", compare)
    changed = {path.stat().st_mtime_ns}
    while len(changed) < 4:
        # SQLite makes a checkpoint at 1,000 pages.
        kb.objects.save_all(waypoint(number) for number in range(10, 3_000))
        kb.objects.delete_all()
        changed.add(path.stat().st_mtime_ns)
    assert len(compared) <= 1


def test_who_connects_to_an_overwritten_file_goes_on_with_it_alone(
    kb: KnowledgeBase, path: Path, connect: Connect, overwrite: Callable[[], object]
) -> None:
    overwrite()
    for companion in ("-wal", "-shm"):
        Path(f"{path}{companion}").unlink()
    again = connect(f"sqlite:///{path}")
    assert fact(1) in again.propositions.get_all()
    with pytest.raises(StoreReplacedError, match="overwritten with another state"):
        kb.propositions.get_all()
    assert fact(1) in again.propositions.get_all()


def test_a_name_of_the_file_may_lead_elsewhere_when_another_stays(
    kb: KnowledgeBase, path: Path, connect: Connect, tmp_path: Path
) -> None:
    kb.close()
    link, foreign = path.with_name("link.db"), tmp_path / "foreign.db"
    link.symlink_to(path)
    first, second = connect(f"sqlite:///{link}"), connect(f"sqlite:///{path}")
    fill(connect(f"sqlite:///{foreign}"), 2)
    link.unlink()
    link.symlink_to(foreign)
    second.propositions.save(fact(1))
    checkpoint(path)
    assert fact(1) in second.propositions.get_all()
    with pytest.raises(StoreReplacedError, match="another file"):
        first.propositions.get_all()


def test_a_checkpoint_is_looked_into_once_in_a_process(
    kb: KnowledgeBase, path: Path, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = [connect(f"sqlite:///{path}") for _ in range(3)]
    kb.propositions.save(fact(1))
    checkpoint(path)
    compared: list[Path] = []
    compare = Contents.compare

    def spy(self: Contents, path: str) -> bool | None:
        compared.append(Path(path))
        return compare(self, path)

    monkeypatch.setattr(Contents, "compare", spy)
    for each in (kb, *others):
        assert fact(1) in each.propositions.get_all()
    assert compared == [path]

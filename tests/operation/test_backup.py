"""Backups while robots write: what is restored is whole, and what it lacks is sent again."""

from __future__ import annotations

import shutil
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

import kant_sql
from kant_sql import DivergedError, KnowledgeBase
from kant_sql.sql.predicate_views import update_views
from tests.support.clusters import DATABASE, Cluster, Node, run_program
from tests.support.processes.workers import wait_for
from tests.support.servers import system_user
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at, waypoint


@contextmanager
def writing(url: str, first: int = 1_000) -> Iterator[Callable[[], int]]:
    """Write in another thread; gives the last revision that was acknowledged."""
    done = threading.Event()
    last = [0]
    failures: list[BaseException] = []

    def write() -> None:
        try:
            with kant_sql.connect(url, knowledge_base="tiago") as kb:
                number = first
                while not done.is_set():
                    with kb.transaction(reason=f"number {number}"):
                        kb.objects.save(waypoint(number))
                        kb.propositions.save(robot_at(place=waypoint(number)))
                    last[0] = kb.revision
                    number += 1
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=write)
    thread.start()
    try:
        wait_for(lambda: last[0] >= 20 or failures)
        yield lambda: last[0]
    finally:
        done.set()
        thread.join()
    assert not failures


def check_copy(copy: KnowledgeBase, original: KnowledgeBase, at_least: int) -> None:
    """Check that a copy is the original as it was once, after some revision."""
    revision = copy.revision
    assert at_least <= revision <= original.revision
    assert copy.store.verify().findings == ()
    # Each revision saved one object and one fact: none is there in part.
    assert len(copy.propositions.get_all()) == len(original.at(revision).propositions.get_all())
    assert [each.hash for each in copy.store.revisions()] == [
        each.hash for each in original.store.revisions(limit=revision)
    ]


# The robot's file.


def backup(source: Path, copy: Path) -> None:
    with closing(sqlite3.connect(source)) as store, closing(sqlite3.connect(copy)) as target:
        # Some pages at a time, between which others write.
        store.backup(target, pages=5)


def vacuum_into(source: Path, copy: Path) -> None:
    with closing(sqlite3.connect(source)) as store:
        store.execute("VACUUM INTO ?", [str(copy)])


@pytest.mark.parametrize("make", [backup, vacuum_into])
def test_a_copy_of_a_file_that_is_written_to_is_whole(
    tmp_path: Path, connect: Connect, make: Callable[[Path, Path], None]
) -> None:
    path, copy = tmp_path / "robot.db", tmp_path / "copy.db"
    kb = connect(f"sqlite:///{path}", knowledge_base="tiago")
    with writing(f"sqlite:///{path}") as last:
        before = last()
        anchor = kb.store.anchor()
        make(path, copy)
    restored = connect(f"sqlite:///{copy}", knowledge_base="tiago")
    check_copy(restored, kb, before)
    # What was noted elsewhere before the backup is in it.
    assert restored.store.verify(anchor).is_intact
    # What was noted after it is missed.
    later = restored.store.verify(kb.store.anchor())
    assert later.is_intact is (restored.revision == kb.revision)


def test_a_restored_robot_gets_the_rest_from_the_server(tmp_path: Path, connect: Connect) -> None:
    path, copy = tmp_path / "robot.db", tmp_path / "copy.db"
    server = f"sqlite:///{tmp_path / 'server.db'}"
    with kant_sql.connect(f"sqlite:///{path}", knowledge_base="tiago") as kb:
        for number in range(5):
            kb.objects.insert(waypoint(number))
        vacuum_into(path, copy)
        for number in range(5, 9):
            kb.objects.insert(waypoint(number))
        kb.store.push(server)
        anchor = kb.store.anchor()
    # The backup is behind what the robot had sent: if it wrote on, there would be two histories.
    shutil.copy(copy, tmp_path / "wrong.db")
    with kant_sql.connect(f"sqlite:///{tmp_path / 'wrong.db'}", knowledge_base="tiago") as wrong:
        wrong.objects.insert(waypoint(99))
        with pytest.raises(DivergedError) as caught:
            wrong.store.push(server)
        assert caught.value.revision == 6
    # So it is fetched whole, becomes the robot's own, and is pushed on.
    fetched = f"sqlite:///{tmp_path / 'fetched.db'}"
    with kant_sql.connect(server, knowledge_base="tiago", read_only=True) as kept:
        kept.store.push(fetched)
    robot = connect(fetched, knowledge_base="tiago")
    assert robot.store.verify(anchor).is_intact
    assert robot.store.promote(reason="the disk failed") == 10
    robot.objects.insert(waypoint(100))
    assert robot.store.push(server).revision == 11


# The server.


def filled(url: str, connect: Connect) -> KnowledgeBase:
    kb = connect(url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    assert update_views(url)
    return kb


def test_a_dump_taken_at_work_is_restored_whole(
    primary: Node, connect: Connect, tmp_path: Path
) -> None:
    kb = filled(primary.url, connect)
    dump = primary.folder / "fleet.dump"
    with writing(primary.url) as last:
        before, anchor = last(), kb.store.anchor()
        run_program("pg_dump", "-d", primary.conninfo(), "-Fc", "-f", dump)
    primary.execute("CREATE DATABASE again")
    run_program("pg_restore", "-d", primary.conninfo("again"), "--exit-on-error", dump)
    again = primary.url.replace(f"/{DATABASE}?", "/again?")
    restored = connect(again, knowledge_base="tiago")
    check_copy(restored, kb, before)
    assert restored.store.verify(anchor).is_intact
    # It goes on, and what was generated is as it was.
    assert {view.change for view in update_views(again)} == {"unchanged"}
    assert restored.objects.insert(waypoint(7))
    assert restored.store.verify().is_intact


def test_a_server_is_restored_to_a_moment_and_robots_send_what_it_lacks(
    cluster: Cluster, connect: Connect, tmp_path: Path
) -> None:
    archive = f"cp %p {cluster.log_archive}/%f"
    primary = cluster.primary(archive_mode="on", archive_command=archive)
    kant_sql.upgrade(primary.url)
    robot = connect(f"sqlite:///{tmp_path / 'robot.db'}", knowledge_base="tiago")
    robot.objects.insert(waypoint(0))
    robot.store.push(primary.url)
    base = cluster.node(5434)
    run_program("pg_basebackup", "-d", primary.conninfo(), "-D", base.data, "-c", "fast")
    for number in range(1, 5):
        robot.objects.insert(waypoint(number))
    robot.store.push(primary.url)
    moment = primary.ask("SELECT clock_timestamp()::text")
    for number in range(5, 9):
        robot.objects.insert(waypoint(number))
    robot.store.push(primary.url)
    anchor = robot.store.anchor()
    # Somebody drops everything, and notices later.
    kant_sql.operations.downgrade(primary.url, revision="base")
    segment = primary.ask("SELECT pg_walfile_name(pg_current_wal_lsn())")
    primary.ask("SELECT pg_switch_wal()")
    primary.wait_for(f"SELECT last_archived_wal >= '{segment}' FROM pg_stat_archiver")
    primary.kill()
    base.configure(
        restore_command=f"cp {cluster.log_archive}/%f %p",
        recovery_target_time=moment,
        recovery_target_action="promote",
        archive_mode="off",
    )
    signal = base.data / "recovery.signal"
    signal.touch()
    if (user := system_user()) is not None:
        shutil.chown(signal, user)
    base.start()
    base.wait_for("SELECT NOT pg_is_in_recovery()")
    restored = connect(base.url, knowledge_base="tiago", read_only=True)
    assert restored.revision == 5
    assert not restored.store.verify(anchor).is_intact
    assert robot.store.push(base.url).revisions == 4
    assert restored.store.verify(anchor).is_intact

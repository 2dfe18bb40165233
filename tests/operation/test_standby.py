"""A hot standby: what can be read there, and what is there after its primary has died."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, ReadOnlyError
from kant_sql.errors import ReadOnlyStoreError, StoreReplacedError
from tests.support.chain import check_chain
from tests.support.clusters import DATABASE, Node
from tests.support.processes.crashes import all_told, check_all, write_for_ever
from tests.support.processes.workers import PATIENCE, killed_later
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import ROBOT, robot_at, waypoint

SYNCHRONOUS = {"synchronous_standby_names": "*", "synchronous_commit": "remote_apply"}


def either(*nodes: Node) -> str:
    """The URL of whichever of some servers may be written to."""
    hosts = "&".join(node.address for node in nodes)
    return f"postgresql://postgres@/{DATABASE}?{hosts}&target_session_attrs=read-write"


def caught_up(primary: Node, standby: Node) -> None:
    """Wait until a standby shows all that is committed."""
    position = primary.ask("SELECT pg_current_wal_lsn()")
    standby.wait_for(f"SELECT pg_last_wal_replay_lsn() >= '{position}'")


def insert(kb: KnowledgeBase, *numbers: int) -> None:
    for number in numbers:
        assert kb.objects.insert(waypoint(number))


def test_a_standby_is_read_and_verified(primary: Node, standby: Node, connect: Connect) -> None:
    kb = connect(primary.url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    insert(kb, *range(10, 20))
    caught_up(primary, standby)
    reader = connect(standby.url, knowledge_base="tiago", read_only=True)
    assert reader.propositions.get_all() == [robot_at()]
    assert reader.revision == kb.revision
    verified = reader.store.verify(kb.store.anchor())
    assert (verified.findings, verified.revisions) == ((), kb.revision)
    assert [one.name for one in kant_sql.operations.knowledge_bases(standby.url)] == ["tiago"]
    with pytest.raises(ReadOnlyError):
        reader.propositions.delete_all()
    with pytest.raises(ReadOnlyStoreError, match="read-only"):
        connect(standby.url, knowledge_base="tiago").propositions.delete_all()
    # Who waits there sees what the primary commits.
    insert(kb, 99)
    assert reader.watch(kb.revision - 1, timeout=PATIENCE) == kb.revision


def test_what_a_synchronous_standby_has_acknowledged_survives_its_primary(
    primary: Node, standby: Node, connect: Connect
) -> None:
    primary.set(**SYNCHRONOUS)
    primary.wait_for("SELECT sync_state IN ('sync', 'quorum') FROM pg_stat_replication")
    kb = connect(primary.url, knowledge_base="tiago")
    counter.start(kb)
    url = either(primary, standby)
    with killed_later(write_for_ever, url) as told:
        assert told.poll(PATIENCE)
        primary.wait_for("SELECT max(revision) > 8 FROM head", DATABASE)
        time.sleep(random.uniform(0.3, 0.8))
        primary.kill()
        standby.promote()
        # A revision more, rather than a connection: the writer may be back already.
        before = standby.ask("SELECT max(revision) FROM head", DATABASE)
        # The writer goes on by itself: the same URL leads to the new primary.
        standby.wait_for(f"SELECT max(revision) > {before} FROM head", DATABASE)
        time.sleep(0.5)
    acknowledged = all_told(told)
    assert len(acknowledged) > 5
    check_all(connect(url, knowledge_base="tiago"), standby.url, acknowledged)


def test_what_an_asynchronous_standby_lacks_comes_from_the_robots(
    primary: Node, standby: Node, connect: Connect, tmp_path: Path
) -> None:
    robot = connect(f"sqlite:///{tmp_path / 'robot.db'}", knowledge_base="tiago")
    url = either(primary, standby)
    insert(robot, *range(5))
    robot.store.push(url)
    direct = connect(url, knowledge_base="dispatcher")
    insert(direct, 1)
    caught_up(primary, standby)
    # From here on the standby receives nothing.
    standby.set(primary_conninfo="")
    primary.wait_for("SELECT count(*) = 0 FROM pg_stat_replication")
    insert(robot, *range(5, 12))
    assert robot.store.push(url).revision == 12
    insert(direct, 2)
    anchor = robot.store.anchor()
    primary.kill()
    standby.promote()
    with connect(url, knowledge_base="tiago", read_only=True) as lost:
        assert lost.revision == 5
    # What nobody else has is lost, and its writer learns of it rather than go on.
    with pytest.raises(StoreReplacedError, match="revision 2, committed before, is not in it"):
        insert(direct, 3)
    # What a robot has is sent again.
    sent = robot.store.push(url)
    assert (sent.before, sent.revision) == (5, 12)
    with connect(url, knowledge_base="tiago", read_only=True) as found:
        assert found.store.verify(anchor).findings == ()
    assert check_chain(standby.url) == {"dispatcher": 1, "tiago": 12}


def test_a_robot_pushes_on_while_servers_change_places(
    primary: Node, standby: Node, connect: Connect, tmp_path: Path
) -> None:
    robot = connect(f"sqlite:///{tmp_path / 'robot.db'}", knowledge_base="tiago")
    url = either(primary, standby)
    for number in range(20):
        assert robot.objects.insert(PddlObjectDto(ROBOT, f"r{number}"))
        if number == 10:
            caught_up(primary, standby)
            primary.kill()
            standby.promote()
        assert robot.store.push(url).revision == number + 1
    assert check_chain(standby.url) == {"tiago": 20}

"""Writers at work on a distributed store while something happens to the cluster."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import kant_sql
from kant_sql import KnowledgeBase, StoreBusyError
from kant_sql.errors import ConnectionLostError
from tests.support.citus import Cluster
from tests.support.worlds.robots import robot_at, waypoint

# Seconds of work before and after what happens.
AROUND = 2.0


class Work(NamedTuple):
    """What writers did.

    Attributes:
        saved: of each knowledge base, the numbers of the facts whose saving returned.
        unsure: of each knowledge base, the numbers of facts whose saving raised an error.
    """

    saved: dict[str, list[int]]
    unsure: dict[str, list[int]]


def names(writers: int) -> list[str]:
    """The knowledge bases, of which each writer has one."""
    return [f"robot {number}" for number in range(writers)]


def at_work(url: str, writers: int, happens: Callable[[], object]) -> Work:
    """Let writers save facts, one after the other, while something happens."""
    saved: dict[str, list[int]] = {name: [] for name in names(writers)}
    unsure: dict[str, list[int]] = {name: [] for name in names(writers)}
    is_over = threading.Event()

    def write(kb: KnowledgeBase, name: str) -> None:
        number = 0
        while not is_over.is_set():
            number += 1
            try:
                kb.propositions.save(robot_at(place=waypoint(number)))
            except (ConnectionLostError, StoreBusyError):
                unsure[name].append(number)
            else:
                saved[name].append(number)

    kbs = {name: kant_sql.connect(url, knowledge_base=name) for name in names(writers)}
    for kb in kbs.values():
        kb.propositions.save(robot_at(place=waypoint(0)))
    threads = [threading.Thread(target=write, args=[kb, name]) for name, kb in kbs.items()]
    for thread in threads:
        thread.start()
    try:
        time.sleep(AROUND)
        happens()
        time.sleep(AROUND)
    finally:
        is_over.set()
        for thread in threads:
            thread.join()
        for kb in kbs.values():
            kb.close()
    return Work(saved, unsure)


def check_work(url: str, work: Work) -> None:
    """Check that what was said to be saved is there, and nothing that was not asked for."""
    for name, numbers in work.saved.items():
        with kant_sql.connect(url, knowledge_base=name) as kb:
            there = {str(fact) for fact in kb.propositions.get_all()}
            wanted = {str(robot_at(place=waypoint(number))) for number in (0, *numbers)}
            asked = {str(robot_at(place=waypoint(number))) for number in work.unsure[name]}
            assert wanted <= there <= wanted | asked
            assert kb.revision == len(there)
            assert kb.store.verify(structure=False).is_intact


def move_a_shard(cluster: Cluster, url: str) -> None:
    """Move the shard of the first knowledge base, with those colocated, to another worker."""
    ((shard, host, port),) = cluster.run(
        "SELECT shardid, nodename, nodeport FROM citus_shards "
        "WHERE table_name = 'head'::regclass "
        "AND shardid = get_shard_id_for_distribution_column('head', 1)",
        url,
    )
    _, to_host, to_port = next(
        node for node in cluster.nodes if node[0] and node[1:] != (host, port)
    )
    cluster.run(
        f"SELECT citus_move_shard_placement({shard}, '{host}', {port}, '{to_host}', {to_port}, "
        "'force_logical')",
        url,
    )


def crash_a_worker(cluster: Cluster, url: str, group: int) -> None:
    """Kill a process of a worker, which ends all others at once and recovers from its log."""
    worker = cluster.at_node(url, group)
    try:
        cluster.run("COPY (SELECT 1) TO PROGRAM 'kill -9 $PPID'", worker)
    except Exception as error:
        if "the connection" not in str(error) and "terminating" not in str(error):
            raise
    end = time.monotonic() + 60
    while time.monotonic() < end:
        try:
            cluster.run("SELECT 1", worker)
        except Exception:
            time.sleep(0.05)
        else:
            return
    raise AssertionError("the worker does not come back")

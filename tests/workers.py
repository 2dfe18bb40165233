"""Processes for the tests, and what they do there.

They are forked from a server that has imported this module, and never from pytest itself, which has
threads and open connections.
"""

from __future__ import annotations

import multiprocessing
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Barrier
from typing import Any

import kant_sql
from kant_sql import KnowledgeBase
from tests import counter
from tests.warm import MODULES

PROCESSES = multiprocessing.get_context("forkserver")
PROCESSES.set_forkserver_preload([__name__, *MODULES])
PATIENCE = 60

Call = tuple[Any, ...]


def in_processes(*calls: Call) -> list[Any]:
    """Run calls at the same moment, each in a process of its own.

    Args:
        *calls: a function that a module can be asked for, and its arguments.

    Returns:
        What each of them returned.

    Raises:
        AssertionError: one of them raised; the message is its traceback.
    """
    barrier = PROCESSES.Barrier(len(calls))
    running = []
    for call in calls:
        ours, theirs = PROCESSES.Pipe(duplex=False)
        process = PROCESSES.Process(target=_run, args=(theirs, barrier, call), daemon=True)
        process.start()
        theirs.close()
        running.append((process, ours))
    answers = []
    for process, ours in running:
        with ours:
            answered = ours.poll(PATIENCE)
            answers.append(ours.recv() if answered else (False, f"{process} does not answer"))
        if not answered:
            process.kill()
        process.join(PATIENCE)
    failures = [result for succeeded, result in answers if not succeeded]
    assert not failures, "\n".join(failures)
    return [result for _, result in answers]


def _run(answer: Connection, barrier: Barrier, call: Call) -> None:
    work, *arguments = call
    try:
        barrier.wait(PATIENCE)
        result = work(*arguments)
    except BaseException:
        answer.send((False, traceback.format_exc()))
    else:
        answer.send((True, result))


def count(url: str, way: Callable[[KnowledgeBase, int], None], times: int) -> None:
    """Open the knowledge base of the counter, and count."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="counting") as kb:
        way(kb, times)


def change(url: str, work: Callable[[KnowledgeBase], None]) -> None:
    """Open the knowledge base, and change it."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="elsewhere") as kb:
        work(kb)


def watch(url: str, end: int) -> int:
    """Read the counter until it is at its end; give how often that was."""
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        return watch_with(kb, end)


def watch_with(kb: KnowledgeBase, end: int) -> int:
    """Read the counter until it is at its end; give how often that was."""
    reads = last = 0
    while last < end:
        value = counter.read(kb) if reads % 2 else counter.read_by_calls(kb)
        assert value >= last, f"{last} was read before {value}"
        last = value
        reads += 1
    return reads

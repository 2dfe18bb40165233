"""Processes of the tests: simultaneous calls, writers to kill, forks.

They are forked from a server that has imported this module, never from pytest itself, which has
threads and open connections.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Barrier
from typing import Any

import kant_sql
from kant_sql import KnowledgeBase
from tests.support.processes.warm import MODULES
from tests.support.worlds import counter

PROCESSES = multiprocessing.get_context("forkserver")
PROCESSES.set_forkserver_preload([__name__, *MODULES])
PATIENCE = 60
# The signals that the starting process may ignore, as with `nohup` or a shell's `&`.
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)

Call = tuple[Any, ...]


def wait_for(is_so: Callable[[], object]) -> None:
    """Wait until a condition is true, which must happen soon."""
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.005)


def in_processes(*calls: Call) -> list[Any]:
    """Run calls at the same moment, each in its own process.

    Args:
        *calls: functions that can be imported from a module, with their arguments.

    Returns:
        The result of each call.

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
            answered = ours.poll(4 * PATIENCE)
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


@contextmanager
def killed_later(work: Callable[[str, Connection], None], url: str) -> Iterator[Connection]:
    """Run a writer in its own process until the end of the block, then kill it."""
    told, tell = PROCESSES.Pipe(duplex=False)
    process = PROCESSES.Process(target=work, args=(url, tell), daemon=True)
    process.start()
    tell.close()
    try:
        yield told
    finally:
        process.kill()
        process.join(PATIENCE)
    assert process.exitcode == -signal.SIGKILL, "the writer has failed by itself"


def dies(work: Callable[..., None], *arguments: object) -> bool:
    """Run a writer in its own process to its end; return whether it was killed."""
    process = PROCESSES.Process(target=work, args=arguments, daemon=True)
    process.start()
    process.join(PATIENCE)
    assert process.exitcode in (0, -signal.SIGKILL)
    return process.exitcode != 0


class Child:
    """A fork of this process that runs a function."""

    def __init__(self, work: Callable[[], None]) -> None:
        self._pid = os.fork()
        if self._pid == 0:
            status = 1
            try:
                work()
                status = 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(status)

    def join(self) -> None:
        """Wait for its end, and check that it succeeded."""
        deadline = time.monotonic() + 2 * PATIENCE
        ended, status = os.waitpid(self._pid, os.WNOHANG)
        while not ended:
            if time.monotonic() > deadline:
                os.kill(self._pid, signal.SIGKILL)
                deadline = math.inf
            time.sleep(0.002)
            ended, status = os.waitpid(self._pid, os.WNOHANG)
        assert status == 0, f"the child ended with {status}"


def count(url: str, way: Callable[[KnowledgeBase, int], None], times: int) -> None:
    """Open the knowledge base of the counter, and count."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="counting") as kb:
        way(kb, times)


def change(url: str, work: Callable[[KnowledgeBase], None]) -> None:
    """Open the knowledge base, and change it."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="elsewhere") as kb:
        work(kb)


def watch(url: str, end: int) -> None:
    """Open the knowledge base of the counter, and read it until the counter reaches its end."""
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        watch_with(kb, end)


def watch_with(kb: KnowledgeBase, end: int) -> None:
    """Read the counter until it reaches its end."""
    reads = last = 0
    while last < end:
        value = counter.read(kb) if reads % 2 else counter.read_by_calls(kb)
        assert value >= last, f"{last} was read before {value}"
        last = value
        reads += 1

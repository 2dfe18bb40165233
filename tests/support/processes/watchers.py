"""Processes that follow a knowledge base, and others that fork while a thread does."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TextIO

import kant_sql
from kant_sql import KnowledgeBase, StoreUnreachableError
from kant_sql.errors import ConnectionLostError
from kant_sql.sql.dialects.base import Listener
from tests.support.processes.workers import PATIENCE
from tests.support.worlds.robots import waypoint

LAST = "last"


_thread = threading.local()


def _announced(made: Listener) -> Listener:
    """Let a listener of this thread report when it listens."""
    wait, listens = made.wait, getattr(_thread, "listens", threading.Event())

    def told(kb_id: int | None, seconds: float) -> None:
        wait(kb_id, seconds)
        listens.set()

    made.wait = told  # type: ignore[method-assign]
    return made


class Waiting:
    """A waiting call of `kb.watch` in its own thread."""

    def __init__(self, kb: KnowledgeBase, after: int | None, timeout: float | None) -> None:
        self._listens = threading.Event()
        self._pool = ThreadPoolExecutor(1)
        self._call = self._pool.submit(self._watch, kb, after, timeout)
        self._pool.shutdown(wait=False)

    def _watch(self, kb: KnowledgeBase, after: int | None, timeout: float | None) -> int | None:
        backend = kb.store.factory._store.backend  # type: ignore[attr-defined]
        _thread.listens = self._listens
        # Any of several threads may have set it: each finds its own event.
        backend.listener = lambda: _announced(type(backend).listener(backend))
        return kb.watch(after, timeout=timeout)

    def listens(self) -> None:
        """Wait until it listens, or raise the error that ended it."""
        end = time.monotonic() + PATIENCE
        while not self._listens.wait(0.1):
            if self._call.done() and not self._listens.is_set():
                raise AssertionError(f"it ended before it listened: {self._call.result()}")
            assert time.monotonic() < end

    def result(self) -> int | None:
        """Return the result of the call."""
        return self._call.result(PATIENCE)


@contextmanager
def waiting(
    kb: KnowledgeBase, after: int | None = None, timeout: float | None = None
) -> Iterator[Waiting]:
    """Wait for news in another thread, which listens when the block begins."""
    call = Waiting(kb, after, timeout)
    call.listens()
    yield call


def follow(folder: Path, url: str, tell: Connection) -> None:
    """Follow a feed for ever, and keep the seen revisions on disk, because it may be killed."""
    with kant_sql.connect(url, knowledge_base="tiago") as kb, (folder / "seen").open("a") as seen:
        tell.send("begins")
        while True:
            # A killed server may stay away for longer than a call retries.
            with suppress(ConnectionLostError, StoreUnreachableError):
                _follow_once(kb, folder, seen, tell)


def _follow_once(kb: KnowledgeBase, folder: Path, seen: TextIO, tell: Connection) -> None:
    place = folder / "place"
    after = int(place.read_text()) if place.exists() else 0
    kb.watch(after, timeout=PATIENCE)
    for entry in kb.changes(after):
        number = entry.revision.number
        seen.write(f"{number} {' '.join(change.text for change in entry.changes)}\n")
        seen.flush()
        new = folder / "new"
        new.write_text(str(number))
        new.replace(place)
        if entry.revision.reason == LAST:
            tell.send(LAST)


def write_many(url: str, first: int, number: int) -> None:
    """Make some revisions."""
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        for place in range(first, first + number):
            assert kb.objects.insert(waypoint(place))


def open_files() -> int:
    """Count the open files of this process."""
    return len(os.listdir("/proc/self/fd"))

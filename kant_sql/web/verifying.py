"""Verifications started by readers: in the background, one at a time per knowledge base."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from typing import NamedTuple

from ..errors import KantSqlError, StoreBusyError
from ..history.anchors import Anchor
from ..history.verify.verify import Verification
from ..knowledge_base import KnowledgeBase
from ..limits import Limit, obeying
from .rendering import Folders

logger = logging.getLogger("kant_sql.web")

# The maximum numbers of running verifications, and of kept results.
MOST_RUNS, MOST_KEPT = 2, 1_000
# The maximum number of running and waiting verifications, each with its anchor.
MOST_STARTED = 50


class VerificationRun(NamedTuple):
    """A verification that runs, or waits for its turn: how much is checked, of how much."""

    started_at: datetime
    done: int
    total: int | None


class VerificationOutcome(NamedTuple):
    """A verification that has ended. Without a `result`, `error` says why there is none.

    `anchor_made_at` is the time of the anchor that the store was compared with, if any.
    """

    started_at: datetime
    ended_at: datetime
    anchor_made_at: str | None
    result: Verification | None
    error: str | None


class VerificationState(NamedTuple):
    """What this server has verified of a knowledge base since it was started."""

    knowledge_base: str
    running: VerificationRun | None
    last: VerificationOutcome | None


class _Run:
    """A running verification."""

    def __init__(self, name: str, anchor: Anchor | None) -> None:
        self.name = name
        self.anchor = anchor
        self.started_at = datetime.now(UTC)
        self.done = 0
        self.total: int | None = None
        self.limit = Limit()

    def tell(self, done: int, total: int) -> None:
        """Record the progress; raise if it was cancelled."""
        self.limit.check()
        self.done, self.total = done, total


class Verifier:
    """Runs verifications, and keeps the last result of each knowledge base. Threads share it."""

    def __init__(
        self, lend: Callable[[str], AbstractContextManager[KnowledgeBase]], folders: Folders
    ) -> None:
        self._lend = lend
        self._folders = folders
        self._lock = threading.Lock()
        self._threads = ThreadPoolExecutor(MOST_RUNS, "kant_sql verify")
        self._running: dict[str, _Run] = {}
        self._last: OrderedDict[str, VerificationOutcome] = OrderedDict()

    def state(self, name: str) -> VerificationState:
        """Return the state of the verifications of a knowledge base."""
        with self._lock:
            run, last = self._running.get(name), self._last.get(name)
        running = None if run is None else VerificationRun(run.started_at, run.done, run.total)
        return VerificationState(name, running, last)

    def start(self, name: str, anchor: Anchor | None = None) -> None:
        """Start a verification; without an anchor, a running one is as good."""
        with self._lock:
            running = self._running.get(name)
            if running is None:
                if len(self._running) >= MOST_STARTED:
                    raise StoreBusyError(
                        f"{MOST_STARTED} verifications run or wait already; try again later"
                    )
                run = self._running[name] = _Run(name, anchor)
                self._threads.submit(self._run, run)
            elif anchor is not None and anchor != running.anchor:
                raise StoreBusyError(
                    f"knowledge base {name!r} is being verified without this anchor; wait for the "
                    "end, or cancel it, then try again"
                )

    def cancel(self, name: str) -> None:
        """Cancel the running verification, if any."""
        with self._lock:
            run = self._running.get(name)
        if run is not None:
            run.limit.cancel()

    def close(self) -> None:
        """Cancel all verifications."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for name in list(self._running):
            self.cancel(name)

    def _run(self, run: _Run) -> None:
        result: Verification | None = None
        error: str | None = None
        try:
            with obeying(run.limit), self._lend(run.name) as kb:
                result = kb.store.verify(run.anchor, progress=run.tell)
        except KantSqlError as refused:
            error = self._folders.said(refused)
        except Exception as failed:
            logger.error("the verification of %r failed", run.name, exc_info=failed)
            error = "the verification failed; the server's log says more"
        made_at = None if run.anchor is None else run.anchor.made_at
        ended = VerificationOutcome(run.started_at, datetime.now(UTC), made_at, result, error)
        with self._lock:
            del self._running[run.name]
            self._last[run.name] = ended
            self._last.move_to_end(run.name)
            if len(self._last) > MOST_KEPT:
                self._last.popitem(last=False)

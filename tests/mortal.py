"""A PostgreSQL server that the tests kill, as a crash does, and start again."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest

from tests.conftest import Server
from tests.workers import PATIENCE

STARTS = 3


class MortalServer(Server):
    """A server that keeps its promises as in earnest, and that a test may kill."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, fsync=True)
        self._child: subprocess.Popen[bytes] | None = None

    def kill(self) -> None:
        """Kill it with all of its processes at once."""
        postmaster = self._server.get_postmaster_info().process
        processes = [postmaster, *postmaster.children(recursive=True)]
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)
        self._reap()
        # It does not start again while its process is known; those of orphans may be, for seconds.
        postmaster.wait(PATIENCE)
        while any(map(_runs, processes)):
            time.sleep(0.001)

    def restart(self) -> None:
        """Start it again; it repairs its files from its log."""
        with self._server._lock:
            # A crash while it repairs its files is one more that it has to survive.
            if not any(self._starts() for _ in range(STARTS)):
                assert self._child is not None
                log = (self._folder / "log").read_text()[-4000:]
                pytest.fail(f"the server does not start: {self._child.poll()}\n{log}")
            self._server.ensure_postgres_running()

    def _starts(self) -> bool:
        # As a child of ours it is buried at once, and tells how it ended if it does not start.
        command: list[Any] = [self._server.bin_path / "postgres", "-D", self._folder]
        command += ["-h", "", "-k", self.url.query["host"]]
        with (self._folder / "log").open("ab") as log:
            self._child = subprocess.Popen(
                command, stdout=log, stderr=log, user=self._server.system_user
            )
        end = time.monotonic() + PATIENCE
        while self._child.poll() is None and time.monotonic() < end:
            with suppress(psycopg.OperationalError):
                psycopg.connect(self._server.get_uri()).close()
                return True
            time.sleep(0.01)
        self._child.kill()
        self._reap()
        return False

    def stop(self) -> None:
        """Stop it for good."""
        self._server.cleanup()
        self._reap()

    def _reap(self) -> None:
        if self._child is not None:
            self._child.wait(PATIENCE)


def _runs(process: psutil.Process) -> bool:
    try:
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False

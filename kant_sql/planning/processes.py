"""The processes of planners: their time, output and memory are limited, and they end."""

from __future__ import annotations

import contextlib
import math
import os
import re
import selectors
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

GUARD = Path(__file__).with_name("guard.py")
# The maximum output of a planner, in bytes; no known planner prints as much.
MOST_OUTPUT = 16 << 20
# Seconds for the system to end killed processes.
_ENDS_WITHIN = 30.0
_MEMORY = re.compile(r"MemoryError|bad_alloc|OutOfMemoryError|out of memory|cannot allocate", re.I)


class Ended(NamedTuple):
    """The end of a planner's process."""

    code: int  # its exit code; the negative number of the signal that ended it
    output: str  # its output
    status: str | None  # `timeout`, `memout`, `internal_error` for too much output; or None

    @property
    def reason(self) -> str:
        """The reason in words: how it ended, and the last line of its output."""
        how = f"it ended with code {self.code}"
        if self.status == "timeout":
            how = "its time was up"
        elif self.status == "internal_error":
            return f"it printed more than {MOST_OUTPUT >> 20} MiB"
        elif self.code < 0:
            how = f"signal {-self.code} ended it"
        lines = self.output[-10_000:].strip().splitlines()
        return how if not lines else f"{how}, and said: {lines[-1].strip()[:200]}"


class PlannerProcess:
    """Runs the programs of a planner in sequence; any thread may `end` them."""

    def __init__(self, folder: str = "", memory: int = 0) -> None:
        self.folder = folder  # their working folder, also for temporary files
        self.memory = memory  # the maximum bytes of each; 0 for no limit
        self.is_ended = False
        self._guard = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def run(self, words: Sequence[str], until: float) -> Ended:
        """Run a program; end it at a moment of the monotonic clock."""
        path = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
        with self._guard:
            if self.is_ended:
                return Ended(0, "", "timeout")
            # It ends with its standard input, so it does not outlive a killed caller.
            self._process = process = subprocess.Popen(
                [sys.executable, "-IS", str(GUARD), str(self.memory), *words],
                cwd=self.folder,
                env={**os.environ, "PYTHONPATH": path, "TMPDIR": self.folder},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        try:
            output, status = _read(process, until)
        finally:
            self._close(process)
        if status is None and process.returncode and _MEMORY.search(output[-10_000:]):
            status = "memout"
        return Ended(process.returncode, output, status)

    def end(self) -> None:
        """End the running program, and start no more."""
        with self._guard:
            self.is_ended = True
            if self._process is not None:
                _stop(self._process)

    def _close(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with self._guard:
            self._process = None
            _stop(process)
        try:
            process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:  # A device blocks its processes.
            process.kill()
            process.wait()
        process.stdout.close()


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Let the guard end the planner, and know that its caller lives."""
    assert process.stdin is not None
    if not process.stdin.closed:
        with contextlib.suppress(OSError):
            process.stdin.write(b"\n")
            process.stdin.close()


def _read(process: subprocess.Popen[bytes], until: float) -> tuple[str, str | None]:
    """Read the output of a process until it ends."""
    assert process.stdout is not None
    found, size, status = [], 0, None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while True:
            left = until - time.monotonic()
            if left <= 0 or not selector.select(None if math.isinf(left) else min(left, 1e6)):
                if left <= 1e6:
                    status = "timeout"
                    break
                continue
            read = os.read(process.stdout.fileno(), 1 << 16)
            if not read:
                break
            found.append(read)
            size += len(read)
            if size >= MOST_OUTPUT:
                status = "internal_error"
                break
    return b"".join(found)[:MOST_OUTPUT].decode(errors="replace"), status

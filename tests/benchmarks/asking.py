"""Asking another parser, in a process of its own, to read pairs one after the other."""

from __future__ import annotations

import json
import selectors
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

SCRIPT = Path(__file__).with_name("other_parsers.py")
STARTS_WITHIN = 60


class Answer(NamedTuple):
    """What came of a pair.

    Attributes:
        seconds: what reading took; None when the parser refused it, crashed or did not finish.
        waited: how long the answer took to come.
    """

    seconds: float | None
    waited: float


class Asked:
    """A parser that is asked; when it crashes or takes too long, it is started anew.

    Attributes:
        installed: whether the interpreter has it.
    """

    def __init__(self, python: str, name: str) -> None:
        self._command = [python, str(SCRIPT), name]
        self._process = self._start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stop()

    def ask(self, pair: tuple[str, str], limit: float) -> Answer:
        """Let it read a domain and a problem.

        Args:
            pair: the paths.
            limit: how many seconds to wait.
        """
        start = time.perf_counter()
        self._stdin.write(json.dumps(pair) + "\n")
        self._stdin.flush()
        line = self._line(limit)
        waited = time.perf_counter() - start
        if not line:
            self._stop()
            self._process = self._start()
            return Answer(None, waited)
        return Answer(json.loads(line), waited)

    def _start(self) -> subprocess.Popen[str]:
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            bufsize=1,
        )
        self._stdin: Any = self._process.stdin
        self._stdout: Any = self._process.stdout
        self.installed = self._line(STARTS_WITHIN).strip() == "ready"
        return self._process

    def _line(self, limit: float) -> str:
        """Wait for a line; give an empty one when none comes."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._stdout, selectors.EVENT_READ)
            return str(self._stdout.readline()) if selector.select(limit) else ""

    def _stop(self) -> None:
        self._process.kill()
        self._process.communicate()

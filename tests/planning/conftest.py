"""What the tests of planning share."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.support.processes.warm import PLANNING, python


def mentioning(folder: Path) -> list[str]:
    """Processes that have a folder among their arguments: a planner's files are in its own."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            arguments = (process / "cmdline").read_bytes().decode(errors="replace")
            if str(folder) in arguments:
                found.append(arguments)
    return found


@pytest.fixture
def quick_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the process that is asked be one that has imported all, which takes most of its time."""
    monkeypatch.setattr(sys, "executable", str(python(*PLANNING)))

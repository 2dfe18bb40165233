"""What the tests of planning share."""

from __future__ import annotations

import sys

import pytest

from tests.support.processes.warm import PLANNING, python


@pytest.fixture
def quick_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the process that is asked be one that has imported all, which takes most of its time."""
    monkeypatch.setattr(sys, "executable", str(python(*PLANNING)))

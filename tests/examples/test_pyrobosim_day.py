"""A day in a simulator that others wrote is executed, sensed, asked about and learned from."""

from __future__ import annotations

import re

import pytest

from tests.support.processes.commands import run_example

pytest.importorskip("pyrobosim", reason="needs pyrobosim: pip install pyrobosim")
pytestmark = pytest.mark.more


def test_sixty_navigations_are_done_seen_and_counted(file_url: str) -> None:
    done = run_example("pyrobosim_day.py", file_url)
    assert done.returncode == 0, done.stderr
    said = done.stdout
    went, failed = map(int, re.findall(r"went (\d+), failed (\d+)", said)[0])
    assert "executions 60\n" in said
    assert went + failed == 60
    assert failed > 0
    # What fails says why; what was done is seen.
    assert sum(map(int, re.findall(r"_FAILURE (\d+)", said))) == failed
    confirmed = int(re.findall(r"confirmed (\d+)", said)[0])
    corrected = int(re.findall(r"corrected (\d+)", said)[0])
    assert confirmed >= went - corrected
    assert int(re.findall(r"led to (\d+) acts", said)[0]) > 0
    assert said.endswith("intact True\n")

"""Nodes and clients as processes, in the environment of ROS 2."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.processes.commands import PROGRAM, ROOT
from tests.support.processes.workers import PATIENCE, wait_for

PREFIX = os.environ.get("KANT_SQL_TEST_ROS", "")
needs_ros = pytest.mark.skipif(
    not PREFIX, reason="needs ROS 2: KANT_SQL_TEST_ROS names the folder with its setup.bash"
)
Process = subprocess.Popen[str]


@functools.cache
def environment() -> dict[str, str]:
    """The environment of ROS 2, on this machine alone, with the library in it."""
    command = f". {Path(PREFIX, 'setup.bash')} && env -0"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    found = dict(line.split("=", 1) for line in done.stdout.split("\0") if "=" in line)
    found["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    found.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    return {**found, "PYTHONPATH": f"{ROOT}:{found.get('PYTHONPATH', '')}"}


@contextmanager
def running(command: list[str], output: Path, **variables: str) -> Iterator[Process]:
    """Run a process that writes into a file, until the end of the block; then it is killed."""
    with output.open("a") as file:
        process = subprocess.Popen(
            command, env={**environment(), **variables}, stdout=file, stderr=file, text=True
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait(PATIENCE)


@contextmanager
def node(url: str, output: Path, *arguments: str, **variables: str) -> Iterator[Process]:
    with running([*PROGRAM, "ros", url, "--", *arguments], output, **variables) as process:
        yield process


@contextmanager
def client(output: Path, *words: str) -> Iterator[Process]:
    """Run a function of `tests.ros.clients`."""
    with running([sys.executable, "-m", "tests.ros.clients", *words], output) as process:
        yield process


def lines(output: Path) -> list[int]:
    """The numbers that a client has printed; a line that is not whole yet is left out."""
    text = output.read_text() if output.exists() else ""
    return [int(line) for line in text.rpartition("\n")[0].split("\n") if line.isdigit()]


def wait_for_lines(output: Path, most: int) -> None:
    """Wait until a client has printed so many numbers."""
    wait_for(lambda: len(lines(output)) >= most)


def ros2(*words: str) -> str:
    """Run the program `ros2`, and return what it says."""
    command = ["ros2", *words]
    done = subprocess.run(
        command, env=environment(), capture_output=True, text=True, timeout=PATIENCE, check=True
    )
    return done.stdout.strip()


def ended(process: Process, number: signal.Signals = signal.SIGTERM) -> int:
    """End a process by a signal, and return its exit code."""
    process.send_signal(number)
    return process.wait(PATIENCE)

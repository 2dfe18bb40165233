"""The patrol runs on every backend: each robot's arrivals are its own revisions."""

from __future__ import annotations

from tests.support.processes.commands import run_example


def test_robots_patrol_at_once(url: str) -> None:
    done = run_example("asyncio_patrol.py", url)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    for robot in ("rb1", "rb2", "rb3"):
        arrivals = [line for line in lines if line.startswith(f"{robot} ")]
        assert arrivals == [f"{robot} arrived at {place}" for place in ("hall", "kitchen", "dock")]
        assert f"(at {robot} dock)" in lines
    assert lines[-1] == "revision 12"

"""The tests run the same in the background, where a shell has some signals ignored."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from tests.support.processes.commands import child
from tests.support.processes.workers import STOPPING

pytestmark = pytest.mark.more

SHOW = "import signal; print([number for number in range(1, 32) if signal.getsignal(number) == 1])"


def test_a_child_ignores_no_signal_that_stops_it() -> None:
    """This runs in the child, too, that the next test starts with these signals ignored."""
    done = child("-c", SHOW, program=[sys.executable])
    assert done.returncode == 0, done.stderr
    # Python itself ignores SIGPIPE and SIGXFSZ.
    assert not {str(int(number)) for number in STOPPING} & set(
        done.stdout.strip("[]\n").split(", ")
    )


def test_ignored_signals_are_not_passed_on_to_children() -> None:
    program = (
        "import os, signal, sys\n"
        f"for number in {[int(number) for number in STOPPING]}:\n"
        "    signal.signal(number, signal.SIG_IGN)\n"
        "os.execv(sys.executable, [sys.executable, '-m', 'pytest', *sys.argv[1:]])\n"
    )
    here = f"{Path(__file__)}::{test_a_child_ignores_no_signal_that_stops_it.__name__}"
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    done = child("-c", program, *options, here, program=[sys.executable], timeout=120)
    assert done.returncode == 0, done.stdout
    assert "1 passed" in done.stdout
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_IGN

"""One listener for all watchers of a process: what ends it reaches each of them, once."""

from __future__ import annotations

import logging
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from kant_sql.sql.dialects.postgresql_sharing import (
    POLL_PAUSE,
    CannotListenError,
    Ears,
    SharedListener,
)
from tests.support.processes.workers import PATIENCE


def deaf() -> object:
    raise CannotListenError("on the moon")


def lost() -> object:
    raise ConnectionError("gone")


def test_a_listener_that_ends_at_once_keeps_nobody_waiting(
    caplog: pytest.LogCaptureFixture,
) -> None:
    # The thread often ends before the one that has started it goes on.
    ears = Ears(deaf)
    listeners = [SharedListener(ears, "here", RuntimeError) for _ in range(50)]
    with ThreadPoolExecutor(len(listeners)) as pool:
        for call in [pool.submit(each.wait, 1, PATIENCE) for each in listeners]:
            assert call.result(PATIENCE / 4) is None
    assert caplog.text.count("LISTEN is not possible on the moon") == 1
    before = time.monotonic()
    with caplog.at_level(logging.WARNING):
        caplog.clear()
        listeners[0].wait(1, PATIENCE)
    assert time.monotonic() - before >= POLL_PAUSE
    assert caplog.text == ""
    ears.close()


def test_the_error_of_a_listener_is_raised_by_each_call() -> None:
    ears = Ears(lost)
    listener = SharedListener(ears, "here", lambda error: RuntimeError(f"translated: {error}"))
    started = time.monotonic()
    for _ in range(200):
        with pytest.raises(RuntimeError, match="translated: gone"):
            listener.wait(1, PATIENCE)
    assert time.monotonic() - started < PATIENCE
    ears.close()

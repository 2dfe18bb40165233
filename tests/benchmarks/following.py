"""What readers of live pages cost a writer: 50 of them, on one knowledge base.

    python -m tests.benchmarks.following [--readers 50] [--backend sqlite]

Three processes: one writes revisions, one is `kant-sql serve`, one has the readers' connections.
The latter two are stopped and go on in turn, every half second, so that what else the machine does
disturbs both sides alike; the table has the median of all windows. A paced writer makes 100
revisions in a second, which is busy for a robot; the other makes them as fast as it can. Aim: 5 %
at most. The server's share of a processor bounds what it can cost a writer with which it has to
share the last core.
"""

from __future__ import annotations

import selectors
import socket
import sys
import tempfile
import time
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import cycle
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import fmean, median
from typing import NamedTuple
from urllib.parse import urlsplit

import psutil

import kant_sql
from tests.benchmarks.support import print_table, read_options, stores
from tests.support.browsing import Serving
from tests.support.processes.workers import PROCESSES
from tests.support.worlds.robots import robot_at

READERS, WINDOWS = 50, 40
PACE = 0.01
# Seconds of a window, and at its beginning those that do not count.
WINDOW, TURN = 0.5, 0.05
WRITERS = {"paced": PACE, "flat out": 0.0}


class Write(NamedTuple):
    """A write.

    Attributes:
        began: when, on the clock that all processes share.
        took: how long it took, in seconds.
    """

    began: float
    took: float


def write(url: str, pace: float, say: Connection) -> None:
    """Write revisions until told to end; send how long each took."""
    with kant_sql.connect(url, knowledge_base="robot", actor="writer") as kb:
        say.send("ready")
        writes = [*_writes(kb, pace, say)]
    say.send(writes)


def _writes(kb: kant_sql.KnowledgeBase, pace: float, say: Connection) -> Iterator[Write]:
    fact, due = robot_at(), time.monotonic()
    kb.propositions.save(fact)
    for change in cycle((kb.propositions.delete, kb.propositions.save)):
        if say.poll():
            return
        began = time.monotonic()
        assert change(fact)
        yield Write(began, time.monotonic() - began)
        due += pace
        if pace:
            time.sleep(max(0.0, due - time.monotonic()))


def read(address: str, readers: int, say: Connection) -> None:
    """Follow live changes on many connections until asked for how many events came."""
    parts = urlsplit(address)
    request = f"GET /live?kb=robot HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode()
    events, is_ready = 0, False
    with ExitStack() as stack:
        waiting = stack.enter_context(selectors.DefaultSelector())
        for _ in range(readers):
            made = socket.create_connection((parts.hostname or "", parts.port or 80))
            stack.enter_context(made).sendall(request)
            waiting.register(made, selectors.EVENT_READ)
        waiting.register(say, selectors.EVENT_READ)
        while True:
            for key, _ in waiting.select():
                if key.fileobj is say:
                    say.send(events)
                    return
                events += key.fileobj.recv(65_536).count(b"event: ")  # type: ignore[union-attr]
            if events >= readers and not is_ready:
                # All are connected: each has the revision that was there.
                is_ready = True
                say.send(events)


@contextmanager
def following(url: str, readers: int) -> Iterator[tuple[psutil.Process, psutil.Process]]:
    """Let readers follow a knowledge base; give the processes of the server and the readers."""
    with tempfile.TemporaryDirectory() as folder:
        served = Serving(url, Path(folder))
        here, there = PROCESSES.Pipe()
        process = PROCESSES.Process(target=read, args=(served.address, readers, there))
        process.start()
        try:
            assert here.poll(20)
            here.recv()
            yield _server(served.address), psutil.Process(process.pid)
            here.send("how many?")
            assert here.poll(20)
            assert here.recv() > readers, "the readers were told of nothing"
        finally:
            process.kill()
            process.join()
            served.stop()


def _server(address: str) -> psutil.Process:
    port = urlsplit(address).port
    listening = (
        each.pid
        for each in psutil.net_connections("tcp")
        if each.status == psutil.CONN_LISTEN and each.laddr.port == port and each.pid is not None
    )
    return psutil.Process(next(listening))


class Compared(NamedTuple):
    """What was measured of a writer.

    Attributes:
        alone: the time of a write while nobody follows, in seconds.
        followed: its time with readers.
        share: of a processor, what the server takes meanwhile.
    """

    alone: float
    followed: float
    share: float


def compare(url: str, readers: int, pace: float, windows: int) -> Compared:
    """Let a process write, with readers in every other window."""
    here, there = PROCESSES.Pipe()
    process = PROCESSES.Process(target=write, args=(url, pace, there))
    begins: list[float] = []
    with following(url, readers) as others:
        used = -sum(others[0].cpu_times()[:2])
        process.start()
        assert here.poll(60)
        here.recv()
        for number in range(2 * windows):
            for each in others:
                each.suspend() if number % 2 else each.resume()
            begins.append(time.monotonic())
            time.sleep(WINDOW)
        for each in others:
            each.resume()
        used += sum(others[0].cpu_times()[:2])
        here.send("enough")
        assert here.poll(60)
        writes: list[Write] = here.recv()
        process.join()
    sides = [_means(writes, begins[side::2]) for side in (1, 0)]
    return Compared(median(sides[0]), median(sides[1]), used / (windows * WINDOW))


def _means(writes: Sequence[Write], begins: Sequence[float]) -> list[float]:
    """Return the mean time of the writes in each window."""
    found = []
    for begin in begins:
        low = bisect_left(writes, begin + TURN, key=lambda one: one.began)
        high = bisect_left(writes, begin + WINDOW - TURN, key=lambda one: one.began)
        if low < high:
            found.append(fmean(one.took for one in writes[low:high]))
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print a table."""
    given = read_options(__doc__, argv, readers=READERS, windows=WINDOWS)
    rows: list[Sequence[str]] = []
    with stores(given.backend) as made:
        for backend, new in made.items():
            url = new()
            with kant_sql.connect(url, knowledge_base="robot", actor="writer") as kb:
                kb.propositions.save(robot_at())
            for writer, pace in WRITERS.items():
                found = compare(url, given.readers, pace, given.windows)
                times = [f"{took * 1e6:.0f} us" for took in (found.alone, found.followed)]
                slower = f"{100 * (found.followed / found.alone - 1):+.1f} %"
                share = f"{100 * found.share:.1f} % of a core"
                rows.append((f"{backend}, {writer}", *times, slower, share))
    header = ("writer", "alone", f"{given.readers} readers", "slower", "server")
    print_table("a write, alone and with readers of live pages", header, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())

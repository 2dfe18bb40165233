"""What readers of live pages cost a writer: 50 of them, on one knowledge base.

    python -m tests.benchmarks.following [--readers 50] [--backend sqlite]

Three processes: one writes revisions, one is `kant-sql serve`, one has the readers' connections.
Rounds alternate with rounds in which the writer is alone, without a server; the table has the best
round of each, for other programs only slow a round down.
A paced writer makes 100 revisions in a second, which is busy for a robot; the other makes them as
fast as it can. Aim: 5 % at most. The server's share of a processor bounds what it can cost a
writer with which it has to share the last core.
"""

from __future__ import annotations

import argparse
import selectors
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import fmean, median
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import psutil

import kant_sql
from kant_sql import PddlPropositionDto
from tests.benchmarks.support import print_table, stores
from tests.support.browsing import Serving
from tests.support.processes.workers import PROCESSES
from tests.support.worlds.robots import robot_at

READERS, ROUNDS = 50, 5
PACE = 0.01
SECONDS = 4.0
WARM_UP = 50


class Written(NamedTuple):
    """What a writer measured.

    Attributes:
        paced: the median time of a write, in seconds, of a writer that makes 100 in a second.
        flat_out: the mean time of a write of a writer that does not wait.
    """

    paced: float
    flat_out: float


def write(url: str, seconds: float, say: Connection) -> None:
    """Write revisions, first at a pace and then without; send the times."""
    with kant_sql.connect(url, knowledge_base="robot", actor="writer") as kb:
        fact = robot_at()
        for _ in range(WARM_UP):
            _toggle(kb, fact)
        paced, flat_out = ([*_times(kb, fact, pace, seconds)] for pace in (PACE, 0.0))
        say.send(Written(median(paced), fmean(flat_out)))


def _toggle(kb: kant_sql.KnowledgeBase, fact: PddlPropositionDto) -> None:
    if not kb.propositions.save(fact):
        kb.propositions.delete(fact)


def _times(
    kb: kant_sql.KnowledgeBase, fact: PddlPropositionDto, pace: float, seconds: float
) -> Iterator[float]:
    due = time.perf_counter()
    end, is_there = due + seconds, False
    change = {False: kb.propositions.save, True: kb.propositions.delete}
    kb.propositions.delete(fact)
    while (started := time.perf_counter()) < end:
        change[is_there](fact)
        is_there = not is_there
        yield time.perf_counter() - started
        due += pace
        time.sleep(max(0.0, due - time.perf_counter()) if pace else 0)


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
def following(url: str, readers: int, shares: list[float]) -> Iterator[None]:
    """Let readers follow a knowledge base; note the server's share of a processor meanwhile."""
    with tempfile.TemporaryDirectory() as folder:
        served = Serving(url, Path(folder))
        here, there = PROCESSES.Pipe()
        process = PROCESSES.Process(target=read, args=(served.address, readers, there))
        process.start()
        try:
            assert here.poll(20)
            here.recv()
            server = _server(served.address)
            before, started = sum(server.cpu_times()[:2]), time.perf_counter()
            yield
            used = sum(server.cpu_times()[:2]) - before
            shares.append(used / (time.perf_counter() - started))
            here.send("how many?")
            assert here.poll(10)
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


def measure(url: str, seconds: float) -> Written:
    """Let a process write."""
    here, there = PROCESSES.Pipe()
    process = PROCESSES.Process(target=write, args=(url, seconds, there))
    process.start()
    assert here.poll(60 + 4 * seconds)
    written: Written = here.recv()
    process.join()
    return written


def compare(url: str, readers: int, rounds: int, seconds: float) -> tuple[Written, Written, float]:
    """Measure a writer alone and with readers, in turn, and the server's share of a processor."""
    with kant_sql.connect(url, knowledge_base="robot", actor="writer") as kb:
        kb.propositions.save(robot_at())
    alone, followed = [], []
    shares: list[float] = []
    for number in range(rounds):
        for is_followed in (False, True) if number % 2 else (True, False):
            if is_followed:
                with following(url, readers, shares):
                    followed.append(measure(url, seconds))
            else:
                alone.append(measure(url, seconds))
    return _best(alone), _best(followed), median(shares)


def _best(measured: Sequence[Written]) -> Written:
    return Written(*(min(column) for column in zip(*measured, strict=True)))


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--readers", type=int, default=READERS)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--backend", action="append", choices=("sqlite", "postgresql"))
    given = parser.parse_args(argv)
    rows: list[Any] = []
    with stores(given.backend or ("sqlite", "postgresql")) as made:
        for backend, new in made.items():
            alone, followed, share = compare(new(), given.readers, given.rounds, given.seconds)
            for writer in Written._fields:
                before, after = getattr(alone, writer), getattr(followed, writer)
                slower = f"{100 * (after / before - 1):+.1f} %"
                shown = [f"{took * 1e6:.0f} us" for took in (before, after)]
                rows.append((backend, writer, *shown, slower))
            rows.append((backend, "server", "", f"{100 * share:.1f} % of a core"))
    header = ("backend", "writer", "alone", f"{given.readers} readers", "slower")
    print_table("a write, alone and with readers of live pages", header, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())

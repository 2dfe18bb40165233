"""What a change costs: bytes and CPU, in a robot's file and on a server, and what a fleet needs.

    python -m tests.benchmarks.sizing [--revisions N] [--backend sqlite]

A robot moves between 40 places (half of the revisions), puts 20 things elsewhere (a fifth),
opens and closes 10 doors (a tenth) and sees its battery change (a fifth). Each revision retracts a
fact or value and asserts another: two changes. For the lines `new`, each fact is of an object that
was never seen before. All numbers are slopes: from a third of the revisions on, so that what a
store is from the start, and each fact when it is first seen, does not count.
"""

from __future__ import annotations

import os
import resource
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import NamedTuple

from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from tests.benchmarks.drivers import bare
from tests.benchmarks.support import BACKENDS, print_table, read_options
from tests.benchmarks.years import DOMAIN
from tests.support.servers import Server

REVISIONS = 6_000
# Autovacuum cleans a table when a fifth of it is dead: about so often here.
PARTS = 12
PLACES, THINGS, DOORS = 40, 20, 10
THING, WP = PddlTypeDto("thing"), PddlTypeDto("wp")
THING_AT = PddlPredicateDto("thing_at", [THING, WP])
# Revisions that a robot pushes at once.
BATCH = 60
PUSHED = "pushed to postgresql"
# A robot at work: changes in a second, hours in a day.
RATES = (0.1, 1.0, 10.0)
HOURS, DAYS = 8, 5 * 365
FLEETS = (10, 1_000, 100_000)


class Spent(NamedTuple):
    """What was used up to a moment."""

    disk: float  # bytes that the store takes
    log: float  # bytes that the server wrote to its log, and sends to a standby
    client: float  # seconds of CPU of this process
    server: float  # seconds of CPU of the server's processes

    def per(self, before: Spent, changes: int) -> Spent:
        """Give what each of some changes has used since."""
        return Spent(*((now - then) / changes for now, then in zip(self, before, strict=True)))


class Place:
    """A store, and what it uses."""

    def __init__(self, name: str, url: str, server: Server | None) -> None:
        self.name = name
        self.url = url
        self._server = server

    def spent(self) -> Spent:
        cpu = self._cpu()
        store = bare(self.url)
        if self._server is None:
            store.settle()
            disk, log = os.path.getsize(str(make_url(self.url).database)), 0
        else:
            store.execute("CHECKPOINT")
            ((disk,),) = store.execute("SELECT pg_database_size(current_database())")
            ((log,),) = store.execute("SELECT pg_current_wal_lsn() - '0/0'")
        store.close()
        return Spent(disk, float(log), own_cpu(), cpu)

    def clean(self) -> None:
        """Do what autovacuum does in time."""
        if self._server is not None:
            store = bare(self.url)
            store.execute("VACUUM")
            store.close()

    def _cpu(self) -> float:
        if self._server is None:
            return 0.0
        postmaster = self._server._server.get_postmaster_info().process
        times = postmaster.cpu_times()
        # What ended counts for its parent.
        ended = times.children_user + times.children_system
        living = [process.cpu_times() for process in postmaster.children(recursive=True)]
        return float(ended + sum(each.user + each.system for each in (times, *living)))


@contextmanager
def places(names: Sequence[str]) -> Iterator[list[Place]]:
    """Make an empty store on each backend, on disk and durable."""
    with tempfile.TemporaryDirectory(prefix="kantbench") as folder:
        found = []
        server = Server(Path(folder, "pg"), fsync=True) if "postgresql" in names else None
        if "sqlite" in names:
            found.append(Place("sqlite", f"sqlite:///{folder}/robot.db", None))
        if server is not None:
            url = server.new_database()
            kant_sql.upgrade(url)
            found.append(Place("postgresql", url, server))
        yield found
        if server is not None:
            server._server.cleanup()


class Work:
    """A robot at work; it goes on from where it stopped."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self._kb = kb
        self._random = Random(1)
        self._held: dict[str, str] = {}
        self._seen = 0
        counts = {"robot": 1, "wp": PLACES, "thing": THINGS, "door": DOORS}
        kb.load_domain(DOMAIN)
        objects = (f"{kind}{n} - {kind}" for kind, count in counts.items() for n in range(count))
        kb.load_problem(f"(define (problem p) (:domain fleet) (:objects {' '.join(objects)}))")

    def write(self, revisions: int) -> None:
        """Write so many revisions of what is known."""
        for _ in range(revisions):
            sort = self._random.randrange(10)
            if sort < 5:
                self._swap("robot0", f"(robot_at robot0 {self._any('wp', PLACES)})")
            elif sort < 7:
                thing = self._any("thing", THINGS)
                self._swap(thing, f"(thing_at {thing} {self._any('wp', PLACES)})")
            elif sort < 8:
                door = self._any("door", DOORS)
                is_open = self._held.get(door) == f"(door_open {door})"
                self._swap(door, f"(door_{'closed' if is_open else 'open'} {door})")
            else:
                level = self._random.randrange(10_000) / 100
                with self._kb.transaction(actor="perception"):
                    self._kb.function_values.save(f"(= (level robot0) {level})")

    def write_new(self, revisions: int) -> None:
        """Write so many revisions, each of an object that was never seen."""
        for _ in range(revisions):
            self._seen += 1
            thing = PddlObjectDto(THING, f"seen{self._seen}")
            place = PddlObjectDto(WP, self._any("wp", PLACES))
            with self._kb.transaction(actor="perception"):
                self._kb.propositions.save(PddlPropositionDto(THING_AT, [thing, place]))

    def _any(self, kind: str, count: int) -> str:
        return f"{kind}{self._random.randrange(count)}"

    def _swap(self, subject: str, fact: str) -> None:
        with self._kb.transaction(actor="executive"):
            if subject in self._held:
                self._kb.propositions.delete(self._held[subject])
            self._kb.propositions.save(fact)
        self._held[subject] = fact


def slope(place: Place, revisions: int, write: Callable[[int], object], changes: int) -> Spent:
    """Write, and give what each change took, of so many in a revision."""
    part = revisions // PARTS
    for number in range(PARTS):
        if number == PARTS // 3:
            before = place.spent()
        write(part)
        place.clean()
    return place.spent().per(before, changes * part * (PARTS - PARTS // 3))


def written(place: Place, revisions: int) -> Iterator[tuple[str, Spent]]:
    """Measure a robot that writes to the store itself."""
    with kant_sql.connect(place.url, knowledge_base="robot") as kb:
        work = Work(kb)
        yield f"written to {place.name}", slope(place, revisions, work.write, 2)
        # A fact, an object.
        yield f"new, written to {place.name}", slope(place, revisions, work.write_new, 2)


def pushed(place: Place, revisions: int) -> Spent:
    """Measure a robot that pushes from its file."""
    with (
        tempfile.TemporaryDirectory(prefix="kantbench") as folder,
        kant_sql.connect(f"sqlite:///{folder}/robot.db", knowledge_base="pushed") as kb,
    ):
        work = Work(kb)
        spent = 0.0

        def write(count: int) -> None:
            nonlocal spent
            for first in range(0, count, BATCH):
                work.write(min(BATCH, count - first))
                began = own_cpu()
                kb.store.push(place.url)
                spent += own_cpu() - began

        kb.store.push(place.url)
        found = slope(place, revisions, write, 2)
        # What writing the file takes is known already.
        return found._replace(client=spent / (2 * revisions))


def own_cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def size(bytes_: float) -> str:
    """Write a number of bytes in decimal units, to two digits."""
    for unit in ("B", "kB", "MB", "GB", "TB", "PB"):
        if bytes_ < 995 or unit == "PB":
            return f"{bytes_:.2g} {unit}" if bytes_ < 9.95 else f"{bytes_:.0f} {unit}"
        bytes_ /= 1000
    raise AssertionError


def cores(seconds: float) -> str:
    """Write how many cores are busy for so many seconds of each second."""
    if seconds < 0.995:
        return f"{100 * seconds:.2g} % of a core"
    return f"{seconds:.2g} cores" if seconds < 99.5 else f"{round(seconds):,} cores"


def needs(spent: Spent) -> Iterator[list[str]]:
    """Compute the disk, and the cores at work, that fleets take of a server, for each rate."""
    for robots in FLEETS:
        rates = [rate * robots for rate in RATES]
        yield [
            f"{robots:,}",
            *(
                f"{size(rate * 3600 * HOURS * DAYS * spent.disk)}, {cores(rate * spent.server)}"
                for rate in rates
            ),
        ]


def columns(spent: Spent) -> list[str]:
    """Write what a change takes."""
    cpu = (f"{1e3 * each:.2f} ms" for each in (spent.client, spent.server))
    return [f"{spent.disk:.0f} B", f"{spent.log:.0f} B", *cpu]


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(__doc__, argv, revisions=REVISIONS)
    found: dict[str, Spent] = {}
    with places(options.backend or BACKENDS) as there:
        for place in there:
            found |= dict(written(place, options.revisions))
            if place.name == "postgresql":
                found[PUSHED] = pushed(place, options.revisions)
    print_table(
        "What a change takes",
        ["", "on disk", "log", "CPU of the client", "CPU of the server"],
        [[name, *columns(each)] for name, each in found.items()],
    )
    if PUSHED in found:
        print_table(
            f"A server in five years of {HOURS} hours a day, without replicas",
            ["robots", *(f"{rate:g} changes/s each" for rate in RATES)],
            needs(found[PUSHED]),
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

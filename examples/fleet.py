"""A fleet for an hour: robots with their own files, often offline, and one server for all.

python examples/fleet.py [URL] [--robots 1000] [--minutes 60] [--kills 5] [--workers 2] [--seed 1]

Time is simulated: an hour takes a minute or two. Each robot writes its acts to its own SQLite file.
While it is online, it pushes to the server; when it comes back, it pushes what it missed. Few
processes play many robots, and some are killed while they push. In the end, anchors and
verification show that each history on the server is the robot's.

Without a URL, the server is an SQLite file. On PostgreSQL, create the tables first: `kant-sql db
upgrade URL`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from multiprocessing.connection import Connection, wait
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import kant_sql
from kant_sql import KnowledgeBase

DOMAIN = """
(define (domain hospital)
  (:requirements :strips :typing :numeric-fluents)
  (:types robot place box)
  (:predicates (robot_at ?r - robot ?p - place) (box_at ?b - box ?p - place)
               (holding ?r - robot ?b - box))
  (:functions (battery ?r - robot)))
"""
PLACES = ("dock", "pharmacy", "laboratory", "kitchen", "ward1", "ward2", "ward3")
BOXES = ("box1", "box2", "box3")
MORNING = datetime(2026, 3, 2, 8, tzinfo=UTC)
# Robots that a process plays at once: each has its file and a connection to the server open.
CREW = 20
# Minutes that a robot stays online or offline.
SPELL = 10


class Fleet(NamedTuple):
    """The simulation.

    Attributes:
        url: the server.
        folder: where the robots' files are.
        minutes: its length.
        seed: the seed of its events.
    """

    url: str
    folder: Path
    minutes: int
    seed: int

    @property
    def spells(self) -> int:
        """How many spells there are."""
        return -(-self.minutes // SPELL)

    def open(self, name: str, **options: Any) -> KnowledgeBase:
        """Open a robot's own file."""
        url = f"sqlite:///{self.folder / name}.db"
        return kant_sql.connect(url, knowledge_base=name, actor="executive", **options)


class Step(NamedTuple):
    """A step of a robot, with the facts that end and begin."""

    moment: datetime
    reason: str
    ends: tuple[str, ...]
    begins: tuple[str, ...]
    battery: int


# A robot.


def problem(name: str) -> str:
    """Write the robot's initial knowledge."""
    boxes = " ".join(f"(box_at {box} pharmacy)" for box in BOXES)
    return f"""
(define (problem morning) (:domain hospital)
  (:objects {name} - robot {" ".join(PLACES)} - place {" ".join(BOXES)} - box)
  (:init (robot_at {name} dock) {boxes} (= (battery {name}) 100)))
"""


def steps(fleet: Fleet, name: str) -> Iterator[Step]:
    """Yield the robot's steps: it carries boxes from place to place."""
    random = Random(f"{fleet.seed} {name[-4:]}")
    moment, end = MORNING, MORNING + timedelta(minutes=fleet.minutes)
    place, battery = "dock", 100
    box_places = dict.fromkeys(BOXES, "pharmacy")
    while True:
        box = random.choice(BOXES)
        goal = random.choice([each for each in PLACES if each != box_places[box]])
        held, lying, lies = f"(holding {name} {box})", f"(box_at {box} {box_places[box]})", ""
        lies = f"(box_at {box} {goal})"
        here, there, then = (f"(robot_at {name} {each})" for each in (place, box_places[box], goal))
        tour = (
            (f"to fetch {box}", (here,), (there,)),
            (f"fetches {box}", (lying,), (held,)),
            (f"carries {box} to {goal}", (there,), (then,)),
            (f"puts {box} down", (held,), (lies,)),
        )
        for reason, ends, begins in tour:
            moment += timedelta(seconds=random.randint(40, 240))
            if moment >= end:
                return
            battery = battery - 1 if battery > 20 else 100
            yield Step(moment, reason, ends, begins, battery)
        place = box_places[box] = goal


def is_online(fleet: Fleet, name: str, spell: int) -> bool:
    """Whether a robot has a connection: always at first, and in the end."""
    drawn = Random(f"{fleet.seed} {name[-4:]} {spell}").random()
    return spell in (0, fleet.spells) or drawn < 0.55


class Robot(NamedTuple):
    """A robot, with its own file open.

    Attributes:
        fleet: its fleet.
        name: of the robot, and of its knowledge base.
        kb: its knowledge base.
        tell: where to report pushes.
    """

    fleet: Fleet
    name: str
    kb: KnowledgeBase
    tell: Connection

    def begin(self) -> None:
        """Load its initial knowledge, unless its file has it."""
        if self.kb.revision == 0:
            self.kb.load_domain(DOMAIN)
        if self.kb.revision == 1:
            with self.kb.transaction(observed_at=MORNING):
                self.kb.load_problem(problem(self.name))

    def live(self, spell: int) -> None:
        """Execute the steps of one spell, except those in its file."""
        start = MORNING + timedelta(minutes=SPELL * spell)
        [last] = self.kb.store.revisions(after=self.kb.revision - 1)
        online = is_online(self.fleet, self.name, spell)
        for step in steps(self.fleet, self.name):
            if start <= step.moment < start + timedelta(minutes=SPELL):
                if last.observed_at is None or step.moment > last.observed_at:
                    self.act(step)
                if online and step.reason.startswith("puts"):
                    self.push()
        if online:
            self.push()

    def act(self, step: Step) -> None:
        """Write a step, as one revision."""
        with self.kb.transaction(reason=step.reason, observed_at=step.moment):
            for fact in step.ends:
                self.kb.propositions.delete(fact)
            for fact in step.begins:
                self.kb.propositions.save(fact)
            self.kb.function_values.save(f"(= (battery {self.name}) {step.battery})")

    def push(self) -> None:
        """Push missing revisions to the server, and report before and after."""
        self.tell.send(("pushes", 0))
        pushed = self.kb.store.push(self.fleet.url)
        self.tell.send(("pushed", pushed.versions))


# A process, which plays many robots.


def play(fleet: Fleet, crews: Sequence[Sequence[str]], tell: Connection) -> None:
    """Play robots, some at a time, from the morning until the time is over."""
    for crew in crews:
        with ExitStack() as stack:
            robots = [
                Robot(fleet, name, stack.enter_context(fleet.open(name)), tell) for name in crew
            ]
            for robot in robots:
                robot.begin()
            for spell in range(fleet.spells + 1):
                for robot in robots:
                    robot.live(spell)
        tell.send(("home", 0))


class Player:
    """A process, which is replaced when killed."""

    def __init__(self, fleet: Fleet, names: Sequence[str]) -> None:
        self._fleet = fleet
        self.crews = [names[start : start + CREW] for start in range(0, len(names), CREW)]
        self.start()

    def start(self) -> None:
        """Start it with the unfinished robots."""
        context = multiprocessing.get_context("spawn")
        self.told, tell = context.Pipe(duplex=False)
        self.process = context.Process(target=play, args=(self._fleet, self.crews, tell))
        self.process.start()
        tell.close()

    def kill(self) -> None:
        """Kill it at any moment, and start another one."""
        self.process.kill()
        self.process.join()
        self.told.close()
        self.start()


def run(fleet: Fleet, names: Sequence[str], workers: int, kills: int) -> Counter[str]:
    """Play all robots, and kill some processes while they push; count their reports."""
    random = Random(fleet.seed)
    # Each robot pushes twice at least.
    numbers = {*random.sample(range(2 * len(names)), min(kills, len(names)))}
    players = [Player(fleet, names[number::workers]) for number in range(workers)]
    counts = Counter[str]()
    while waiting := {player.told: player for player in players if player.crews}:
        for told in wait([*waiting]):
            player = waiting[told]  # type: ignore[index]
            try:
                what, number = player.told.recv()
            except EOFError:
                raise SystemExit(f"a process ended with {player.process.exitcode}") from None
            if what == "home":
                player.crews = player.crews[1:]
            counts[what] += 1
            counts["changes"] += number
            if what == "pushes" and counts[what] - 1 in numbers:
                time.sleep(random.uniform(0, 0.01))
                player.kill()
                counts["kills"] += 1
    for player in players:
        player.process.join()
    return counts


# The end.


def compare(fleet: Fleet, names: Sequence[str]) -> tuple[int, int, list[str]]:
    """Compare robots with the server: numbers of revisions and bytes, and differences."""
    revisions, size, wrong = 0, 0, []
    with kant_sql.open_store(fleet.url, read_only=True) as server:
        for name in names:
            with fleet.open(name, read_only=True) as robot:
                anchor = robot.store.anchor()
                kept = server.knowledge_base(name)
                [head] = anchor.heads
                found = kept.store.revisions(after=head.revision - 1)
                same = [(each.number, each.hash) for each in found] == [(head.revision, head.hash)]
                # All share the schema: check it once.
                if not (same and kept.store.verify(structure=name == names[0]).is_intact):
                    wrong.append(name)
                revisions += head.revision
            size += (fleet.folder / f"{name}.db").stat().st_size
    return revisions, size, wrong


def main(argv: Sequence[str] | None = None) -> int:
    """Simulate the fleet, and print the server's contents."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("url", nargs="?", help="the server; default: an SQLite file")
    for option, value in (("robots", 1000), ("minutes", 60), ("kills", 5), ("workers", 2)):
        parser.add_argument(f"--{option}", type=int, default=value)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="fleet") as place:
        folder = Path(place)
        url = options.url or f"sqlite:///{folder / 'server.db'}"
        fleet = Fleet(url, folder, options.minutes, options.seed)
        # A server may be reused: each run has its own robots.
        prefix = f"{datetime.now(UTC):%Y%m%d%H%M%S}"
        names = [f"robot_{prefix}_{number:04}" for number in range(options.robots)]
        prepare(fleet, names)
        began = time.monotonic()
        counts = run(fleet, names, options.workers, options.kills)
        played = time.monotonic()
        with ProcessPoolExecutor(options.workers) as pool:
            shares = [names[number :: options.workers] for number in range(options.workers)]
            compared = [*pool.map(compare, [fleet] * options.workers, shares)]
        return report(options, counts, compared, (played - began, time.monotonic() - played))


def prepare(fleet: Fleet, names: Sequence[str]) -> None:
    """Make empty stores: copying one is faster than making each."""
    kant_sql.connect(fleet.url, knowledge_base=names[0]).close()
    fleet.open(names[0]).close()
    first, *others = (fleet.folder / f"{name}.db" for name in names)
    for other in others:
        shutil.copy(first, other)


def report(
    options: argparse.Namespace,
    counts: Counter[str],
    compared: Sequence[tuple[int, int, list[str]]],
    seconds: tuple[float, float],
) -> int:
    """Print the numbers, and whether each history is the same."""
    revisions, size = (sum(each[number] for each in compared) for number in (0, 1))  # type: ignore[misc]
    wrong = [name for each in compared for name in each[2]]
    print(f"{options.robots:,} robots, {options.minutes} minutes, {seconds[0]:.1f} s")
    pushes, changes = counts["pushed"], counts["changes"]
    print(f"{revisions:,} revisions, {changes:,} changes sent in {pushes:,} pushes")
    print(f"{size:,} bytes in the robots' files")
    print(f"{counts['kills']} processes killed while they pushed")
    print(f"compared and verified in {seconds[1]:.1f} s")
    for name in wrong:
        print(f"{name}: its history on the server is not its own")
    if not wrong:
        print("every history on the server is its robot's")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

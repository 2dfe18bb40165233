"""A service robot in a coffee shop: several components share what the robot knows.

Its five tasks are timed as in the KANT paper (Gonzalez-Santamarta et al., 2022): reset (TtR), load
the initial PDDL (TtL), check the tables (TtC), serve the orders (TtS), guide the persons (TtG).
Then it queries the store: where was the robot at each moment, and who reported that?

    python examples/coffee_shop.py [URL] [--iterations N]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table
from sqlalchemy import create_engine, make_url, text

import kant_sql
from kant_sql_plugins.demo.coffee_shop_tasks import TASKS, Robot, connect_robot, load

KNOWLEDGE_BASE = "coffee_shop"
REPORT = Path("coffee_shop.html")

# Any SQL client can run this, without the library.
WHEREABOUTS = """\
SELECT atom.text, began.number, began.committed_at, ended.number, ended.committed_at,
       began.actor, began.reason
FROM proposition_version AS held
JOIN knowledge_base ON knowledge_base.id = held.kb_id
JOIN predicate ON predicate.kb_id = held.kb_id AND predicate.id = held.predicate_id
JOIN proposition AS atom ON atom.kb_id = held.kb_id AND atom.id = held.proposition_id
JOIN revision AS began ON began.kb_id = held.kb_id AND began.number = held.since
LEFT JOIN revision AS ended ON ended.kb_id = held.kb_id AND ended.number = held.until
WHERE knowledge_base.name = :knowledge_base AND predicate.key = 'robot_at'
  AND NOT atom.is_goal AND held.since > :start
ORDER BY held.since"""


def main(arguments: list[str] | None = None) -> int:
    """Run the example."""
    parser = argparse.ArgumentParser(description="A service robot in a coffee shop.")
    parser.add_argument("url", nargs="?", help="the store; a new SQLite file when not given")
    parser.add_argument("--iterations", type=positive, default=20, metavar="N")
    options = parser.parse_args(arguments)
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    try:
        run(options.url or new_file(), options.iterations, console)
    except kant_sql.KantSqlError as error:
        print(f"coffee_shop: {error}", file=sys.stderr)
        return 1
    return 0


def positive(value: str) -> int:
    """Parse the number of iterations."""
    number = int(value)
    if number < 1:
        raise ValueError
    return number


def new_file() -> str:
    """Choose a new SQLite file."""
    return f"sqlite:///{Path(tempfile.mkdtemp(prefix='kant_sql_')) / 'coffee_shop.db'}"


def connect(url: str) -> Robot:
    """Connect the robot's components."""
    robot = connect_robot(
        lambda component: kant_sql.connect(url, knowledge_base=KNOWLEDGE_BASE, actor=component)
    )
    if make_url(url).database in (None, "", ":memory:"):
        robot.close()
        raise kant_sql.errors.InvalidUrlError(
            f"{url}: each component connects by itself, and a store in memory is its connection's "
            "own; name a file or a server"
        )
    return robot


def run(url: str, iterations: int, console: Console) -> None:
    """Run the robot, then query what happened."""
    with closing(connect(url)) as robot:
        label = make_url(url).render_as_string()
        console.print(f"The robot's knowledge is in {label}", soft_wrap=True)
        load(robot)  # so that the first reset has something to delete
        seconds: dict[str, list[float]] = {name: [] for name in TASKS}
        start = 0
        for _ in progress(console, iterations):
            start = robot.mission.revision
            for name, took in timed_tasks(robot):
                seconds[name].append(took)
        end = robot.mission.revision
    console.print(time_table(seconds))
    console.print(f"The last iteration made revisions {start + 1} to {end}. Asked in plain SQL:\n")
    console.print(WHEREABOUTS, end="\n\n")
    rows = whereabouts(url, start)
    console.print(whereabouts_table(rows))
    console.print(f"Before revision {rows[0][1]} the robot knew nothing: it had been reset.")
    console.print(f"All that happened: kant-sql log '{label}'", soft_wrap=True)
    written = report(url, start + 1)
    if written is None:
        console.print(
            "Look at it in a browser: pip install 'kant-sql[web]', and then:", markup=False
        )
    else:
        console.print(f"A report of the last iteration is in {written}", soft_wrap=True)
    out = f"--since {start + 1} --out {written or REPORT}"
    console.print(f"In a browser: kant-sql serve '{label}'", soft_wrap=True)
    console.print(f"The report again: kant-sql report '{label}' {out}", soft_wrap=True)


def report(url: str, since: int) -> Path | None:
    """Write a report of the revisions since one beside the store; return None without `web`."""
    try:
        from kant_sql.web.report import write_report
    except ImportError:
        return None
    address = make_url(url)
    is_file = address.get_backend_name() == "sqlite"
    folder = (
        Path(address.database or "").parent
        if is_file
        else Path(tempfile.mkdtemp(prefix="kant_sql_"))
    )
    with kant_sql.connect(url, knowledge_base=KNOWLEDGE_BASE, read_only=True) as kb:
        return write_report(kb, folder / REPORT, since=since)


def progress(console: Console, iterations: int) -> Iterator[int]:
    """Count iterations and show progress: a bar, or lines if there is no terminal."""
    if console.is_terminal:
        yield from track(range(iterations), "Serving coffee ...", console=console)
        return
    for done in range(iterations):
        yield done
        if (done + 1) * 4 // iterations > done * 4 // iterations:
            console.print(f"iteration {done + 1} of {iterations}")


def timed_tasks(robot: Robot) -> Iterator[tuple[str, float]]:
    """Run the tasks of one iteration; return the seconds that each took."""
    for name, task in TASKS.items():
        start = time.perf_counter()
        task(robot)
        yield name, time.perf_counter() - start


def time_table(seconds: dict[str, list[float]]) -> Table:
    """Return the paper's table."""
    table = Table(box=box.SIMPLE, title="Time of each task in milliseconds", title_justify="left")
    table.add_column("")
    for heading in ("mean", "std dev", "min", "max", "sum"):
        table.add_column(heading, justify="right")
    rows = {**seconds, "total": [sum(tasks) for tasks in zip(*seconds.values(), strict=True)]}
    for name, values in rows.items():
        deviation = statistics.stdev(values) if len(values) > 1 else 0.0
        cells = (statistics.mean(values), deviation, min(values), max(values), sum(values))
        table.add_row(name, *(f"{1000 * cell:.2f}" for cell in cells))
    return table


def whereabouts(url: str, start: int) -> list[Any]:
    """Query where the robot was after a revision."""
    address = make_url(url)
    if address.get_backend_name() == "sqlite":
        address = address.set(query={})
    engine = create_engine(address)
    try:
        with engine.connect() as connection:
            parameters = {"knowledge_base": KNOWLEDGE_BASE, "start": start}
            return [*connection.execute(text(WHEREABOUTS), parameters)]
    finally:
        engine.dispose()


def whereabouts_table(rows: list[Any]) -> Table:
    """Return the table of where the robot was, when, and who reported it."""
    table = Table(box=box.SIMPLE, title="Where was the robot?", title_justify="left")
    for heading in ("from (UTC)", "to", "revisions", "fact", "put there by", "because"):
        table.add_column(heading, overflow="fold")
    for fact, since, began, until, ended, actor, reason in rows:
        revisions = f"{since} - {until or 'now'}"
        table.add_row(clock(began), clock(ended), revisions, fact, actor, reason or "-")
    return table


def clock(moment: str | datetime | None) -> str:
    """Format a time: text on SQLite, a datetime on PostgreSQL."""
    if moment is None:
        return "now"
    if isinstance(moment, str):
        moment = datetime.fromisoformat(moment)
    return f"{moment.astimezone(UTC):%H:%M:%S.%f}"[:-3]


if __name__ == "__main__":
    sys.exit(main())

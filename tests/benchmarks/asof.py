"""Questions to years of a fleet's past: how long they take, and how that grows.

    python -m tests.benchmarks.asof [--changes 5000000] [--small 50000] [--backend sqlite]

The stores have 10 knowledge bases; what is measured is asked of one of them, through the library
and through the bare driver by the best SQL by hand on the same tables. That starts from what the
library is given, and gives what is asked for, as rows: a fact's text is resolved by its names, a
version comes with who wrote both of its ends, when and why, a log in order and with its revisions.
It need not do what the library does for every store: it knows that only facts and values change
here, that names are spelled as they are stored, and that nothing was archived. Calls alternate; the
table has medians. Aims: each question about one point in at most twice the time of the SQL by
hand, and in less than 10 ms; a past state in a time that does not depend on how long ago it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime, timedelta
from statistics import median
from typing import Any

import kant_sql
from kant_sql.knowledge.canonical import time_text
from kant_sql.sql.intervals import forks_at
from tests.benchmarks.drivers import Driver, bare
from tests.benchmarks.support import alternate, print_table, read_options, stores
from tests.benchmarks.years import START, STEP, fill, ids_of

NAME = "robot5"
REPEAT = 31
AGES = {"lately": 0.99, "halfway": 0.5, "long ago": 0.01}
MOMENT = timedelta(microseconds=1)
Call = Callable[[], Any]
Make = Callable[[int], Call]

HELD = "fork IN ({forks}) AND since <= ? AND (until IS NULL OR until > ?)"
STATE = (
    "SELECT text FROM proposition WHERE kb_id = ? AND id IN (SELECT proposition_id"
    " FROM proposition_version WHERE kb_id = ? AND predicate_id IN ({predicates}) AND " + HELD + ")"
)
ENDS = (
    "SELECT v.{end}, {sign}, CASE WHEN v.is_goal THEN 'goal' ELSE 'fact' END, p.text"
    " FROM proposition_version v JOIN proposition p ON p.kb_id = v.kb_id"
    " AND p.id = v.proposition_id WHERE v.kb_id = ? AND v.{end} BETWEEN ? AND ?"
    " UNION ALL SELECT {end}, {sign}, 'value', text FROM function_value_version"
    " WHERE kb_id = ? AND {end} BETWEEN ? AND ?"
)
CHANGES = (
    ENDS.format(sign="'+'", end="since") + " UNION ALL " + ENDS.format(sign="'-'", end="until")
)
REVISIONS = (
    "SELECT number, committed_at, actor, reason, source, observed_at FROM revision"
    " WHERE kb_id = ? AND committed_at BETWEEN ? AND ? ORDER BY committed_at DESC, number DESC"
)
CAME = "since BETWEEN ? AND ? AND (until IS NULL OR until > ?)"
WENT = "until BETWEEN ? AND ? AND since <= ?"
FACTS = (
    "SELECT {change} AS change, CASE WHEN is_goal THEN 'goal' ELSE 'fact' END AS kind,"
    " (SELECT text FROM proposition WHERE kb_id = v.kb_id AND id = v.proposition_id) AS text"
    " FROM proposition_version v WHERE kb_id = ? AND {within}"
)
VALUES = "SELECT {change}, 'value', text FROM function_value_version v WHERE kb_id = ? AND {within}"
DIFFERENCE = (
    "SELECT sum(change), kind, text FROM ("
    + " UNION ALL ".join(
        part.format(change=change, within=within)
        for part in (FACTS, VALUES)
        for change, within in ((1, CAME), (-1, WENT))
    )
    + ") AS ends GROUP BY kind, text HAVING sum(change) <> 0 ORDER BY 1 DESC, 2, 3"
)
NAMED = "(SELECT id FROM {kind} WHERE kb_id = ? AND key = ?)"
VERSIONS = (
    "SELECT p.text, v.since, s.committed_at, s.actor, s.reason, s.source, s.observed_at,"
    " v.until, u.committed_at, u.actor, u.reason, u.source, u.observed_at"
    " FROM proposition p JOIN proposition_version v ON v.kb_id = p.kb_id"
    " AND v.proposition_id = p.id JOIN revision s ON s.kb_id = v.kb_id AND s.number = v.since"
    " LEFT JOIN revision u ON u.kb_id = v.kb_id AND u.number = v.until"
    # That all begin after 0 tells SQLite which index to take: else it goes through all versions.
    " WHERE p.kb_id = ? AND p.is_goal = false AND v.since > 0"
    f" AND p.predicate_id = {NAMED.format(kind='predicate')}"
    f" AND p.arguments = {NAMED.format(kind='object')} || ' ' || {NAMED.format(kind='object')}"
)


class ByHand:
    """The questions, as somebody asks them who writes the SQL for just this store."""

    def __init__(self, store: Driver) -> None:
        self.store = store
        ((self.kb,),) = store.execute("SELECT id FROM knowledge_base WHERE name = ?", (NAME,))
        self.ids = ids_of(store, self.kb)

    def state(self, at: int, *predicates: str) -> list[Any]:
        ids = [self.ids["predicate", name] for name in predicates]
        forks = ", ".join(map(str, forks_at(at)))
        sql = STATE.format(forks=forks, predicates=", ".join(map(str, ids)))
        return self.store.execute(sql, (self.kb, self.kb, at, at))

    def whole_state(self, at: int) -> list[Any]:
        names = [key for kind, key in self.ids if kind == "predicate"]
        return self.state(at, *names)

    def versions(self, text: str, only: str = "") -> list[Any]:
        names = text.strip("()").split()
        values = [value for name in names for value in (self.kb, name)]
        return self.store.execute(VERSIONS + only, (self.kb, *values))

    def log(self, since: str, until: str) -> list[Any]:
        revisions = self.store.execute(REVISIONS, (self.kb, since, until))
        values = (self.kb, revisions[-1][0], revisions[0][0])
        # In SQL, SQLite would take longer to sort them.
        return [revisions, sorted(self.store.execute(CHANGES, values * 4))]

    def difference(self, before: int, after: int) -> list[Any]:
        came = (self.kb, before + 1, after, after)
        went = (self.kb, before + 1, after, before)
        return self.store.execute(DIFFERENCE, (came + went) * 2)


class Questions:
    """The questions; the n-th time that one is asked, it is about another moment or element."""

    def __init__(self, kb: kant_sql.KnowledgeBase, hand: ByHand, last: int) -> None:
        self.kb = kb
        self.hand = hand
        self.last = last
        self.held = [str(row[0]) for row in hand.state(last, "robot_at")]

    def all(self) -> Iterator[tuple[str, Make, Make]]:
        """Give name, and what answers: the library, and the SQL by hand."""
        for name, answers in (("one predicate", self.predicate), ("everything", self.everything)):
            for age, part in AGES.items():
                yield f"state of {name}, {age}", *answers(max(int(self.last * part), REPEAT))
        yield "history of one fact", self.history, self.history_by_hand
        yield "blame of one fact", self.blame, self.blame_by_hand
        yield "changes between two times, 100 revisions", self.log, self.log_by_hand
        yield "difference of states, 100 revisions apart", self.diff, self.diff_by_hand

    def predicate(self, at: int) -> tuple[Make, Make]:
        return (
            lambda n: lambda: self.kb.at(at - n).propositions.get_by_predicate("robot_at"),
            lambda n: lambda: self.hand.state(at - n, "robot_at"),
        )

    def everything(self, at: int) -> tuple[Make, Make]:
        return (
            lambda n: lambda: [*self.kb.at(at - n).propositions.get_all()],
            lambda n: lambda: self.hand.whole_state(at - n),
        )

    def history(self, n: int) -> Call:
        text = self.held[n % len(self.held)]
        return lambda: self.kb.history(text)

    def history_by_hand(self, n: int) -> Call:
        text = self.held[n % len(self.held)]
        return lambda: self.hand.versions(text)

    def blame(self, n: int) -> Call:
        text = self.held[n % len(self.held)]
        return lambda: self.kb.blame(text)

    def blame_by_hand(self, n: int) -> Call:
        text = self.held[n % len(self.held)]
        return lambda: self.hand.versions(text, " AND v.until IS NULL")

    def window(self, n: int) -> tuple[datetime, datetime]:
        """A time, and another 100 revisions later."""
        since = START + (self.last // 2 + 10 * n) * STEP
        return since + MOMENT, since + 100 * STEP

    def log(self, n: int) -> Call:
        since, until = self.window(n)
        return lambda: list(self.kb.log(since, until=until))

    def log_by_hand(self, n: int) -> Call:
        since, until = map(time_text, self.window(n))
        return lambda: self.hand.log(since, until)

    def diff(self, n: int) -> Call:
        first = self.last // 2 + 10 * n
        return lambda: self.kb.diff(first, first + 100)

    def diff_by_hand(self, n: int) -> Call:
        first = self.last // 2 + 10 * n
        return lambda: self.hand.difference(first, first + 100)


def measure(url: str, last: int) -> Iterator[tuple[str, float, float]]:
    """Give each question with the seconds of the library and of the SQL by hand."""
    store = bare(url)
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        for name, library, by_hand in Questions(kb, ByHand(store), last).all():
            library(0)(), by_hand(0)()
            taken = alternate(REPEAT, library, by_hand)
            yield name, median(taken[0]), median(taken[1])
    store.close()


def run(backend: str, new: Callable[[], str], sizes: Sequence[int]) -> None:
    found: dict[str, list[tuple[float, float]]] = {}
    for changes in sizes:
        url = new()
        last = fill(url, changes)
        for name, library, by_hand in measure(url, last):
            found.setdefault(name, []).append((library, by_hand))
    header = [f"{backend}, ms"]
    for changes in sizes:
        header += [f"{changes:,} changes", "by hand", "ratio"]
    rows = []
    for name, times in found.items():
        row = [name]
        for library, by_hand in times:
            row += [f"{1e3 * library:.2f}", f"{1e3 * by_hand:.2f}", f"{library / by_hand:.2f}x"]
        rows.append([*row, f"{times[-1][0] / times[0][0]:.2f}x"])
    print_table("Questions to the past, median", [*header, "growth"], rows)


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(__doc__, argv, changes=5_000_000, small=50_000)
    with stores(options.backend) as places:
        for backend, new in places.items():
            run(backend, new, [options.small, options.changes])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Findings of verification, and tables that it reads side by side."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from datetime import date, datetime
from functools import cache, lru_cache
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Table, and_, or_, select, union

from ... import html
from ...sql.dialects.base import Row, Session
from ...sql.query import Query, in_rows, integer
from ...sql.rows import KB

# Further findings of a table are only counted, to bound memory.
LISTED = 100


class Finding(NamedTuple):
    """A fault.

    Attributes:
        revision: the first affected revision; None if no single revision is to blame.
        table: the table; None if no single table is to blame.
        message: the difference.
    """

    revision: int | None
    table: str | None
    message: str

    def _html_row_(self) -> html.Row:
        return self._asdict()


class Report:
    """Collects the findings of one knowledge base."""

    def __init__(self) -> None:
        self._findings: list[Finding] = []
        self._counts: Counter[str | None] = Counter()

    def add(self, revision: int | None, table: str | None, message: str) -> None:
        """Add a finding."""
        self._counts[table] += 1
        if self._counts[table] <= LISTED:
            # SQLite stores any value in any column.
            number = revision if isinstance(revision, int) else None
            self._findings.append(Finding(number, table, message))

    def findings(self) -> tuple[Finding, ...]:
        """Return all findings, by revision."""
        more = [
            Finding(None, table, f"{count - LISTED} more findings in {table or 'several tables'}")
            for table, count in self._counts.items()
            if count > LISTED
        ]
        found = sorted(self._findings, key=lambda each: (each.revision is None, each.revision or 0))
        return (*found, *more)


_END: Any = object()


class Side:
    """The rows of one table, to take key by key.

    Keys are the first columns of a row, and must come in ascending order.
    """

    def __init__(self, rows: Iterator[Row], width: int, stray: Callable[[Row], None]) -> None:
        self._groups = groupby(rows, key=itemgetter(*range(width)))
        self._stray = stray
        self._key: Any = _END
        self._rows: Iterable[Row] = ()
        self._next()

    def take(self, key: Any) -> Iterable[Row]:
        """Return the rows of a key, to read at once; take keys in ascending order."""
        # Comparing a key with NULL raises: an error, not the end.
        while self._key is not _END and self._key < key:
            self._pass()
        if self._key != key:
            return ()
        # The next key is found when needed, so rows taken by then are not strays.
        rows, self._rows = self._rows, ()
        return rows

    def end(self) -> None:
        """Report the remaining rows as strays."""
        while self._key is not _END:
            self._pass()

    def _pass(self) -> None:
        for row in self._rows:
            self._stray(row)
        self._next()

    def _next(self) -> None:
        self._key, self._rows = next(self._groups, (_END, ()))


Narrow = Callable[[Table], ColumnElement[bool]]
AFTER = integer("after")


@cache
def in_order(table: Table, *names: str, narrow: Narrow | None = None) -> Query:
    """Build the query of the rows of one knowledge base, in the order of the primary key.

    `narrow` restricts it to the rows for a verification that continues an earlier one. It is a
    constant, or a method of one: a statement is built once for each.
    """
    columns = [table.c[name] for name in names or [*table.c.keys()][1:]]
    _, *key = table.primary_key.columns
    rows = select(*columns).where(table.c.kb_id == KB)
    return Query((rows if narrow is None else rows.where(narrow(table))).order_by(*key))


def _ends(touched: Touched) -> Select[Any]:
    """Select the elements with a version that began or ended, or a saying, after a revision."""
    version, owner, sayings = touched
    ends = [version.c.since, version.c.until, *(() if sayings is None else (sayings.c.since,))]
    found = (
        select(end.table.c[owner].label("id")).where(end.table.c.kb_id == KB, end > AFTER)
        for end in ends
    )
    either = union(*found).subquery("touched")
    return select(either.c.id)


class Touched(NamedTuple):
    """The rows of one kind for a verification that continues an earlier one.

    For each element with a version that began or ended after its revision, or with a saying since,
    these are all rows except earlier sayings, and versions that had already ended.
    The element's other versions are read because no two may overlap.

    Attributes:
        version: the table whose versions began or ended.
        owner: its column that names the element.
        sayings: the table of sayings, if any.
    """

    version: Table
    owner: str
    sayings: Table | None = None

    def identities(self, table: Table) -> ColumnElement[bool]:
        """Restrict the table of identities."""
        return in_rows(table.c.id, _ends(self))

    def parts(self, table: Table) -> ColumnElement[bool]:
        """Restrict a table with a column that names the element."""
        return in_rows(table.c[self.owner], _ends(self))

    def said(self, table: Table) -> ColumnElement[bool]:
        """Restrict the table of sayings."""
        return and_(self.parts(table), table.c.since > AFTER)

    def versions(self, table: Table) -> ColumnElement[bool]:
        """Restrict the table of versions."""
        until = table.c.until
        return and_(self.parts(table), or_(table.c.since > AFTER, until > AFTER, until.is_(None)))


def began(table: Table) -> ColumnElement[bool]:
    """Restrict a table to versions that began after the revision."""
    return table.c.since > AFTER


class Check(NamedTuple):
    """A knowledge base under verification, and its report.

    Attributes:
        session: the session, in a read transaction.
        kb_id: the knowledge base.
        report: collects the findings.
        after: the last revision that was verified before; 0 to verify all.
    """

    session: Session
    kb_id: int
    report: Report
    after: int = 0

    def rows(self, query: Query) -> list[Row]:
        """Read the rows of a query."""
        return self.session.rows(query, kb=self.kb_id)

    def stream(self, query: Query) -> Iterator[Row]:
        """Read the rows of a query in constant memory."""
        return self.session.stream(query, kb=self.kb_id)

    def read(
        self, table: Table, *names: str, narrow: Narrow, whole: Narrow | None = None
    ) -> Iterator[Row]:
        """Read a table in the order of its key: all of `whole`, or restricted by `narrow`."""
        if not self.after:
            return self.stream(in_order(table, *names, narrow=whole))
        query = in_order(table, *names, narrow=narrow)
        return self.session.stream(query, kb=self.kb_id, after=self.after)

    def side(
        self,
        table: Table,
        of: Table,
        *names: str,
        narrow: Narrow,
        whole: Narrow | None = None,
        width: int = 1,
    ) -> Side:
        """Begin to read a table; report rows whose key, of one or two columns, `of` lacks."""
        has_versions = width > 1 and "since" in of.primary_key.columns

        def stray(row: Row) -> None:
            owner, since = ".".join(map(str, row[:width])), None
            if has_versions:
                owner, since = f"{row[0]} since revision {row[1]}", row[1]
            self.report.add(
                since,
                table.name,
                f"a row of {table.name} is of {owner}, of which {of.name} has no row",
            )

        return Side(self.read(table, *names, narrow=narrow, whole=whole), width, stray)


def interval_fault(before: Any, since: Any, until: Any) -> str | None:
    """Find the fault of an interval; `before` is the end of the one before it, or 0."""
    if until is not None and not (isinstance(until, int) and until > since):
        return "ends before it begins, or in no revision"
    return "overlaps the version before it" if before is None or before > since else None


def differing(given: Iterable[Row], expected: Iterable[Row]) -> list[str]:
    """Return the tables whose rows differ; each row begins with the name of its table."""
    left, right = Counter(given), Counter(expected)
    return list(dict.fromkeys(row[0] for row in (left - right) + (right - left)))


_DATE, _CLOCK = (
    r"[0-9]{4}-[0-9]{2}-[0-9]{2}",
    r"(?:[01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9]\.[0-9]{6}",
)
_TIME = re.compile(f"{_DATE}T{_CLOCK}Z")
_date = lru_cache(maxsize=8)(date.fromisoformat)


def check_time(raw: Any) -> None:
    """Raise unless a time stored as text has exactly the written form."""
    if isinstance(raw, str):
        # Several texts are read as the same time, but only one has this form.
        if _TIME.fullmatch(raw) is None:
            raise ValueError(f"{raw!r} is not written as times are")
        _date(raw[:10])


def stored_time(session: Session, raw: Any) -> datetime:
    """Read a time; raise unless it has exactly the written form."""
    check_time(raw)
    return session.to_time(raw)

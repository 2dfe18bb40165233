"""The contents of a store's knowledge bases: heads, facts, goals, origins, verifications.

Facts are counted up to a limit, so a page takes a bounded time, however large the knowledge bases
are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import ColumnElement, Select, Text, and_, bindparam, cast, func, select

from ..errors import UNREADABLE, StoreError, missing_revision, reading_rows, unreadable
from ..knowledge.canonical import read_source
from ..knowledge.definitions import DERIVED_PREDICATE, GOAL
from . import tables as t
from .dialects import create_backend
from .dialects.base import Backend, Session, retrying
from .dialects.containing import contains, pattern_of
from .query import Query, constant, first_rows, in_list, integer
from .schema import ensure_schema

T = TypeVar("T")

# Facts to count on a page: for all knowledge bases together, and for each at least.
COUNTED_TOGETHER, COUNTED_EACH = 250_000, 10_000
MOST_GOALS = 1_000
PAGE = 50

_ZERO = constant(0)


# Statements are built on first use: few processes that connect list knowledge bases.
_COLUMNS: tuple[Any, ...] = (
    t.KnowledgeBaseRow.id,
    t.KnowledgeBaseRow.name,
    t.HeadRow.revision,
    t.RevisionRow.number,
    t.RevisionRow.committed_at,
    t.RevisionRow.actor,
    t.RevisionRow.reason,
    # As text: a driver decodes a JSON string, and the result is no longer JSON.
    cast(t.RevisionRow.source, Text),
    t.HeadRow.origin,
    t.HeadRow.origin_revision,
    t.HeadRow.origin_committed_at,
    t.HeadRow.heard_at,
    t.VerificationRow.revision,
    t.VerificationRow.verified_at,
    t.VerificationRow.complete_at,
)


def _rows(*conditions: ColumnElement[bool]) -> Select[Any]:
    return (
        select(*_COLUMNS)
        .select_from(t.KnowledgeBaseRow)
        # A missing head, or a head without its revision, is reported, not skipped.
        .outerjoin(t.HeadRow, t.HeadRow.kb_id == t.KnowledgeBaseRow.id)
        .outerjoin(
            t.RevisionRow,
            and_(
                t.RevisionRow.kb_id == t.HeadRow.kb_id, t.RevisionRow.number == t.HeadRow.revision
            ),
        )
        .outerjoin(t.VerificationRow, t.VerificationRow.kb_id == t.HeadRow.kb_id)
        .where(t.HeadRow.revision.is_distinct_from(_ZERO), *conditions)
        .order_by(t.KnowledgeBaseRow.id)
    )


class _Listing(NamedTuple):
    """The statement that lists some knowledge bases, and the one of their ids alone."""

    rows: Query
    ids: Query


def _listing(rows: Callable[[], Select[Any]]) -> _Listing:
    return _Listing(Query(rows), Query(lambda: rows().with_only_columns(t.KnowledgeBaseRow.id)))


def _page(conditions: Callable[[], Iterable[ColumnElement[bool]]]) -> _Listing:
    return _listing(lambda: first_rows(_rows(*conditions()), integer("number")))


def _after() -> ColumnElement[bool]:
    last = select(t.KnowledgeBaseRow.id).where(t.KnowledgeBaseRow.name == bindparam("after"))
    found = last.correlate(None).scalar_subquery()
    return t.KnowledgeBaseRow.id > func.coalesce(found, integer("last"), _ZERO)


_EVERY = _listing(_rows)
_BY_ID = Query(lambda: _rows(t.KnowledgeBaseRow.id == bindparam("id")))
_NAME = Query(
    lambda: select(t.KnowledgeBaseRow.name).where(t.KnowledgeBaseRow.id == bindparam("id"))
)
# Replaces a damaged name.
_NAMELESS = re.compile(r"id (\d{1,18})")
_PAGE = _page(lambda: [_after()])
_FOUND = _page(lambda: [_after(), contains(t.KnowledgeBaseRow.name)])
_NAMED = _page(lambda: [t.KnowledgeBaseRow.name == bindparam("name")])
_TOTAL = Query(
    lambda: select(func.count(), func.coalesce(func.sum(t.HeadRow.revision), _ZERO)).where(
        # Numbers beyond all revisions are damaged, and might be too large for a sum.
        t.HeadRow.revision.between(constant(1), constant(2**40))
    )
)


def _live(is_goal: bool, most: str) -> Any:
    """Select the facts or the goals of a head, up to a number."""
    version = t.PropositionVersionRow
    kind = version.is_goal if is_goal else ~version.is_goal
    rows: Any = (
        select(version.kb_id, version.proposition_id)
        .where(version.kb_id == t.HeadRow.kb_id, version.until.is_(None), kind)
        .correlate(t.HeadRow)
    )
    return first_rows(rows, integer(most)).subquery()


def _count(rows: Any) -> Any:
    return select(func.count()).select_from(rows).correlate(t.HeadRow).scalar_subquery()


def _reached(goals: Any) -> Any:
    """Count the goals that are facts now."""
    goal, fact = t.PropositionRow.__table__.alias("goal"), t.PropositionRow.__table__.alias("fact")
    version = t.PropositionVersionRow.__table__.alias("held")
    rows = (
        goals.join(goal, and_(goal.c.kb_id == goals.c.kb_id, goal.c.id == goals.c.proposition_id))
        .join(
            fact,
            and_(
                fact.c.kb_id == goal.c.kb_id,
                ~fact.c.is_goal,
                fact.c.predicate_id == goal.c.predicate_id,
                fact.c.arguments == goal.c.arguments,
            ),
        )
        .join(
            version,
            and_(
                version.c.kb_id == fact.c.kb_id,
                version.c.proposition_id == fact.c.id,
                version.c.until.is_(None),
            ),
        )
    )
    return _count(rows)


def _formulas() -> Any:
    """Count the live goals that are not atoms, and the rules that may derive one."""
    version = t.TABLES["formula_version"]
    section = version.c.section.in_([constant(s) for s in (GOAL, DERIVED_PREDICATE)])
    return (
        select(func.count())
        .where(version.c.kb_id == t.HeadRow.kb_id, version.c.until.is_(None), section)
        .correlate(t.HeadRow)
        .scalar_subquery()
    )


# Of some knowledge bases in one statement: it walks the live propositions of each, up to a limit.
_COUNTS = Query(
    lambda: select(
        t.HeadRow.kb_id,
        _count(_live(False, "facts")),
        _count(_live(True, "goals")),
        _reached(_live(True, "goals")),
        _formulas(),
    ).where(in_list(t.HeadRow.kb_id, "ids"))
)


@dataclass(frozen=True)
class Inventory:
    """A knowledge base: its last revision, counts, origin, and last verified revision.

    Unreadable attributes of its origin and its verifications are None. If its name or its last
    revision is damaged, `error` says how, and the attributes of that revision are None.

    Attributes:
        name: its name; "id" and its id if the name is damaged.
        revision: the number of its last revision.
        committed_at: when that was made, in UTC.
        actor: who made it.
        reason: why.
        source: where its knowledge comes from, as JSON values.
        facts: the number of facts, counted up to a limit.
        has_more_facts: whether there are more.
        goals: the number of goals that are atoms, counted up to 1,000.
        reached: how many of these are facts; None if a goal is another condition, or may follow
            from a rule: use `not kb.unsatisfied()` then.
        origin: the store that it is a replica of, without a password; None if it is written here.
        origin_revision: the last known revision of the origin.
        origin_committed_at: when that was made, in UTC.
        heard_at: when the origin was last heard of, in UTC.
        verified_revision: the last verified revision; None if no verification was kept.
        verified_at: the time of that verification, in UTC.
        complete_at: the time of the last kept verification that began at revision 1, in UTC.
        error: the damage of its name or its last revision; None if both can be read.
    """

    _json_ = (
        *("name", "revision", "committed_at", "actor", "reason", "source", "facts"),
        *("has_more_facts", "goals", "reached", "origin", "origin_revision", "origin_committed_at"),
        *("heard_at", "behind", "lag", "verified_revision", "verified_at", "complete_at", "error"),
    )

    name: str
    revision: int | None
    committed_at: datetime | None
    actor: str | None
    reason: str | None
    source: Any
    facts: int
    has_more_facts: bool
    goals: int
    reached: int | None
    origin: str | None = None
    origin_revision: int | None = None
    origin_committed_at: datetime | None = None
    heard_at: datetime | None = None
    verified_revision: int | None = None
    verified_at: datetime | None = None
    complete_at: datetime | None = None
    error: str | None = None

    @property
    def behind(self) -> int | None:
        """The number of known revisions of its origin that it lacks; None without an origin."""
        if self.origin is None or self.origin_revision is None or self.revision is None:
            return None
        return max(0, self.origin_revision - self.revision)

    @property
    def lag(self) -> float | None:
        """The age of its last revision relative to that of its origin, in seconds."""
        there, here = self.origin_committed_at, self.committed_at
        if self.behind is None or there is None or here is None:
            return None
        return max(0.0, (there - here).total_seconds())


class Catalog:
    """The knowledge bases of a store. Threads may share it."""

    def __init__(self, backend: Backend) -> None:
        """Read through a backend, which the caller closes.

        Args:
            backend: the database.
        """
        self._backend = backend

    def overview(
        self, *, after: str | None = None, part: str | None = None, limit: int = PAGE
    ) -> tuple[list[Inventory], bool]:
        """Read a page of written knowledge bases, oldest first, and whether there are more.

        `after` is the last name of the page before, and names contain `part`, in any case.
        """

        def read(session: Session) -> tuple[list[Inventory], bool]:
            nameless = _NAMELESS.fullmatch(after or "")
            last = None if nameless is None else int(nameless[1])
            given = {"after": after, "last": last, "number": limit + 1}
            if part:
                pattern = pattern_of(session, part)
                rows = _read_rows(session, _FOUND, pattern=pattern, **given)
            else:
                rows = _read_rows(session, _PAGE, **given)
            return _counted(session, rows[:limit]), len(rows) > limit

        return self._read(read)

    def every(self) -> list[Inventory]:
        """Read all knowledge bases that have a revision, oldest first."""
        return self._read(lambda session: _counted(session, _read_rows(session, _EVERY)))

    def find(self, name: str) -> Inventory | None:
        """Read one knowledge base; None if it does not exist or has no revision."""
        found = self._read(
            lambda session: _counted(session, _read_rows(session, _NAMED, name=name, number=1))
        )
        return found[0] if found else None

    def first_names(self, limit: int) -> list[str]:
        """Return the first names, oldest first, without damaged ones."""
        return self._read(
            lambda session: [
                row[1]
                for row in _read_rows(session, _PAGE, after=None, last=None, number=limit)
                if isinstance(row[1], str)
            ]
        )

    def has(self, name: str) -> bool:
        """Return whether there is a knowledge base of this name that has a revision."""
        return self._read(lambda session: bool(session.rows(_NAMED.ids, name=name, number=1)))

    def total(self) -> tuple[int, int]:
        """Count the knowledge bases, and all their revisions: each commit changes this."""
        row = self._read(lambda session: session.rows(_TOTAL))[0]
        with reading_rows("head", f"column revision of {self._backend.label}"):
            return int(row[0]), int(row[1])

    def _read(self, work: Callable[[Session], T]) -> T:
        def once() -> T:
            with closing(self._backend.reader()) as session:
                return work(session)

        return retrying(self._backend, once)


def knowledge_bases(url: str) -> list[Inventory]:
    """List the knowledge bases of a store that have a revision, in two statements.

    Args:
        url: the database URL; nothing is created.

    Returns:
        The knowledge bases, oldest first.

    Raises:
        InvalidUrlError: the URL is not valid.
        SchemaMissingError: the database has no kant_sql tables.
        StoreError: the database cannot be opened.
    """
    with closing(create_backend(url, read_only=True)) as backend:
        ensure_schema(backend)
        return Catalog(backend).every()


def _counted(session: Session, rows: list[tuple[Any, ...]]) -> list[Inventory]:
    """Count what is in some knowledge bases."""
    if not rows:
        return []
    most = max(COUNTED_EACH, COUNTED_TOGETHER // len(rows))
    ids = session.list_value([row[0] for row in rows])
    counts = {
        row[0]: row[1:] for row in session.rows(_COUNTS, ids=ids, facts=most + 1, goals=MOST_GOALS)
    }
    return [_inventory(session, row, counts.get(row[0], (0, 0, 0, 0)), most) for row in rows]


def _read_rows(session: Session, listing: _Listing, **given: Any) -> list[tuple[Any, ...]]:
    """Read the rows; where a driver cannot read one, an error is in its place of the revision."""
    try:
        return session.rows(listing.rows, **given)
    except StoreError as error:
        # Any other error is not about a row.
        if type(error) is not StoreError:
            raise
    return [_read_row(session, id_) for (id_,) in session.rows(listing.ids, **given)]


def _read_row(session: Session, id_: Any) -> tuple[Any, ...]:
    name = None
    try:
        [(name,)] = session.rows(_NAME, id=id_)
        return session.rows(_BY_ID, id=id_)[0]
    except StoreError as error:
        return (id_, name, error, *(None for _ in _COLUMNS[3:]))


def _inventory(
    session: Session, row: tuple[Any, ...], counts: tuple[int, ...], most: int
) -> Inventory:
    last: tuple[int | None, datetime | None, str | None, str | None, Any] = (None,) * 5
    error = None
    try:
        last = _last_revision(session, row)
    except StoreError as damage:
        # Readers know the store, or must not learn where it is.
        error = str(damage).removeprefix(f"{session.backend.label}: ")
    origin, at_origin, said_at, heard_at, verified, verified_at, complete_at = row[8:]
    facts, goals, reached, formulas = counts
    return Inventory(
        row[1] if isinstance(row[1], str) else f"id {row[0]}",
        *last,
        min(facts, most),
        facts > most,
        goals,
        None if formulas else reached,
        origin if isinstance(origin, str) else None,
        _number(at_origin),
        _moment(session, said_at),
        _moment(session, heard_at),
        # 0 is the mark of a verification that found a fault.
        _number(verified) or None,
        None if verified == 0 else _moment(session, verified_at),
        _moment(session, complete_at),
        error,
    )


def _last_revision(
    session: Session, row: tuple[Any, ...]
) -> tuple[int, datetime, str | None, str | None, Any]:
    """Return number, time, actor, reason and source of the last revision."""
    name, revision, number, committed_at, actor, reason, source = row[1:8]
    if isinstance(revision, StoreError):
        raise revision
    with reading_rows("knowledge_base", f"id {row[0]!r}"):
        # SQLite stores any type in any column.
        if not isinstance(name, str):
            raise TypeError(f"column name has {name!r}, which is not text")
    if revision is None:
        raise unreadable("head", f"knowledge base {name!r}", LookupError("there is no row"))
    if number is None or type(revision) is not int:
        raise missing_revision(session.backend.label, name, revision)
    with reading_rows("revision", f"revision {revision} of knowledge base {name!r}"):
        for column, text in (("actor", actor), ("reason", reason)):
            if text is not None and not isinstance(text, str):
                raise TypeError(f"column {column} has {text!r}, which is not text")
        return revision, session.to_time(committed_at), actor, reason, read_source(source)


# No history depends on origins and verifications: unreadable ones are unknown, and hide nothing
# else.


def _number(value: Any) -> int | None:
    return value if type(value) is int and value >= 0 else None


def _moment(session: Session, raw: Any) -> datetime | None:
    if raw is None:
        return None
    try:
        return session.to_time(raw)
    except UNREADABLE:
        return None

"""What is in the knowledge bases of a store: heads, facts and goals, origins, verifications.

Facts are counted up to a limit, so that a page of knowledge bases takes a bounded time, however
large they are.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from datetime import datetime
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import ColumnElement, Select, and_, bindparam, func, literal_column, select

from ..errors import UNREADABLE, missing_revision, reading_rows
from ..knowledge.definitions import DERIVED_PREDICATE, GOAL
from .dialects import create_backend
from .dialects.base import Backend, Session, retrying
from .query import Query, first_rows, in_list, integer
from .schema import ensure_schema
from .tables import (
    TABLES,
    HeadRow,
    KnowledgeBaseRow,
    PropositionRow,
    PropositionVersionRow,
    RevisionRow,
    VerificationRow,
)

T = TypeVar("T")

# How many facts are counted on a page, of all its knowledge bases together, and of each at least.
COUNTED_TOGETHER, COUNTED_EACH = 250_000, 10_000
MOST_GOALS = 1_000
PAGE = 50

_ZERO: ColumnElement[Any] = literal_column("0")
_EMPTY: ColumnElement[Any] = literal_column("''")


_COLUMNS: tuple[Any, ...] = (
    KnowledgeBaseRow.id,
    KnowledgeBaseRow.name,
    HeadRow.revision,
    RevisionRow.number,
    RevisionRow.committed_at,
    RevisionRow.actor,
    RevisionRow.reason,
    HeadRow.origin,
    HeadRow.origin_revision,
    HeadRow.origin_committed_at,
    HeadRow.heard_at,
    VerificationRow.revision,
    VerificationRow.verified_at,
    VerificationRow.complete_at,
)


def _rows(*conditions: ColumnElement[bool]) -> Select[Any]:
    return (
        select(*_COLUMNS)
        .select_from(KnowledgeBaseRow)
        .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
        # A head whose revision is missing is named, not passed over.
        .outerjoin(
            RevisionRow,
            and_(RevisionRow.kb_id == HeadRow.kb_id, RevisionRow.number == HeadRow.revision),
        )
        .outerjoin(VerificationRow, VerificationRow.kb_id == HeadRow.kb_id)
        .where(HeadRow.revision.is_distinct_from(_ZERO), *conditions)
        .order_by(KnowledgeBaseRow.id)
    )


def _page(*conditions: ColumnElement[bool]) -> Query:
    return Query(first_rows(_rows(*conditions), integer("number")))


_EVERY = Query(_rows())
_LAST = select(KnowledgeBaseRow.id).where(KnowledgeBaseRow.name == bindparam("after"))
_AFTER = KnowledgeBaseRow.id > func.coalesce(_LAST.correlate(None).scalar_subquery(), _ZERO)
_LOWER = func.lower(KnowledgeBaseRow.name)
_PAGE = _page(_AFTER)
# Both dialects can replace; each searches by a function of its own.
_FOUND = _page(_AFTER, func.replace(_LOWER, func.lower(bindparam("part")), _EMPTY) != _LOWER)
_NAMED = _page(KnowledgeBaseRow.name == bindparam("name"))
_TOTAL = Query(
    select(func.count(), func.coalesce(func.sum(HeadRow.revision), _ZERO)).where(
        HeadRow.revision > _ZERO
    )
)


def _live(is_goal: bool, most: str) -> Any:
    """Select the facts or the goals of a head, up to a number."""
    version = PropositionVersionRow
    kind = version.is_goal if is_goal else ~version.is_goal
    rows: Any = (
        select(version.kb_id, version.proposition_id)
        .where(version.kb_id == HeadRow.kb_id, version.until.is_(None), kind)
        .correlate(HeadRow)
    )
    return first_rows(rows, integer(most)).subquery()


def _count(rows: Any) -> Any:
    return select(func.count()).select_from(rows).correlate(HeadRow).scalar_subquery()


def _reached(goals: Any) -> Any:
    """Count the goals that are facts now."""
    goal, fact = PropositionRow.__table__.alias("goal"), PropositionRow.__table__.alias("fact")
    version = PropositionVersionRow.__table__.alias("held")
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
    """Count the live goals that are no atoms, and the rules that may derive one."""
    version = TABLES["formula_version"]
    section = version.c.section.in_([literal_column(f"'{s}'") for s in (GOAL, DERIVED_PREDICATE)])
    return (
        select(func.count())
        .where(version.c.kb_id == HeadRow.kb_id, version.c.until.is_(None), section)
        .correlate(HeadRow)
        .scalar_subquery()
    )


# Of some knowledge bases in one statement: it walks the live propositions of each, up to a limit.
_COUNTS = Query(
    select(
        HeadRow.kb_id,
        _count(_live(False, "facts")),
        _count(_live(True, "goals")),
        _reached(_live(True, "goals")),
        _formulas(),
    ).where(in_list(HeadRow.kb_id, "ids"))
)


class Inventory(NamedTuple):
    """A knowledge base: its last revision, what it has, its origin, and how far it is verified.

    What cannot be read of its origin and its verifications is None.

    Attributes:
        name: its name.
        revision: the number of its last revision.
        committed_at: when that was made, in UTC.
        actor: who made it.
        reason: why.
        facts: how many facts hold, counted up to a limit.
        has_more_facts: whether there are more than were counted.
        goals: how many atoms are goals, counted up to 1,000.
        reached: how many of these are facts; None where a goal is another condition, or may follow
            from a rule: `kb.is_goal_reached()` tells.
        origin: the store that it is replicated from, without a password; None where it is written.
        origin_revision: the last revision of the origin, as last heard of.
        origin_committed_at: when that was made, in UTC.
        heard_at: when the origin was last heard of, in UTC.
        verified_revision: the revision up to which a kept verification found it intact; None when
            none was kept.
        verified_at: when that was, in UTC.
        complete_at: when a verification that began at revision 1 was last kept, in UTC.
    """

    name: str
    revision: int
    committed_at: datetime
    actor: str | None
    reason: str | None
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

    @property
    def behind(self) -> int | None:
        """How many revisions of its origin it lacks, as last heard of; None where it has none."""
        if self.origin is None or self.origin_revision is None:
            return None
        return max(0, self.origin_revision - self.revision)

    @property
    def lag(self) -> float | None:
        """How much older its last revision is than that of its origin, in seconds."""
        if self.behind is None or self.origin_committed_at is None:
            return None
        return max(0.0, (self.origin_committed_at - self.committed_at).total_seconds())


class Catalog:
    """The knowledge bases of a store. Threads may share it."""

    def __init__(self, backend: Backend) -> None:
        """Read through a backend, which stays the caller's.

        Args:
            backend: the database.
        """
        self._backend = backend

    def overview(
        self, *, after: str | None = None, part: str | None = None, limit: int = PAGE
    ) -> tuple[list[Inventory], bool]:
        """Read a page of the knowledge bases that have a revision, oldest first.

        Args:
            after: the last name of the page before.
            part: what the names contain, in small or capital letters.
            limit: how many at most.

        Returns:
            The page, and whether there are more.
        """

        def read(session: Session) -> tuple[list[Inventory], bool]:
            given = {"after": after, "number": limit + 1}
            if part:
                rows = session.rows(_FOUND, part=part, **given)
            else:
                rows = session.rows(_PAGE, **given)
            return _counted(session, rows[:limit]), len(rows) > limit

        return self._read(read)

    def every(self) -> list[Inventory]:
        """Read all knowledge bases that have a revision, oldest first."""
        return self._read(lambda session: _counted(session, session.rows(_EVERY)))

    def find(self, name: str) -> Inventory | None:
        """Read one knowledge base; None if there is none of this name that has a revision."""
        found = self._read(
            lambda session: _counted(session, session.rows(_NAMED, name=name, number=1))
        )
        return found[0] if found else None

    def first_names(self, limit: int) -> list[str]:
        """Return the first names, oldest first."""
        return self._read(
            lambda session: [
                _name(session, row) for row in session.rows(_PAGE, after=None, number=limit)
            ]
        )

    def has(self, name: str) -> bool:
        """Return whether there is a knowledge base of this name that has a revision."""
        return self._read(lambda session: bool(session.rows(_NAMED, name=name, number=1)))

    def total(self) -> tuple[int, int]:
        """Count the knowledge bases, and the revisions of all: any change changes this."""
        row = self._read(lambda session: session.rows(_TOTAL))[0]
        with reading_rows("head", f"column revision of {self._backend.label}"):
            return int(row[0]), int(row[1])

    def _read(self, work: Callable[[Session], T]) -> T:
        def once() -> T:
            session = self._backend.reader()
            try:
                return work(session)
            finally:
                session.close()

        return retrying(self._backend, once)


def knowledge_bases(url: str) -> list[Inventory]:
    """List the knowledge bases of a store that have a revision, in two statements.

    Args:
        url: the database URL; nothing is created.

    Returns:
        What is in each of them, the oldest knowledge base first.

    Raises:
        InvalidUrlError: the URL is not valid.
        SchemaMissingError: the database has no kant_sql tables.
        StoreIntegrityError: a name or a last revision is damaged; the message says whose.
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


def _inventory(
    session: Session, row: tuple[Any, ...], counts: tuple[int, ...], most: int
) -> Inventory:
    revision, committed_at, actor, reason = _last_revision(session, row)
    origin, at_origin, said_at, heard_at, verified, verified_at, complete_at = row[7:]
    facts, goals, reached, formulas = counts
    return Inventory(
        _name(session, row),
        revision,
        committed_at,
        actor,
        reason,
        min(facts, most),
        facts > most,
        goals,
        None if formulas else reached,
        origin if isinstance(origin, str) else None,
        _number(at_origin),
        _moment(session, said_at),
        _moment(session, heard_at),
        _number(verified),
        _moment(session, verified_at),
        _moment(session, complete_at),
    )


def _name(session: Session, row: tuple[Any, ...]) -> str:
    """Return the name: SQLite keeps anything in any column."""
    name = row[1]
    with reading_rows("knowledge_base", f"id {row[0]!r} of {session.backend.label}"):
        if not isinstance(name, str):
            raise TypeError(f"column name has {name!r}, no text")
    return name


def _last_revision(
    session: Session, row: tuple[Any, ...]
) -> tuple[int, datetime, str | None, str | None]:
    """Return number, time, actor and reason of the last revision."""
    name, label = _name(session, row), session.backend.label
    revision, number, committed_at, actor, reason = row[2:7]
    if number is None or type(revision) is not int:
        raise missing_revision(label, name, revision)
    with reading_rows("revision", f"revision {revision} of knowledge base {name!r} of {label}"):
        for column, text in (("actor", actor), ("reason", reason)):
            if text is not None and not isinstance(text, str):
                raise TypeError(f"column {column} has {text!r}, no text")
        return revision, session.to_time(committed_at), actor, reason


# No history depends on where a replica comes from, and on what was verified: what cannot be read of
# these is not known, and hides nothing else.


def _number(value: Any) -> int | None:
    return value if type(value) is int and value >= 0 else None


def _moment(session: Session, raw: Any) -> datetime | None:
    if raw is None:
        return None
    try:
        return session.to_time(raw)
    except UNREADABLE:
        return None

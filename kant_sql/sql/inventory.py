"""What is in the knowledge bases of a store: their heads, and how many facts and goals they have.

Facts are counted up to a limit, so that a page of knowledge bases takes a bounded time, however
large they are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import ColumnElement, Select, and_, bindparam, func, literal_column, select

from ..errors import StoreReplacedError
from ..knowledge.definitions import DERIVED_PREDICATE, GOAL
from .dialects import create_backend
from .dialects.base import Backend, Session, retrying
from .query import Query, first_rows, integer
from .rows import KB
from .schema import ensure_schema
from .tables import (
    TABLES,
    HeadRow,
    KnowledgeBaseRow,
    PropositionRow,
    PropositionVersionRow,
    RevisionRow,
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
    RevisionRow.committed_at,
    RevisionRow.actor,
    RevisionRow.reason,
)


def _page(*conditions: ColumnElement[bool]) -> Query:
    rows = (
        select(*_COLUMNS)
        .select_from(KnowledgeBaseRow)
        .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
        .join(
            RevisionRow,
            and_(RevisionRow.kb_id == HeadRow.kb_id, RevisionRow.number == HeadRow.revision),
        )
        .where(*conditions)
        .order_by(KnowledgeBaseRow.id)
    )
    return Query(first_rows(rows, integer("number")))


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


def _live(is_goal: bool) -> Select[Any]:
    version = PropositionVersionRow
    kind = version.is_goal if is_goal else ~version.is_goal
    return select(version.proposition_id).where(version.kb_id == KB, version.until.is_(None), kind)


def _count(rows: Select[Any]) -> Any:
    return select(func.count()).select_from(rows.subquery()).scalar_subquery()


def _reached(goals: Any) -> Any:
    """Count the goals that are facts now."""
    goal, fact = PropositionRow.__table__.alias("goal"), PropositionRow.__table__.alias("fact")
    version = PropositionVersionRow.__table__.alias("held")
    holds = (
        select(func.count())
        .select_from(goals)
        .join(goal, and_(goal.c.kb_id == KB, goal.c.id == goals.c.proposition_id))
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
    return holds.scalar_subquery()


def _formulas() -> Any:
    """Count the live goals that are no atoms, and the rules that may derive one."""
    version = TABLES["formula_version"]
    section = version.c.section.in_([literal_column(f"'{s}'") for s in (GOAL, DERIVED_PREDICATE)])
    return _count(
        select(version.c.kb_id).where(version.c.kb_id == KB, version.c.until.is_(None), section)
    )


_COUNTS = Query(
    select(
        _count(first_rows(_live(False), integer("facts"))),
        _count(first_rows(_live(True), integer("goals"))),
        _reached(first_rows(_live(True), integer("goals")).subquery()),
        _formulas(),
    )
)


class Inventory(NamedTuple):
    """A knowledge base: its last revision, and how many facts and goals it has.

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


class Catalog:
    """The knowledge bases of a store, read over connections of its own. Threads may share it."""

    def __init__(self, url: str) -> None:
        """Open the store to read; nothing is created.

        Args:
            url: the database URL.
        """
        self._url = url
        self._backend = self._open()

    def _open(self) -> Backend:
        backend = create_backend(self._url, read_only=True)
        try:
            ensure_schema(backend)
        except BaseException:
            backend.close()
            raise
        return backend

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
            most = max(COUNTED_EACH, COUNTED_TOGETHER // max(1, min(len(rows), limit)))
            found = [_overview(session, row, most) for row in rows[:limit]]
            return found, len(rows) > limit

        return self._read(read)

    def every(self) -> Iterator[Inventory]:
        """Read all knowledge bases that have a revision, oldest first, page by page."""
        after, has_more = None, True
        while has_more:
            page, has_more = self.overview(after=after)
            yield from page
            after = page[-1].name if page else None

    def find(self, name: str) -> Inventory | None:
        """Read one knowledge base; None if there is none of this name that has a revision."""

        def read(session: Session) -> Inventory | None:
            row = session.first(_NAMED, name=name, number=1)
            return None if row is None else _overview(session, row, COUNTED_TOGETHER)

        return self._read(read)

    def first_names(self, limit: int) -> list[str]:
        """Return the first names, oldest first."""
        return self._read(
            lambda session: [row[1] for row in session.rows(_PAGE, after=None, number=limit)]
        )

    def has(self, name: str) -> bool:
        """Return whether there is a knowledge base of this name that has a revision."""
        return self._read(lambda session: bool(session.rows(_NAMED, name=name, number=1)))

    def total(self) -> tuple[int, int]:
        """Count the knowledge bases, and the revisions of all: any change changes this."""
        row = self._read(lambda session: session.rows(_TOTAL))[0]
        return int(row[0]), int(row[1])

    def _read(self, work: Callable[[Session], T]) -> T:
        try:
            return self._read_from(self._backend, work)
        except StoreReplacedError:
            # Another file is there now.
            replaced, self._backend = self._backend, self._open()
            replaced.close()
            return self._read_from(self._backend, work)

    @staticmethod
    def _read_from(backend: Backend, work: Callable[[Session], T]) -> T:
        def once() -> T:
            session = backend.reader()
            try:
                return work(session)
            finally:
                session.close()

        return retrying(backend, once)

    def close(self) -> None:
        """Close its connections."""
        self._backend.close()


def _overview(session: Session, row: tuple[Any, ...], most: int) -> Inventory:
    kb_id, name, revision, committed_at, actor, reason = row
    [(facts, goals, reached, formulas)] = session.rows(
        _COUNTS, kb=kb_id, facts=most + 1, goals=MOST_GOALS
    )
    return Inventory(
        name,
        revision,
        session.to_time(committed_at),
        actor,
        reason,
        min(facts, most),
        facts > most,
        goals,
        None if formulas else reached,
    )

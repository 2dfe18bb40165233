"""A consistent state to read from, and the definitions that are cached with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from sqlalchemy import BigInteger, bindparam, func, select

from ..errors import ArchivedError, StoreIntegrityError
from ..knowledge.definitions import Definitions
from ..sql.answers import Reader
from ..sql.dialects.base import Row, Session
from ..sql.intervals import then
from ..sql.query import Query
from ..sql.rows import KB, table_of
from ..sql.tables import ArchiveRow, ErasureRow, HeadRow
from .caches import DefinitionCache
from .head import check_numbers

LAST_ERASURE = select(func.max(ErasureRow.since)).where(ErasureRow.kb_id == KB).scalar_subquery()
_NUMBERS = "revision", "archived_revision", "definition_revision"
_HEAD = table_of(HeadRow).c
# What `make_position` reads.
POSITION = select(*(_HEAD[name] for name in _NUMBERS), LAST_ERASURE).where(_HEAD.kb_id == KB)
_POSITION = Query(POSITION)
_ARCHIVE = Query(
    select(ArchiveRow.target)
    .where(ArchiveRow.kb_id == KB, ArchiveRow.revision > bindparam("at", type_=BigInteger))
    .order_by(ArchiveRow.revision, ArchiveRow.id.desc())
)


class HeadPosition(NamedTuple):
    """Where a knowledge base stands, read without its lock."""

    kb_id: int | None = None  # None before the first write
    head: int = 0  # the last revision; 0 before the first
    archived: int = 0  # versions that ended up to this revision are in an archive
    redefined: int = 0  # the last revision that changed a definition
    erased: int | None = None  # the last erasure; None if there is none


def read_position(session: Session, kb_id: int | None) -> HeadPosition:
    """Read where a knowledge base stands, in one statement."""
    if kb_id is None:
        return HeadPosition()
    row = session.first(_POSITION, kb=kb_id)
    if row is None:
        raise vanished(session)
    return make_position(session, kb_id, row)


def make_position(session: Session, kb_id: int, row: Row) -> HeadPosition:
    """Check a row that begins with the columns of `POSITION`."""
    # A log from an endless revision would never end.
    check_numbers(session, kb_id, zip(_NUMBERS, row, strict=False))
    return HeadPosition(kb_id, *row[:4])


class View(NamedTuple):
    """A consistent state to read from: now, or as it was at a revision."""

    session: Session
    kb_id: int | None  # the knowledge base; None when it has not been written to yet
    definitions: Definitions
    at: int | None = None  # the revision; None for now
    # The revision that last changed a definition, where it still has to be compared with the head
    # in the statement that reads; else None.
    definition_revision: int | None = None

    @property
    def reader(self) -> Reader:
        """Return what runs the statements of conditions on this state."""
        return Reader(self.session, self.kb_id, self.at)

    def rows(self, queries: Mapping[bool, Query]) -> list[Row]:
        """Run a query of the present or that of the past; nothing is found before a first write."""
        if self.kb_id is None:
            return []
        past = {} if self.at is None else then(self.session, self.at)
        return self.session.rows(queries[self.at is not None], kb=self.kb_id, **past)


class DefinitionsMovedError(Exception):
    """A statement found that definitions have changed since they were cached."""


def open_view(
    session: Session,
    kb_id: int | None,
    cache: DefinitionCache,
    at: int | None,
    oldest: int | None = None,
) -> View:
    """Open a state to read from; the `oldest` that will be read is another at a valid time."""
    if kb_id is None:
        return View(session, None, Definitions(), at)
    if at is None and cache.snapshot is None:
        return View(session, kb_id, cache.load(session, kb_id))
    position = read_position(session, kb_id)
    pasts = cache.heed(position.erased)
    redefined, archived = position.redefined, position.archived
    if at is None:
        return View(session, kb_id, cache.at_head(session, kb_id, redefined, archived))
    refuse_archived(session, kb_id, at if oldest is None else oldest, archived)
    definitions = cache.at_revision(session, kb_id, at, redefined, archived, pasts)
    return View(session, kb_id, definitions, at)


def refuse_archived(session: Session, kb_id: int, at: int, archived: int) -> None:
    """Refuse to read a state of which a part was moved elsewhere."""
    if session.overlay is not None:
        at = session.overlay.oldest
    # Before the first revision there was nothing that could have been moved.
    if 0 < at < archived:
        raise ArchivedError(
            f"a part of the state at revision {at} was moved to an archive: ask the one in "
            f"{archive_of(session, kb_id, at)}"
        )


def archive_of(session: Session, kb_id: int, at: int) -> str:
    """Return where the archive is that has a part of a state."""
    row = session.first(_ARCHIVE, kb=kb_id, at=at)
    if row is None:
        raise StoreIntegrityError(
            f"{session.backend.label}: the head of knowledge base {kb_id} says that versions "
            f"after revision {at} were moved to an archive, but there is no record of one; "
            "'kant-sql verify' shows what else was changed by hand"
        )
    return str(row[0])


def read_revision(view: View) -> int:
    """Read which revision a state is of."""
    return read_position(view.session, view.kb_id).head if view.at is None else view.at


def vanished(session: Session) -> StoreIntegrityError:
    """Make the error for a knowledge base that was there, and is gone."""
    return StoreIntegrityError(
        f"{session.backend.label}: the head of the knowledge base is gone; the database was "
        "replaced while it was open, connect again"
    )

"""A consistent state to read, with its cached definitions."""

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
# The columns for `make_position`.
POSITION = select(*(_HEAD[name] for name in _NUMBERS), LAST_ERASURE).where(_HEAD.kb_id == KB)
_POSITION = Query(POSITION)
_ARCHIVE = Query(
    select(ArchiveRow.target)
    .where(ArchiveRow.kb_id == KB, ArchiveRow.revision > bindparam("at", type_=BigInteger))
    .order_by(ArchiveRow.revision, ArchiveRow.id.desc())
)


class HeadPosition(NamedTuple):
    """The head, read without its lock."""

    kb_id: int | None = None  # None before the first write
    head: int = 0  # the last revision; 0 before the first
    archived: int = 0  # versions that ended up to this revision are in an archive
    redefined: int = 0  # the last revision that changed a definition
    erased: int | None = None  # the last erasure; None if there is none


def read_position(session: Session, kb_id: int | None) -> HeadPosition:
    """Read the head, in one statement."""
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
    """A consistent state to read: the present, or that at a revision."""

    session: Session
    kb_id: int | None  # the knowledge base; None before its first write
    definitions: Definitions
    at: int | None = None  # the revision; None for now
    # The last change of a definition, if the reading statement still has to compare it with the
    # head; else None.
    definition_revision: int | None = None

    @property
    def reader(self) -> Reader:
        """Return a runner of the statements of conditions on this state."""
        return Reader(self.session, self.kb_id, self.at)

    def rows(self, queries: Mapping[bool, Query]) -> list[Row]:
        """Run the query of the present or of the past; before the first write, find nothing."""
        if self.kb_id is None:
            return []
        past = {} if self.at is None else then(self.session, self.at)
        return self.session.rows(queries[self.at is not None], kb=self.kb_id, **past)


class DefinitionsMovedError(Exception):
    """Definitions have changed since they were cached."""


def open_view(
    session: Session,
    kb_id: int | None,
    cache: DefinitionCache,
    at: int | None,
    oldest: int | None = None,
) -> View:
    """Open a state to read; at a valid time, the `oldest` revision read is another one."""
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
    """Refuse to read a state that is partly in an archive."""
    if session.overlay is not None:
        at = session.overlay.oldest
    # Before the first revision there was nothing to move.
    if 0 < at < archived:
        raise ArchivedError(
            f"a part of the state at revision {at} was moved to an archive: ask the one in "
            f"{archive_of(session, kb_id, at)}"
        )


def archive_of(session: Session, kb_id: int, at: int) -> str:
    """Return the location of the archive that has a part of a state."""
    row = session.first(_ARCHIVE, kb=kb_id, at=at)
    if row is None:
        raise StoreIntegrityError(
            f"{session.backend.label}: the head of knowledge base {kb_id} says that versions "
            f"after revision {at} were moved to an archive, but there is no record of one; "
            "'kant-sql verify' shows what else was changed by hand"
        )
    return str(row[0])


def read_revision(view: View) -> int:
    """Read the revision of a state."""
    return read_position(view.session, view.kb_id).head if view.at is None else view.at


def vanished(session: Session) -> StoreIntegrityError:
    """Make the error for a knowledge base that has disappeared."""
    return StoreIntegrityError(
        f"{session.backend.label}: the head of the knowledge base is gone; the database was "
        "replaced while it was open, connect again"
    )

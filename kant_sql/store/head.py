"""The head of a knowledge base: the row that its writers lock and advance."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import bindparam, func, select, update

from ..errors import (
    UNREADABLE,
    StoreBusyError,
    StoreIntegrityError,
    check_integer,
    missing_revision,
    unreadable,
)
from ..sql.dialects.base import Session
from ..sql.query import Insert, Query, StoreClock, integer
from ..sql.rows import KB, table_of
from ..sql.tables import EMPTY_HEAD, HeadRow, KnowledgeBaseRow, RevisionRow

# A SHA-256 in hexadecimal digits.
HASH_LENGTH = 64

_HASH = Query(
    select(RevisionRow.hash).where(RevisionRow.kb_id == KB, RevisionRow.number == bindparam("at"))
)
_FIND = Query(select(KnowledgeBaseRow.id).where(KnowledgeBaseRow.name == bindparam("name")))
_LAST_KB = Query(select(func.max(KnowledgeBaseRow.id)))
# Attempts to allocate an id for a knowledge base while others take it.
_ATTEMPTS = 100
_NAME = Query(select(KnowledgeBaseRow.name).where(KnowledgeBaseRow.id == KB))
_NEW_KB = Insert(table_of(KnowledgeBaseRow), "id", "name")
_NEW_HEAD = Insert(table_of(HeadRow), "kb_id", *EMPTY_HEAD)


class Head(NamedTuple):
    """The head, read under its lock."""

    revision: int  # the last revision; 0 before the first
    definition_revision: int  # the last revision that changed a definition
    next_id: int  # the id that the next element gets
    hash: str | None  # the last revision's hash
    committed_at: datetime | None  # the last revision's time
    archived_revision: int  # versions that ended up to this revision are in an archive
    origin: str | None  # the store that it is a replica of; None if it is written here
    clock: datetime  # the store's time when the lock was taken


_HEAD = table_of(HeadRow).c
_LOCK = Query(
    select(*(_HEAD[name] for name in Head._fields[:-1]), StoreClock())
    .where(_HEAD.kb_id == KB)
    .with_for_update()
)


# The columns of a head that each revision changes, written or copied.
MOVED: dict[str, Any] = {
    "revision": integer("number"),
    "definition_revision": integer("definitions"),
    "next_id": integer("next"),
    "hash": bindparam("digest"),
    "committed_at": bindparam("time"),
}


def set_head(**values: Any) -> Query:
    """Make the statement that sets columns of a head."""
    return Query(update(HeadRow).where(HeadRow.kb_id == bindparam("kb")).values(**values))


class Committed(NamedTuple):
    """A written revision, whose commit the database still has to confirm."""

    number: int
    hash: str
    moment: Any  # its time, in the driver's form


def read_name(session: Session, kb_id: int) -> str:
    """Read the name of a knowledge base."""
    row = session.first(_NAME, kb=kb_id)
    return "" if row is None else str(row[0])


def whose(session: Session, kb_id: int) -> str:
    """Return the name of a knowledge base and its store, for a message."""
    return f"knowledge base {read_name(session, kb_id)!r} of {session.backend.label}"


def find_knowledge_base(session: Session, name: str) -> int | None:
    """Find a knowledge base by its name; None before its first write."""
    row = session.first(_FIND, name=name)
    if row is not None and not isinstance(row[0], int):
        check_integer("knowledge_base", f"{name!r} of {session.backend.label}", "id", row[0])
    return None if row is None else int(row[0])


def create_knowledge_base(session: Session, name: str) -> int:
    """Create a knowledge base before its first revision, unless another process just did."""
    taken = None
    for _ in range(_ATTEMPTS):
        kb_id = 1 + _last_id(session)
        try:
            session.insert(_NEW_KB, [(kb_id, name)])
        except StoreIntegrityError as error:
            # The other one has committed: without a pause, for newcomers would be faster.
            taken = error
            session.rollback()
            session.begin(write=True)
            found = find_knowledge_base(session, name)
            if found is not None:
                return found
            continue
        session.insert(_NEW_HEAD, [(kb_id, *EMPTY_HEAD.values())])
        session.commit()
        session.begin(write=True)
        return kb_id
    raise StoreBusyError(
        f"{session.backend.label}: other processes are creating knowledge bases just now; nothing "
        "was written, try again"
    ) from taken


def _last_id(session: Session) -> int:
    row = session.first(_LAST_KB)
    last = row[0] or 0 if row else 0
    if not isinstance(last, int):
        # A label is formatted only for its message.
        check_integer("knowledge_base", f"the largest id of {session.backend.label}", "id", last)
    return int(last)


def lock_head(session: Session, kb_id: int) -> Head | None:
    """Lock a knowledge base against other writers, and read its head."""
    row = session.first(_LOCK, kb=kb_id)
    if row is None:
        return None
    revision, definition_revision, next_id, digest, moment, archived, origin, clock = row
    numbers = (revision, definition_revision, next_id, archived)
    if {*map(type, numbers)} != {int} or min(numbers) < 0:
        check_numbers(session, kb_id, zip(EMPTY_HEAD, numbers, strict=True))
    # The next hash is chained to this one.
    if revision and (not isinstance(digest, str) or len(digest) != HASH_LENGTH):
        error = ValueError(f"column hash has {digest!r}, which is not a hash")
        raise unreadable("head", whose(session, kb_id), error) from error
    committed_at = to_time_of_head(session, kb_id, moment)
    now = session.now(clock)
    return Head(revision, definition_revision, next_id, digest, committed_at, archived, origin, now)


def to_time_of_head(session: Session, kb_id: int, moment: Any) -> datetime | None:
    """Convert the time of the last revision; the error names the knowledge base."""
    try:
        return None if moment is None else session.to_time(moment)
    except UNREADABLE as error:
        raise unreadable("head", whose(session, kb_id), error) from error


def check_numbers(session: Session, kb_id: int, numbers: Iterable[tuple[str, Any]]) -> None:
    """Check that columns of the head have integers: SQLite stores any type in any column."""
    for name, value in numbers:
        if not isinstance(value, int) or value < 0:
            raise StoreIntegrityError(
                f"{session.backend.label}: column {name} of table head has {value!r} for knowledge "
                f"base {read_name(session, kb_id)!r}, which is not an integer from 0 on; nothing "
                "was written; 'kant-sql verify' shows what else was changed by hand"
            )


def hash_of(session: Session, kb_id: int, number: int) -> str | None:
    """Read the hash of a revision."""
    row = session.first(_HASH, kb=kb_id, at=number)
    return None if row is None else str(row[0])


def check_last(session: Session, kb_id: int, head: Head) -> None:
    """Check that the revision of a locked head exists."""
    if head.revision and hash_of(session, kb_id, head.revision) is None:
        name = read_name(session, kb_id)
        raise missing_revision(session.backend.label, name, head.revision)

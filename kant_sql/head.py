"""The head of a knowledge base: the row that its writers lock, and move on."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import bindparam, func, select, update

from .backends import Query, Session, StoreClock
from .errors import StoreBusyError, StoreIntegrityError, reading_rows
from .knowledge.loading import KB
from .knowledge.rows import table_of
from .tables import HeadRow, KnowledgeBaseRow, RevisionRow

FIRST_ID = 1
# A SHA-256 in hexadecimal digits.
HASH_LENGTH = 64

_NUMBERS = ("revision", "definition_revision", "next_id", "archived_revision")

_LOCK = Query(
    select(
        HeadRow.revision,
        HeadRow.definition_revision,
        HeadRow.next_id,
        HeadRow.hash,
        HeadRow.committed_at,
        HeadRow.archived_revision,
        StoreClock(),
    )
    .where(HeadRow.kb_id == KB)
    .with_for_update()
)
_HASH = Query(
    select(RevisionRow.hash).where(RevisionRow.kb_id == KB, RevisionRow.number == bindparam("at"))
)
_LAST_KB = Query(select(func.max(KnowledgeBaseRow.id)))
_MOVE = Query(
    update(HeadRow)
    .where(HeadRow.kb_id == bindparam("kb"))
    .values(
        revision=bindparam("number"),
        definition_revision=bindparam("definitions"),
        next_id=bindparam("next"),
        hash=bindparam("digest"),
        committed_at=bindparam("time"),
    )
)


class Head(NamedTuple):
    """Where a knowledge base stands, read under its lock.

    Attributes:
        revision: the last revision; 0 before the first.
        definition_revision: the last revision that changed a definition.
        next_id: the id that the next element gets.
        hash: the last revision's hash.
        committed_at: the last revision's time.
        archived_revision: what ended up to this revision was moved to an archive.
        clock: the store's time when the lock was taken.
    """

    revision: int
    definition_revision: int
    next_id: int
    hash: str | None
    committed_at: datetime | None
    archived_revision: int
    clock: datetime


class Committed(NamedTuple):
    """A revision that was written, and is committed when the database says so.

    Attributes:
        number: its number.
        hash: its hash.
        moment: when, in the driver's form.
    """

    number: int
    hash: str
    moment: Any


def create_knowledge_base(session: Session, name: str) -> int:
    """Create a knowledge base, before its first revision.

    Args:
        session: the session, in a transaction that writes: it is committed, and another one begun,
            for who creates another knowledge base at this moment waits for it.
        name: the knowledge base's name.

    Returns:
        Its id.

    Raises:
        StoreBusyError: another process is creating one.
    """
    row = session.first(_LAST_KB)
    kb_id: int = 1 + (row[0] or 0 if row else 0)
    try:
        session.insert(table_of(KnowledgeBaseRow), [(kb_id, name)])
    except StoreIntegrityError as error:
        raise StoreBusyError(
            f"{session.backend.label}: another process is creating a knowledge base just now; "
            "nothing was written, try again"
        ) from error
    session.insert(table_of(HeadRow), [(kb_id, 0, 0, FIRST_ID, None, None, 0)])
    session.commit()
    session.begin(write=True)
    return kb_id


def lock_head(session: Session, kb_id: int) -> Head | None:
    """Lock a knowledge base against other writers, and read where it stands.

    Args:
        session: the session, in a transaction that writes.
        kb_id: the knowledge base.

    Returns:
        The head, or None when there is no such knowledge base any more.

    Raises:
        StoreIntegrityError: a number of the head is none, its time, or its hash.
    """
    row = session.first(_LOCK, kb=kb_id)
    if row is None:
        return None
    check_numbers(session, kb_id, zip(_NUMBERS, (row[0], row[1], row[2], row[5]), strict=True))
    with reading_rows("head", f"knowledge base {kb_id!r}"):
        committed_at = None if row[4] is None else session.to_time(row[4])
        # What is hashed next would be chained to it.
        if row[0] and (not isinstance(row[3], str) or len(row[3]) != HASH_LENGTH):
            raise ValueError(f"column hash has {row[3]!r}, which is no hash")
    return Head(row[0], row[1], row[2], row[3], committed_at, row[5], session.now(row[6]))


def check_numbers(session: Session, kb_id: int, numbers: Iterable[tuple[str, Any]]) -> None:
    """Check that columns of the head have integers: SQLite keeps anything in any column.

    Args:
        session: the session that they are from.
        kb_id: the knowledge base.
        numbers: the name of each column, and what it has.

    Raises:
        StoreIntegrityError: one of them is no integer from 0 on.
    """
    for name, value in numbers:
        if not isinstance(value, int) or value < 0:
            raise StoreIntegrityError(
                f"{session.backend.label}: column {name} of table head has {value!r} for knowledge "
                f"base {kb_id}, which is no integer from 0 on; nothing was written; 'kant-sql "
                "verify' shows what else was changed by hand"
            )


def is_stored(session: Session, kb_id: int, made: Committed) -> bool:
    """Tell whether a revision is in the store.

    Args:
        session: the session.
        kb_id: the knowledge base.
        made: the revision; its hash tells it from another writer's of the same number.

    Returns:
        Whether it is.
    """
    return hash_of(session, kb_id, made.number) == made.hash


def hash_of(session: Session, kb_id: int, number: int) -> str | None:
    """Read the hash of a revision.

    Args:
        session: the session.
        kb_id: the knowledge base.
        number: the revision.

    Returns:
        The hash; None when there is no such revision.
    """
    row = session.first(_HASH, kb=kb_id, at=number)
    return None if row is None else str(row[0])


def move_head(
    session: Session, kb_id: int, made: Committed, definition_revision: int, next_id: int
) -> None:
    """Let a knowledge base stand at a new revision.

    Args:
        session: the session that has locked it.
        kb_id: the knowledge base.
        made: the new revision.
        definition_revision: the last revision that changed a definition.
        next_id: the id that the next element gets.
    """
    session.run(
        _MOVE,
        kb=kb_id,
        number=made.number,
        definitions=definition_revision,
        next=next_id,
        digest=made.hash,
        time=made.moment,
    )

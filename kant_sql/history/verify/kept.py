"""How far a knowledge base was verified: kept in the store, for the next verification to continue.

Who may write the table can lie in it: what is kept saves time, and proves nothing.
"""

from __future__ import annotations

from datetime import datetime
from typing import NamedTuple

from sqlalchemy import bindparam, delete, select, update

from ...errors import UNREADABLE, StoreIntegrityError
from ...knowledge.canonical import time_text
from ...sql.dialects.base import Session
from ...sql.query import Insert, Query, integer
from ...sql.rows import KB, table_of
from ...sql.tables import VerificationRow
from ...store.store import Store

_ROW = VerificationRow
_READ = Query(
    select(_ROW.revision, _ROW.hash, _ROW.verified_at, _ROW.complete_at).where(_ROW.kb_id == KB)
)
# One that began earlier, on an older state, does not put back what a later one has kept.
_MOVE = Query(
    update(_ROW)
    .where(_ROW.kb_id == KB, _ROW.revision <= integer("number"))
    .values(
        revision=bindparam("number"),
        hash=bindparam("digest"),
        verified_at=bindparam("now"),
        complete_at=bindparam("complete"),
    )
)
_NEW = Insert(table_of(_ROW), "kb_id", "revision", "hash", "verified_at", "complete_at")
_FORGET = Query(delete(_ROW).where(_ROW.kb_id == KB))


class Kept(NamedTuple):
    """How far a knowledge base was verified.

    Attributes:
        revision: the last revision then.
        hash: its hash then.
        verified_at: when that was.
        complete_at: when a verification that began at revision 1 last ended; None: none was kept.
    """

    revision: int
    hash: str
    verified_at: datetime
    complete_at: datetime | None

    @property
    def origin(self) -> str:
        """Name the verification, for a message."""
        return f"verification of {time_text(self.verified_at)}"


def read_kept(session: Session, kb_id: int) -> Kept | None:
    """Read how far it was verified; None if nothing was kept, or nothing readable."""
    row = session.first(_READ, kb=kb_id)
    if row is None:
        return None
    number, digest, verified_at, complete_at = row
    try:
        moments = (
            session.to_time(verified_at),
            None if complete_at is None else session.to_time(complete_at),
        )
    except UNREADABLE:
        return None
    if type(number) is not int or number < 1 or not isinstance(digest, str):
        return None
    return Kept(number, digest, *moments)


def keep(store: Store, kb_id: int, number: int, digest: str, before: Kept | None) -> None:
    """Keep how far it was verified; `before` is what was continued, None if it is complete."""

    def write(session: Session) -> None:
        now = session.from_time(store.clock(session))
        last = None if before is None else before.complete_at
        complete = now if before is None else last and session.from_time(last)
        given = {"number": number, "digest": digest, "now": now, "complete": complete}
        if not session.run(_MOVE, kb=kb_id, **given) and session.first(_READ, kb=kb_id) is None:
            session.insert(_NEW, [(kb_id, number, digest, now, complete)])

    try:
        store.write_beside(write)
    except StoreIntegrityError:
        # Another verification has kept its end at the same moment.
        if store.query(lambda session, _: session.first(_READ, kb=kb_id)) is None:
            raise


def forget(store: Store, kb_id: int) -> None:
    """Forget how far it was verified: the next verification begins at revision 1."""

    def write(session: Session) -> None:
        session.run(_FORGET, kb=kb_id)

    store.write_beside(write)

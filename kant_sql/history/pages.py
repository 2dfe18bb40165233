"""A page of what changed: some revisions, oldest first, in two statements."""

from __future__ import annotations

from collections.abc import Iterator

from ..backends import Session
from ..errors import StoreIntegrityError
from ..knowledge.changes import Change, stream_changes
from .revisions import OLDEST_FIRST, LogEntry, make_revision

# So many revisions at a time are read together with their changes, but no further than to the one
# with which there are so many changes.
PAGE = 500
PAGE_CHANGES = 50_000


def read_page(session: Session, kb_id: int, low: int, high: int) -> list[LogEntry]:
    """Read a range of revisions with what they changed, or the beginning of it.

    Args:
        session: the session, in a transaction that sees one state.
        kb_id: the knowledge base.
        low: the first revision, which there is.
        high: the last revision.

    Returns:
        The entries without gaps, one at least; not all when they have too many changes.

    Raises:
        StoreIntegrityError: a revision is missing.
    """
    rows = session.rows(OLDEST_FIRST, kb=kb_id, low=low, high=high)
    for number, row in enumerate(rows, low):
        if row[0] != number:
            raise missing_revision(session, number)
    if not rows:
        raise missing_revision(session, low)
    last = rows[-1][0]
    changes: dict[int, list[Change]] = {row[0]: [] for row in rows}
    end = _collect(stream_changes(session, kb_id, low, last), changes)
    return [
        LogEntry(make_revision(session, row), tuple(changes[row[0]]))
        for row in rows
        if end is None or row[0] < end
    ]


def _collect(lines: Iterator[tuple[int, Change]], changes: dict[int, list[Change]]) -> int | None:
    """Sort changes by revision; tell before which it ended, because there were too many."""
    for count, (number, change) in enumerate(lines):
        if count >= PAGE_CHANGES and not changes[number]:
            return number
        changes[number].append(change)
    return None


def missing_revision(session: Session, number: int) -> StoreIntegrityError:
    """Make the error for a revision that should be there, and is not.

    Args:
        session: the session.
        number: the revision.

    Returns:
        The error.
    """
    return StoreIntegrityError(
        f"{session.backend.label}: revision {number} is missing; run verify to see what else is "
        "not as it was written"
    )

"""Archives: what ended long ago is moved into another store."""

from __future__ import annotations

from collections import Counter
from datetime import datetime, timedelta
from typing import NamedTuple

from ..archive import (
    Leaving,
    Target,
    check_same,
    compare,
    count,
    first_of,
    open_target,
    read_archived_revision,
    refuse_without_right,
    remove,
    replicate,
)
from ..arguments import flag, optional_call
from ..backends import Session, create_backend
from ..errors import InvalidArgumentError, ReadOnlyError
from ..knowledge.archive import archive_text
from ..knowledge.changes import ARCHIVE, ASSERTED, Change
from ..knowledge.rows import table_of
from ..store import Store
from ..tables import ArchiveRow
from ..transaction import Transaction
from ..verification.checkpoints import rest_digest
from ..verification.findings import Progress
from .moments import revision_at

# So many versions leave in one transaction, as far as whole revisions allow: others wait for it.
AT_ONCE = 200_000

_TICK = timedelta(microseconds=1)


class Archived(NamedTuple):
    """What was moved, or would be.

    Attributes:
        upto: the versions that ended up to this revision.
        versions: how many, by the name of their table.
        target: where to: the URL without a password.
        revision: the last revision that records it; None when nothing was moved.
    """

    upto: int
    versions: dict[str, int]
    target: str
    revision: int | None


def archive(
    store: Store,
    before: int | datetime,
    to: str,
    dry_run: bool = False,
    actor: str | None = None,
    reason: str | None = None,
    progress: Progress | None = None,
) -> Archived:
    """Move versions that ended before a time into another store; `History.archive` says more.

    Args:
        store: the store.
        before: an aware time, or a revision's number.
        to: the other store's URL.
        dry_run: only count.
        actor: who does it.
        reason: why.
        progress: called with the number of revisions that the other store has, and is to have.

    Returns:
        What was moved, or would be.
    """
    if store.current() is not None:
        raise ReadOnlyError(
            f"knowledge base {store.name!r} has a transaction open in this task or thread: "
            "archive when it has ended"
        )
    optional_call(progress, "progress")
    flag(dry_run, "dry_run", InvalidArgumentError)
    upto = _last_before(store, before)
    leaving = store.look(lambda session, kb_id: _count(session, kb_id, upto))
    if dry_run or not leaving.versions:
        return Archived(upto, leaving.versions, _label(to), None)
    _refuse_without_right(store)
    with open_target(to, store.name, store.backend) as target:
        _replicate(store, target, upto, progress)
        return Archived(upto, *_move_all(store, target, upto, actor, reason))


def _last_before(store: Store, before: int | datetime) -> int:
    """Find the last revision before one, or before a time."""
    if not isinstance(before, datetime):
        return max(revision_at(store, before) - 1, 0)
    # A time in the future is refused as it stands.
    revision_at(store, before)
    return revision_at(store, before - _TICK)


def _label(url: str) -> str:
    backend = create_backend(url)
    try:
        return backend.label
    finally:
        backend.close()


def _count(session: Session, kb_id: int | None, upto: int) -> Leaving:
    archived = 0 if kb_id is None else read_archived_revision(session, kb_id)
    if kb_id is None or upto <= archived:
        return Leaving(archived + 1, upto, {})
    return count(session, kb_id, archived + 1, upto)


def _refuse_without_right(store: Store) -> None:
    with store.backend.open_session() as session:
        session.begin(write=True)
        try:
            refuse_without_right(session)
        finally:
            session.rollback()


def _replicate(store: Store, target: Target, upto: int, progress: Progress | None) -> None:
    kb_id = store.look(lambda _, kb_id: kb_id)
    assert kb_id is not None
    replicate(store.backend, kb_id, target, upto, progress)


def _move_all(
    store: Store, target: Target, upto: int, actor: str | None, reason: str | None
) -> tuple[dict[str, int], str, int | None]:
    """Remove what the target has; give how many versions, where they are, and the last revision."""
    moved: Counter[str] = Counter()
    revision, is_over = None, False
    while not is_over:
        made, leaving = _move(store, target, upto, actor, reason)
        if made is not None:
            revision = made
            moved.update(leaving.versions)
        is_over = not leaving.versions or (made is not None and leaving.high == upto)
    return dict(moved), target.backend.label, revision


def _move(
    store: Store, target: Target, upto: int, actor: str | None, reason: str | None
) -> tuple[int | None, Leaving]:
    """Remove some of what the target has.

    Gives the revision, or None when there was nothing to remove, or another process did that
    meanwhile; and what was to leave.
    """
    # The target's lock comes first: it is kept until what it has is the only copy.
    with target.locked() as (session, target_kb, head):

        def check(source: Session, kb_id: int | None) -> tuple[Leaving, str]:
            leaving = _count(source, kb_id, upto)
            if kb_id is None or not leaving.versions:
                return leaving, ""
            check_same(source, kb_id, session, target_kb, min(head.revision, upto))
            leaving = first_of(source, kb_id, leaving, AT_ONCE)
            compare(leaving, (source, kb_id), (session, target_kb))
            # What holds behind these revisions is not changed any more, but for when it ends.
            return leaving, rest_digest(source, kb_id, leaving.high)

        leaving, rest = store.look(check)
        if not leaving.versions:
            return None, leaving
        with store.transaction(actor, reason) as transaction:
            if transaction.head.archived_revision == leaving.low - 1:
                remove(transaction.session, transaction.kb_id, leaving)
                _record(transaction, leaving, rest, target.backend.label)
    made = transaction.committed
    return (None if made is None else made.number), leaving


def _record(transaction: Transaction, leaving: Leaving, rest: str, target: str) -> None:
    versions = leaving.total
    id_ = transaction.allocate()
    text = archive_text(id_, leaving.high, target, versions, rest)
    row = (transaction.kb_id, id_, transaction.number, leaving.high, target, versions, rest, text)
    transaction.records.add(Change(ASSERTED, ARCHIVE, text), [(table_of(ArchiveRow), row)])

"""Archives: copies old versions to another store, and removes them here."""

from __future__ import annotations

import logging
from collections import Counter
from contextlib import closing
from datetime import datetime
from typing import NamedTuple

from ...arguments import Progress, flag, optional_call
from ...errors import ConflictError, InvalidArgumentError
from ...knowledge.canonical import archive_text
from ...moment_text import When, read_when
from ...sql.changes import ARCHIVE
from ...sql.dialects import create_backend
from ...sql.dialects.base import Session, retrying
from ...sql.rows import table_of
from ...sql.tables import ArchiveRow
from ...store.head import hash_of
from ...store.snapshot import read_position
from ...store.state import State
from ...store.store import Store
from ...store.transaction import Transaction
from ..moments import just_before, revision_at
from ..replication.batch import Batches, copy_batch, wipe
from ..replication.copy import Stores
from ..replication.target import (
    ReplicationSide,
    Target,
    begin_on,
    diverged,
    last_archive,
    open_target,
    read_state,
)
from ..rewriting.parts import leave_commitments, standing_commitments
from ..verify.chain import rest_digest
from .remove import Leaving, compare, count, first_of, refuse_without_right, remove


def check_archive(stores: Stores, name: str, at: int) -> None:
    """Check that the target has the source's revisions up to one, and all earlier archives."""
    source, source_kb, target, target_kb = stores
    if at and hash_of(source, source_kb, at) != hash_of(target, target_kb, at):
        raise diverged(stores, name, at)
    archived = read_position(source, source_kb).archived
    if archived > at:
        last = last_archive(source, source_kb) or "an archive"
        raise ConflictError(
            f"{target.backend.label}: it lacks the versions that ended up to revision {archived}, "
            f"which were moved to {last}; archive into that store, or a copy"
        )


def replicate(
    source: ReplicationSide,
    target: Target,
    upto: int,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Replicate revisions up to one, continuing an earlier interrupted call."""
    # Each of several transactions leaves the target complete at some revision. Returns where bytes
    # of texts that were erased there may remain.
    batches, at = Batches(), -1
    while at < upto:
        at = retrying(target.backend, lambda: _advance(source, target, upto, batches))
        if progress is not None:
            progress(min(at, upto), upto)
    return wipe(target.backend) if batches.erasures else ()


def _advance(source: ReplicationSide, target: Target, upto: int, batches: Batches) -> int:
    """Copy some revisions; return the target's last one."""
    with (
        target.locked(durable=True) as (session, target_kb, head),
        begin_on(source.backend) as reader,
    ):
        kb_id = source.find(reader)
        state = read_state(reader, kb_id)
        assert kb_id is not None
        # The rest of an erased revision is copied with the erasure.
        upto = max(upto, state.erased)
        stores = Stores(reader, kb_id, session, target_kb)
        check_archive(stores, source.name, head.revision)
        if head.revision >= upto:
            return head.revision
        bounds = batches.following(state, head, upto, state.archived_revision > 0)
        copied = copy_batch(stores, source, state, head, bounds)
    batches.add(copied)
    return bounds.high


# Versions per transaction, as far as whole revisions allow: other writers wait for it.
AT_ONCE = 200_000


logger = logging.getLogger("kant_sql.history")


class Archived(NamedTuple):
    """The result of archiving, or of a dry run.

    Attributes:
        upto: versions that ended up to this revision move.
        versions: their number, by table.
        target: the URL of the archive, without a password.
        revision: the last revision that records the move; None if nothing moved.
    """

    upto: int
    versions: dict[str, int]
    target: str
    revision: int | None


def archive(
    state: State,
    before: When,
    *,
    to: str,
    dry_run: bool = False,
    reason: str | None = None,
    actor: str | None = None,
    progress: Progress | None = None,
) -> Archived:
    """Move versions that ended before a revision or time into another store.

    The target holds the knowledge base up to the last revision before `before`, with its
    history, and answers every question about it. This store keeps that state, all revisions and
    their hashes. Call it again to resume an interrupted archive.

    Args:
        before: a revision, given as for `kb.at`: versions that ended earlier are moved.
        to: the target's URL, on any dialect; a new SQLite file is created. The target may
            contain this knowledge base only from earlier archiving.
        dry_run: count only.
        reason: why.
        actor: who archives; by default the knowledge base's actor.
        progress: called with the number of copied revisions, and their total.

    Returns:
        The versions that moved or would move.

    Raises:
        UnknownRevisionError: there is no such revision yet, or the time lies in the future or
            has no zone.
        ConflictError: the target has another knowledge base of this name.
        ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.

    Examples:
        >>> _ = kb.propositions.delete_all()
        >>> kb.store.archive(2, to="sqlite:///2025.db", dry_run=True).upto
        1
    """
    store = state.store
    store.refuse_open()
    store.refuse_read_only()
    optional_call(progress, "progress")
    flag(dry_run, "dry_run", InvalidArgumentError)
    upto = _last_before(state, before)
    leaving = store.query_in_snapshot(lambda session, kb_id: _count(session, kb_id, upto))
    if dry_run or not leaving.versions:
        with closing(create_backend(to)) as backend:
            moved = Archived(upto, leaving.versions, backend.label, None)
    else:
        refuse_without_right(store)
        with open_target(to, store.name, store.backend, "an archive") as target:
            replicate(ReplicationSide(store.backend, store.name), target, upto, progress)
            moved = Archived(upto, *_move_all(store, target, upto, actor, reason))
    logger.info(
        "knowledge base %r: %d versions that ended up to revision %d %s %s",
        store.name,
        sum(moved.versions.values()),
        moved.upto,
        "would be moved to" if dry_run else "were moved to",
        moved.target,
    )
    return moved


def _last_before(state: State, before: When) -> int:
    """Find the last revision before one, or before a time."""
    before = read_when(before)
    if not isinstance(before, datetime):
        return max(revision_at(state, before) - 1, 0)
    # Raises for a time in the future.
    revision_at(state, before)
    return revision_at(state, just_before(before))


def _count(session: Session, kb_id: int | None, upto: int) -> Leaving:
    archived = 0 if kb_id is None else read_position(session, kb_id).archived
    if kb_id is None or upto <= archived:
        return Leaving(archived + 1, upto, {})
    return count(session, kb_id, archived + 1, upto)


def _move_all(
    store: Store, target: Target, upto: int, actor: str | None, reason: str | None
) -> tuple[dict[str, int], str, int | None]:
    """Remove the copied versions; return them, the target and the last revision."""
    moved: Counter[str] = Counter()
    revision, is_over = None, False
    while not is_over:
        made, leaving = _move(store, target, upto, actor, reason)
        if made is not None:
            revision = made
            moved.update(leaving.versions)
        elif leaving.versions:
            # An erasure may have come between: then the copy still has the erased texts.
            replicate(ReplicationSide(store.backend, store.name), target, upto)
        is_over = not leaving.versions or (made is not None and leaving.high == upto)
    return dict(moved), target.backend.label, revision


def _move(
    store: Store, target: Target, upto: int, actor: str | None, reason: str | None
) -> tuple[int | None, Leaving]:
    """Remove some copied versions; return the revision, if any, and these versions."""
    # The target's lock comes first, and lasts until its copy is the only one.
    with target.locked(durable=True) as (session, target_kb, head):

        def check(source: Session, kb_id: int | None) -> tuple[Leaving, str, int]:
            leaving = _count(source, kb_id, upto)
            erased = read_state(source, kb_id).erased
            if kb_id is None or not leaving.versions or erased > head.revision:
                return leaving, "", erased
            stores = Stores(source, kb_id, session, target_kb)
            check_archive(stores, store.name, min(head.revision, upto))
            leaving = first_of(source, kb_id, leaving, AT_ONCE)
            compare(leaving, (source, kb_id), (session, target_kb))
            # After these revisions, only `until` of versions can still change, except by an
            # erasure.
            return leaving, rest_digest(source, kb_id, leaving.high), erased

        leaving, rest, erased = store.query_in_snapshot(check)
        if not rest:
            return None, leaving
        with store.transaction(actor, reason) as transaction:
            now = read_state(transaction.session, transaction.kb_id)
            if (now.archived_revision, now.erased) == (leaving.low - 1, erased):
                where = transaction.session, transaction.kb_id, store.name, leaving.high
                before = standing_commitments(*where)
                remove(*where[:2], leaving)
                leave_commitments(*where, before)
                record_archive(transaction, leaving, rest, target.backend.label)
    return transaction.made, leaving


def record_archive(transaction: Transaction, leaving: Leaving, rest: str, target: str) -> None:
    """Record a move of versions, and the hash of the rest of their revisions."""
    said = transaction.allocate(), leaving.high, target, leaving.total, rest
    transaction.record(ARCHIVE, table_of(ArchiveRow), archive_text, *said)

"""Replicates a knowledge base up to a revision into its archive."""

from __future__ import annotations

from collections.abc import Callable

from ...errors import ConflictError
from ...sql.dialects.base import retrying
from ...store.head import hash_of
from ..replication.batch import BatchSize, CopyRange, OriginHead, copy_batch
from ..replication.copy import Stores
from ..replication.histories import diverged, last_archive, read_state
from ..replication.target import ReplicationSide, Target, reading
from ..revisions import read_position


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
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Replicate revisions up to one, resuming where an earlier call ended.

    Each of several transactions leaves the target complete at some revision.
    """
    size = BatchSize()
    at = -1
    while at < upto:
        at, rows = retrying(target.backend, lambda: _advance(source, target, upto, size.revisions))
        if progress is not None:
            progress(min(at, upto), upto)
        size.learn(rows)


def _advance(source: ReplicationSide, target: Target, upto: int, revisions: int) -> tuple[int, int]:
    """Copy some revisions; return the target's last one and how many versions were copied."""
    with (
        target.locked(durable=True) as (session, target_kb, head),
        reading(source.backend) as reader,
    ):
        kb_id = source.find(reader)
        state = read_state(reader, kb_id)
        assert kb_id is not None
        stores = Stores(reader, kb_id, session, target_kb)
        check_archive(stores, source.name, head.revision)
        if head.revision >= upto:
            return head.revision, 0
        high = min(upto, head.revision + revisions)
        redefined = state.definition_revision > head.revision
        bounds = CopyRange(head.revision + 1, high, state.archived_revision > 0, redefined)
        origin = OriginHead(source.backend.label, state.revision, state.committed_at, state.next_id)
        return high, copy_batch(stores, source.name, head, bounds, origin).rows

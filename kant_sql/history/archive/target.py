"""The target of an archive: a store that replicates the knowledge base up to a revision."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from typing import NamedTuple

from sqlalchemy import bindparam, select

from ...errors import ConflictError
from ...sql.dialects import create_backend
from ...sql.dialects.base import Backend, Session, retrying
from ...sql.query import Query, StorePlace
from ...sql.rows import KB
from ...sql.schema import ensure_schema
from ...sql.tables import ArchiveRow, KnowledgeBaseRow, RevisionRow
from ...store.head import Committed, Head, create_knowledge_base, hash_of, lock_head, move_head
from ...store.snapshot import vanished
from ...store.store import end_session
from ..revisions import read_archived_revision
from .copy import Copied, Copy, Stores

_FIND = Query(select(KnowledgeBaseRow.id).where(KnowledgeBaseRow.name == bindparam("name")))
_PLACE = Query(select(StorePlace()))
_LAST_TARGET = Query(
    select(ArchiveRow.target)
    .where(ArchiveRow.kb_id == KB)
    .order_by(ArchiveRow.revision.desc(), ArchiveRow.id.desc())
)


class Target(NamedTuple):
    """A knowledge base in the target store."""

    backend: Backend
    name: str

    @contextmanager
    def locked(self) -> Iterator[tuple[Session, int, Head]]:
        """Lock it against other writers for the length of a `with` block."""
        session = self.backend.session()
        try:
            session.define(self.backend.durable)
            session.begin(write=True)
            row = session.first(_FIND, name=self.name)
            kb_id = create_knowledge_base(session, self.name) if row is None else int(row[0])
            head = lock_head(session, kb_id)
            if head is None:
                raise vanished(session)
            yield session, kb_id, head
        finally:
            end_session(session)


@contextmanager
def open_target(url: str, name: str, source: Backend) -> Iterator[Target]:
    """Open the target store; a new SQLite file is created."""
    with closing(create_backend(url)) as backend:
        place = _place(backend)
        if not place:
            raise ConflictError(
                f"{backend.label}: an archive in memory ends with this process; "
                "name a file or a server"
            )
        if place == _place(source):
            raise ConflictError(
                f"{backend.label}: this is the archived store itself; name another one"
            )
        ensure_schema(backend)
        yield Target(backend, name)


def _place(backend: Backend) -> str:
    with backend.open_session() as session:
        row = session.first(_PLACE)
        return f"{backend.dialect.name} {row[0]}" if row and row[0] else ""


def check_same(source: Session, source_kb: int, target: Session, target_kb: int, at: int) -> None:
    """Check that the target has the source's revisions up to one, and all earlier archives."""
    label = target.backend.label
    if at and hash_of(source, source_kb, at) != hash_of(target, target_kb, at):
        raise ConflictError(
            f"{label}: it has another knowledge base of this name, or one that was written to: its "
            f"revision {at} is not the one of {source.backend.label}; archive into another store, "
            "or into an unchanged copy"
        )
    archived = read_archived_revision(source, source_kb)
    if archived > at:
        last = source.first(_LAST_TARGET, kb=source_kb)
        raise ConflictError(
            f"{label}: it lacks the versions that ended up to revision {archived}, which were "
            f"moved to {last[0] if last else 'an archive'}; archive into that store, or a copy"
        )


# Versions per transaction on the target, as far as whole revisions allow.
ROWS = 20_000
FIRST_REVISIONS = 50

_LAST = Query(
    select(RevisionRow.hash, RevisionRow.committed_at).where(
        RevisionRow.kb_id == KB, RevisionRow.number == bindparam("at")
    )
)


def replicate(
    source: Backend,
    kb_id: int,
    target: Target,
    upto: int,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Replicate revisions up to one, resuming where an earlier call ended.

    Each of several transactions leaves the target complete at some revision.
    """
    revisions = FIRST_REVISIONS
    at = -1
    while at < upto:
        advance = partial(_advance, source, kb_id, target, upto, revisions)
        at, rows = retrying(target.backend, advance)
        if progress is not None:
            progress(min(at, upto), upto)
        if rows < ROWS // 2:
            revisions *= 2
        elif rows > ROWS:
            revisions = max(1, revisions * ROWS // rows)


def _advance(
    source: Backend, kb_id: int, target: Target, upto: int, revisions: int
) -> tuple[int, int]:
    """Copy some revisions; return the target's last one and how many versions were copied."""
    with target.locked() as (session, target_kb, head), _reading(source) as reader:
        check_same(reader, kb_id, session, target_kb, head.revision)
        if head.revision >= upto:
            return head.revision, 0
        high = min(upto, head.revision + revisions)
        stores = Stores(reader, kb_id, session, target_kb)
        may_return = read_archived_revision(reader, kb_id) > 0
        copied = Copy(stores, head.revision + 1, high, may_return).run()
        _move(stores, head, high, copied)
        return high, copied.rows


def _move(stores: Stores, head: Head, number: int, copied: Copied) -> None:
    source, source_kb, target, target_kb = stores
    row = source.first(_LAST, kb=source_kb, at=number)
    if row is None:
        raise ConflictError(f"{source.backend.label}: revision {number} is gone; verify the store")
    made = Committed(number, row[0], target.from_time(source.to_time(row[1])))
    definitions = max(head.definition_revision, copied.definition_revision)
    move_head(target, target_kb, made, definitions, max(head.next_id, copied.largest_id + 1))
    target.commit(target_kb)


@contextmanager
def _reading(backend: Backend) -> Iterator[Session]:
    """Open a read transaction."""
    session = backend.session()
    try:
        session.begin(write=False)
        yield session
    finally:
        end_session(session)

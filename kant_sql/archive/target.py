"""The store that an archive is in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import NamedTuple

from sqlalchemy import bindparam, select

from ..backends import Backend, Query, Session, StorePlace, create_backend
from ..errors import ConflictError
from ..head import Head, create_knowledge_base, hash_of, lock_head
from ..knowledge.loading import KB
from ..reader import end_session
from ..schema import ensure_schema
from ..tables import ArchiveRow, HeadRow, KnowledgeBaseRow
from ..view import vanished

_FIND = Query(select(KnowledgeBaseRow.id).where(KnowledgeBaseRow.name == bindparam("name")))
_PLACE = Query(select(StorePlace()))
_ARCHIVED = Query(select(HeadRow.archived_revision).where(HeadRow.kb_id == KB))
_LAST_TARGET = Query(
    select(ArchiveRow.target)
    .where(ArchiveRow.kb_id == KB)
    .order_by(ArchiveRow.revision.desc(), ArchiveRow.id.desc())
)


class Target(NamedTuple):
    """A knowledge base in the store that an archive is in.

    Attributes:
        backend: the database.
        name: the knowledge base's name.
    """

    backend: Backend
    name: str

    @contextmanager
    def locked(self) -> Iterator[tuple[Session, int, Head]]:
        """Keep all others from writing to it for the length of a `with` block.

        Yields:
            The session, in a transaction that writes and survives a power cut once it is
            committed; the knowledge base's id; and where it stands.
        """
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
    """Open the store that an archive is in; a new SQLite file is created.

    Args:
        url: the store's URL.
        name: the knowledge base's name.
        source: the store that is archived.

    Yields:
        The knowledge base there.

    Raises:
        ConflictError: it is the very store that is archived, or one that does not last.
    """
    with closing(create_backend(url)) as backend:
        place = _place(backend)
        if not place:
            raise ConflictError(
                f"{backend.label}: an archive in memory would be gone with this process; "
                "name a file or a server"
            )
        if place == _place(source):
            raise ConflictError(
                f"{backend.label}: this is the store that is to be archived; name another one"
            )
        ensure_schema(backend)
        yield Target(backend, name)


def _place(backend: Backend) -> str:
    with backend.open_session() as session:
        row = session.first(_PLACE)
        return f"{backend.dialect.name} {row[0]}" if row and row[0] else ""


def read_archived_revision(session: Session, kb_id: int) -> int:
    """Read up to which revision what ended was moved to an archive.

    Args:
        session: the session.
        kb_id: the knowledge base.

    Returns:
        The revision; 0 when nothing was.
    """
    row = session.first(_ARCHIVED, kb=kb_id)
    return int(row[0]) if row else 0


def check_same(source: Session, source_kb: int, target: Session, target_kb: int, at: int) -> None:
    """Check that the target has the source's revisions up to one, and what was moved before.

    Args:
        source: a session on the source, in a transaction.
        source_kb: the knowledge base there.
        target: a session on the target, in a transaction.
        target_kb: the knowledge base there.
        at: the last revision that the target has.

    Raises:
        ConflictError: it is another knowledge base, or something is not there.
    """
    label = target.backend.label
    if at and hash_of(source, source_kb, at) != hash_of(target, target_kb, at):
        raise ConflictError(
            f"{label}: the knowledge base of this name there is another one, or somebody has "
            f"written to it: its revision {at} is not the one of {source.backend.label}; archive "
            "into another store, or into a copy that nobody has written to"
        )
    archived = read_archived_revision(source, source_kb)
    if archived > at:
        last = source.first(_LAST_TARGET, kb=source_kb)
        raise ConflictError(
            f"{label}: what ended up to revision {archived} was moved to "
            f"{last[0] if last else 'an archive'} before, and is not there: archive into that "
            "store, or into a copy of it"
        )

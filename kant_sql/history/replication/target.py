"""The store that revisions are replicated into."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress

from sqlalchemy import bindparam, select

from ...errors import ConflictError, check_integer
from ...sql.dialects import create_backend
from ...sql.dialects.base import Backend, Session
from ...sql.query import Query, StorePlace
from ...sql.schema import ensure_schema
from ...sql.tables import KnowledgeBaseRow
from ...store.head import Head, create_knowledge_base, lock_head
from ...store.snapshot import vanished
from ...store.store import end_session

_FIND = Query(select(KnowledgeBaseRow.id).where(KnowledgeBaseRow.name == bindparam("name")))
_PLACE = Query(select(StorePlace()))


def find(session: Session, name: str) -> int | None:
    """Find a knowledge base by its name."""
    row = session.first(_FIND, name=name)
    if row is None:
        return None
    check_integer("knowledge_base", f"{name!r} of {session.backend.label}", "id", row[0])
    kb_id: int = row[0]
    return kb_id


class ReplicationSide:
    """A knowledge base in one of the two stores.

    Attributes:
        backend: the database.
        name: the knowledge base's name.
        kb_id: its id, once it was found.
    """

    def __init__(self, backend: Backend, name: str) -> None:
        self.backend = backend
        self.name = name
        self.kb_id: int | None = None

    def find(self, session: Session) -> int | None:
        """Return its id; None before its first revision."""
        if self.kb_id is None:
            self.kb_id = find(session, self.name)
        return self.kb_id


class Target(ReplicationSide):
    """A knowledge base in the store that is written to."""

    @contextmanager
    def locked(self, durable: bool = False) -> Iterator[tuple[Session, int, Head]]:
        """Lock it against other writers for the length of a `with` block; create it if missing.

        With `durable`, what is committed survives a power cut.
        """
        session = self.backend.session()
        try:
            if durable:
                session.make_durable()
            session.begin(write=True)
            kb_id = self.find(session)
            if kb_id is None:
                kb_id = self.kb_id = create_knowledge_base(session, self.name)
            head = lock_head(session, kb_id)
            if head is None:
                raise vanished(session)
            yield session, kb_id, head
        finally:
            end_session(session)


@contextmanager
def reading(backend: Backend) -> Iterator[Session]:
    """Open a read transaction for the length of a `with` block."""
    session = backend.session()
    try:
        session.begin(write=False)
        yield session
    finally:
        end_session(session)


def open_store(url: str, source: Backend, noun: str) -> Backend:
    """Open the store that a source is replicated into; a new SQLite file is created."""
    backend = create_backend(url)
    try:
        place = _place(backend)
        if not place[1]:
            raise ConflictError(
                f"{backend.label}: {noun} in memory ends with this process; name a file or a server"
            )
        if _is_same(place, _place(source)):
            raise ConflictError(
                f"{backend.label}: source and target are the same store; name another one"
            )
        ensure_schema(backend)
    except BaseException:
        backend.close()
        raise
    return backend


@contextmanager
def open_target(url: str, name: str, source: Backend, noun: str) -> Iterator[Target]:
    """Open a knowledge base of another store for the length of a `with` block."""
    with closing(open_store(url, source, noun)) as backend:
        yield Target(backend, name)


def _place(backend: Backend) -> tuple[str, str]:
    """Return what identifies a database among those of its kind, or nothing for one in memory."""
    with backend.open_session() as session:
        row = session.first(_PLACE)
        return backend.dialect.name, str(row[0] or "") if row else ""


def _is_same(place: tuple[str, str], other: tuple[str, str]) -> bool:
    """Whether two places are one; a file may have several names."""
    if place[0] != other[0]:
        return False
    with suppress(OSError):
        return place[1] == other[1] or os.path.samefile(place[1], other[1])
    # Of a server, a place is not a file.
    return False

"""The other store of a replication, and the comparison of two histories."""

from __future__ import annotations

import os
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import select

from ...errors import (
    ConflictError,
    DivergedError,
    KantSqlError,
    StoreIntegrityError,
    missing_revision,
)
from ...sql.dialects import create_backend
from ...sql.dialects.base import Backend, Session
from ...sql.query import Query, StorePlace
from ...sql.rows import KB, table_of
from ...sql.schema import ensure_schema
from ...sql.tables import ArchiveRow, HeadRow
from ...store.head import (
    Head,
    check_numbers,
    create_knowledge_base,
    find_knowledge_base,
    hash_of,
    lock_head,
    to_time_of_head,
)
from ...store.snapshot import LAST_ERASURE, vanished
from ...store.store import end_session
from .copy import Stores


class HeadState(NamedTuple):
    """The head of one side of a replication, read without its lock."""

    revision: int  # the last revision; 0 before the first
    definition_revision: int  # the last revision that changed a definition
    next_id: int  # the id of the next element
    archived_revision: int  # versions that ended up to this revision were moved to an archive
    hash: str | None  # the last revision's hash
    committed_at: datetime | None  # the last revision's time
    origin: str | None  # the store of its origin; None if it is not a replica
    erased: int  # the revision of the last erasure; 0 without one


_HEAD = table_of(HeadRow).c
_STATE = Query(
    select(
        *(_HEAD[name] for name in HeadState._fields[:-1]),
        LAST_ERASURE,
    ).where(_HEAD.kb_id == KB)
)


def read_state(session: Session, kb_id: int | None) -> HeadState:
    """Read the head of a knowledge base, in one statement."""
    if kb_id is None:
        return HeadState(0, 0, 0, 0, None, None, None, 0)
    row: Any = session.first(_STATE, kb=kb_id)
    if row is None:
        raise vanished(session)
    check_numbers(session, kb_id, zip(HeadState._fields, row[:4], strict=False))
    committed_at = to_time_of_head(session, kb_id, row[5])
    return HeadState._make((*row[:5], committed_at, row[6], row[7] or 0))


_LAST_TARGET = Query(
    select(ArchiveRow.target)
    .where(ArchiveRow.kb_id == KB)
    .order_by(ArchiveRow.revision.desc(), ArchiveRow.id.desc())
)


def last_archive(session: Session, kb_id: int) -> str | None:
    """Read the place of the last archive."""
    row = session.first(_LAST_TARGET, kb=kb_id)
    return None if row is None else str(row[0])


def first_difference(stores: Stores, upto: int) -> int:
    """Find the first revision with another hash by binary search: each covers all before it."""
    source, source_kb, target, target_kb = stores

    def differs(number: int) -> bool:
        return hash_of(source, source_kb, number) != hash_of(target, target_kb, number)

    return 1 + bisect_left(range(1, upto), True, key=differs)


def diverged(stores: Stores, name: str, upto: int) -> KantSqlError:
    """Make the error for two histories with different hashes of a revision."""
    source, source_kb, target, target_kb = stores
    number = first_difference(stores, upto)
    here, there = hash_of(source, source_kb, number), hash_of(target, target_kb, number)
    for found, side, kb_id in ((there, target, target_kb), (here, source, source_kb)):
        # An archive may have more revisions than the source.
        if found is None and read_state(side, kb_id).revision >= number:
            return missing_revision(side.backend.label, name, number)
    if here == there:
        # Only heads differ: one of them does not have the hash of its last revision.
        return StoreIntegrityError(
            f"{target.backend.label} and {source.backend.label}: the heads of knowledge base "
            f"{name!r} differ at revision {upto}, and all revisions up to there are the same; "
            "nothing was written: 'kant-sql verify' shows which head was changed by hand"
        )
    label, there_is, here_is = target.backend.label, there or "missing", here or "missing"
    return DivergedError(
        f"{label}: it has another knowledge base {name!r}, or one that was written to: the first "
        f"revision that differs is {number}, whose hash is {there_is} there and {here_is} in "
        f"{source.backend.label}; nothing was written: name another store, or a copy that was not "
        "written to",
        number,
        here,
        there,
    )


_PLACE = Query(select(StorePlace()))


class ReplicationSide:
    """A knowledge base in one of the two stores."""

    def __init__(self, backend: Backend, name: str) -> None:
        self.backend = backend
        self.name = name
        self.kb_id: int | None = None  # its id, once known

    def find(self, session: Session) -> int | None:
        """Return its id; None before its first revision."""
        if self.kb_id is None:
            self.kb_id = find_knowledge_base(session, self.name)
        return self.kb_id


class Target(ReplicationSide):
    """A knowledge base in the store that is written to."""

    @contextmanager
    def locked(self, durable: bool = False) -> Iterator[tuple[Session, int, Head]]:
        """Lock it against other writers during a `with` block; create it if missing."""
        with begin_on(self.backend, write=True, durable=durable) as session:
            kb_id = self.find(session)
            if kb_id is None:
                kb_id = self.kb_id = create_knowledge_base(session, self.name)
            head = lock_head(session, kb_id)
            if head is None:
                raise vanished(session)
            yield session, kb_id, head


@contextmanager
def begin_on(backend: Backend, *, write: bool = False, durable: bool = False) -> Iterator[Session]:
    """Open a transaction during a `with` block; at its end, roll back uncommitted changes."""
    # With `durable`, commits survive a power cut.
    session = backend.session()
    try:
        if durable:
            session.make_durable()
        session.begin(write=write)
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
    """Open a knowledge base of another store during a `with` block."""
    with closing(open_store(url, source, noun)) as backend:
        yield Target(backend, name)


def _place(backend: Backend) -> tuple[str, str]:
    """Return what identifies a database among those of its kind; empty for one in memory."""
    with backend.open_session() as session:
        row = session.first(_PLACE)
        return backend.dialect.name, str(row[0] or "") if row else ""


def _is_same(place: tuple[str, str], other: tuple[str, str]) -> bool:
    """Whether two places are one; a file may have several names."""
    if place[0] != other[0]:
        return False
    with suppress(OSError):
        return place[1] == other[1] or os.path.samefile(place[1], other[1])
    # The place of a server is not a file.
    return False

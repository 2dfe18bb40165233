"""Compares the histories of a knowledge base in two stores, by their chained hashes."""

from __future__ import annotations

from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import select

from ...errors import (
    DivergedError,
    KantSqlError,
    StoreIntegrityError,
    missing_revision,
)
from ...sql.dialects.base import Session
from ...sql.query import Query
from ...sql.rows import KB
from ...sql.tables import ArchiveRow, HeadRow
from ...store.head import check_numbers, hash_of, to_time_of_head
from ...store.snapshot import vanished
from .copy import Stores

_NUMBERS = ("revision", "definition_revision", "next_id", "archived_revision")
_STATE = Query(
    select(
        HeadRow.revision,
        HeadRow.definition_revision,
        HeadRow.next_id,
        HeadRow.archived_revision,
        HeadRow.hash,
        HeadRow.committed_at,
        HeadRow.origin,
    ).where(HeadRow.kb_id == KB)
)


class HeadState(NamedTuple):
    """Where a knowledge base stands, read without its lock.

    Attributes:
        revision: the last revision; 0 before the first.
        definition_revision: the last revision that changed a definition.
        next_id: the id that the next element gets.
        archived_revision: what ended up to this revision was moved to an archive.
        hash: the last revision's hash.
        committed_at: the last revision's time.
        origin: the store that it is replicated from; None when it is written here.
    """

    revision: int
    definition_revision: int
    next_id: int
    archived_revision: int
    hash: str | None
    committed_at: datetime | None
    origin: str | None


NOTHING = HeadState(0, 0, 0, 0, None, None, None)


def read_state(session: Session, kb_id: int | None) -> HeadState:
    """Read where a knowledge base stands, in one statement."""
    if kb_id is None:
        return NOTHING
    row: Any = session.first(_STATE, kb=kb_id)
    if row is None:
        raise vanished(session)
    check_numbers(session, kb_id, zip(_NUMBERS, row[:4], strict=True))
    committed_at = to_time_of_head(session, kb_id, row[5])
    return HeadState._make((*row[:5], committed_at, row[6]))


_LAST_TARGET = Query(
    select(ArchiveRow.target)
    .where(ArchiveRow.kb_id == KB)
    .order_by(ArchiveRow.revision.desc(), ArchiveRow.id.desc())
)


def last_archive(session: Session, kb_id: int) -> str | None:
    """Read where the last versions were moved to."""
    row = session.first(_LAST_TARGET, kb=kb_id)
    return None if row is None else str(row[0])


def first_difference(stores: Stores, upto: int) -> int:
    """Find the first revision with another hash, by a binary search: each covers all before it."""
    source, source_kb, target, target_kb = stores
    low, high = 1, upto
    while low < high:
        middle = (low + high) // 2
        if hash_of(source, source_kb, middle) == hash_of(target, target_kb, middle):
            low = middle + 1
        else:
            high = middle
    return low


def diverged(stores: Stores, name: str, upto: int) -> KantSqlError:
    """Build the error for two histories whose hashes of a revision differ."""
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

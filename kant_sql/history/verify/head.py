"""Compares the head and the archives with the chain."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import Select, func, or_, select, union_all

from ...knowledge.canonical import archive_text
from ...sql.dialects.base import Session
from ...sql.query import Query
from ...sql.rows import KB, KIND_TABLES, table_of
from ...sql.tables import (
    ArchiveRow,
    FunctionValueRow,
    HeadRow,
    KnowledgeBaseRow,
    PlanRow,
    PropositionRow,
)
from .chain import Chain, moment_text
from .findings import Report

_HEAD, _ARCHIVE = table_of(HeadRow).c, table_of(ArchiveRow).c
_KB = table_of(KnowledgeBaseRow).c


class _HeadRow(NamedTuple):
    """A row of `head`; its values are checked here, so they may be of any type."""

    revision: Any
    definition_revision: Any
    next_id: Any
    hash: Any
    committed_at: Any
    archived_revision: Any


_READ_HEAD = Query(select(*(_HEAD[name] for name in _HeadRow._fields)).where(_HEAD.kb_id == KB))
# Read before any check: a damaged value in another column must not be in its way.
_HOW_FAR = Query(select(_HEAD.revision, _HEAD.next_id).where(_HEAD.kb_id == KB))
_SELF = table_of(KnowledgeBaseRow).alias("self").c
_NAMES_OF_IT = select(_SELF.name).where(_SELF.id == KB)
_OWN = Query(
    union_all(
        select(func.count()).where(or_(_KB.id == KB, _KB.name.in_(_NAMES_OF_IT))),
        select(func.count()).where(_HEAD.kb_id == KB),
    )
)


def _largest(columns: list[Any]) -> Query:
    """Read the largest value of some columns, each by its index."""
    values: list[Select[Any]] = [
        select(func.max(column)).where(column.table.c.kb_id == KB) for column in columns
    ]
    return Query(union_all(*values))


_IDS = _largest(
    [
        *(tables.identity.c.id for tables in KIND_TABLES.values()),
        *(
            table_of(mapped).c.id
            for mapped in (PropositionRow, FunctionValueRow, PlanRow, ArchiveRow)
        ),
    ]
)
_DEFINED = _largest(
    [
        column
        for tables in KIND_TABLES.values()
        for column in (tables.version.table.c.since, tables.version.table.c.until)
    ]
)


class Archive(NamedTuple):
    """The record of an archive.

    Attributes:
        id: its id.
        since: the revision that recorded it.
        revision: versions that ended up to this revision were moved.
        target: where to.
        versions: how many.
        rest: the hash of what was left.
        text: the canonical text of all.
    """

    id: int
    since: int
    revision: int
    target: str
    versions: int
    rest: str
    text: str

    @property
    def is_possible(self) -> bool:
        """Whether it was recorded after the versions it moved; else its own record is unchecked."""
        return self.since > self.revision


_READ_ARCHIVES = Query(
    select(*(_ARCHIVE[name] for name in Archive._fields))
    .where(_ARCHIVE.kb_id == KB)
    .order_by(_ARCHIVE.since)
)


def _read_head(session: Session, kb_id: int) -> _HeadRow | None:
    row = session.first(_READ_HEAD, kb=kb_id)
    return None if row is None else _HeadRow(*row)


def check_rows_of(session: Session, kb_id: int, report: Report) -> None:
    """Check that the knowledge base has one row, and one head."""
    for table, rows in zip(("knowledge_base", "head"), session.rows(_OWN, kb=kb_id), strict=True):
        if rows[0] != 1:
            report.add(None, table, f"{table} has {rows[0]} rows of the knowledge base, not one")


def read_archives(session: Session, kb_id: int) -> list[Archive]:
    """Read the records of archives."""
    return [Archive(*row) for row in session.rows(_READ_ARCHIVES, kb=kb_id)]


def archived_upto(head: int, archives: list[Archive]) -> int:
    """Return the revision up to which ended versions are in an archive."""
    possible = [archive.revision for archive in archives if archive.is_possible]
    return max(possible, default=0) if head else 0


def read_archived(session: Session, kb_id: int, archives: list[Archive]) -> int:
    """Read the revision up to which ended versions are in an archive."""
    head = _read_head(session, kb_id)
    return archived_upto(0 if head is None else head.archived_revision, archives)


def read_next_id(session: Session, kb_id: int) -> tuple[int, int]:
    """Read the last revision and the next id from the head."""
    head = session.first(_HOW_FAR, kb=kb_id) or (0, 0)
    # Later checks report wrong values: this only measures progress.
    revision, next_id = (each if isinstance(each, int) else 0 for each in head)
    return max(revision, 0), max(next_id, 0)


def check_head(
    session: Session, kb_id: int, chain: Chain, archives: list[Archive], report: Report
) -> None:
    """Compare the head with the chain, and archives with what is left."""
    head = _read_head(session, kb_id)
    if head is None:
        return
    _check_last(session, head, chain, report)
    for archive in archives:
        _, since, upto, target, versions, rest, text = archive
        if archive_text(archive.id, upto, target, versions, rest) != text:
            message = f"the columns of archive {archive.id} are not what its text says"
            report.add(since, "archive", message)
        if not archive.is_possible:
            message = f"archive {archive.id} was recorded before revision {upto}, which it moved"
            report.add(since, "archive", message)
    archived = archived_upto(head.archived_revision, archives)
    if head.archived_revision != archived:
        report.add(
            None,
            "head",
            f"archived_revision is {head.archived_revision}, and the last archive is of revision "
            f"{archived}",
        )
    _check_numbers(session, kb_id, head, archived, report)
    if archived and archives[-1].rest != chain.rest:
        report.add(
            None,
            "archive",
            f"what is left of the revisions up to {archived} is not what was left when the others "
            f"were moved to {archives[-1].target}: a revision, or what it changed, was altered, "
            "removed or added",
        )


def _check_last(session: Session, head: _HeadRow, chain: Chain, report: Report) -> None:
    last = chain.last
    expected = (0, None, None) if last is None else (last.number, last.hash, last.committed_at)
    try:
        moment = None if head.committed_at is None else moment_text(session, head.committed_at)
    except (TypeError, ValueError):
        moment = "no time"
    for name, given, wanted in zip(
        ("revision", "hash", "committed_at"),
        (head.revision, head.hash, moment),
        expected,
        strict=True,
    ):
        if given != wanted:
            shown = "none" if wanted is None else wanted
            message = f"{name} is {given}, and that of the last revision is {shown}"
            report.add(_first_lost(name, head, expected), "head", message)


def _first_lost(name: str, head: _HeadRow, expected: tuple[Any, ...]) -> int | None:
    """Return the first missing revision, when the head is beyond the chain."""
    beyond = name == "revision" and isinstance(head.revision, int) and head.revision > expected[0]
    return int(expected[0]) + 1 if beyond else None


def _check_numbers(
    session: Session, kb_id: int, head: _HeadRow, archived: int, report: Report
) -> None:
    largest = max((row[0] or 0 for row in session.rows(_IDS, kb=kb_id)), default=0)
    if head.next_id <= largest:
        report.add(None, "head", f"next_id is {head.next_id}, and {largest} is given out already")
    defined = max((row[0] or 0 for row in session.rows(_DEFINED, kb=kb_id)), default=0)
    # The last change of a definition may be in an archive.
    if head.definition_revision != defined and not (defined < head.definition_revision <= archived):
        report.add(
            None,
            "head",
            f"definition_revision is {head.definition_revision}, and {defined} last changed a "
            "definition",
        )

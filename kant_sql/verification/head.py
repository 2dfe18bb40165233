"""The head and the archives, against the chain."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import (
    Select,
    func,
    or_,
    select,
    union_all,
)

from ..backends import Query, Row, Session
from ..knowledge.archive import archive_text
from ..knowledge.loading import KB
from ..knowledge.rows import KIND_TABLES, table_of
from ..tables import (
    ArchiveRow,
    FunctionValueRow,
    HeadRow,
    KnowledgeBaseRow,
    PlanRow,
    PropositionRow,
)
from .chain import Chain
from .checkpoints import moment_text
from .findings import Report

_HEAD, _ARCHIVE = table_of(HeadRow).c, table_of(ArchiveRow).c
_KB = table_of(KnowledgeBaseRow).c

_READ_HEAD = Query(
    select(
        _HEAD.revision,
        _HEAD.definition_revision,
        _HEAD.next_id,
        _HEAD.hash,
        _HEAD.committed_at,
        _HEAD.archived_revision,
    ).where(_HEAD.kb_id == KB)
)
# By itself, for this is read before anything is checked: no other column may be in its way.
_HOW_FAR = Query(select(_HEAD.revision, _HEAD.next_id).where(_HEAD.kb_id == KB))
_SELF = table_of(KnowledgeBaseRow).alias("self").c
_NAMES_OF_IT = select(_SELF.name).where(_SELF.id == KB)
_OWN = Query(
    union_all(
        select(func.count()).where(or_(_KB.id == KB, _KB.name.in_(_NAMES_OF_IT))),
        select(func.count()).where(_HEAD.kb_id == KB),
    )
)
_READ_ARCHIVES = Query(
    select(
        _ARCHIVE.id,
        _ARCHIVE.since,
        _ARCHIVE.revision,
        _ARCHIVE.target,
        _ARCHIVE.versions,
        _ARCHIVE.rest,
        _ARCHIVE.text,
    )
    .where(_ARCHIVE.kb_id == KB)
    .order_by(_ARCHIVE.since)
)


def _largest(columns: list[Any]) -> Query:
    """Read the largest value of some columns, each by the index that begins with it."""
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
    """A move into an archive, as it was recorded.

    Attributes:
        id: its id.
        since: the revision that recorded it.
        revision: what ended up to this revision was moved.
        target: where to.
        versions: how many.
        rest: the hash of what was left.
        text: all of it.
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
        """Whether it was recorded after what it moved: else its own record is not hashed anew."""
        return self.since > self.revision


def check_rows_of(session: Session, kb_id: int, report: Report) -> None:
    """Check that there is one row of the knowledge base, and one head.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        report: takes what is wrong.
    """
    for table, rows in zip(("knowledge_base", "head"), session.rows(_OWN, kb=kb_id), strict=True):
        if rows[0] != 1:
            report.add(None, table, f"{table} has {rows[0]} rows of the knowledge base, not one")


def read_archives(session: Session, kb_id: int) -> list[Archive]:
    """Read what was moved elsewhere.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.

    Returns:
        The archives, oldest first.
    """
    return [Archive(*row) for row in session.rows(_READ_ARCHIVES, kb=kb_id)]


def archived_upto(head: int, archives: list[Archive]) -> int:
    """Tell up to which revision what ended is missing here.

    Args:
        head: what the head says of it. An archive itself has the records of the store that it is
            of, and all that they say was moved: its head says 0, and every hash must be right.
        archives: what was moved elsewhere.

    Returns:
        The revision; 0 when nothing is missing.
    """
    possible = [archive.revision for archive in archives if archive.is_possible]
    return max(possible, default=0) if head else 0


def read_archived(session: Session, kb_id: int, archives: list[Archive]) -> int:
    """Read up to which revision what ended is missing here.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        archives: what was moved elsewhere.

    Returns:
        The revision; 0 when nothing is missing.
    """
    head = session.first(_READ_HEAD, kb=kb_id)
    return archived_upto(0 if head is None else head[5], archives)


def read_next_id(session: Session, kb_id: int) -> tuple[int, int]:
    """Read how far a knowledge base has come, as its head says.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.

    Returns:
        The last revision, and the id that the next element gets.
    """
    head = session.first(_HOW_FAR, kb=kb_id) or (0, 0)
    # Whatever stands there is looked at later: this only tells how much there is to do.
    revision, next_id = (each if isinstance(each, int) else 0 for each in head)
    return max(revision, 0), max(next_id, 0)


def check_head(
    session: Session, kb_id: int, chain: Chain, archives: list[Archive], report: Report
) -> None:
    """Compare the head with the chain, and archives with what is left here.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        chain: what the chain pass has learned.
        archives: what was moved elsewhere.
        report: takes what is wrong.
    """
    head = session.first(_READ_HEAD, kb=kb_id)
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
    archived = archived_upto(head[5], archives)
    if head[5] != archived:
        report.add(
            None,
            "head",
            f"archived_revision is {head[5]}, and the last archive is of revision {archived}",
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


def _check_last(session: Session, head: Row, chain: Chain, report: Report) -> None:
    last = chain.last
    expected = (0, None, None) if last is None else (last.number, last.hash, last.committed_at)
    try:
        moment = None if head[4] is None else moment_text(session, head[4])
    except (TypeError, ValueError):
        moment = "no time"
    for name, given, wanted in zip(
        ("revision", "hash", "committed_at"), (head[0], head[3], moment), expected, strict=True
    ):
        if given != wanted:
            shown = "none" if wanted is None else wanted
            message = f"{name} is {given}, and that of the last revision is {shown}"
            report.add(_first_lost(name, head, expected), "head", message)


def _first_lost(name: str, head: Row, expected: tuple[Any, ...]) -> int | None:
    """Give the first revision that is gone, when the head is beyond the chain."""
    beyond = name == "revision" and isinstance(head[0], int) and head[0] > expected[0]
    return int(expected[0]) + 1 if beyond else None


def _check_numbers(session: Session, kb_id: int, head: Row, archived: int, report: Report) -> None:
    largest = max((row[0] or 0 for row in session.rows(_IDS, kb=kb_id)), default=0)
    if head[2] <= largest:
        report.add(None, "head", f"next_id is {head[2]}, and {largest} is given out already")
    defined = max((row[0] or 0 for row in session.rows(_DEFINED, kb=kb_id)), default=0)
    # What was moved elsewhere may have been the last definition that changed.
    if head[1] != defined and not (defined < head[1] <= archived):
        report.add(
            None,
            "head",
            f"definition_revision is {head[1]}, and {defined} last changed a definition",
        )

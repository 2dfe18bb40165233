"""Compares the head and the archives with the chain."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import Select, func, or_, select, union_all

from ...knowledge.canonical import archive_text, promotion_text
from ...sql import tables as t
from ...sql.executions import NO_PLAN
from ...sql.query import Query, constant
from ...sql.rows import KB, KIND_TABLES, columns_of, table_of
from .chain import Chain, moment_text
from .sides import Check

_HEAD = table_of(t.HeadRow).c
_KB = table_of(t.KnowledgeBaseRow).c


class _HeadRow(NamedTuple):
    """A row of `head`; not checked yet, so values may have any type."""

    revision: Any
    definition_revision: Any
    next_id: Any
    hash: Any
    committed_at: Any
    archived_revision: Any


_READ_HEAD = columns_of(table_of(t.HeadRow), _HeadRow._fields)
# Read before any check, so without columns that may be damaged.
_HOW_FAR = columns_of(table_of(t.HeadRow), ("revision", "next_id"))
_SELF = table_of(t.KnowledgeBaseRow).alias("self").c
_NAMES_OF_IT = select(_SELF.name).where(_SELF.id == KB)
_OWN = Query(
    union_all(
        select(func.count()).where(or_(_KB.id == KB, _KB.name.in_(_NAMES_OF_IT))),
        select(func.count()).where(_HEAD.kb_id == KB),
    )
)


def _largest(columns: list[Any], *others: Select[Any]) -> Query:
    """Read the maximum of some columns, each by its index."""
    values: list[Select[Any]] = [
        select(func.max(column)).where(column.table.c.kb_id == KB) for column in columns
    ]
    return Query(union_all(*values, *others))


_OTHERS: tuple[type[t.Base], ...] = (
    *(t.PropositionRow, t.FunctionValueRow, t.PlanRow),
    *(t.ArchiveRow, t.PromotionRow, t.ErasureRow),
)
_IDENTITIES = [kind.identity for kind in KIND_TABLES.values()] + [*map(table_of, _OTHERS)]
_EXECUTION = table_of(t.ExecutionRow).c
# An execution without a plan has an id from the head; a step has a position.
_OF_NO_PLAN = _EXECUTION.kb_id == KB, _EXECUTION.plan_id == constant(NO_PLAN)
_IDS = _largest(
    [table.c.id for table in _IDENTITIES], select(func.max(_EXECUTION.position)).where(*_OF_NO_PLAN)
)
_VERSIONS = [kind.version.table.c for kind in KIND_TABLES.values()]
_ERASURE = table_of(t.ErasureRow).c
# Caches of definitions are read again after an erasure, as after a change of a definition.
_DEFINED = _largest(
    [*(end for version in _VERSIONS for end in (version.since, version.until)), _ERASURE.since]
)


class Archive(NamedTuple):
    """The record of an archive."""

    id: int
    since: int  # the revision that recorded it
    revision: int  # versions that ended up to this revision were moved
    target: str
    versions: int
    rest: str  # the hash of the rest
    text: str  # the canonical text of all columns

    @property
    def is_possible(self) -> bool:
        """Whether it was recorded after the moved versions; if not, its own record is unchecked."""
        return self.since > self.revision


_READ_ARCHIVES = columns_of(table_of(t.ArchiveRow), Archive._fields, "since")
_PROMOTION = "id", "since", "revision", "origin", "text"
_READ_PROMOTIONS = columns_of(table_of(t.PromotionRow), _PROMOTION, "since")


def _read_head(check: Check) -> _HeadRow | None:
    row = check.session.first(_READ_HEAD, kb=check.kb_id)
    return None if row is None else _HeadRow(*row)


def check_rows_of(check: Check) -> None:
    """Check that the knowledge base has one row, and one head."""
    for table, (count,) in zip(("knowledge_base", "head"), check.rows(_OWN), strict=True):
        if count != 1:
            message = f"{table} has {count} rows of the knowledge base, not one"
            check.report.add(None, table, message)


def read_archives(check: Check) -> list[Archive]:
    """Read the records of archives."""
    return [Archive(*row) for row in check.rows(_READ_ARCHIVES)]


def read_archived(check: Check, archives: list[Archive]) -> int:
    """Read the revision up to which ended versions are in an archive."""
    head = _read_head(check)
    possible = [archive.revision for archive in archives if archive.is_possible]
    return 0 if head is None or not head.archived_revision else max(possible, default=0)


def read_head_numbers(check: Check) -> tuple[int, int]:
    """Read the last revision and the next id from the head."""
    head = check.session.first(_HOW_FAR, kb=check.kb_id) or (0, 0)
    # Later checks report wrong values: here they only measure progress.
    revision, next_id = (each if isinstance(each, int) else 0 for each in head)
    return max(revision, 0), max(next_id, 0)


def check_head(check: Check, chain: Chain, archives: list[Archive]) -> None:
    """Compare the head with the chain, and the archives with the rest of their revisions."""
    head, add = _read_head(check), check.report.add
    if head is None:
        return
    _check_last(check, head, chain)
    for archive in archives:
        id_, since, upto, target, versions, rest, text = archive
        if archive_text(id_, upto, target, versions, rest) != text:
            add(since, "archive", f"the columns of archive {id_} differ from its text")
        if not archive.is_possible:
            message = f"archive {id_} was recorded before revision {upto}, which it moved"
            add(since, "archive", message)
    if head.archived_revision != chain.archived:
        message = f"archived_revision is {head.archived_revision}, and the last archive is of "
        add(None, "head", f"{message}revision {chain.archived}")
    _check_numbers(check, head, chain.archived)
    if chain.archived and not check.after and archives[-1].rest != chain.rest:
        add(
            None,
            "archive",
            f"the rest of the revisions up to {chain.archived} differs from that when versions "
            f"were moved to {archives[-1].target}: a revision, or one of its changes, was altered, "
            "removed or added",
        )


def check_promotions(check: Check) -> None:
    """Compare the columns of promotions with their texts, which the chain covers."""
    for id_, since, upto, origin, text in check.rows(_READ_PROMOTIONS):
        if promotion_text(id_, upto, origin) != text or upto != since - 1:
            message = f"the columns of promotion {id_} differ from its text"
            check.report.add(since, "promotion", message)


def _check_last(check: Check, head: _HeadRow, chain: Chain) -> None:
    last = chain.last
    number, *others = (
        (0, None, None) if last is None else (last.number, last.hash, last.committed_at)
    )
    try:
        moment = head.committed_at and moment_text(check.session, head.committed_at)
    except (TypeError, ValueError):
        moment = "no time"
    # The first missing revision if the head is beyond the chain.
    is_beyond = isinstance(head.revision, int) and head.revision > number
    lost = {"revision": number + 1} if is_beyond else {}
    names, given = ("revision", "hash", "committed_at"), (head.revision, head.hash, moment)
    for name, value, wanted in zip(names, given, (number, *others), strict=True):
        if value != wanted:
            shown = "none" if wanted is None else wanted
            message = f"{name} is {value}, and that of the last revision is {shown}"
            check.report.add(lost.get(name), "head", message)


def _check_numbers(check: Check, head: _HeadRow, archived: int) -> None:
    largest, defined = (
        max((row[0] or 0 for row in check.rows(query)), default=0) for query in (_IDS, _DEFINED)
    )
    if head.next_id <= largest:
        message = f"next_id is {head.next_id}, and {largest} is given out already"
        check.report.add(None, "head", message)
    # The last change of a definition may be in an archive.
    if head.definition_revision != defined and not (defined < head.definition_revision <= archived):
        message = f"definition_revision is {head.definition_revision}, and {defined} last changed "
        check.report.add(None, "head", f"{message}a definition")

"""Verification, and the last verified revision, from which the next one can continue.

Anybody who may write its table can forge it: the kept revision saves time, but proves nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from typing import NamedTuple, TypeVar

from sqlalchemy import bindparam, func, null, or_, select, update

from ... import html
from ...arguments import Progress, flag, optional_call
from ...errors import (
    UNREADABLE,
    ConflictError,
    InvalidArgumentError,
    NotADatabaseError,
    ReadOnlyError,
    StatementTimeoutError,
    StoreError,
    StoreFullError,
    StoreIntegrityError,
    TransactionOpenError,
)
from ...knowledge.canonical import time_text
from ...sql.dialects.base import PASSING, Row, Session
from ...sql.query import Query, constant, integer, whole_rows
from ...sql.rows import KB, columns_of, table_of
from ...sql.tables import ArchiveRow, ErasureRow, VerificationRow
from ...store.head import hash_of
from ...store.state import State
from ...store.store import Store
from ..anchors import Anchor, AnchoredHead, check_anchor
from .chain import Chain
from .definition_check import DefinitionCheck, ObjectFunctions, check_names
from .erasures import Erasure, ErasureCheck, read_erasures
from .facts import ExecutionCheck, FactCheck, check_confirmations, check_plans
from .head import (
    Archive,
    check_head,
    check_promotions,
    check_rows_of,
    read_archived,
    read_archives,
    read_head_numbers,
)
from .sides import Check, Finding, Report
from .structure import check_generated, check_indexes, check_strays, check_structure, check_types

_ROW = VerificationRow
# The revision of the mark that a verification with a finding leaves.
_FAULT = 0
_READ = columns_of(table_of(_ROW), ("revision", "hash", "verified_at", "complete_at"))
# The revisions of the last archive and the last erasure.
_LAST_RECORDS = tuple(
    Query(select(func.max(row.since)).where(row.kb_id == KB)) for row in (ArchiveRow, ErasureRow)
)
# A verification that began earlier, on an older state, does not replace what a later one kept, nor
# the mark of one that found a fault after it began.
_MOVE = Query(
    update(_ROW)
    .where(
        _ROW.kb_id == KB,
        _ROW.revision <= integer("number"),
        or_(_ROW.revision != constant(_FAULT), _ROW.verified_at == bindparam("seen")),
    )
    .values(
        revision=bindparam("number"),
        hash=bindparam("digest"),
        verified_at=bindparam("now"),
        complete_at=bindparam("complete"),
    )
)
_MARK = Query(
    update(_ROW)
    .where(_ROW.kb_id == KB)
    .values(
        revision=constant(_FAULT),
        hash=constant(""),
        verified_at=bindparam("now"),
        complete_at=null(),
    )
)


class Kept(NamedTuple):
    """The last kept verification of a knowledge base."""

    revision: int  # the last revision at that time
    hash: str  # its hash at that time
    verified_at: datetime  # the time itself
    # the end of the last kept verification that began at revision 1; None if there is none
    complete_at: datetime | None


def _kept_in(session: Session, row: Row) -> Kept | None:
    """Return the last kept verification; None if there is none, or it cannot be read."""
    number, digest, verified_at, complete_at = row
    try:
        moments = (
            session.to_time(verified_at),
            None if complete_at is None else session.to_time(complete_at),
        )
    except UNREADABLE:
        return None
    if type(number) is not int or number < 1 or not isinstance(digest, str):
        return None
    return Kept(number, digest, *moments)


def keep(
    store: Store, kb_id: int, number: int, digest: str, before: Kept | None, seen: object = None
) -> None:
    """Keep the last verified revision.

    `before` is the continued verification, None if this one is complete; `seen` the time of the row
    when this one began.
    """

    def write(session: Session) -> None:
        now = session.from_time(store.clock(session))
        last = None if before is None else before.complete_at
        complete = now if before is None else last and session.from_time(last)
        given = {"number": number, "digest": digest, "now": now, "complete": complete}
        if session.run(_MOVE, kb=kb_id, seen=seen, **given):
            return
        row = session.first(_READ, kb=kb_id)
        if row is None:
            session.insert(whole_rows(table_of(_ROW)), [(kb_id, number, digest, now, complete)])
        elif row[0] == _FAULT:
            raise ConflictError(
                f"{store.backend.label}: another verification found a fault meanwhile; verify again"
            )

    _write_row(store, write)


def forget(store: Store, kb_id: int) -> None:
    """Forget the last verified revision: the next verification begins at revision 1."""

    def write(session: Session) -> None:
        now = session.from_time(store.clock(session))
        if not session.run(_MARK, kb=kb_id, now=now):
            session.insert(whole_rows(table_of(_ROW)), [(kb_id, _FAULT, "", now, None)])

    _write_row(store, write)


def _write_row(store: Store, write: Callable[[Session], None]) -> None:
    """Write the kept row, again if another verification has inserted it at the same moment."""
    try:
        store.write_beside(write)
    except StoreIntegrityError:
        store.write_beside(write)


T = TypeVar("T")

_WRONG_VALUES = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
# The kept revision only saves time: these errors leave the verdict as it is.
_NOT_KEPT = (
    *PASSING,
    ConflictError,
    ReadOnlyError,
    StatementTimeoutError,
    StoreFullError,
    TransactionOpenError,
)
# The number of progress reports.
_REPORTS = 200


@dataclass(frozen=True)
class Verification:
    """The result of a verification.

    Attributes:
        knowledge_base: the name.
        revisions: the number of checked revisions.
        changes: the number of hashed changes.
        findings: the faults, by revision.
        archives: the archives and their contents, in words.
        erasures: the erasures and their revisions, in words.
        anchored: the revision that was compared with an anchor, or None.
        continued_from: the last revision of the continued verification; None if it began at
            revision 1.
        continued_at: the time of that verification, in UTC.
        complete_at: the time of the last kept verification that began at revision 1, before this
            one.
        is_kept: whether the next verification can continue this one; None without `keep`.
        keep_error: why the last verified revision could not be stored, or, after a finding, the
            stored one not removed.
    """

    _json_ = (
        *("knowledge_base", "revisions", "changes", "findings", "archives", "erasures", "anchored"),
        *("is_intact", "continued_from", "continued_at", "complete_at", "is_kept"),
    )

    knowledge_base: str
    revisions: int
    changes: int
    findings: tuple[Finding, ...]
    archives: tuple[str, ...] = ()
    erasures: tuple[str, ...] = ()
    anchored: int | None = None
    continued_from: int | None = None
    continued_at: datetime | None = None
    complete_at: datetime | None = None
    is_kept: bool | None = None
    keep_error: str | None = None

    @property
    def is_intact(self) -> bool:
        """Whether there are no findings."""
        return not self.findings

    def _repr_html_(self) -> str:
        checked = {
            "knowledge base": self.knowledge_base,
            "verdict": "intact" if self.is_intact else "not intact",
            "revisions": self.revisions,
            "changes": self.changes,
            "continued from revision": self.continued_from,
            "compared with an anchor at revision": self.anchored,
            "archives": self.archives,
            "erasures": self.erasures,
        }
        found = html.listing(self.findings, "finding") if self.findings else ""
        return html.fields(checked) + found


def verify(
    state: State,
    anchor: Anchor | None = None,
    *,
    progress: Progress | None = None,
    structure: bool = True,
    resume: bool = False,
    keep: bool = False,
) -> Verification:
    """Recompute every hash from the tables, and compare all redundant data.

    With `keep`, the store keeps the last revision of an intact verification; with `resume`, the
    next one continues there. It checks the rows of later revisions, and does not find alterations
    of earlier ones: run a complete verification from time to time. Anyone who may write the table
    `verification` can forge the kept revision.

    Args:
        anchor: an earlier result of `anchor()`, kept elsewhere.
        progress: called with the number of checked items, and their total.
        structure: also check indexes, constraints and views. All knowledge bases of a store
            share them, so one check per store is enough. A continued verification skips the
            indexes.
        resume: continue after the kept revision, if there is one.
        keep: keep the last verified revision, if there are no findings; otherwise remove the kept
            one, so the next verification begins at revision 1. A read-only user keeps nothing.

    Returns:
        The findings, each with the first affected revision and the difference.

    Raises:
        ReadOnlyError: the task or thread has a transaction open.

    Examples:
        >>> verification = kb.store.verify(keep=True)
        >>> verification.is_intact
        True
        >>> kb.store.verify(resume=True).continued_from == kb.revision
        True
    """
    store = state.store
    store.refuse_open(", and verification reads committed revisions")
    optional_call(progress, "progress")
    for name, value in (("structure", structure), ("resume", resume), ("keep", keep)):
        flag(value, name, InvalidArgumentError)
    anchored = None if anchor is None else check_anchor(anchor).head(store.name)

    def check(session: Session, kb_id: int | None) -> tuple[Verification, End | None]:
        report, row, kept, after = Report(), None, None, 0
        if (resume or keep) and kb_id is not None:
            row = _guarded(session, report, partial(session.first, _READ, kb=kb_id))
        if resume and row is not None:
            kept = _kept_in(session, row)
        if kept is not None and kb_id is not None:
            start = partial(_first_to_check, session, kb_id, kept)
            after = _guarded(session, report, start) or 0
        if structure:
            _guarded(session, report, partial(check_structure, session, report))
            _guarded(session, report, partial(check_generated, session, kb_id, report))
            if not after:
                _guarded(session, report, partial(check_indexes, session, report))
        done, end = verify_session(
            session, kb_id, store.name, anchored, report, kept, after, progress
        )
        return done, end and end._replace(seen=row and row[2])

    done, end = store.query_in_snapshot(check)
    return _keep(store, done, end) if keep and end is not None else done


def verify_session(
    session: Session,
    kb_id: int | None,
    name: str,
    anchored: AnchoredHead | None = None,
    report: Report | None = None,
    kept: Kept | None = None,
    after: int = 0,
    progress: Progress | None = None,
) -> tuple[Verification, End | None]:
    """Verify one knowledge base in the transaction of a session."""
    report = report or Report()
    _guarded(session, report, lambda: check_strays(session, kb_id, report))
    if kb_id is None:
        if anchored is not None:
            report.add(1, "knowledge_base", f"knowledge base {name!r} is missing")
        return Verification(
            name, 0, 0, report.findings(), anchored=anchored and anchored.revision
        ), None
    verifier = _Verifier(Check(session, kb_id, report, after), name, progress)
    done, last = verifier.run(anchored, kept), verifier.chain.last
    before = kept if after else None
    return done, None if last is None else End(kb_id, last.number, last.hash, before)


class End(NamedTuple):
    """The end of a verification, and the verification that it continued."""

    kb_id: int
    revision: int
    hash: str
    before: Kept | None
    seen: object = None  # the time of the kept row when it began


def _first_to_check(session: Session, kb_id: int, kept: Kept) -> int:
    """Return the revision to continue from; 0 to begin at revision 1."""
    is_there = hash_of(session, kb_id, kept.revision) == kept.hash
    # An archive and an erasure change the rest of earlier revisions.
    rows = (session.first(query, kb=kb_id) for query in _LAST_RECORDS)
    changed = max(row[0] if row is not None and isinstance(row[0], int) else 0 for row in rows)
    return kept.revision if is_there and changed <= kept.revision else 0


def _keep(store: Store, done: Verification, end: End) -> Verification:
    """Keep the end of an intact verification; after a fault, forget the kept one."""
    try:
        if done.is_intact:
            keep(store, *end)
        else:
            forget(store, end.kb_id)
    except (ConflictError, ReadOnlyError, StoreError) as error:
        # The table itself may have a finding.
        if done.is_intact and not isinstance(error, _NOT_KEPT):
            raise
        return replace(done, is_kept=False, keep_error=str(error))
    return replace(done, is_kept=done.is_intact)


class _Verifier:
    def __init__(self, check: Check, name: str, progress: Progress | None) -> None:
        self._check = check
        self._name = name
        self._progress = progress
        self._last, self._ids = read_head_numbers(check)
        self._told = 0
        self._archives: list[Archive] = []
        self._archived = 0
        self._erasures: list[Erasure] = []
        self.chain = Chain(check, self._tell)

    def run(self, anchored: AnchoredHead | None, kept: Kept | None) -> Verification:
        check, report = self._check, self._check.report
        known = [each.revision for each in (anchored, kept) if each is not None]
        for part in (
            partial(check_rows_of, check),
            # Only a scan of all tables finds these.
            *(() if check.after else (partial(check_types, *check[:3]),)),
            partial(self._check_chain, frozenset(known)),
            self._check_rows,
        ):
            _guarded(check.session, report, part)
        chain = self.chain
        if anchored is not None:
            place = f"anchor of {anchored.committed_at}"
            _check_anchor(check, anchored.revision, anchored.hash, place, chain)
        if kept is not None:
            place = f"verification of {time_text(kept.verified_at)}"
            _check_anchor(check, kept.revision, kept.hash, place, chain)
        self._tell(self._last + self._ids)
        return Verification(
            self._name,
            chain.revisions,
            chain.changes,
            report.findings(),
            tuple(_archive_words(archive) for archive in self._archives),
            tuple(erasure.words for erasure in self._erasures),
            anchored and anchored.revision,
            check.after or None,
            kept.verified_at if kept is not None and check.after else None,
            kept and kept.complete_at,
        )

    def _check_chain(self, wanted: frozenset[int]) -> None:
        archives = read_archives(self._check)
        archived = read_archived(self._check, archives)
        self._archived = archived
        # An archive also has the records of its own versions, which are complete there.
        self._archives = archives if archived else []
        self._erasures = read_erasures(self._check.session, self._check.kb_id)
        # Later erasures change earlier revisions, so a continued verification has none to check.
        erasures = None if self._check.after else ErasureCheck(self._check, self._erasures)
        chain = Chain(self._check, self._tell, archived, wanted, erasures=erasures)
        chain.run()
        self.chain = chain
        check_head(self._check, chain, archives)
        check_promotions(self._check)

    def _check_rows(self) -> None:
        check, names = self._check, check_names(self._check)
        functions = ObjectFunctions(check)
        for part in (
            DefinitionCheck(check, names.held, functions).run,
            FactCheck(check, names, functions, lambda id_: self._tell(self._last + id_)).run,
            ExecutionCheck(check, names, self._archived).run,
            partial(check_plans, check),
            partial(check_confirmations, check, self._archived),
        ):
            _guarded(check.session, check.report, part)

    def _tell(self, done: int) -> None:
        whole = self._last + self._ids
        if self._progress is not None and (done >= self._told or done >= whole):
            self._told = done + max(1, whole // _REPORTS)
            self._progress(min(done, whole), whole)


def _guarded(session: Session, report: Report, check: Callable[[], T]) -> T | None:
    """Run a check; a value that it cannot read is a finding, not an error."""
    savepoint, fault, found = session.savepoint(), None, None
    try:
        found = check()
    except _WRONG_VALUES as error:
        fault = f"a value cannot be read: {error}"
    except NotADatabaseError as error:
        fault = f"the file is damaged: {error}"
    except StoreError as error:
        # Subclasses are errors of the connection, not of the tables.
        if type(error) is not StoreError:
            raise
        fault = f"the tables cannot be read: {error}"
    # Only now, without the error and the cursors of its frames.
    if fault is None:
        session.release(savepoint)
    else:
        session.rollback_to(savepoint)
        report.add(None, None, fault)
    return found


def _check_anchor(check: Check, number: int, digest: str, place: str, chain: Chain) -> None:
    """Compare the history with a hash that an anchor or a verification kept."""
    add = check.report.add
    found = chain.hashes.get(number)
    if found is None and number < check.after:
        # It was verified before; the stored hash must still be the anchored one.
        found = hash_of(check.session, check.kb_id, number)
        if found is None:
            add(number, "revision", f"revision {number} is missing, and is in the {place}")
    last = 0 if chain.last is None else chain.last.number
    if found is not None and found != digest:
        add(
            number,
            None,
            f"revision {number} has another hash than the {place}: the history up to it was "
            "rewritten",
        )
    elif found is None and last < number:
        add(
            last + 1,
            None,
            f"the history was cut off: it ends at revision {last}, and the {place} is of revision "
            f"{number}",
        )


def _archive_words(archive: Archive) -> str:
    if not archive.versions:
        return f"revision {archive.since} erased in the archive {archive.target} as well"
    count = "1 version" if archive.versions == 1 else f"{archive.versions} versions"
    return (
        f"{count} that ended up to revision {archive.revision} moved to {archive.target} in "
        f"revision {archive.since}: verify that store as well, because this one has only a part of "
        "the changes up to there"
    )

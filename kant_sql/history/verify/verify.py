"""Verification: recomputes every hash and compares redundant data."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from ... import html
from ...arguments import flag, optional_call
from ...dao.interfaces import Progress
from ...errors import InvalidArgumentError, NotADatabaseError, ReadOnlyError, StoreError
from ...sql.dialects.base import Session
from ...store.store import Store
from ..anchors import Anchor, AnchoredHead, check_anchor
from .chain import Chain
from .definitions import DefinitionCheck
from .facts import FactCheck, PlanCheck
from .findings import Finding, Report
from .head import Archive, check_head, check_rows_of, read_archived, read_archives, read_next_id
from .identities import ObjectFunctions, check_names
from .sides import Check
from .structure import check_generated, check_indexes, check_strays, check_structure, check_types

__all__ = ["Finding", "Progress", "Verification", "verify", "verify_session"]

_WRONG_VALUES = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
# How often progress is reported.
_REPORTS = 200


class Verification(NamedTuple):
    """The result of a verification.

    Attributes:
        knowledge_base: the name.
        revisions: how many revisions were checked.
        changes: how many changes were hashed.
        findings: the faults, by revision.
        archives: the archives and their contents, in words.
        anchored: the revision that was compared with an anchor; None when none was.
    """

    knowledge_base: str
    revisions: int
    changes: int
    findings: tuple[Finding, ...]
    archives: tuple[str, ...] = ()
    anchored: int | None = None

    @property
    def is_intact(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings

    def _repr_html_(self) -> str:
        checked = {
            "knowledge base": self.knowledge_base,
            "verdict": "intact" if self.is_intact else "not intact",
            "revisions": self.revisions,
            "changes": self.changes,
            "compared with an anchor at revision": self.anchored,
            "archives": self.archives,
        }
        found = html.listing(self.findings, "finding") if self.findings else ""
        return html.fields(checked) + found


def verify(
    store: Store, anchor: Anchor | None, progress: Progress | None, structure: bool = True
) -> Verification:
    """Verify a knowledge base; see `History.verify`."""
    if store.current() is not None:
        raise ReadOnlyError(
            f"a transaction of knowledge base {store.name!r} is open, and verification reads "
            "committed revisions; end it first"
        )
    optional_call(progress, "progress")
    flag(structure, "structure", InvalidArgumentError)
    anchored = None if anchor is None else check_anchor(anchor).head(store.name)

    def check(session: Session, kb_id: int | None) -> Verification:
        report = Report()
        if structure:
            for common in (check_structure, check_generated, check_indexes):
                _guarded(session, report, partial(common, session, report))
        return verify_session(session, kb_id, store.name, anchored, progress, report)

    return store.query_in_snapshot(check)


def verify_session(
    session: Session,
    kb_id: int | None,
    name: str,
    anchored: AnchoredHead | None = None,
    progress: Progress | None = None,
    report: Report | None = None,
) -> Verification:
    """Verify one knowledge base in the transaction of a session."""
    report = Report() if report is None else report
    _guarded(session, report, lambda: check_strays(session, kb_id, report))
    if kb_id is None:
        if anchored is not None:
            report.add(1, "knowledge_base", f"knowledge base {name!r} is missing")
        return Verification(name, 0, 0, report.findings(), anchored=_number(anchored))
    return _Verifier(Check(session, kb_id, report), name, progress).run(anchored)


class _Verifier:
    def __init__(self, check: Check, name: str, progress: Progress | None) -> None:
        self._check = check
        self._name = name
        self._progress = progress
        self._last, self._ids = read_next_id(check)
        self._told = 0
        self._archives: list[Archive] = []
        self._chain = Chain(check, self._tell)

    def run(self, anchored: AnchoredHead | None) -> Verification:
        check, report = self._check, self._check.report
        wanted = frozenset() if anchored is None else frozenset([anchored.revision])
        for part in (
            partial(check_rows_of, check),
            partial(check_types, check.session, check.kb_id, report),
            partial(self._check_chain, wanted),
            self._check_rows,
        ):
            _guarded(check.session, report, part)
        chain = self._chain
        if anchored is not None:
            _check_anchor(anchored, chain, report)
        self._tell(self._last + self._ids)
        return Verification(
            self._name,
            chain.revisions,
            chain.changes,
            report.findings(),
            tuple(_archive_words(archive) for archive in self._archives),
            _number(anchored),
        )

    def _check_chain(self, wanted: frozenset[int]) -> None:
        archives = read_archives(self._check)
        archived = read_archived(self._check, archives)
        # An archive has the records of its own versions, which are complete there.
        self._archives = archives if archived else []
        chain = Chain(self._check, self._tell, archived, wanted)
        chain.run()
        self._chain = chain
        check_head(self._check, chain, archives)

    def _check_rows(self) -> None:
        check, names = self._check, check_names(self._check)
        functions = ObjectFunctions(check)
        for part in (
            DefinitionCheck(check, names.held, functions),
            FactCheck(check, names, functions, lambda id_: self._tell(self._last + id_)),
            PlanCheck(check, names),
        ):
            _guarded(check.session, check.report, part.run)

    def _tell(self, done: int) -> None:
        whole = self._last + self._ids
        if self._progress is not None and (done >= self._told or done >= whole):
            self._told = done + max(1, whole // _REPORTS)
            self._progress(min(done, whole), whole)


def _guarded(session: Session, report: Report, check: Callable[[], None]) -> None:
    """Run a check; a value that it cannot read is a finding, not an error."""
    savepoint, fault = session.savepoint(), None
    try:
        check()
    except _WRONG_VALUES as error:
        fault = f"a value cannot be read: {error}"
    except NotADatabaseError as error:
        fault = f"the file is damaged: {error}"
    except StoreError as error:
        # Subclasses are errors of the connection, not of the tables.
        if type(error) is not StoreError:
            raise
        fault = f"the tables cannot be read: {error}"
    # After the error is gone, and with it the cursors of its frames.
    if fault is None:
        session.release(savepoint)
    else:
        session.rollback_to(savepoint)
        report.add(None, None, fault)


def _number(anchored: AnchoredHead | None) -> int | None:
    return None if anchored is None else anchored.revision


def _check_anchor(anchored: AnchoredHead, chain: Chain, report: Report) -> None:
    number, at = anchored.revision, anchored.committed_at
    if number in chain.hashes:
        if chain.hashes[number] != anchored.hash:
            report.add(
                number,
                None,
                f"revision {number} has another hash than the anchor of {at}: the history up to it "
                "was rewritten",
            )
        return
    last = 0 if chain.last is None else chain.last.number
    if last < number:
        report.add(
            last + 1,
            None,
            f"the history was cut off: it ends at revision {last}, and the anchor of {at} is of "
            f"revision {number}",
        )


def _archive_words(archive: Archive) -> str:
    return (
        f"{archive.versions} versions that ended up to revision {archive.revision} were moved to "
        f"{archive.target} in revision {archive.since}: verify that store as well, because this "
        "one has only a part of the changes up to there"
    )

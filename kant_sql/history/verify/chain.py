"""Checks the chain: numbers, times and hashes of all revisions, and explains wrong hashes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import chain, groupby, islice
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import select

from ...knowledge.canonical import (
    FORM,
    FORMS,
    SAID,
    SEED,
    Metadata,
    revision_hash,
    sealed_hash,
    time_text,
)
from ...sql.changes import REVISIONS, SIGNS, in_range, stream_change_rows
from ...sql.dialects.base import Row, Session
from ...sql.query import Query, constant, in_list
from ...sql.rows import KB, table_of
from ...sql.tables import CommitmentRow, RevisionRow
from ...store.head import read_name
from ..revisions import LARGEST
from .erasures import ErasureCheck
from .parts import PARTS_OF, READ_PARTS, WHOLE, WHOLE_AT, Part, committed
from .sides import Check, Side, check_time, stored_time

SMALLEST = -(2**63)
# Keep at most this many changes of a revision in a list: most have no more.
FEW = 1_000

_PART = table_of(CommitmentRow).c
# Whether any of them has parts: read with each revision, but computed once.
_ANY_PART = select(_PART.number).where(_PART.kb_id == KB, in_range(_PART.number)).exists()
_REVISIONS = Query(
    REVISIONS.add_columns(RevisionRow.form, RevisionRow.seed, select(_ANY_PART).scalar_subquery())
    .where(in_range(RevisionRow.number))
    .order_by(RevisionRow.number)
)


# Sign, kind and text of a change; also the ids of its element if the revision has parts.
_Line = tuple[Any, ...]


# With slots, a dataclass is faster to make and read than a named tuple.
@dataclass(slots=True)
class Link:
    """A revision as stored, without its changes."""

    number: int
    committed_at: str  # as in the hash
    metadata: Metadata
    form: int
    seed: bytes | None
    hash: str
    is_readable: bool  # whether its times can be read
    fault: str | None  # the fault of its form, its seed or its parts, in words
    parts: tuple[Part, ...] = ()  # if its seed was destroyed

    def digest(
        self, name: str, previous: str | None, changes: Iterable[_Line], is_archived: bool = False
    ) -> str:
        """Recompute the hash; it is empty for a revision with a fault.

        For a revision of form 1 with an erasure, this is the kept hash.
        """
        link = previous, name, self.number, self.committed_at, self.metadata
        if self.fault is not None:
            deque(changes, 0)
            return ""
        if not self.parts:
            return revision_hash(*link, changes, self.seed, self.form)
        if self.form == 1:
            return self.parts[0].commitment or ""
        return sealed_hash(*link, *committed(self.parts, self.metadata, changes, is_archived))


def _fault(form: int, seed: Any, parts: tuple[Part, ...]) -> str | None:
    """Find the fault of the form, the seed or the parts of a revision."""
    if form not in FORMS:
        return f"form {form} is unknown: revisions have form 1 or {FORM}"
    if form == 1:
        if seed is not None:
            return "it is of form 1, and has a seed"
        is_kept = not parts or [part[:6] for part in parts] == [(WHOLE_AT, "", WHOLE, 0, 0, None)]
        return None if is_kept else "it is of form 1, and has rows of form 2 in commitment"
    if seed is None:
        return None if parts else "its seed is missing, and nothing of it was erased"
    if parts:
        return "it has a seed, and rows in commitment"
    is_seed = isinstance(seed, bytes) and len(seed) == SEED
    return None if is_seed else f"its seed is not {SEED} bytes"


class Step(NamedTuple):
    """A revision and its changes, or the changes of a missing revision."""

    number: int
    link: Link | None
    changes: Iterable[_Line]  # a list, or for many an iterator, to be read before the next step


def stream_chain(
    session: Session,
    kb_id: int,
    low: int = SMALLEST,
    high: int = LARGEST,
    changes: Iterable[Row] | None = None,
    left: bool = False,
) -> Iterator[Step]:
    """Read revisions with their changes, in two statements and constant memory.

    After an erasure, it takes three, and reads the parts of each revision with erased texts.

    Args:
        changes: the changes, if already read; unused after an erasure.
        left: only the changes that remain after an archive of these revisions.
    """
    bounds = {"kb": kb_id, "low": low, "high": high}
    revisions = session.stream(_REVISIONS, **bounds)
    first = next(revisions, None)
    parts, strays = None, list[int]()
    if first is not None and first[-1]:
        rows = session.stream(READ_PARTS, **bounds)
        parts = Side(rows, 1, lambda stray: strays.append(stray[0]))
    if changes is None or parts is not None:
        changes = stream_change_rows(session, kb_id, low, high, left, parts is not None)
    groups = groupby(changes, key=itemgetter(0))
    group = next(groups, None)
    for row in () if first is None else chain((first,), revisions):
        while group is not None and group[0] < row[0]:
            yield Step(group[0], None, _lines(group[1]))
            group = next(groups, None)
        link = _link(session, row, parts)
        if group is not None and group[0] == row[0]:
            yield Step(row[0], link, _lines(group[1], bool(link.parts)))
            group = next(groups, None)
        else:
            yield Step(row[0], link, iter(()))
    while group is not None:
        yield Step(group[0], None, _lines(group[1]))
        group = next(groups, None)
    if parts is not None:
        parts.end()
    for number in strays:
        yield Step(number, None, iter(()))


_OF_NUMBERS = Query(
    REVISIONS.add_columns(RevisionRow.form, RevisionRow.seed, constant(1))
    .where(in_list(RevisionRow.number, "numbers"))
    .order_by(RevisionRow.number)
)


def read_links(session: Session, kb_id: int, numbers: Sequence[int]) -> list[Link]:
    """Read some revisions, with their parts."""
    listed = {"kb": kb_id, "numbers": session.list_value([*numbers])}
    parts = Side(iter(session.rows(PARTS_OF, **listed)), 1, lambda _: None)
    return [_link(session, row, parts) for row in session.rows(_OF_NUMBERS, **listed)]


def _lines(rows: Iterator[Row], keyed: bool = False) -> Iterable[_Line]:
    # A change without an identity has no text.
    if keyed:
        return [(SIGNS[sign], kind, text or "", *key) for _, sign, kind, text, *key in rows]
    few = [(SIGNS[row[1]], row[2], row[3] or "") for row in islice(rows, FEW)]
    if len(few) < FEW:
        return few
    return chain(few, ((SIGNS[row[1]], row[2], row[3] or "") for row in rows))


def _link(session: Session, row: Row, parts: Side | None = None) -> Link:
    number, at, actor, reason, source, digest, seen, plan_id, position, form, seed, _ = row
    step = None if plan_id is None else (plan_id, position)
    try:
        committed_at, is_readable = moment_text(session, at), True
        observed_at = None if seen is None else stored_time(session, seen)
        check_time(at)  # The hash covers its text, so it must have the form of a time.
    except (TypeError, ValueError):
        committed_at, observed_at, is_readable = "", None, False
    metadata = Metadata(actor, reason, source, observed_at, step)
    own = () if parts is None else tuple(Part(*part[1:]) for part in parts.take(number))
    fault = _fault(form, seed, own)
    return Link(number, committed_at, metadata, form, seed, digest, is_readable, fault, own)


def texts_of(
    link: Link, name: str, previous: str | None, changes: Iterable[_Line]
) -> dict[Any, str | None]:
    """Return the present texts of a revision with parts, by their keys."""
    lines = [*changes]
    texts: dict[Any, str | None] = {(line[0], line[1], *line[3:]): line[2] for line in lines}
    texts |= {("", label, 0, 0): getattr(link.metadata, label) for label in SAID}
    if link.form == 1:
        of = previous, name, link.number, link.committed_at, link.metadata
        texts["", WHOLE, 0, 0] = revision_hash(*of, sorted(line[:3] for line in lines), None, 1)
    return texts


def moment_text(session: Session, raw: Any) -> str:
    """Return a time as the hash covers it."""
    return raw if isinstance(raw, str) else time_text(session.to_time(raw))


def rest_digest(session: Session, kb_id: int, upto: int) -> str:
    """Hash the first revisions as an archive leaves them: without ended versions."""
    name, rest = read_name(session, kb_id), sha256()
    previous: str | None = None
    for step in stream_chain(session, kb_id, 1, upto, left=True):
        if step.link is not None:
            _add_rest(rest, step.link, step.link.digest(name, previous, step.changes, True))
            previous = step.link.hash
    return rest.hexdigest()


def _add_rest(rest: Any, link: Link, recomputed: str) -> None:
    rest.update(f"{recomputed}{link.hash}".encode())


# In a larger revision, leaving out each line in turn takes too many hashes.
MANY_LINES = 2_000
# The maximum number of lines to hash to explain one store.
EFFORT = 8_000_000

_SAID = (*SAID, "observed_at", "plan_step")
_UNEXPLAINED = (
    "its contents differ from what was hashed: actor, reason, source, a time, the name of the "
    "knowledge base, or one of its {count} changes was altered, removed or added"
)


class Wrong(NamedTuple):
    """A revision whose stored hash differs from that of its contents."""

    link: Link
    previous: str | None  # the stored hash of the revision before
    digest: str  # the hash of its contents


class _Explainer:
    """Reports revisions with wrong hashes, with the difference if the hashes show it."""

    def __init__(self, check: Check, name: str) -> None:
        self._check = check
        self._name = name
        self._effort = EFFORT
        # The changes that somebody inserted into revisions.
        self._slipped_in: dict[_Line, int] = {}

    def run(self, wrong: list[Wrong]) -> None:
        unexplained = []
        for each in self._without_altered_hashes(wrong):
            lines = self._lines(each.link.number)
            if lines is None or not self._explain(each, lines):
                unexplained.append((each, lines))
        for each, lines in unexplained:
            self._report_missing(each, lines)

    def _without_altered_hashes(self, wrong: list[Wrong]) -> Iterator[Wrong]:
        """Report altered hashes, and yield the revisions that are wrong for another reason."""
        rest = deque(wrong)
        while rest:
            each = rest.popleft()
            number = each.link.number
            if rest and rest[0].link.number == number + 1 and self._is_successor(each, rest[0]):
                rest.popleft()
                self._check.report.add(
                    number,
                    "revision",
                    f"the column hash of revision {number} was altered: revision {number + 1} is "
                    "chained to the right hash",
                )
            else:
                yield each

    def _explain(self, wrong: Wrong, lines: list[_Line]) -> bool:
        """Report metadata or a change added to a revision; return whether there is any."""
        number, add = wrong.link.number, self._check.report.add
        said = self._added_metadata(wrong, lines)
        if said is not None:
            add(number, "revision", f"its {said} was added: without it, the hash is right")
            return True
        line = self._added_line(wrong, lines)
        if line is not None:
            self._slipped_in[line] = number
            message = f"'{_shown(line)}' was inserted into it, moved there or duplicated: without "
            add(number, None, f"{message}it, the hash is right")
        return line is not None

    def _report_missing(self, wrong: Wrong, lines: list[_Line] | None) -> None:
        number = wrong.link.number
        line = None if lines is None else self._missing_line(wrong, lines)
        if line is not None:
            message = f"'{_shown(line)}' is missing in it; it was moved to revision "
            message += str(self._slipped_in[line])
        else:
            count = len(lines) if lines is not None else sum(1 for _ in self._changes(number))
            message = _UNEXPLAINED.format(count=count)
        self._check.report.add(number, None, message)

    def _changes(self, number: int) -> Iterator[_Line]:
        for step in stream_chain(self._check.session, self._check.kb_id, number, number):
            yield from step.changes

    def _lines(self, number: int) -> list[_Line] | None:
        """Return the changes of a revision; None if there are too many to try."""
        lines = list(islice(self._changes(number), MANY_LINES + 1))
        return None if len(lines) > MANY_LINES else lines

    def _fits(self, wrong: Wrong, lines: list[_Line], metadata: Metadata | None = None) -> bool:
        """Return whether a revision with these contents has its stored hash."""
        self._effort -= len(lines) + 1
        link = wrong.link if metadata is None else replace(wrong.link, metadata=metadata)
        return link.digest(self._name, wrong.previous, lines) == link.hash

    def _is_successor(self, wrong: Wrong, following: Wrong) -> bool:
        """Return whether a revision is chained to the previous contents, not to their hash."""
        lines = self._lines(following.link.number)
        return lines is not None and self._fits(following._replace(previous=wrong.digest), lines)

    def _added_metadata(self, wrong: Wrong, lines: list[_Line]) -> str | None:
        """Find the metadata without which the hash is right."""
        metadata = wrong.link.metadata
        for name in _SAID:
            if getattr(metadata, name) is not None:
                without = metadata._replace(**{name: None})
                if self._fits(wrong, lines, without):
                    return name
        return None

    def _added_line(self, wrong: Wrong, lines: list[_Line]) -> _Line | None:
        """Find the change without which the hash is right."""
        if len(lines) ** 2 > self._effort:
            return None
        for position, line in enumerate(lines):
            if self._fits(wrong, lines[:position] + lines[position + 1 :]):
                return line
        return None

    def _missing_line(self, wrong: Wrong, lines: list[_Line]) -> _Line | None:
        """Find the change of another revision with which the hash is right."""
        known = (line for line in self._slipped_in if self._fits(wrong, sorted([*lines, line])))
        return next(known, None)


def _shown(line: _Line) -> str:
    text = " ".join(" ".join(line[:3]).split())
    return text if len(text) <= 200 else f"{text[:197]}..."


# The number of wrong revisions to explain; of the others, the first and the last are named.
EXPLAINED = 20


@dataclass
class Chain:
    """One pass over all revisions in constant memory, and its results."""

    check: Check
    tick: Callable[[int], None]
    archived: int = 0
    wanted: frozenset[int] = frozenset()  # revisions whose stored hashes are needed
    last: Link | None = None
    revisions: int = 0
    changes: int = 0
    rest: str = ""  # the hash of the rest of the revisions up to the archived one
    hashes: dict[int, str] = field(default_factory=dict)
    erasures: ErasureCheck | None = None  # None if this continues an earlier verification
    _name: str = ""
    _rest: Any = field(default_factory=sha256)
    _wrong: list[Wrong] = field(default_factory=list)
    _more: list[int] = field(default_factory=list)
    _more_count: int = 0

    def run(self) -> None:
        """Recompute all hashes."""
        session, kb_id, report, after = self.check
        self._name = read_name(session, kb_id)
        if after > 1:
            self._begin_after(after - 1)
        # Also the last verified one: its hash must be the same as before.
        for step in stream_chain(session, kb_id, after or SMALLEST):
            self._take(step)
        if self.erasures is not None:
            self.erasures.end()
        _Explainer(self.check, self._name).run(self._wrong)
        if self._more:
            report.add(self._more[0], "revision", _more(self._more_count, self._more[-1]))
        self.rest = self._rest.hexdigest()

    def _begin_after(self, number: int) -> None:
        session, kb_id, report, _ = self.check
        row = session.first(_REVISIONS, kb=kb_id, low=number, high=number)
        if row is None:
            report.add(number, "revision", f"revision {number} is missing: a hole in the chain")
        else:
            self.last = _link(session, row)

    def _take(self, step: Step) -> None:
        link = step.link
        if link is None:
            count = sum(1 for _ in step.changes)
            self.check.report.add(
                step.number, None, f"revision {step.number} is missing, but has {count} changes"
            )
            return
        self._check_order(link)
        previous = None if self.last is None else self.last.hash
        counted = self.changes
        is_archived = link.number <= self.archived
        changes = self._counted(step.changes)
        if link.parts:
            self._check_erased(link, previous, changes)
        digest = link.digest(self._name, previous, changes, is_archived)
        if link.number <= self.check.after:
            self.changes = counted
        if is_archived:
            _add_rest(self._rest, link, digest)
        elif digest != link.hash:
            self._note(Wrong(link, previous, digest))
        if link.number in self.wanted:
            self.hashes[link.number] = link.hash
        self.last = link
        self.revisions += link.number > self.check.after
        self.tick(link.number)

    def _check_erased(self, link: Link, previous: str | None, changes: Iterable[_Line]) -> None:
        """Check the replacements of erased parts of a revision."""
        if self.erasures is not None and link.fault is None:
            texts = texts_of(link, self._name, previous, changes)
            self.erasures.take(link.number, link.parts, texts, self.archived)

    def _counted(self, changes: Iterable[_Line]) -> Iterable[_Line]:
        """Count changes; many of them while they are read."""
        if not isinstance(changes, list):
            return self._many(changes)
        self.changes += len(changes)
        return changes

    def _many(self, changes: Iterable[_Line]) -> Iterator[_Line]:
        for change in changes:
            self.changes += 1
            yield change

    def _note(self, wrong: Wrong) -> None:
        if len(self._wrong) < EXPLAINED:
            self._wrong.append(wrong)
        else:
            self._more = [*self._more[:1], wrong.link.number]
            self._more_count += 1

    def _check_order(self, link: Link) -> None:
        number, add = link.number, self.check.report.add
        expected = max(1, self.check.after) if self.last is None else self.last.number + 1
        if number < expected:
            add(number, "revision", f"a revision has the number {number}; they begin with 1")
        elif number > expected:
            several = f"revisions {expected} to {number - 1} are"
            missing = several if number > expected + 1 else f"revision {expected} is"
            add(expected, "revision", f"{missing} missing: a hole in the chain")
        if link.fault is not None:
            add(number, "revision", link.fault)
        if not link.is_readable:
            add(number, "revision", "a time is not in the library's format")
        # Both hash like NULL.
        if link.metadata.source in ("", "null"):
            add(number, "revision", "an empty source is not NULL")
        # In this form, texts sort like times.
        if self.last is not None and link.committed_at < self.last.committed_at:
            add(number, "revision", "it was committed before the revision before it")


def _more(count: int, last: int) -> str:
    if count == 1:
        return "this revision differs from what was hashed, too"
    return f"{count} more revisions differ from what was hashed, the last is {last}"

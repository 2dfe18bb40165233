"""Checks the chain: numbers, times and hashes of all revisions, and explains wrong hashes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from hashlib import sha256
from itertools import chain, groupby, islice
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import select

from ...knowledge.canonical import FORM, Metadata, revision_hash, time_text
from ...sql.changes import (
    ASSERTED,
    RETRACTED,
    REVISIONS,
    in_range,
    stream_change_rows,
    stream_rows_left,
)
from ...sql.dialects.base import Row, Session
from ...sql.query import Query
from ...sql.rows import KB
from ...sql.tables import KnowledgeBaseRow, RevisionRow
from ..revisions import LARGEST
from .findings import Report

SMALLEST = -(2**63)

_SIGNS = ASSERTED, RETRACTED
_DATE, _CLOCK = r"[0-9]{4}-[0-9]{2}-[0-9]{2}", r"(?:[01][0-9]|2[0-3]):[0-9]{2}:[0-9]{2}\.[0-9]{6}"
_TIME = re.compile(f"{_DATE}T{_CLOCK}Z")
_NAME = Query(select(KnowledgeBaseRow.name).where(KnowledgeBaseRow.id == KB))
_REVISIONS = Query(
    REVISIONS.add_columns(RevisionRow.form)
    .where(in_range(RevisionRow.number))
    .order_by(RevisionRow.number)
)


class Link(NamedTuple):
    """A revision as stored, without its changes.

    Attributes:
        number: its number.
        committed_at: when, as the text that is hashed.
        metadata: who, why and from what.
        form: the form that was hashed.
        hash: its hash, as it is stored.
        is_readable: whether its times are times.
    """

    number: int
    committed_at: str
    metadata: Metadata
    form: int
    hash: str
    is_readable: bool

    def digest(
        self, name: str, previous: str | None, changes: Iterable[tuple[str, str, str]]
    ) -> str:
        """Recompute its hash."""
        said = self.committed_at, self.metadata, changes, self.form
        return revision_hash(previous, name, self.number, *said)


class Step(NamedTuple):
    """A revision and its changes, or the changes of a missing revision.

    Attributes:
        number: the number.
        link: the revision; None when there are only changes.
        changes: sign, kind and text of each change, to be read before the next step.
    """

    number: int
    link: Link | None
    changes: Iterator[tuple[str, str, str]]


def read_name(session: Session, kb_id: int) -> str:
    """Read the name of a knowledge base."""
    row = session.first(_NAME, kb=kb_id)
    return "" if row is None else str(row[0])


def stream_chain(
    session: Session,
    kb_id: int,
    low: int = SMALLEST,
    high: int = LARGEST,
    changes: Iterable[Row] | None = None,
) -> Iterator[Step]:
    """Read revisions with their changes, in two statements and constant memory."""
    bounds = {"kb": kb_id, "low": low, "high": high}
    rows = stream_change_rows(session, kb_id, low, high) if changes is None else changes
    groups = groupby(rows, key=itemgetter(0))
    group = next(groups, None)
    for row in session.stream(_REVISIONS, **bounds):
        while group is not None and group[0] < row[0]:
            yield Step(group[0], None, _lines(group[1]))
            group = next(groups, None)
        link = _link(session, row)
        if group is not None and group[0] == row[0]:
            yield Step(row[0], link, _lines(group[1]))
            group = next(groups, None)
        else:
            yield Step(row[0], link, iter(()))
    while group is not None:
        yield Step(group[0], None, _lines(group[1]))
        group = next(groups, None)


def _lines(rows: Iterable[Row]) -> Iterator[tuple[str, str, str]]:
    # A change whose identity is missing has no text.
    return ((_SIGNS[sign], kind, text or "") for _, sign, kind, text in rows)


def _link(session: Session, row: Row) -> Link:
    number, at, actor, reason, source, digest, seen, plan_id, position, form = row
    step = None if plan_id is None else (plan_id, position)
    try:
        committed_at, observed_at = moment_text(session, at), _moment(session, seen)
        if isinstance(at, str):
            # Its text is hashed, so it must be in the form of a time.
            _moment(session, at)
    except (TypeError, ValueError):
        metadata = Metadata(actor, reason, source, None, step)
        return Link(number, "", metadata, form, digest, False)
    metadata = Metadata(actor, reason, source, observed_at, step)
    return Link(number, committed_at, metadata, form, digest, True)


def moment_text(session: Session, raw: Any) -> str:
    """Return a time as it is hashed."""
    return raw if isinstance(raw, str) else time_text(session.to_time(raw))


def _moment(session: Session, raw: Any) -> datetime | None:
    """Read a time in the form that the library stores."""
    if raw is None:
        return None
    # Several texts are read as the same time; only one has this form.
    if isinstance(raw, str) and _TIME.fullmatch(raw) is None:
        raise ValueError(f"{raw!r} is not written as times are")
    return session.to_time(raw)


class RestDigest:
    """The hash of what an archive left of revisions."""

    def __init__(self) -> None:
        self._digest = sha256()

    def add(self, recomputed: str, stored: str) -> None:
        """Add a revision."""
        self._digest.update(f"{recomputed}{stored}".encode())

    def text(self) -> str:
        """Return the hash of all revisions."""
        return self._digest.hexdigest()


def rest_digest(session: Session, kb_id: int, upto: int) -> str:
    """Hash the first revisions as an archive leaves them: without the versions that ended."""
    name, rest = read_name(session, kb_id), RestDigest()
    previous: str | None = None
    left = stream_rows_left(session, kb_id, upto)
    for step in stream_chain(session, kb_id, 1, upto, left):
        if step.link is not None:
            rest.add(step.link.digest(name, previous, step.changes), step.link.hash)
            previous = step.link.hash
    return rest.text()


# Trying a larger revision without each of its lines takes too many hashes.
MANY_LINES = 2_000
# Lines that may be hashed to explain one store.
EFFORT = 8_000_000

_Line = tuple[str, str, str]
_SAID = ("actor", "reason", "source", "observed_at", "plan_step")
_UNEXPLAINED = (
    "what the tables say of revision {number} is not what was hashed: its actor, reason, source or "
    "a time, the name of the knowledge base, or one of its {count} changes was altered, removed or "
    "added"
)


class Wrong(NamedTuple):
    """A revision whose stored hash differs from that of its contents.

    Attributes:
        link: the revision.
        previous: the stored hash of the revision before.
        digest: the hash of its contents.
    """

    link: Link
    previous: str | None
    digest: str


class _Explainer:
    def __init__(self, session: Session, kb_id: int, name: str) -> None:
        self._session = session
        self._kb_id = kb_id
        self._name = name
        self._effort = EFFORT

    def lines(self, number: int) -> list[_Line] | None:
        """Return the changes of a revision; None when there are too many to try."""
        lines: list[_Line] = []
        for step in stream_chain(self._session, self._kb_id, number, number):
            lines = list(islice(step.changes, MANY_LINES + 1))
        return None if len(lines) > MANY_LINES else lines

    def count(self, number: int) -> int:
        """Count the changes of a revision."""
        chain = stream_chain(self._session, self._kb_id, number, number)
        return sum(1 for step in chain for _ in step.changes)

    def fits(self, wrong: Wrong, lines: list[_Line], metadata: Metadata | None = None) -> bool:
        """Return whether a revision with these contents would have its hash."""
        self._effort -= len(lines) + 1
        link = wrong.link if metadata is None else wrong.link._replace(metadata=metadata)
        return link.digest(self._name, wrong.previous, lines) == link.hash

    def is_successor(self, wrong: Wrong, following: Wrong) -> bool:
        """Return whether a revision is chained to the previous contents, not to their hash."""
        lines = self.lines(following.link.number)
        return lines is not None and self.fits(following._replace(previous=wrong.digest), lines)

    def added_metadata(self, wrong: Wrong, lines: list[_Line]) -> str | None:
        """Find the metadata without which the hash is right."""
        metadata = wrong.link.metadata
        for name in _SAID:
            if getattr(metadata, name) is not None:
                without = metadata._replace(**{name: None})
                if self.fits(wrong, lines, without):
                    return name
        return None

    def added_line(self, wrong: Wrong, lines: list[_Line]) -> _Line | None:
        """Find the change without which the hash is right."""
        if len(lines) ** 2 > self._effort:
            return None
        for position, line in enumerate(lines):
            if self.fits(wrong, lines[:position] + lines[position + 1 :]):
                return line
        return None

    def missing_line(self, wrong: Wrong, lines: list[_Line], known: list[_Line]) -> _Line | None:
        """Find the change of another revision with which the hash is right."""
        for line in known:
            if self.fits(wrong, sorted([*lines, line])):
                return line
        return None


def explain(session: Session, kb_id: int, name: str, wrong: list[Wrong], report: Report) -> None:
    """Report revisions with a wrong hash, and what differs where that can be found."""
    explainer = _Explainer(session, kb_id, name)
    slipped_in: dict[int, _Line] = {}
    unexplained: list[tuple[Wrong, list[_Line] | None]] = []
    rest = iter(_without_altered_hashes(explainer, wrong, report))
    for each in rest:
        number = each.link.number
        lines = explainer.lines(number)
        said = None if lines is None else explainer.added_metadata(each, lines)
        line = None if lines is None or said else explainer.added_line(each, lines)
        if said is not None:
            report.add(number, "revision", f"its {said} was added: without it, the hash is right")
        elif line is not None:
            slipped_in[number] = line
            report.add(
                number,
                None,
                f"'{_shown(line)}' was slipped into it, or moved or doubled: without it, the hash "
                "is right",
            )
        else:
            unexplained.append((each, lines))
    for each, lines in unexplained:
        _report_missing(explainer, each, lines, slipped_in, report)


def _without_altered_hashes(
    explainer: _Explainer, wrong: list[Wrong], report: Report
) -> Iterator[Wrong]:
    """Report altered hashes, and yield the revisions that are wrong for another reason."""
    skipped = -1
    for position, each in enumerate(wrong):
        if position == skipped:
            continue
        following = wrong[position + 1] if position + 1 < len(wrong) else None
        number = each.link.number
        if (
            following is not None
            and following.link.number == number + 1
            and explainer.is_successor(each, following)
        ):
            skipped = position + 1
            report.add(
                number,
                "revision",
                f"the column hash of revision {number} was altered: revision {number + 1} was "
                "chained to the hash that it should have",
            )
        else:
            yield each


def _report_missing(
    explainer: _Explainer,
    wrong: Wrong,
    lines: list[_Line] | None,
    slipped_in: dict[int, _Line],
    report: Report,
) -> None:
    number = wrong.link.number
    known = {line: other for other, line in slipped_in.items()}
    line = None if lines is None else explainer.missing_line(wrong, lines, list(known))
    if line is not None:
        message = f"'{_shown(line)}' is missing in it; it was moved to revision {known[line]}"
        report.add(number, None, message)
        return
    count = explainer.count(number) if lines is None else len(lines)
    report.add(number, None, _UNEXPLAINED.format(number=number, count=count))


def _shown(line: _Line) -> str:
    text = " ".join(" ".join(line).split())
    return text if len(text) <= 200 else f"{text[:197]}..."


# Wrong revisions that are explained; of the others, the first and the last are named.
EXPLAINED = 20
FEW = 1_000


class Chain(NamedTuple):
    """The result of the check.

    Attributes:
        last: the last revision; None when there is none.
        revisions: how many there are.
        changes: how many changes were hashed.
        rest: the hash of what is left of the revisions up to the archived one.
        hashes: the stored hash of each wanted revision.
    """

    last: Link | None
    revisions: int
    changes: int
    rest: str
    hashes: dict[int, str]


@dataclass
class _Pass:
    session: Session
    kb_id: int
    name: str
    archived: int
    wanted: frozenset[int]
    report: Report
    tick: Callable[[int], None]
    last: Link | None = None
    revisions: int = 0
    changes: int = 0
    rest: RestDigest = field(default_factory=RestDigest)
    hashes: dict[int, str] = field(default_factory=dict)
    wrong: list[Wrong] = field(default_factory=list)
    more: list[int] = field(default_factory=list)
    more_count: int = 0

    def run(self) -> Chain:
        for step in stream_chain(self.session, self.kb_id):
            self.take(step)
        explain(self.session, self.kb_id, self.name, self.wrong, self.report)
        if self.more:
            self.report.add(self.more[0], "revision", _more(self.more_count, self.more[-1]))
        rest = self.rest.text()
        return Chain(self.last, self.revisions, self.changes, rest, self.hashes)

    def take(self, step: Step) -> None:
        link = step.link
        if link is None:
            count = sum(1 for _ in step.changes)
            self.report.add(
                step.number,
                None,
                f"there is no revision {step.number}, but {count} changes say that they are of it",
            )
            return
        self.check_order(link)
        previous = None if self.last is None else self.last.hash
        digest = link.digest(self.name, previous, self.counted(step.changes))
        if link.number <= self.archived:
            self.rest.add(digest, link.hash)
        elif digest != link.hash:
            self.note(Wrong(link, previous, digest))
        if link.number in self.wanted:
            self.hashes[link.number] = link.hash
        self.last = link
        self.revisions += 1
        self.tick(link.number)

    def counted(self, changes: Iterator[tuple[str, str, str]]) -> Iterable[tuple[str, str, str]]:
        """Count changes while they are read; most revisions have few."""
        few = [*islice(changes, FEW)]
        self.changes += len(few)
        return few if len(few) < FEW else chain(few, self.many(changes))

    def many(self, changes: Iterator[tuple[str, str, str]]) -> Iterator[tuple[str, str, str]]:
        for change in changes:
            self.changes += 1
            yield change

    def note(self, wrong: Wrong) -> None:
        if len(self.wrong) < EXPLAINED:
            self.wrong.append(wrong)
        else:
            self.more = [*self.more[:1], wrong.link.number]
            self.more_count += 1

    def check_order(self, link: Link) -> None:
        number, add = link.number, self.report.add
        expected = 1 if self.last is None else self.last.number + 1
        if number != expected:
            missing = (
                f"revision {expected} is"
                if number == expected + 1
                else (f"revisions {expected} to {number - 1} are")
            )
            # No revision is missing before a number below 1.
            add(
                min(number, expected),
                "revision",
                f"{missing} missing: a hole in the chain"
                if number > expected
                else f"a revision has the number {number}; they begin with 1",
            )
        if link.form != FORM:
            add(number, "revision", f"form {link.form} is unknown: revisions have form {FORM}")
        if not link.is_readable:
            add(number, "revision", "a time is not written as the library writes times")
        # Both hash as NULL does.
        if link.metadata.source in ("", "null"):
            add(number, "revision", "an empty source is not written as the library writes it")
        # Texts of this form sort as the moments do.
        if self.last is not None and link.committed_at < self.last.committed_at:
            add(number, "revision", "it was committed before the revision before it")


def _more(count: int, last: int) -> str:
    if count == 1:
        return "this revision is not what was hashed, either"
    return f"{count} more revisions are not what was hashed, the last is {last}"


def check_chain(
    session: Session,
    kb_id: int,
    archived: int,
    wanted: frozenset[int],
    report: Report,
    tick: Callable[[int], None],
) -> Chain:
    """Recompute all hashes, in constant memory."""
    name = read_name(session, kb_id)
    return _Pass(session, kb_id, name, archived, wanted, report, tick).run()

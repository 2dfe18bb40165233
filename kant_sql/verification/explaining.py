"""Why the hash of a revision is wrong, as far as the hashes themselves tell."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

from ..backends import Session
from ..canonical import Metadata
from .checkpoints import Link, stream_chain
from .findings import Report

# A revision of more lines is hashed too often to try what it is without each of them.
MANY_LINES = 2_000
# So many lines may be hashed to explain one store.
EFFORT = 8_000_000

_Line = tuple[str, str, str]
_SAID = ("actor", "reason", "source", "observed_at", "plan_step")
_UNEXPLAINED = (
    "what the tables say of revision {number} is not what was hashed: its actor, reason, source or "
    "a time, the name of the knowledge base, or one of its {count} changes was altered, removed or "
    "added"
)


class Wrong(NamedTuple):
    """A revision whose hash is not that of what it says.

    Attributes:
        link: the revision.
        previous: the stored hash of the revision before.
        digest: the hash of what it says.
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
        """Give what a revision changed; None when that is too much to try anything with."""
        lines: list[_Line] = []
        for step in stream_chain(self._session, self._kb_id, number, number):
            lines = list(islice(step.changes, MANY_LINES + 1))
        return None if len(lines) > MANY_LINES else lines

    def count(self, number: int) -> int:
        """Count what a revision changed."""
        chain = stream_chain(self._session, self._kb_id, number, number)
        return sum(1 for step in chain for _ in step.changes)

    def fits(self, wrong: Wrong, lines: list[_Line], metadata: Metadata | None = None) -> bool:
        """Tell whether a revision that said this would have its hash."""
        self._effort -= len(lines) + 1
        link = wrong.link if metadata is None else wrong.link._replace(metadata=metadata)
        return link.digest(self._name, wrong.previous, lines) == link.hash

    def is_successor(self, wrong: Wrong, following: Wrong) -> bool:
        """Tell whether a revision was chained to what the one before says, not to its hash."""
        lines = self.lines(following.link.number)
        return lines is not None and self.fits(following._replace(previous=wrong.digest), lines)

    def added_metadata(self, wrong: Wrong, lines: list[_Line]) -> str | None:
        """Find what the revision does not have when its hash is right."""
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
    """Report revisions whose hash is wrong, and what differs where that can be told.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        name: its name.
        wrong: the revisions, oldest first.
        report: takes the findings.
    """
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
    """Report hashes that were altered, and give the revisions that are wrong for another reason."""
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

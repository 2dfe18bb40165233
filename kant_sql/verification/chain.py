"""The chain pass: numbers, times and hashes of all revisions, in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import NamedTuple

from ..backends import Session
from .checkpoints import Link, RestDigest, Step, read_name, stream_chain
from .explaining import Wrong, explain
from .findings import Report

FORMS = (1, 2)
# So many wrong revisions are looked into; of the others, only the first and the last are named.
EXPLAINED = 20
FEW = 1_000


class Chain(NamedTuple):
    """What the pass has learned.

    Attributes:
        last: the last revision; None when there is none.
        revisions: how many there are.
        changes: how many changes were hashed.
        rest: the hash of what is left of the revisions up to the archived one.
        hashes: the stored hash of each revision that was asked for.
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
        """Count changes, and give them: most revisions have few."""
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
            # A number below 1 has nothing before it that could be missing.
            add(
                min(number, expected),
                "revision",
                f"{missing} missing: a hole in the chain"
                if number > expected
                else f"a revision has the number {number}; they begin with 1",
            )
        if link.form not in FORMS:
            add(number, "revision", f"form {link.form} is none that is known: {FORMS}")
        if link.form == 1 and (link.metadata.observed_at or link.metadata.plan_step):
            add(
                number,
                "revision",
                "a revision of form 1 has no time of observation and no plan step: it was added",
            )
        if not link.is_readable:
            add(number, "revision", "a time is not written as the library writes times")
        # Both are hashed as no source at all is, which is NULL.
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
    """Hash all revisions anew, in constant memory.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        archived: what ended up to this revision was moved elsewhere.
        wanted: the numbers of the revisions whose hashes are to be given.
        report: takes what is wrong.
        tick: called with the number of each revision that is checked.

    Returns:
        What the pass has learned.
    """
    name = read_name(session, kb_id)
    return _Pass(session, kb_id, name, archived, wanted, report, tick).run()

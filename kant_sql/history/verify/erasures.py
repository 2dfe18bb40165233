"""Checks erasures: each erased part and its replacement belong to a recorded one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import partial
from hashlib import sha256
from typing import Any, NamedTuple

from ...knowledge.canonical import commit_to, erasure_text
from ...sql.changes import PLAN
from ...sql.dialects.base import Row, Session
from ...sql.rows import columns_of, table_of
from ...sql.tables import ErasureRow, ReplacementRow
from .parts import PREFIX, WHOLE, Part, said_in_place
from .sides import Check, Report, Side


class Erasure(NamedTuple):
    """The record of an erasure."""

    id: int
    since: int  # the revision that recorded it
    revision: int  # it erased texts of revisions up to this one
    kind: str
    element_id: int | None
    pseudonym: str
    parts: int
    digest: str
    text: str  # the canonical text of all columns

    @property
    def words(self) -> str:
        """Describe the erasure, and name its revision."""
        what = "texts of revisions" if self.element_id is None else f"object {self.element_id}"
        several = "text was" if self.parts == 1 else "texts were"
        return (
            f"{what}: {self.parts} {several} erased by revision {self.since}, "
            f"{self.pseudonym} took their place"
        )


_READ = columns_of(table_of(ErasureRow), Erasure._fields, "id")
_PLACE = "number", "position", "erasure_id"
_REPLACEMENTS = columns_of(table_of(ReplacementRow), (*_PLACE, "salt", "commitment"), *_PLACE)


def read_erasures(session: Session, kb_id: int) -> list[Erasure]:
    """Read the records of erasures."""
    return [Erasure(*row) for row in session.rows(_READ, kb=kb_id)]


def add_part(digest: Any, number: int, part: Part, replacement: str) -> None:
    """Add an erased part, and the commitment to its replacement, to an erasure's digest."""
    sign, kind, *_ = part[1:]
    line = f"{number} {part.position} {sign} {kind} {part.commitment} {replacement}\n"
    digest.update(line.encode())


class ErasureCheck:
    """Recomputes the digests of all erasures, revision by revision."""

    def __init__(self, check: Check, erasures: list[Erasure]) -> None:
        self._check = check
        self._erasures = erasures
        self._pseudonyms = {each.id: each.pseudonym for each in erasures}
        self._digests: defaultdict[int, Any] = defaultdict(sha256)
        self._counts: defaultdict[int, int] = defaultdict(int)
        rows = check.session.stream(_REPLACEMENTS, kb=check.kb_id) if erasures else iter(())
        # Not a method of its own: a cycle would keep the cursor of an abandoned check, and psycopg,
        # which the collection may interrupt, would wait for itself to close it.
        self._rows = Side(rows, 2, partial(_stray, check.report))

    def take(
        self, number: int, parts: Iterable[Part], texts: dict[Any, str | None], upto: int
    ) -> None:
        """Check the parts of a revision."""
        # `texts` are the present texts, by the keys of parts. Changes up to `upto` may be archived.
        for part in parts:
            if part.erasure_id is None:
                continue
            rows = self._rows.take((number, part.position))
            replacements = [Replacement(*row[2:]) for row in rows]
            for fault in self._faults(number, part, replacements, texts.get(part.key), upto):
                message = f"part {part.position} of revision {number}, which is erased, {fault}"
                self._check.report.add(number, "commitment", message)

    def _faults(
        self, number: int, part: Part, replacements: list[Replacement], text: str | None, upto: int
    ) -> Iterator[str]:
        ids = [each.erasure_id for each in replacements]
        if not ids or ids[0] != part.erasure_id or ids != sorted({*ids}):
            yield "has no row of replacement by the erasure that it is of"
        # For a part that was moved to an archive since, the commitment is left.
        is_left = number <= upto and (text is None or part.kind == WHOLE)
        for each in replacements:
            is_last, commitment = each is replacements[-1], each.commitment
            has_salt = isinstance(each.salt, bytes)
            if has_salt == (commitment is not None) or (is_last != has_salt and not is_left):
                yield "has a replacement whose salt and commitment do not fit"
                continue
            if each.salt is not None:
                commitment = commit_to(each.salt, text or "")
                pseudonym = self._pseudonyms.get(each.erasure_id, "")
                if not _is_in_place(part, text or "", pseudonym):
                    yield f"has a text without the pseudonym {pseudonym}, which no erasure leaves"
            self._counts[each.erasure_id] += 1
            add_part(self._digests[each.erasure_id], number, part, commitment or "")

    def end(self) -> None:
        """Compare the digests with the recorded ones."""
        self._rows.end()
        add = self._check.report.add
        for id_ in sorted(self._counts.keys() - self._pseudonyms.keys()):
            add(None, "erasure", f"parts are of erasure {id_}, which is not on record")
        for each in self._erasures:
            id_, since, upto, *_ = each
            if erasure_text(id_, *each[2:8]) != each.text or upto != since - 1:
                add(since, "erasure", f"the columns of erasure {id_} differ from its text")
            if not each.pseudonym.removeprefix(PREFIX).isdecimal():
                add(since, "erasure", f"the pseudonym {each.pseudonym!r} is none of an erasure")
            if self._counts[id_] != each.parts or self._digests[id_].hexdigest() != each.digest:
                message = (
                    f"erasure {id_} erased {each.parts} texts, and what is there now differs from "
                    "what it left: a text was altered, or a part added, removed or exchanged"
                )
                add(since, "erasure", message)


def _is_in_place(part: Part, text: str, pseudonym: str) -> bool:
    """Return whether an erasure can leave a text: any other may be forged."""
    if part.position < 0:
        return part.kind == WHOLE or text == said_in_place(pseudonym, [part.kind])[part.kind]
    return part.kind in _WITH_HASHES or pseudonym in text


# Their texts contain hashes instead of the name: of the problem, or of formulas.
_WITH_HASHES = PLAN, "document"


class Replacement(NamedTuple):
    """The replacement of an erased part."""

    erasure_id: int
    salt: bytes | None
    commitment: str | None


def _stray(report: Report, row: Row) -> None:
    message = f"a row of replacement is of part {row[1]} of revision {row[0]}, not erased"
    report.add(row[0], "replacement", message)

"""Destroys texts and salts of revisions, and keeps the commitments covered by their hashes.

A commitment with its own salt binds each replacement of an erased text: the digest of the erasure
covers it, and reveals nothing that a later erasure destroys.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from hashlib import sha256
from typing import Any, NamedTuple

from sqlalchemy import bindparam, null, select, update

from ...dao.base import batches
from ...errors import StoreIntegrityError
from ...knowledge.canonical import SAID, SEED, commit_to, revision_hash
from ...sql import tables as t
from ...sql.changes import keyed_changes_of, lines_by_revision
from ...sql.dialects.base import Row, Session
from ...sql.query import Query, in_list, integer, whole_rows
from ...sql.rows import KB, table_of
from ...store.head import hash_of
from ..verify.chain import Link, read_links, texts_of
from ..verify.erasures import add_part
from ..verify.parts import Part, kept_parts, whole_part
from .texts import ChangeKey

_PARTS, _NEW = table_of(t.CommitmentRow), table_of(t.ReplacementRow)
_REVISION = table_of(t.RevisionRow)
_HERE = _NEW.c.kb_id == KB, in_list(_NEW.c.number, "numbers"), _NEW.c.salt.is_not(None)
_STANDING = Query(select(_NEW.c.number, _NEW.c.position, _NEW.c.salt).where(*_HERE))
_AT = tuple(
    (table.c.kb_id == bindparam("kb"), table.c.number == integer("own_number"))
    for table in (_PARTS, _NEW, _REVISION)
)
_ERASE = Query(
    update(_PARTS)
    .where(*_AT[0], _PARTS.c.position == integer("own_position"))
    .values(salt=null(), commitment=bindparam("digest"), erasure_id=integer("erasure"))
)
_SUPERSEDE = Query(
    update(_NEW)
    .where(*_AT[1], _NEW.c.position == integer("own_position"), _NEW.c.salt.is_not(None))
    .values(salt=null(), commitment=bindparam("digest"))
)
_UNSEED = Query(update(_REVISION).where(*_AT[2]).values(seed=null()))
_SAY = {
    label: Query(update(_REVISION).where(*_AT[2]).values({label: bindparam("text")}))
    for label in SAID
}


class Taken(NamedTuple):
    """An erased part and its replacement."""

    number: int
    part: Part  # the row to keep, without the erasure
    salt: bytes | None  # the salt of the replacement; None if that is in an archive
    replacement: str  # the commitment to the replacement
    is_new: bool  # whether the revision had no parts before
    superseded: str | None  # the commitment to the old text, if that was a replacement


def next_salt(salt: bytes) -> bytes:
    """Derive the salt of a replacement from the destroyed salt of the old text."""
    # A store that has not followed the erasure yet derives the same.
    return sha256(b"replacement" + salt).digest()[:SEED]


def whole_salt(previous: str | None, name: str, link: Link, lines: Iterable[Row]) -> bytes:
    """Derive a salt from all texts of a revision of form 1, which has none."""
    of = previous, name, link.number, link.committed_at, link.metadata
    return bytes.fromhex(revision_hash(*of, sorted(row[:3] for row in lines), b""))[:SEED]


class Destroyer:
    """Destroys parts of revisions in one knowledge base, in an open transaction."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        name: str,
        into: tuple[Session, int] | None = None,
    ) -> None:
        self._session = session
        self._kb = kb_id
        # The store that gets the commitments.
        self._into = (session, kb_id) if into is None else into
        self._name = name
        self._taken: list[Taken] = []
        self._salts: dict[tuple[int, int], bytes] = {}
        self.form_1 = 0  # the number of revisions of form 1

    def destroy(self, old: Mapping[ChangeKey, str], said: Mapping[int, Mapping[str, str]]) -> None:
        """Keep the commitments to old texts instead of their salts."""
        # `old` has the old texts of changes, whose new ones are already in the tables, and `said`
        # the replacements of the actors, reasons or sources of revisions.
        by_number: defaultdict[int, dict[Any, str]] = defaultdict(dict)
        for (number, *key), text in old.items():
            by_number[number][tuple(key)] = text
        for numbers in batches(sorted({*by_number, *said})):
            lines = lines_by_revision(self._changes(numbers))
            self._salts = _standing(self._session, self._kb, numbers)
            for link in read_links(self._session, self._kb, numbers):
                new = said.get(link.number, {})
                self._destroy(link, lines[link.number], by_number[link.number], new)

    def _changes(self, numbers: list[int]) -> list[Row]:
        return keyed_changes_of(self._session, self._kb, numbers)

    def _destroy(
        self, link: Link, lines: list[Row], old: dict[Any, str], new: Mapping[str, str]
    ) -> None:
        now = {(sign, kind, *key): text for sign, kind, text, *key in lines}
        before = [
            (sign, kind, old.get((sign, kind, *key), text), *key)
            for sign, kind, text, *key in lines
        ]
        if link.fault is not None or not {*old} <= {*now}:
            raise self._damaged(link)
        if link.form == 1:
            self.form_1 += 1
            self._destroy_whole(link, before, lines, new)
            return
        is_new = not link.parts
        parts = link.parts
        if is_new and link.seed is not None:
            parts = tuple(kept_parts(link.seed, link.metadata, sorted(before)))
        wanted = {("", label, 0, 0): getattr(link.metadata, label) for label in new} | old
        texts = {("", label, 0, 0): text for label, text in new.items()} | now
        kept = []
        session, kb = self._into
        for part in parts:
            if part.key in wanted:
                key = part.key
                self._take(link.number, part, wanted.pop(key), texts[key], is_new)
            elif is_new:
                kept.append((kb, link.number, *self._own(part)))
        if wanted:
            raise self._damaged(link)
        session.insert(whole_rows(_PARTS), kept)
        if is_new:
            session.run(_UNSEED, kb=kb, own_number=link.number)

    def _destroy_whole(
        self, link: Link, before: list[Row], after: list[Row], new: Mapping[str, str]
    ) -> None:
        """Keep the hash of a revision of form 1, whose parts have no commitments."""
        previous = hash_of(self._session, self._kb, link.number - 1)
        of = previous, self._name, link.number, link.committed_at
        own: dict[str, Any] = {**new}
        old, now = (
            revision_hash(*of, metadata, sorted(row[:3] for row in lines), None, 1)
            for metadata, lines in (
                (link.metadata, before),
                (link.metadata._replace(**own), after),
            )
        )
        if not link.parts and old != link.hash:
            raise self._damaged(link)
        part = link.parts[0] if link.parts else whole_part(link.hash)
        first = whole_salt(previous, self._name, link, before)
        self._take(link.number, part, old, now, not link.parts, first)

    def _take(
        self, number: int, part: Part, old: str, new: str, is_new: bool, first: bytes = b""
    ) -> None:
        before = self._salts.get((number, part.position))
        salt = next_salt(before or part.salt or first)
        if part.salt is not None:
            part = part._replace(salt=None, commitment=commit_to(part.salt, old))
        superseded = None if before is None else commit_to(before, old)
        replacement = commit_to(salt, new)
        part = self._own(part)
        left = salt if self._has(number, part) else None
        self._taken.append(Taken(number, part, left, replacement, is_new, superseded))

    def _own(self, part: Part) -> Part:
        """Return a part in the form in which it is written."""
        return part

    def _has(self, number: int, part: Part) -> bool:
        """Return whether the replacement of a part is in the store that gets the commitments."""
        return True

    def _damaged(self, link: Link) -> StoreIntegrityError:
        return StoreIntegrityError(
            f"{self._session.backend.label}: revision {link.number} of knowledge base "
            f"{self._name!r} differs from what was hashed; nothing was erased: 'kant-sql verify' "
            "shows what was changed by hand"
        )

    @property
    def parts(self) -> int:
        """The number of erased texts."""
        return len(self._taken)

    @property
    def revisions(self) -> int:
        """The number of their revisions."""
        return len({each.number for each in self._taken})

    def digest(self) -> str:
        """Hash the commitments to the erased texts and to their replacements."""
        digest = sha256()
        for each in sorted(self._taken, key=lambda one: (one.number, one.part.position)):
            add_part(digest, each.number, each.part, each.replacement)
        return digest.hexdigest()

    def write(self, erasure_id: int, said: Mapping[int, Mapping[str, str]]) -> None:
        """Write the commitments, once the erasure has its row."""
        session, kb = self._into
        new, updated, superseded, replaced = [], [], [], []
        for number, part, salt, replacement, is_new, before in self._taken:
            place = {"kb": kb, "own_number": number, "own_position": part.position}
            if is_new:
                new.append((kb, number, *part._replace(erasure_id=erasure_id)))
            elif part.erasure_id is None:
                updated.append({**place, "digest": part.commitment, "erasure": erasure_id})
            if before is not None:
                superseded.append({**place, "digest": before})
            left = replacement if salt is None else None
            replaced.append((kb, number, part.position, erasure_id, salt, left))
        session.insert(whole_rows(_PARTS), new)
        session.run_many(_ERASE, updated)
        session.run_many(_SUPERSEDE, superseded)
        session.insert(whole_rows(_NEW), replaced)
        for label, query in _SAY.items():
            rows = [
                {"kb": kb, "own_number": number, "text": texts[label]}
                for number, texts in said.items()
                if label in texts
            ]
            session.run_many(query, rows)


_STAND = Query(
    select(_NEW.c.number)
    .where(_NEW.c.kb_id == KB, _NEW.c.number <= integer("upto"), _NEW.c.salt.is_not(None))
    .distinct()
    .order_by(_NEW.c.number)
)


def _standing(session: Session, kb_id: int, numbers: list[int]) -> dict[tuple[int, int], bytes]:
    """Return the salts of present replacements of erased parts."""
    rows = session.rows(_STANDING, kb=kb_id, numbers=session.list_value(numbers))
    return {(number, position): salt for number, position, salt in rows}


def standing_commitments(
    session: Session, kb_id: int, name: str, upto: int
) -> dict[tuple[int, int], str]:
    """Return the commitments to present replacements of erased parts."""
    found: dict[tuple[int, int], str] = {}
    for numbers in batches([row[0] for row in session.rows(_STAND, kb=kb_id, upto=upto)]):
        lines = lines_by_revision(keyed_changes_of(session, kb_id, numbers))
        salts = _standing(session, kb_id, numbers)
        for link in read_links(session, kb_id, numbers):
            previous = hash_of(session, kb_id, link.number - 1)
            texts = texts_of(link, name, previous, lines[link.number])
            for part in link.parts:
                text, salt = texts.get(part.key), salts.get((link.number, part.position))
                if text is not None and salt is not None:
                    found[link.number, part.position] = commit_to(salt, text)
    return found


def leave_commitments(
    session: Session, kb_id: int, name: str, upto: int, before: Mapping[tuple[int, int], str]
) -> None:
    """Keep the commitments to archived replacements instead of their salts."""
    now = standing_commitments(session, kb_id, name, upto)
    given = [
        {"kb": kb_id, "own_number": number, "own_position": position, "digest": commitment}
        for (number, position), commitment in before.items()
        if now.get((number, position)) != commitment
    ]
    session.run_many(_SUPERSEDE, given)

"""Erasures reach replicas: each replica erases in its own rows, and compares the results."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from functools import cache
from operator import itemgetter

from sqlalchemy import Table, Text, bindparam, cast, delete, null, select, update

from ...dao.base import batches
from ...errors import StoreIntegrityError
from ...knowledge.canonical import SAID
from ...sql import tables as t
from ...sql.changes import LOW, in_range, keyed_changes_of, lines_by_revision
from ...sql.dialects.base import Session
from ...sql.query import Query, in_list, integer, whole_rows
from ...sql.rows import KB, table_of
from ...store.head import hash_of
from ...store.snapshot import read_position
from ..revisions import LARGEST
from ..rewriting.parts import next_salt, whole_salt
from ..rewriting.texts import Renaming, TextWriter
from ..verify.chain import read_links, texts_of
from ..verify.erasures import ErasureCheck, read_erasures
from ..verify.parts import Part, kept_parts, whole_part
from ..verify.sides import Check, Report
from .copy import ATOMS, COMMITMENT, REPLACEMENT, CopyRange, Identities, Stores

_IN_ORDER = itemgetter(1, 2, 3)
_ERASURE, _REVISION = table_of(t.ErasureRow).c, table_of(t.RevisionRow)
_OBJECT, _NEW = t.TABLES["object"].c, REPLACEMENT.c
_IN_RANGE = Query(
    select(_ERASURE.id, _ERASURE.element_id, _ERASURE.pseudonym)
    .where(_ERASURE.kb_id == KB, in_range(_ERASURE.since))
    .order_by(_ERASURE.id)
)
_TOUCHED = Query(
    select(_NEW.number)
    .where(_NEW.kb_id == KB, in_list(_NEW.erasure_id, "ids"), _NEW.number < LOW)
    .distinct()
    .order_by(_NEW.number)
)
_ERASED = Query(select(_NEW.number).where(_NEW.kb_id == KB).distinct().order_by(_NEW.number))
_NAME = Query(select(_OBJECT.name).where(_OBJECT.kb_id == KB, _OBJECT.id == integer("object")))
_READ_SAID = Query(
    select(_REVISION.c.number, *(cast(_REVISION.c[name], Text) for name in SAID)).where(
        _REVISION.c.kb_id == KB, in_list(_REVISION.c.number, "numbers")
    )
)
_SAY = Query(
    update(_REVISION)
    .where(_REVISION.c.kb_id == bindparam("kb"), _REVISION.c.number == integer("own_number"))
    .values(seed=null(), **{f"{name}": bindparam(f"new_{name}") for name in SAID})
)


@cache
def _rows(table: Table) -> Query:
    return Query(select(*table.c).where(table.c.kb_id == KB, in_list(table.c.number, "numbers")))


@cache
def _remove(table: Table) -> Query:
    return Query(delete(table).where(table.c.kb_id == KB, in_list(table.c.number, "numbers")))


class Followed:
    """The erasures among the revisions that a target gets."""

    def __init__(self, stores: Stores, name: str, bounds: CopyRange) -> None:
        self._stores = stores
        self._name = name
        self._bounds = bounds
        self._identities = Identities(stores, bounds.may_return)
        self._touched: list[int] = []
        # For parts in an archive: the source has no salt for them.
        self._salts: dict[tuple[int, int], bytes] = {}
        self.ids: list[int] = []

    def erase(self) -> None:
        """Erase in the target's present rows, before it gets these revisions."""
        source, source_kb, target, target_kb = self._stores
        low, high, _, _, last = self._bounds
        if last < low:
            return
        found = source.rows(_IN_RANGE, kb=source_kb, low=low, high=high)
        if not found:
            return
        self.ids = [row[0] for row in found]
        self._touched = touched_by(source, source_kb, self.ids, low)
        for numbers in batches(self._touched) if self._bounds.may_return else ():
            self._derive_salts(numbers)
        target.overwrite_deleted()
        for _, element_id, pseudonym in found:
            row = element_id and target.first(_NAME, kb=target_kb, object=element_id)
            if row and row[0] != pseudonym:
                renaming = Renaming(element_id, row[0], pseudonym)
                TextWriter(target, target_kb, self._name, renaming).run()
        for numbers in batches(self._touched):
            self._take_parts(numbers)

    def _derive_salts(self, numbers: list[int]) -> None:
        """Derive the salts that the source lacks from those that erasures are about to destroy."""
        source, source_kb, target, target_kb = self._stores
        wanted, own = (
            _replacements(session, kb_id, numbers)
            for session, kb_id in ((source, source_kb), (target, target_kb))
        )
        moved = {place: ids for place, (ids, salt) in wanted.items() if salt is None}
        if not moved:
            return
        lines = lines_by_revision(keyed_changes_of(target, target_kb, numbers))
        whole = read_position(target, target_kb).archived
        for link in read_links(target, target_kb, numbers):
            parts: Iterable[Part] = link.parts
            if link.seed is not None and link.fault is None and link.number > whole:
                parts = kept_parts(link.seed, link.metadata, sorted(lines[link.number]))
            elif link.form == 1 and not parts and link.number > whole:
                previous = hash_of(target, target_kb, link.number - 1)
                first = whole_salt(previous, self._name, link, lines[link.number])
                parts = [whole_part(link.hash)._replace(salt=first)]
            for part in parts:
                place = link.number, part.position
                known, salt = own.get(place, ({}, part.salt))
                for id_ in moved.get(place, ()):
                    salt = salt if id_ in known or salt is None else next_salt(salt)
                if place in moved and salt is not None:
                    self._salts[place] = salt

    def _take_parts(self, numbers: list[int]) -> None:
        """Copy the rest of some revisions: commitments, salts, and actor, reason and source."""
        source, source_kb, target, target_kb = self._stores
        here = {"kb": source_kb, "numbers": source.list_value(numbers)}
        there = {"kb": target_kb, "numbers": target.list_value(numbers)}
        for table in (REPLACEMENT, COMMITMENT):
            target.run(_remove(table), **there)
        parts, replaced = (source.rows(_rows(table), **here) for table in (COMMITMENT, REPLACEMENT))
        owner = [*COMMITMENT.c.keys()].index("owner_id")
        for atoms in ATOMS if self._bounds.may_return else ():
            self._identities.find_ids(atoms, {row[owner] for row in parts})
        own = self._identities.known_id
        target.insert(
            whole_rows(COMMITMENT),
            [(target_kb, *row[1:owner], own(row[owner]), *row[owner + 1 :]) for row in parts],
        )
        last = {(row[1], row[2]): row[3] for row in sorted(replaced, key=_IN_ORDER)}
        given = [(target_kb, *row[1:]) for row in replaced]
        for index, (_, number, position, id_, *_) in enumerate(given):
            salt = self._salts.get((number, position))
            if salt is not None and last[number, position] == id_:
                given[index] = (target_kb, number, position, id_, salt, None)
        target.insert(whole_rows(REPLACEMENT), given)
        said = source.rows(_READ_SAID, **here)
        names = ("own_number", *(f"new_{name}" for name in SAID))
        values = [{"kb": target_kb, **dict(zip(names, row, strict=True))} for row in said]
        target.run_many(_SAY, values)

    def check(self) -> None:
        """Recompute these revisions' hashes and the digests of all erasures in the target."""
        if not self.ids:
            return
        source, _, target, target_kb = self._stores
        message = first_fault(target, target_kb, self._name, {*self._touched})
        if message is not None:
            raise StoreIntegrityError(
                f"{target.backend.label}: erasures of knowledge base {self._name!r} that "
                f"{source.backend.label} sends do not fit its rows: {message}; "
                "nothing was written: 'kant-sql verify' of both shows which was changed by hand"
            )


def touched_by(session: Session, kb_id: int, ids: Sequence[int], low: int = LARGEST) -> list[int]:
    """Return the revisions, below one, in which some erasures erased texts."""
    listed = session.list_value([*ids])
    return [row[0] for row in session.rows(_TOUCHED, kb=kb_id, ids=listed, low=low)]


def _replacements(
    session: Session, kb_id: int, numbers: list[int]
) -> dict[tuple[int, int], tuple[list[int], bytes | None]]:
    """Return, for each erased part, its erasures, and the salt of the present text."""
    listed = session.list_value(numbers)
    found: dict[tuple[int, int], tuple[list[int], bytes | None]] = {}
    for row in sorted(session.rows(_rows(REPLACEMENT), kb=kb_id, numbers=listed), key=_IN_ORDER):
        _, number, position, id_, salt, _ = row
        ids, _ = found.get((number, position), ([], None))
        found[number, position] = [*ids, id_], salt
    return found


def first_fault(session: Session, kb_id: int, name: str, touched: Collection[int]) -> str | None:
    """Recompute the hashes of some revisions and the digests of all erasures; return a fault."""
    # For a revision with a part in an archive, only the digests check the rest.
    report, upto = Report(), read_position(session, kb_id).archived
    erasures = ErasureCheck(Check(session, kb_id, report), read_erasures(session, kb_id))
    erased = [number for (number,) in session.rows(_ERASED, kb=kb_id)]
    for numbers in batches(erased):
        lines = lines_by_revision(keyed_changes_of(session, kb_id, numbers))
        for link in read_links(session, kb_id, numbers):
            previous, own = hash_of(session, kb_id, link.number - 1), lines[link.number]
            texts = texts_of(link, name, previous, own)
            erasures.take(link.number, link.parts, texts, upto)
            is_whole = link.number in touched and link.number > upto
            if is_whole and link.digest(name, previous, own) != link.hash:
                report.add(link.number, "revision", f"revision {link.number} has another hash")
    erasures.end()
    return next((message for _, _, message in report.findings()), None)

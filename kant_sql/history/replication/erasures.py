"""Erasures reach replicas: each erases in its own rows, and compares what is left."""

from __future__ import annotations

from collections import defaultdict
from functools import cache

from sqlalchemy import Table, Text, bindparam, cast, delete, null, select, update

from ...dao.base import batches
from ...errors import StoreIntegrityError
from ...sql import tables as t
from ...sql.changes import LOW, in_range, keyed_changes_of
from ...sql.dialects.base import Row
from ...sql.query import Query, in_list, integer, whole_rows
from ...sql.rows import KB, table_of
from ...store.head import hash_of
from ..erasure.texts import Renaming, TextWriter
from ..verify.chain import SIGNS, read_links, texts_of
from ..verify.erasures import ErasureCheck
from ..verify.sides import Check, Report
from .copy import COMMITMENT, REPLACEMENT, Stores

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
_SAID = "actor", "reason", "source"
_READ_SAID = Query(
    select(_REVISION.c.number, *(cast(_REVISION.c[name], Text) for name in _SAID)).where(
        _REVISION.c.kb_id == KB, in_list(_REVISION.c.number, "numbers")
    )
)
_SAY = Query(
    update(_REVISION)
    .where(_REVISION.c.kb_id == bindparam("kb"), _REVISION.c.number == integer("own_number"))
    .values(seed=null(), **{f"{name}": bindparam(f"new_{name}") for name in _SAID})
)


@cache
def _rows(table: Table) -> Query:
    return Query(select(*table.c).where(table.c.kb_id == KB, in_list(table.c.number, "numbers")))


@cache
def _remove(table: Table) -> Query:
    return Query(delete(table).where(table.c.kb_id == KB, in_list(table.c.number, "numbers")))


class Followed:
    """The erasures among the revisions that a target gets.

    Attributes:
        ids: their ids.
    """

    def __init__(self, stores: Stores, name: str, low: int, high: int, erased: int) -> None:
        self._stores = stores
        self._name = name
        self._range = {"low": low, "high": high}
        # The last erasure of the source.
        self._erased = erased
        self._touched: list[int] = []
        self.ids: list[int] = []

    def erase(self) -> None:
        """Erase in what the target has already, before it gets these revisions."""
        source, source_kb, target, target_kb = self._stores
        if self._erased < self._range["low"]:
            return
        found = source.rows(_IN_RANGE, kb=source_kb, **self._range)
        if not found:
            return
        self.ids = [row[0] for row in found]
        target.overwrite_deleted()
        for _, element_id, pseudonym in found:
            row = element_id and target.first(_NAME, kb=target_kb, object=element_id)
            if row and row[0] != pseudonym:
                renaming = Renaming(element_id, row[0], pseudonym)
                TextWriter(target, target_kb, self._name, renaming).run()
        ids = source.list_value(self.ids)
        touched = source.rows(_TOUCHED, kb=source_kb, ids=ids, low=self._range["low"])
        self._touched = [number for (number,) in touched]
        for numbers in batches(self._touched):
            self._take_parts(numbers)

    def _take_parts(self, numbers: list[int]) -> None:
        """Take over what is left of some revisions: commitments, salts, and what they say."""
        source, source_kb, target, target_kb = self._stores
        here = {"kb": source_kb, "numbers": source.list_value(numbers)}
        there = {"kb": target_kb, "numbers": target.list_value(numbers)}
        for table in (REPLACEMENT, COMMITMENT):
            target.run(_remove(table), **there)
        for table in (COMMITMENT, REPLACEMENT):
            rows: list[Row] = source.rows(_rows(table), **here)
            target.insert(whole_rows(table), [(target_kb, *row[1:]) for row in rows])
        said = source.rows(_READ_SAID, **here)
        names = ("own_number", *(f"new_{name}" for name in _SAID))
        given = [{"kb": target_kb, **dict(zip(names, row, strict=True))} for row in said]
        target.run_many(_SAY, given)

    def check(self) -> None:
        """Recompute these revisions' hashes and the digests of all erasures in the target."""
        if not self.ids:
            return
        _, _, target, target_kb = self._stores
        report, touched = Report(), {*self._touched}
        erasures = ErasureCheck(Check(target, target_kb, report))
        erased = [number for (number,) in target.rows(_ERASED, kb=target_kb)]
        for numbers in batches(erased):
            lines: defaultdict[int, list[Row]] = defaultdict(list)
            for number, sign, *line in keyed_changes_of(target, target_kb, numbers):
                lines[number].append((SIGNS[sign], *line))
            for link in read_links(target, target_kb, numbers):
                previous, own = hash_of(target, target_kb, link.number - 1), lines[link.number]
                texts = texts_of(link, self._name, previous, own)
                erasures.take(link.number, link.parts, texts, 0)
                if link.number in touched and link.digest(self._name, previous, own) != link.hash:
                    report.add(link.number, "revision", f"revision {link.number} has another hash")
        erasures.end()
        for _, _, message in report.findings()[:1]:
            raise StoreIntegrityError(
                f"{target.backend.label}: erasures of knowledge base {self._name!r} that "
                f"{self._stores.source.backend.label} sends do not fit what is there: {message}; "
                "nothing was written: 'kant-sql verify' of both shows which was changed by hand"
            )

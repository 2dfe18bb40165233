"""Copying a range of revisions, with all that they asserted and retracted."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache, partial
from typing import Any, NamedTuple

from sqlalchemy import BigInteger, ColumnElement, Table, bindparam, select, update

from ..backends import Query, Row, in_rows
from ..errors import ConflictError
from ..knowledge.changes import LOW, in_range
from ..knowledge.loading import KB
from ..knowledge.past import fork
from ..knowledge.rows import table_of
from ..tables import RevisionPlanStepRow, RevisionRow
from .converting import batches, columns_of, converted, converters
from .identities import Identities, Stores
from .parts import (
    ARCHIVE,
    ATOMS,
    BELOW_PLANS,
    PARTS,
    PLAN,
    Part,
    children_of,
    references,
)

_REVISION, _PLAN_STEP = table_of(RevisionRow), table_of(RevisionPlanStepRow)


class Copied(NamedTuple):
    """What was copied.

    Attributes:
        rows: how many versions were written or closed.
        definition_revision: the last revision that changed a definition; 0 for none of these.
        largest_id: the largest id that was written; 0 for none.
    """

    rows: int
    definition_revision: int
    largest_id: int


def _all_of(table: Table, *condition: ColumnElement[bool]) -> Query:
    statement = select(*columns_of(table)).where(table.c.kb_id == KB, *condition)
    return Query(statement.order_by(*table.primary_key.columns.values()[1:]))


@cache
def _asserted(table: Table) -> Query:
    """Give what revisions of the range asserted, of a table with `since`."""
    statement = select(*columns_of(table)).where(table.c.kb_id == KB, in_range(table.c.since))
    return Query(statement)


@cache
def _closed(part: Part) -> Query:
    """Give what revisions of the range retracted, and earlier ones had asserted."""
    version = part.version.c
    owner = (version[name] for name in part.owner)
    return Query(
        select(*owner, version.since, version.until).where(
            version.kb_id == KB, in_range(version.until), version.since < LOW
        )
    )


@cache
def _close(part: Part) -> Query:
    version = part.version.c
    owner = (version[name] == bindparam(f"own_{name}") for name in part.owner)
    since, until = (bindparam(f"own_{name}", type_=BigInteger) for name in ("since", "until"))
    values: dict[str, Any] = {"until": until}
    if "fork" in version:
        values["fork"] = bindparam("own_fork", type_=BigInteger)
    return Query(
        update(part.version)
        .where(version.kb_id == bindparam("kb"), *owner, version.since == since)
        .values(**values)
    )


@cache
def _children(part: Part, child: Table) -> Query:
    held = children_of(part, child, in_range(part.version.c.since))
    return _all_of(child, *held[1:], in_range(child.c.since))


@cache
def _below_plans(table: Table) -> Query:
    plans = select(PLAN.c.id).where(PLAN.c.kb_id == KB, in_range(PLAN.c.since))
    return _all_of(table, in_rows(table.c.plan_id, plans))


_REVISIONS = _all_of(_REVISION, in_range(_REVISION.c.number))
_STEPS = _all_of(_PLAN_STEP, in_range(_PLAN_STEP.c.number))


class Copy:
    """Copies one range of revisions."""

    def __init__(self, stores: Stores, low: int, high: int, may_return: bool) -> None:
        """Make it.

        Args:
            stores: the two stores; the source sees one state.
            low: the first revision.
            high: the last revision.
            may_return: whether atoms may have been moved before.
        """
        self._reader = stores.source
        self._stores = stores
        self._range = {"kb": stores.source_kb, "low": low, "high": high}
        self._high = high
        self._identities = Identities(stores, may_return)
        self._rows = 0
        self._definition_revision = 0
        self._largest = 0

    def run(self) -> Copied:
        """Copy it all.

        Returns:
            How much it was.
        """
        self._insert(_REVISION, _REVISIONS)
        for part in PARTS[:-1]:
            self._copy_part(part)
        if self._insert(PLAN, _asserted(PLAN)):
            for table in BELOW_PLANS:
                self._insert(table, _below_plans(table))
        self._copy_part(PARTS[-1])
        self._insert(_PLAN_STEP, _STEPS)
        self._insert(ARCHIVE, _asserted(ARCHIVE))
        largest = max(self._largest, self._identities.largest)
        return Copied(self._rows, self._definition_revision, largest)

    def _copy_part(self, part: Part) -> None:
        # First: of each element, one version holds at most.
        closed = self._close(part)
        inserted = self._insert(part.version, _asserted(part.version), part)
        if inserted:
            for child in part.children:
                self._insert(child, _children(part, child))
        self._rows += inserted + closed

    def _insert(self, table: Table, query: Query, part: Part | None = None) -> int:
        target, target_kb = self._stores.target, self._stores.target_kb
        adapt = self._adapter(table)
        count = 0
        for rows in batches(self._reader.stream(query, **self._range)):
            self._identities.trim()
            self._identities.bring(table, rows)
            target.insert(table, [(target_kb, *adapt(row)[1:]) for row in rows])
            count += len(rows)
            if part is not None and part.is_definition:
                ends = (end for row in rows for end in row[2:4] if end is not None)
                self._see(end for end in ends if end <= self._high)
            elif table in (PLAN, ARCHIVE):
                self._largest = max(self._largest, *(row[1] for row in rows))
        return count

    def _adapter(self, table: Table) -> Callable[[Row], Row]:
        """Give what makes a row of the source one of the target."""
        convert: dict[int, Callable[[Any], Any]] = converters(
            table.columns, self._reader, self._stores.target
        )
        names = [column.name for column in table.columns]
        for index, identity in references(table):
            if identity in ATOMS:
                convert[index] = partial(self._identities.id_of, identity)
        if "until" not in names:
            return lambda row: converted(row, convert)
        since, until = names.index("since"), names.index("until")

        def adapt(row: Row) -> Row:
            values = list(converted(row, convert))
            if values[until] is not None and values[until] > self._high:
                # What was retracted later holds still at the last of these revisions.
                values[until] = None
            if "fork" in names:
                values[names.index("fork")] = fork(values[since], values[until])
            return tuple(values)

        return adapt

    def _close(self, part: Part) -> int:
        """Close what earlier revisions had asserted."""
        names = [f"own_{name}" for name in (*part.owner, "since", "until")]
        target, target_kb = self._stores.target, self._stores.target_kb
        count = 0
        for ended in batches(self._reader.stream(_closed(part), **self._range)):
            rows = self._with_own_ids(part, ended)
            closing = [{"kb": target_kb, **dict(zip(names, row, strict=True))} for row in rows]
            if "fork" in part.version.c:
                for row in closing:
                    row["own_fork"] = fork(row["own_since"], row["own_until"])
            if target.run_many(_close(part), closing) != len(closing):
                raise ConflictError(
                    f"{target.backend.label}: rows of {part.version.name} are missing there that "
                    "it was given before; archive into a copy of it that is whole"
                )
            count += len(rows)
            if part.is_definition:
                self._see(row[-1] for row in rows)
        return count

    def _with_own_ids(self, part: Part, rows: list[Row]) -> list[Row]:
        """Give rows that begin with an id, with the one that it has in the target."""
        if part.atoms is None:
            return rows
        identity = part.atoms.identity
        self._identities.trim()
        self._identities.bring_ids(identity, {row[0] for row in rows})
        return [(self._identities.id_of(identity, row[0]), *row[1:]) for row in rows]

    def _see(self, revisions: Iterable[int]) -> None:
        """Take note of revisions that have changed a definition."""
        self._definition_revision = max(self._definition_revision, *revisions, 0)

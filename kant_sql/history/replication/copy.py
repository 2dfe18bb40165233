"""Copies a range of revisions, with everything that they refer to, into another store."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

from sqlalchemy import (
    Boolean,
    ColumnElement,
    Select,
    Table,
    Text,
    and_,
    bindparam,
    cast,
    or_,
    select,
    update,
)

from ...dao.base import batches
from ...errors import UNREADABLE, ConflictError, StoreIntegrityError, reading_rows
from ...sql import tables as t
from ...sql.changes import LOW, in_range
from ...sql.dialects.base import Row, Session
from ...sql.executions import NO_PLAN
from ...sql.intervals import fork
from ...sql.query import Query, constant, found_rows, in_rows, integer, whole_rows
from ...sql.rows import ATOM_TABLES, KB, KIND_TABLES, AtomTables, is_of_version, table_of
from ...sql.tables.base import UtcTime

_REVISION, _LINK = table_of(t.RevisionRow), table_of(t.RevisionExecutionRow)


def _rows_of(table: Table, *conditions: ColumnElement[bool]) -> Select[Any]:
    """Select rows of a table, with all columns in order."""
    # As text: a driver would parse the JSON document, but the hash covers its text.
    is_json = {_REVISION.c.source}
    columns = (cast(column, Text) if column in is_json else column for column in table.columns)
    return select(*columns).where(table.c.kb_id == KB, *conditions)


def converters(
    columns: Iterable[ColumnElement[Any]], source: Session, target: Session
) -> dict[int, Callable[[Any], Any]]:
    """Return the functions that convert the values of some columns, by index."""
    found: dict[int, Callable[[Any], Any]] = {}
    for index, column in enumerate(columns):
        if isinstance(column.type, Boolean):
            found[index] = bool
        elif isinstance(column.type, UtcTime):
            found[index] = lambda raw: (
                None if raw is None else target.from_time(source.to_time(raw))
            )
    return found


def converted(row: Row, convert: Mapping[int, Callable[[Any], Any]]) -> Row:
    """Convert a row."""
    if not convert:
        return row
    values = list(row)
    for index, change in convert.items():
        values[index] = change(values[index])
    return tuple(values)


class CopiedTable(NamedTuple):
    """A table of versions, each of which holds from one revision until another."""

    version: Table
    owner: tuple[str, ...]  # the columns of the identity, without `kb_id`
    children: tuple[Table, ...] = ()  # the tables below it, parents first
    # for identities that are removed with their last version; None for names and outcomes
    atoms: AtomTables | None = None
    is_definition: bool = False  # whether its changes move `head.definition_revision`


ATOMS = {atoms.identity: atoms for atoms in ATOM_TABLES.values()}
ARCHIVED_TABLES = (
    *(
        CopiedTable(kind.version.table, (f"{name}_id",), kind.version.children, is_definition=True)
        for name, kind in KIND_TABLES.items()
    ),
    *(CopiedTable(each.version, (each.owner,), atoms=each) for each in ATOMS.values()),
)
IDENTITIES = {*(kind.identity for kind in KIND_TABLES.values()), *ATOMS}
PLAN = table_of(t.PlanRow)
# Records that are written once, besides plans.
ERASURE = table_of(t.ErasureRow)
RECORDS = table_of(t.ArchiveRow), table_of(t.PromotionRow), ERASURE
# When versions move to an archive, these rows stay in the store, as records do.
CONFIRMATION = table_of(t.ConfirmationRow)
SAYINGS = tuple(atoms.sayings for atoms in ATOMS.values())
COMMITMENT, REPLACEMENT = table_of(t.CommitmentRow), table_of(t.ReplacementRow)
EXECUTION, ARGUMENT = table_of(t.ExecutionRow), table_of(t.ExecutionArgumentRow)
VERSION = table_of(t.ExecutionVersionRow)
# An act began with its first outcome, so all of them stay in the store.
OUTCOMES = CopiedTable(VERSION, ("plan_id", "position"))


def children_of(
    part: CopiedTable, child: Table, held: ColumnElement[bool]
) -> tuple[ColumnElement[bool], ...]:
    """Write the condition that a row belongs to a version for which `held` is true."""
    version, (owner,) = part.version, part.owner
    which = and_(version.c.kb_id == KB, held)
    return child.c.kb_id == KB, *is_of_version(child, version, owner, which)


def references(table: Table) -> tuple[tuple[int, Table], ...]:
    """Return the columns of a table that refer to identities, by index."""
    places = {column.name: index for index, column in enumerate(table.columns)}
    found = {
        (places[constraint.column_keys[-1]], constraint.referred_table)
        for constraint in table.foreign_key_constraints
        if constraint.referred_table in IDENTITIES and len(constraint.column_keys) == 2
    }
    return tuple(sorted(found, key=lambda reference: reference[0]))


# The maximum number of cached identities per table.
_REMEMBERED = 100_000


class Stores(NamedTuple):
    """A knowledge base in the two stores between which its rows are copied."""

    source: Session
    source_kb: int
    target: Session
    target_kb: int


@cache
def _of_ids(owner: ColumnElement[int], *columns: ColumnElement[Any]) -> Query:
    """Read columns of the rows of a table, or all columns, by the ids in one of them."""
    table: Any = owner.table
    rows = _rows_of(table)
    some = rows.with_only_columns(*columns) if columns else rows
    return Query(select(*found_rows(some, owner, "ids").c))


@cache
def _by_key(atoms: AtomTables) -> Query:
    columns = atoms.identity.c
    *exact, last = atoms.key
    own = (columns[name] == bindparam(name) for name in exact)
    rows = select(columns.id, columns[last]).where(columns.kb_id == KB, *own)
    return Query(select(*found_rows(rows, columns[last], "keys").c))


class Identities:
    """The identities that one transaction needs in the target; it writes the missing ones.

    A name keeps its id in both stores. A ground atom that was archived and came back has a new id
    in the source, and its old one in the target.
    """

    def __init__(self, stores: Stores, may_return: bool) -> None:
        self._stores = stores
        self._may_return = may_return
        self._ids: dict[Table, dict[int, int]] = {table: {} for table in IDENTITIES}
        self.largest = 0  # the largest written id

    def trim(self) -> None:
        """Bound the cache, between batches of rows."""
        for known in self._ids.values():
            if len(known) > _REMEMBERED:
                known.clear()

    def bring(self, table: Table, rows: Sequence[Row]) -> None:
        """Copy the identities that rows refer to, if the target lacks them."""
        wanted: defaultdict[Table, set[int]] = defaultdict(set)
        for index, identity in references(table):
            wanted[identity].update(row[index] for row in rows if row[index] is not None)
        for identity, ids in wanted.items():
            self.bring_ids(identity, ids)

    def bring_ids(self, table: Table, ids: set[int]) -> None:
        """Copy some identities, if the target lacks them."""
        missing = ids - self._ids[table].keys()
        if missing:
            self._bring(table, sorted(missing))

    def id_of(self, table: Table, id_: int) -> int:
        """Return the id of an identity in the target."""
        return self._ids[table][id_]

    def known_id(self, id_: int) -> int:
        """Return the id in the target of an element that these revisions change."""
        # No two elements of any kind have the same id.
        facts, fluents = (self._ids[table] for table in ATOMS)
        return facts.get(id_) or fluents.get(id_) or id_

    def find_ids(self, table: Table, ids: set[int]) -> Mapping[int, int]:
        """Find some identities in the target, without writing."""
        self._find(table, sorted(ids - self._ids[table].keys()))
        return self._ids[table]

    def _bring(self, table: Table, ids: list[int]) -> None:
        rows = self._find(table, ids)
        known = self._ids[table]
        lost = {*ids} - known.keys() - {row[1] for row in rows}
        if lost:
            raise StoreIntegrityError(
                f"{self._stores.source.backend.label}: {table.name} {min(lost)} is missing, "
                "although others refer to it; verify the store; nothing of these revisions was "
                "written"
            )
        self._write(table, rows)

    def _find(self, table: Table, ids: list[int]) -> list[Row]:
        """Find identities in the target; return the rows of the missing ones."""
        if not ids:
            return []
        source, source_kb, target, target_kb = self._stores
        known, own = self._ids[table], table.c.id
        there = target.rows(_of_ids(own, own), kb=target_kb, ids=target.list_value(ids))
        known.update((id_, id_) for (id_,) in there)
        missing = [id_ for id_ in ids if id_ not in known]
        if not missing:
            return []
        rows = source.rows(_of_ids(own), kb=source_kb, ids=source.list_value(missing))
        if table in ATOMS and self._may_return:
            rows = self._recognise(ATOMS[table], rows)
        return rows

    def _recognise(self, atoms: AtomTables, rows: list[Row]) -> list[Row]:
        """Map atoms that have another id in the target; return the others."""
        _, _, target, target_kb = self._stores
        *exact, last = (list(atoms.identity.c.keys()).index(name) for name in atoms.key)
        flags = [isinstance(atoms.identity.c[name].type, Boolean) for name in atoms.key[:-1]]
        groups: defaultdict[tuple[int, ...], dict[str, int]] = defaultdict(dict)
        for row in rows:
            # A boolean is a number on SQLite.
            key = (bool(row[i]) if flag else row[i] for i, flag in zip(exact, flags, strict=True))
            groups[tuple(key)][row[last]] = row[1]
        for values, ids in groups.items():
            found = target.rows(
                _by_key(atoms),
                kb=target_kb,
                keys=target.list_value([*ids]),
                **dict(zip(atoms.key, values, strict=False)),
            )
            self._ids[atoms.identity].update((ids[key], id_) for id_, key in found)
        known = self._ids[atoms.identity]
        return [row for row in rows if row[1] not in known]

    def _write(self, table: Table, rows: list[Row]) -> None:
        if not rows:
            return
        source, source_kb, target, target_kb = self._stores
        self.bring(table, rows)
        convert = converters(table.columns, source, target)
        target.insert(
            whole_rows(table), [(target_kb, *converted(row, convert)[1:]) for row in rows]
        )
        ids = [row[1] for row in rows]
        self._ids[table].update(zip(ids, ids, strict=True))
        self.largest = max(self.largest, *ids)
        if table in ATOMS:
            atoms = ATOMS[table]
            query = _of_ids(atoms.arguments.c[atoms.owner])
            arguments = source.rows(query, kb=source_kb, ids=source.list_value(ids))
            self.bring(atoms.arguments, arguments)
            target.insert(whole_rows(atoms.arguments), [(target_kb, *row[1:]) for row in arguments])


def _adapted(
    table: Table, rows: list[Row], adapt: Callable[[Row], Row], target_kb: int
) -> list[Row]:
    """Convert rows for the target; name the one that cannot be read."""
    try:
        return [(target_kb, *adapt(row)[1:]) for row in rows]
    except UNREADABLE:
        name = table.columns[1].name
        for row in rows:
            with reading_rows(table.name, f"{name.removesuffix('_id')} {row[1]!r}"):
                adapt(row)
        raise


class CopyRange(NamedTuple):
    """The revisions to copy."""

    low: int  # the first
    high: int  # the last
    may_return: bool  # whether atoms may have other ids in the target, because of an archive
    redefined: bool  # whether they may change definitions
    erased: int  # the last erasure in the source; 0 without one


class Copied(NamedTuple):
    """The result of a copy."""

    rows: int  # the number of versions written or closed
    definition_revision: int  # the last revision that changed a definition; 0 without one
    largest_id: int  # the largest written id; 0 without one
    erasures: int = 0  # the number of erasures that the target followed


def _all_of(table: Table, *condition: ColumnElement[bool]) -> Query:
    rows = _rows_of(table, *condition)
    return Query(rows.order_by(*table.primary_key.columns.values()[1:]))


@cache
def _asserted(table: Table) -> Query:
    """Select the rows that begin in the range, or whose number is in it."""
    number = table.c.since if "since" in table.c else table.c.number
    return Query(_rows_of(table, in_range(number)))


@cache
def _closed(part: CopiedTable) -> Query:
    """Select the versions that the range retracted and earlier revisions asserted."""
    version = part.version.c
    owner = (version[name] for name in part.owner)
    return Query(
        select(*owner, version.since, version.until).where(
            version.kb_id == KB, in_range(version.until), version.since < LOW
        )
    )


@cache
def _close(part: CopiedTable) -> Query:
    version = part.version.c
    owner = (version[name] == bindparam(f"own_{name}") for name in part.owner)
    since, until = map(integer, ("own_since", "own_until"))
    values: dict[str, Any] = {"until": until}
    if "fork" in version:
        values["fork"] = integer("own_fork")
    return Query(
        update(part.version)
        .where(version.kb_id == bindparam("kb"), *owner, version.since == since)
        .values(**values)
    )


@cache
def _children(part: CopiedTable, child: Table) -> Query:
    held = children_of(part, child, in_range(part.version.c.since))
    return _all_of(child, *held[1:], in_range(child.c.since))


@cache
def _recorded(table: Table) -> Query:
    """Select the rows of the executions that the range recorded."""
    plans = select(PLAN.c.id).where(PLAN.c.kb_id == KB, in_range(PLAN.c.since))
    # An execution without a plan is recorded with its first outcome.
    began, execution = VERSION.alias("began").c, EXECUTION.alias("own").c
    own = select(began.position).where(
        began.kb_id == KB, began.plan_id == constant(NO_PLAN), in_range(began.since)
    )
    recorded = select(constant(1)).where(
        execution.kb_id == KB,
        execution.plan_id == constant(NO_PLAN),
        execution.position == table.c.position,
        in_range(execution.since),
    )
    is_own = and_(table.c.plan_id == constant(NO_PLAN), in_rows(table.c.position, own))
    is_new = recorded.correlate(table).exists()
    return _all_of(table, or_(in_rows(table.c.plan_id, plans), and_(is_own, is_new)))


class Copy:
    """Copies one range of revisions."""

    def __init__(self, stores: Stores, bounds: CopyRange) -> None:
        low, high, may_return, redefined, erased = bounds
        self._reader = stores.source
        self._stores = stores
        self._range = {"kb": stores.source_kb, "low": low, "high": high}
        self._high = high
        # Whether the range may change definitions.
        self._redefined = redefined
        # Whether it may have an erasure, or its results.
        self._erased = erased >= low
        self._identities = Identities(stores, may_return)
        self._rows = 0
        self._definition_revision = 0
        self._largest = 0

    def run(self) -> Copied:
        """Copy the range."""
        self._insert(_REVISION, _asserted(_REVISION))
        for part in ARCHIVED_TABLES:
            if self._redefined or not part.is_definition:
                self._copy_part(part)
        self._insert(PLAN, _asserted(PLAN))
        if self._insert(EXECUTION, _recorded(EXECUTION)):
            self._insert(ARGUMENT, _recorded(ARGUMENT))
        self._copy_part(OUTCOMES)
        # Commitments last: they name atoms of these revisions by ids, which may differ in the
        # target.
        for table in (_LINK, *RECORDS, CONFIRMATION, *SAYINGS, COMMITMENT, REPLACEMENT):
            if self._erased or table not in (ERASURE, COMMITMENT, REPLACEMENT):
                self._insert(table, _asserted(table))
        largest = max(self._largest, self._identities.largest)
        return Copied(self._rows, self._definition_revision, largest)

    def _copy_part(self, part: CopiedTable) -> None:
        # First: at most one version of an element is open.
        closed = self._close(part)
        inserted = self._insert(part.version, _asserted(part.version), part)
        if inserted:
            for child in part.children:
                self._insert(child, _children(part, child))
        self._rows += inserted + closed

    def _insert(self, table: Table, query: Query, part: CopiedTable | None = None) -> int:
        target, target_kb = self._stores.target, self._stores.target_kb
        adapt = self._adapter(table)
        count = 0
        for rows in batches(self._reader.stream(query, **self._range)):
            self._identities.trim()
            self._identities.bring(table, rows)
            target.insert(whole_rows(table), _adapted(table, rows, adapt, target_kb))
            count += len(rows)
            if part is not None and part.is_definition:
                ends = (end for row in rows for end in row[2:4] if end is not None)
                self._see(end for end in ends if end <= self._high)
            elif table in (PLAN, *RECORDS):
                self._largest = max(self._largest, *(row[1] for row in rows))
                if table is ERASURE:
                    self._see(row[2] for row in rows)
            elif table is EXECUTION:
                own = (row[2] for row in rows if row[1] == NO_PLAN)
                self._largest = max(self._largest, *own, 0)
        return count

    def _adapter(self, table: Table) -> Callable[[Row], Row]:
        """Return the function that converts a row of the source for the target."""
        convert: dict[int, Callable[[Any], Any]] = converters(
            table.columns, self._reader, self._stores.target
        )
        names = [column.name for column in table.columns]
        for index, identity in references(table):
            if identity in ATOMS:
                convert[index] = partial(self._identities.id_of, identity)
        if table is COMMITMENT:
            convert[names.index("owner_id")] = self._identities.known_id
        if "until" not in names:
            return lambda row: converted(row, convert)
        since, until = names.index("since"), names.index("until")

        def adapt(row: Row) -> Row:
            values = list(converted(row, convert))
            if values[until] is not None and values[until] > self._high:
                # At the end of the range, a version that a later revision retracts is open.
                values[until] = None
            if "fork" in names:
                values[names.index("fork")] = fork(values[since], values[until])
            return tuple(values)

        return adapt

    def _close(self, part: CopiedTable) -> int:
        """Close versions of earlier revisions."""
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
                    f"{target.backend.label}: rows of {part.version.name} are missing that an "
                    "earlier call wrote; verify that store, and replicate into a complete copy"
                )
            count += len(rows)
            if part.is_definition:
                self._see(row[-1] for row in rows)
        return count

    def _with_own_ids(self, part: CopiedTable, rows: list[Row]) -> list[Row]:
        """Replace the ids at the beginning of rows by those in the target."""
        if part.atoms is None:
            return rows
        identity = part.atoms.identity
        self._identities.trim()
        self._identities.bring_ids(identity, {row[0] for row in rows})
        return [(self._identities.id_of(identity, row[0]), *row[1:]) for row in rows]

    def _see(self, revisions: Iterable[int]) -> None:
        """Record revisions that changed a definition."""
        self._definition_revision = max(self._definition_revision, *revisions, 0)

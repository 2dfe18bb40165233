"""What rows refer to: names and ground atoms, brought along when the target lacks them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

from sqlalchemy import Boolean, Table, bindparam, select

from ..backends import Query, Row, Session, in_list
from ..errors import StoreIntegrityError
from ..knowledge.loading import KB
from .converting import columns_of, converted, converters
from .parts import ATOMS, IDENTITIES, Atoms, references

# So many are remembered of each table.
_REMEMBERED = 100_000


class Stores(NamedTuple):
    """Two stores between which rows are copied, each in a transaction.

    Attributes:
        source: where rows are read.
        source_kb: the knowledge base there.
        target: where they are written.
        target_kb: the same knowledge base there.
    """

    source: Session
    source_kb: int
    target: Session
    target_kb: int


@cache
def _by_ids(table: Table) -> Query:
    return Query(select(*columns_of(table)).where(table.c.kb_id == KB, in_list(table.c.id, "ids")))


@cache
def _which_are_there(table: Table) -> Query:
    return Query(select(table.c.id).where(table.c.kb_id == KB, in_list(table.c.id, "ids")))


@cache
def _arguments(atoms: Atoms) -> Query:
    table = atoms.arguments
    owner = table.primary_key.columns.values()[1]
    return Query(select(*table.columns).where(table.c.kb_id == KB, in_list(owner, "ids")))


@cache
def _by_key(atoms: Atoms) -> Query:
    columns = atoms.identity.c
    *exact, last = atoms.key
    return Query(
        select(columns.id, columns[last]).where(
            columns.kb_id == KB,
            *(columns[name] == bindparam(name) for name in exact),
            in_list(columns[last], "keys"),
        )
    )


class Identities:
    """The identities that one transaction on the target needs, and writes where they are missing.

    A name has one id in both stores for ever. A ground atom that was moved, and came back, has a
    new one in the source; in the target it is what it was.

    Attributes:
        largest: the largest id that was written.
    """

    def __init__(self, stores: Stores, may_return: bool) -> None:
        """Make it.

        Args:
            stores: the two stores.
            may_return: whether atoms may have been moved before.
        """
        self._stores = stores
        self._may_return = may_return
        self._ids: dict[Table, dict[int, int]] = {table: {} for table in IDENTITIES}
        self.largest = 0

    def trim(self) -> None:
        """Forget what is known if it is much: between one batch of rows and the next."""
        for known in self._ids.values():
            if len(known) > _REMEMBERED:
                known.clear()

    def bring(self, table: Table, rows: Sequence[Row]) -> None:
        """Make sure that the target has what rows refer to.

        Args:
            table: the table of the rows.
            rows: the rows, with the ids of the source.
        """
        wanted: defaultdict[Table, set[int]] = defaultdict(set)
        for index, identity in references(table):
            wanted[identity].update(row[index] for row in rows if row[index] is not None)
        for identity, ids in wanted.items():
            self.bring_ids(identity, ids)

    def bring_ids(self, table: Table, ids: set[int]) -> None:
        """Make sure that the target has some identities.

        Args:
            table: the identity table.
            ids: their ids in the source.
        """
        missing = ids - self._ids[table].keys()
        if missing:
            self._bring(table, sorted(missing))

    def id_of(self, table: Table, id_: int) -> int:
        """Give the id that an identity has in the target.

        Args:
            table: the identity table.
            id_: the id in the source, of a row that was given to `bring` just before.

        Returns:
            The id.
        """
        return self._ids[table][id_]

    def _bring(self, table: Table, ids: list[int]) -> None:
        source, source_kb, target, target_kb = self._stores
        known = self._ids[table]
        there = target.rows(_which_are_there(table), kb=target_kb, ids=target.list_value(ids))
        known.update((id_, id_) for (id_,) in there)
        missing = [id_ for id_ in ids if id_ not in known]
        if not missing:
            return
        rows = source.rows(_by_ids(table), kb=source_kb, ids=source.list_value(missing))
        if len(rows) < len(missing):
            lost = min(set(missing) - {row[1] for row in rows})
            raise StoreIntegrityError(
                f"{source.backend.label}: {table.name} {lost} is referred to and not there; "
                "verify the store; nothing of these revisions was archived"
            )
        if table in ATOMS and self._may_return:
            rows = self._recognise(ATOMS[table], rows)
        self._write(table, rows)

    def _recognise(self, atoms: Atoms, rows: list[Row]) -> list[Row]:
        """Find atoms that the target knows by another id; give the others."""
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
        target.insert(table, [(target_kb, *converted(row, convert)[1:]) for row in rows])
        ids = [row[1] for row in rows]
        self._ids[table].update(zip(ids, ids, strict=True))
        self.largest = max(self.largest, *ids)
        if table in ATOMS:
            atoms = ATOMS[table]
            arguments = source.rows(_arguments(atoms), kb=source_kb, ids=source.list_value(ids))
            self.bring(atoms.arguments, arguments)
            target.insert(atoms.arguments, [(target_kb, *row[1:]) for row in arguments])

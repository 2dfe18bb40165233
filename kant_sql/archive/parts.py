"""Which tables hold what ends, and what is below them."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Table, and_, select

from ..knowledge.loading import KB
from ..knowledge.rows import KIND_TABLES, is_of_version, table_of
from ..tables import (
    ArchiveRow,
    FunctionValueArgumentRow,
    FunctionValueRow,
    FunctionValueVersionRow,
    PlanRow,
    PlanStepArgumentRow,
    PlanStepRow,
    PlanStepVersionRow,
    PropositionArgumentRow,
    PropositionRow,
    PropositionVersionRow,
)


class Atoms(NamedTuple):
    """Ground atoms: they have no name, and go with the last of their versions.

    Attributes:
        identity: the identity table.
        arguments: the table of their arguments.
        key: the columns that make one what it is, the last being its arguments.
    """

    identity: Table
    arguments: Table
    key: tuple[str, ...]


class Part(NamedTuple):
    """A table of what holds from one revision until another.

    Attributes:
        version: the table.
        owner: the columns that say of what, without `kb_id`.
        children: the tables below it, parents first.
        atoms: what it says when it holds, if that are ground atoms.
        is_definition: whether the head counts its changes as changes of definitions.
    """

    version: Table
    owner: tuple[str, ...]
    children: tuple[Table, ...] = ()
    atoms: Atoms | None = None
    is_definition: bool = False


FACTS = Atoms(
    table_of(PropositionRow),
    table_of(PropositionArgumentRow),
    ("is_goal", "predicate_id", "arguments"),
)
FLUENTS = Atoms(
    table_of(FunctionValueRow), table_of(FunctionValueArgumentRow), ("function_id", "arguments")
)
ATOMS = {atoms.identity: atoms for atoms in (FACTS, FLUENTS)}
PARTS = (
    *(
        Part(kind.version.table, (f"{name}_id",), kind.version.children, is_definition=True)
        for name, kind in KIND_TABLES.items()
    ),
    Part(table_of(PropositionVersionRow), ("proposition_id",), atoms=FACTS),
    Part(table_of(FunctionValueVersionRow), ("function_value_id",), atoms=FLUENTS),
    Part(table_of(PlanStepVersionRow), ("plan_id", "position")),
)
IDENTITIES = {*(kind.identity for kind in KIND_TABLES.values()), *ATOMS}
PLAN, ARCHIVE = table_of(PlanRow), table_of(ArchiveRow)
BELOW_PLANS = table_of(PlanStepRow), table_of(PlanStepArgumentRow)


def children_of(
    part: Part, child: Table, held: ColumnElement[bool]
) -> tuple[ColumnElement[bool], ...]:
    """Give the condition that a row belongs to a version of which something is true.

    Args:
        part: where the version is.
        child: the table of the row.
        held: what is true of the version.

    Returns:
        The conditions, all of which must hold.
    """
    version, (owner,) = part.version, part.owner
    which = and_(version.c.kb_id == KB, held)
    return child.c.kb_id == KB, *is_of_version(child, version, owner, which)


def references(table: Table) -> tuple[tuple[int, Table], ...]:
    """Tell which columns of a table refer to identities.

    Args:
        table: the table.

    Returns:
        The index of each such column, and the identity table.
    """
    places = {column.name: index for index, column in enumerate(table.columns)}
    found = {
        (places[constraint.column_keys[-1]], constraint.referred_table)
        for constraint in table.foreign_key_constraints
        if constraint.referred_table in IDENTITIES and len(constraint.column_keys) == 2
    }
    return tuple(sorted(found, key=lambda reference: reference[0]))


def text_of(atoms: Atoms, owner: Any) -> Select[Any]:
    """Give the text of the atom that a row is about.

    Args:
        atoms: the kind of atoms.
        owner: the column with its id.

    Returns:
        The subquery.
    """
    identity = atoms.identity.c
    return (
        select(identity.text)
        .where(identity.kb_id == KB, identity.id == owner)
        .correlate(owner.table)
    )

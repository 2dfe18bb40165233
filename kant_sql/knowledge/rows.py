"""How a definition becomes rows: which tables each kind of element has, and what goes into them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from sqlalchemy import Table, bindparam, delete, null, update

from ..backends import Query, Row
from ..tables import (
    ActionExpressionRow,
    ActionExpressionTermRow,
    ActionParameterRow,
    ActionParameterTypeRow,
    ActionRow,
    ActionVersionRow,
    Base,
    ObjectRow,
    ObjectVersionRow,
    PredicateParameterRow,
    PredicateParameterTypeRow,
    PredicateRow,
    PredicateVersionRow,
    TypeRow,
    TypeVersionRow,
)
from .action import CONDITION, DURATION, EFFECT, ActionDefinition, duration_tree, literals_tree
from .object import ObjectDefinition
from .predicate import ParameterDefinition, PredicateDefinition
from .type import TypeDefinition


def table_of(mapped: type[Base]) -> Table:
    """Give the table of a mapped class.

    Args:
        mapped: the class.

    Returns:
        The table.
    """
    table = mapped.__table__
    assert isinstance(table, Table)
    return table


class VersionTable:
    """The version table of one kind of element, and the four changes that a row of it can see.

    All of them take the parameters `kb` and `id`; `at` is the number of the revision that is being
    made.
    """

    def __init__(self, owner: str, mapped: type[Base], *children: type[Base]) -> None:
        self.table = table_of(mapped)
        self.children = tuple(table_of(child) for child in children)
        columns = self.table.c
        mine = (columns.kb_id == bindparam("kb"), columns[owner] == bindparam("id"))
        number: Any = bindparam("at")
        self.close = Query(
            update(self.table).where(*mine, columns.until.is_(None)).values(until=number)
        )
        self.reopen = Query(
            update(self.table).where(*mine, columns.until == number).values(until=null())
        )
        # Only rows of the revision that is being made, which nobody else has seen.
        self.unmake = tuple(
            Query(
                delete(table).where(
                    table.c.kb_id == bindparam("kb"),
                    table.c[owner] == bindparam("id"),
                    table.c.since == number,
                )
            )
            for table in (*reversed(self.children), self.table)
        )


class Kind(NamedTuple):
    """The tables of one kind of named element.

    Attributes:
        identity: the identity table.
        version: the version table and those below it.
        rows: gives the rows of one version, each with its table, parents first.
    """

    identity: Table
    version: VersionTable
    rows: Callable[[int, int, Any], Iterator[tuple[Table, Row]]]


def _type_rows(kb: int, since: int, type_: TypeDefinition) -> Iterator[tuple[Table, Row]]:
    yield table_of(TypeVersionRow), (kb, type_.id, since, None, type_.parent_id, type_.text)


def _object_rows(kb: int, since: int, object_: ObjectDefinition) -> Iterator[tuple[Table, Row]]:
    yield table_of(ObjectVersionRow), (kb, object_.id, since, None, object_.type_id, object_.text)


def _parameter_rows(
    kb: int,
    since: int,
    owner: int,
    parameters: tuple[ParameterDefinition, ...],
    tables: tuple[Table, Table],
) -> Iterator[tuple[Table, Row]]:
    parameter_table, type_table = tables
    for position, parameter in enumerate(parameters):
        yield parameter_table, (kb, owner, since, position, parameter.name)
        for alternative, type_id in enumerate(parameter.type_ids):
            yield type_table, (kb, owner, since, position, alternative, type_id)


def _predicate_rows(
    kb: int, since: int, predicate: PredicateDefinition
) -> Iterator[tuple[Table, Row]]:
    yield table_of(PredicateVersionRow), (kb, predicate.id, since, None, predicate.text)
    tables = table_of(PredicateParameterRow), table_of(PredicateParameterTypeRow)
    yield from _parameter_rows(kb, since, predicate.id, predicate.parameters, tables)


def _action_rows(kb: int, since: int, action: ActionDefinition) -> Iterator[tuple[Table, Row]]:
    durative = action.duration is not None
    yield table_of(ActionVersionRow), (kb, action.id, since, None, durative, action.text)
    tables = table_of(ActionParameterRow), table_of(ActionParameterTypeRow)
    yield from _parameter_rows(kb, since, action.id, action.parameters, tables)
    trees = {
        DURATION: [] if action.duration is None else duration_tree(action.duration),
        CONDITION: literals_tree(action.conditions),
        EFFECT: literals_tree(action.effects),
    }
    for section, nodes in trees.items():
        for node in nodes:
            place = (kb, action.id, since, section, node.position)
            values = (node.parent, node.operator, node.predicate_id, node.value)
            yield table_of(ActionExpressionRow), (*place, *values)
            for position, term in enumerate(node.terms):
                yield table_of(ActionExpressionTermRow), (*place, position, *term)


# In the order in which they can be written: each refers to those before it only.
KIND_TABLES = {
    "type": Kind(table_of(TypeRow), VersionTable("type_id", TypeVersionRow), _type_rows),
    "object": Kind(table_of(ObjectRow), VersionTable("object_id", ObjectVersionRow), _object_rows),
    "predicate": Kind(
        table_of(PredicateRow),
        VersionTable(
            "predicate_id", PredicateVersionRow, PredicateParameterRow, PredicateParameterTypeRow
        ),
        _predicate_rows,
    ),
    "action": Kind(
        table_of(ActionRow),
        VersionTable(
            "action_id",
            ActionVersionRow,
            ActionParameterRow,
            ActionParameterTypeRow,
            ActionExpressionRow,
            ActionExpressionTermRow,
        ),
        _action_rows,
    ),
}

"""How a definition becomes rows: which tables each kind of element has, and what goes into them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, ScalarSelect, Table, bindparam, delete, null, select, update

from ..backends import Query, Row, in_rows
from ..tables import (
    ActionNodeRow,
    ActionParameterRow,
    ActionParameterTypeRow,
    ActionRow,
    ActionTermRow,
    ActionVariableRow,
    ActionVariableTypeRow,
    ActionVersionRow,
    Base,
    DocumentItemRow,
    DocumentRow,
    DocumentVersionRow,
    FormulaNodeRow,
    FormulaRow,
    FormulaTermRow,
    FormulaVariableRow,
    FormulaVariableTypeRow,
    FormulaVersionRow,
    FunctionParameterRow,
    FunctionParameterTypeRow,
    FunctionRow,
    FunctionTypeRow,
    FunctionVersionRow,
    ObjectRow,
    ObjectTypeRow,
    ObjectVersionRow,
    PredicateParameterRow,
    PredicateParameterTypeRow,
    PredicateRow,
    PredicateVersionRow,
    TypeParentRow,
    TypeRow,
    TypeVersionRow,
)
from .action import CONDITION, DURATION, EFFECT, ActionDefinition
from .document import DocumentDefinition
from .formula import FormulaDefinition
from .function import FunctionDefinition
from .object import ObjectDefinition
from .predicate import ParameterDefinition, PredicateDefinition
from .tree import Tree
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
    made. `owner` is the column that names the element.
    """

    def __init__(self, owner: str, mapped: type[Base], *children: type[Base]) -> None:
        self.table = table_of(mapped)
        self.owner: ColumnElement[int] = self.table.c[owner]
        self.children = tuple(table_of(child) for child in children)
        columns = self.table.c
        mine = (columns.kb_id == bindparam("kb"), self.owner == bindparam("id"))
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


def is_of_version(
    child: Table, version: Table, owner: str, which: ColumnElement[bool]
) -> tuple[ColumnElement[bool], ...]:
    """Give the condition that a row belongs to a version of which something is true.

    Args:
        child: the table of the row.
        version: the version table.
        owner: the column of both that names what the version is of.
        which: what is true of the version, its knowledge base included.

    Returns:
        The conditions, all of which must hold.
    """
    of_one = (version.c[name] == child.c[name] for name in ("kb_id", owner, "since"))
    exactly = select(version.c.since).where(*of_one, which).correlate(child).scalar_subquery()
    owners = select(version.c[owner]).where(which)
    return in_rows(child.c[owner], owners), exactly.is_not(None)


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

    @property
    def name(self) -> ScalarSelect[str]:
        """What the element is called that a row of the version table is of, as a subquery."""
        identity, version = self.identity.c, self.version
        of_version = identity.kb_id == version.table.c.kb_id, identity.id == version.owner
        return select(identity.name).where(*of_version).scalar_subquery()


Rows = Iterator[tuple[Table, Row]]
# The tables of an expression: nodes, variables, their types, terms.
_ACTION_EXPRESSION = (ActionNodeRow, ActionVariableRow, ActionVariableTypeRow, ActionTermRow)
_FORMULA_EXPRESSION = (FormulaNodeRow, FormulaVariableRow, FormulaVariableTypeRow, FormulaTermRow)


def _type_rows(kb: int, since: int, type_: TypeDefinition) -> Rows:
    yield table_of(TypeVersionRow), (kb, type_.id, since, None, type_.parent_id, type_.text)
    for position, parent_id in enumerate(type_.other_parent_ids, start=1):
        yield table_of(TypeParentRow), (kb, type_.id, since, position, parent_id)


def _object_rows(kb: int, since: int, object_: ObjectDefinition) -> Rows:
    values = (object_.type_id, object_.text, object_.is_constant)
    yield table_of(ObjectVersionRow), (kb, object_.id, since, None, *values)
    for position, type_id in enumerate(object_.other_type_ids, start=1):
        yield table_of(ObjectTypeRow), (kb, object_.id, since, position, type_id)


def _parameter_rows(
    kb: int,
    since: int,
    owner: int,
    parameters: tuple[ParameterDefinition, ...],
    tables: tuple[Table, Table],
) -> Rows:
    parameter_table, type_table = tables
    for position, parameter in enumerate(parameters):
        yield parameter_table, (kb, owner, since, position, parameter.name)
        for alternative, type_id in enumerate(parameter.type_ids):
            yield type_table, (kb, owner, since, position, alternative, type_id)


def _expression_rows(
    kb: int, since: int, owner: int, section: str, tree: Tree, mapped: tuple[type[Base], ...]
) -> Rows:
    nodes, variables, variable_types, terms = map(table_of, mapped)
    for node in tree:
        place = (kb, owner, since, section, node.position)
        values = (node.parent, node.operator, node.predicate_id, node.function_id, node.value)
        yield nodes, (*place, *values)
        for position, variable in enumerate(node.variables):
            yield variables, (*place, position, variable.name)
            for alternative, type_id in enumerate(variable.type_ids):
                yield variable_types, (*place, position, alternative, type_id)
        for position, term in enumerate(node.terms):
            yield terms, (*place, position, *term)


def _predicate_rows(kb: int, since: int, predicate: PredicateDefinition) -> Rows:
    yield table_of(PredicateVersionRow), (kb, predicate.id, since, None, predicate.text)
    tables = table_of(PredicateParameterRow), table_of(PredicateParameterTypeRow)
    yield from _parameter_rows(kb, since, predicate.id, predicate.parameters, tables)


def _function_rows(kb: int, since: int, function: FunctionDefinition) -> Rows:
    yield table_of(FunctionVersionRow), (kb, function.id, since, None, function.text)
    tables = table_of(FunctionParameterRow), table_of(FunctionParameterTypeRow)
    yield from _parameter_rows(kb, since, function.id, function.parameters, tables)
    for position, type_id in enumerate(function.type_ids):
        yield table_of(FunctionTypeRow), (kb, function.id, since, position, type_id)


def _action_rows(kb: int, since: int, action: ActionDefinition) -> Rows:
    yield table_of(ActionVersionRow), (kb, action.id, since, None, action.text, action.kind)
    tables = table_of(ActionParameterRow), table_of(ActionParameterTypeRow)
    yield from _parameter_rows(kb, since, action.id, action.parameters, tables)
    for section, tree in zip((DURATION, CONDITION, EFFECT), action.trees, strict=True):
        yield from _expression_rows(kb, since, action.id, section, tree, _ACTION_EXPRESSION)


def _formula_rows(kb: int, since: int, formula: FormulaDefinition) -> Rows:
    values = (formula.section, formula.text)
    yield table_of(FormulaVersionRow), (kb, formula.id, since, None, *values)
    yield from _expression_rows(
        kb, since, formula.id, formula.section, formula.tree, _FORMULA_EXPRESSION
    )


def _document_rows(kb: int, since: int, document: DocumentDefinition) -> Rows:
    values = (document.title, document.domain, document.text)
    yield table_of(DocumentVersionRow), (kb, document.id, since, None, *values)
    positions: Counter[str] = Counter()
    for item in document.items:
        place = (item.section, positions[item.section])
        positions[item.section] += 1
        yield table_of(DocumentItemRow), (kb, document.id, since, *place, item.name)


# In the order in which they can be written: each refers to those before it only.
KIND_TABLES = {
    "type": Kind(
        table_of(TypeRow), VersionTable("type_id", TypeVersionRow, TypeParentRow), _type_rows
    ),
    "object": Kind(
        table_of(ObjectRow),
        VersionTable("object_id", ObjectVersionRow, ObjectTypeRow),
        _object_rows,
    ),
    "predicate": Kind(
        table_of(PredicateRow),
        VersionTable(
            "predicate_id", PredicateVersionRow, PredicateParameterRow, PredicateParameterTypeRow
        ),
        _predicate_rows,
    ),
    "function": Kind(
        table_of(FunctionRow),
        VersionTable(
            "function_id",
            FunctionVersionRow,
            FunctionParameterRow,
            FunctionParameterTypeRow,
            FunctionTypeRow,
        ),
        _function_rows,
    ),
    "action": Kind(
        table_of(ActionRow),
        VersionTable(
            "action_id",
            ActionVersionRow,
            ActionParameterRow,
            ActionParameterTypeRow,
            *_ACTION_EXPRESSION,
        ),
        _action_rows,
    ),
    "formula": Kind(
        table_of(FormulaRow),
        VersionTable("formula_id", FormulaVersionRow, *_FORMULA_EXPRESSION),
        _formula_rows,
    ),
    "document": Kind(
        table_of(DocumentRow),
        VersionTable("document_id", DocumentVersionRow, DocumentItemRow),
        _document_rows,
    ),
}

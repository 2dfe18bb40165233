"""Definitions: the text that was hashed against the rows that the library reads."""

from __future__ import annotations

from collections import Counter
from typing import Any

from sqlalchemy import Table, select

from ..backends import Query, Row, Session
from ..errors import UNREADABLE, KantSqlError
from ..knowledge.action import ActionDefinition
from ..knowledge.assembling import Part, assemble
from ..knowledge.definitions import KINDS, Definitions
from ..knowledge.document import DocumentDefinition
from ..knowledge.formula import FormulaDefinition, formula_name
from ..knowledge.function import FunctionDefinition
from ..knowledge.loading import KB
from ..knowledge.predicate import PredicateDefinition
from ..knowledge.rows import KIND_TABLES
from ..tables import Base
from .findings import Report
from .merging import in_order, side
from .naming import ObjectFunctions
from .rebuilding import definition_text
from .tree_shapes import tree_fault
from .wording import document_fault, formula_fault, is_end, parameter_fault

_NODE = {"section": "section", "a": "parent", "b": "predicate_id", "c": "function_id"}
_TERM = {"b": "parameter", "c": "object_id", "d": "quantifier", "e": "variable", "f": "child"}
# For each table, what its rows are called where definitions are made of them, and the columns.
_PARTS: dict[str, tuple[str, dict[str, str]]] = {
    "type_version": ("type", {"a": "parent_id", "text": "text"}),
    "object_version": ("object", {"a": "type_id", "b": "is_constant", "text": "text"}),
    "predicate_version": ("predicate", {"text": "text"}),
    "function_version": ("function", {"text": "text"}),
    "action_version": ("action", {"section": "kind", "text": "text"}),
    "formula_version": ("formula", {"section": "section", "text": "text"}),
    "document_version": ("document", {"section": "domain", "name": "title", "text": "text"}),
    "type_parent": ("type parent", {"a": "parent_id"}),
    "object_type": ("object type", {"a": "type_id"}),
    "function_type": ("function value type", {"a": "type_id"}),
    "document_item": ("item", {"section": "section", "text": "name"}),
}
for _kind in ("predicate", "function", "action"):
    _PARTS[f"{_kind}_parameter"] = (f"{_kind} parameter", {"name": "name"})
    _PARTS[f"{_kind}_parameter_type"] = (f"{_kind} type", {"a": "alternative", "b": "type_id"})
for _kind in ("action", "formula"):
    _bound = {"section": "section", "a": "variable"}
    _PARTS |= {
        f"{_kind}_node": (f"{_kind} node", {**_NODE, "name": "operator", "text": "value"}),
        f"{_kind}_variable": (f"{_kind} variable", {**_bound, "text": "name"}),
        f"{_kind}_variable_type": (
            f"{_kind} variable type",
            {**_bound, "b": "alternative", "c": "type_id"},
        ),
        f"{_kind}_term": (f"{_kind} term", {"section": "section", "a": "term", **_TERM}),
    }


def _places(table: Table) -> tuple[int | None, ...]:
    """Give, for each field of a part from its third, which column of a row it is, if any."""
    # Rows are read without their knowledge base.
    names = list(table.c.keys())[1:]
    columns = {"position": "position", **_PARTS[table.name][1]}
    wanted = (columns.get(field) for field in Part._fields[2:])
    return tuple(names.index(name) if name in names else None for name in wanted)


_PLACES = {name: _places(Base.metadata.tables[name]) for name in _PARTS}


def _part(table: Table, row: Row, name: str | None = None) -> Part:
    """Give a row, without its knowledge base, in the form that definitions are made of."""
    values = [None if place is None else row[place] for place in _PLACES[table.name]]
    part = Part._make((_PARTS[table.name][0], row[0], *values))
    return part if name is None or part.name is not None else part._replace(name=name)


def _version_query(kind: str) -> Query:
    tables = KIND_TABLES[kind]
    version = tables.version.table.c
    _, *own = version
    return Query(
        select(*own, tables.name.label("identity_name"))
        .where(version.kb_id == KB)
        .order_by(tables.version.owner, version.since)
    )


_VERSIONS = {kind: _version_query(kind) for kind in KINDS}
_CHILDREN = {
    kind: [(table, in_order(table, key=2)) for table in KIND_TABLES[kind].version.children]
    for kind in KINDS
}


class DefinitionCheck:
    """Compares the text of every version of every definition with its rows."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        names: Definitions,
        object_functions: ObjectFunctions,
        report: Report,
    ) -> None:
        """Make it.

        Args:
            session: the session, in a transaction.
            kb_id: the knowledge base.
            names: the names of what definitions refer to.
            object_functions: tells which functions have objects for values.
            report: takes what is wrong.
        """
        self._session = session
        self._kb_id = kb_id
        self._names = names
        self._object_functions = object_functions
        self._report = report

    def run(self) -> None:
        """Check all kinds."""
        for kind in KINDS:
            self._check_kind(kind)

    def _check_kind(self, kind: str) -> None:
        version = KIND_TABLES[kind].version.table
        sides = [
            (table, side(self._session, self._kb_id, query, 2, self._stray(table, version)))
            for table, query in _CHILDREN[kind]
        ]
        before: Row | None = None
        for row in self._session.stream(_VERSIONS[kind], kb=self._kb_id):
            *own, name = row
            self._check_interval(version, before, row)
            children = [(table, [*child.take(row[:2])]) for table, child in sides]
            fault = self._fault(kind, (version, tuple(own)), children, name)
            if fault is not None:
                self._report.add(row[1], version.name, f"{_shown(row, version)}: {fault}")
            before = row
        for _, child in sides:
            child.end()

    def _stray(self, table: Table, version: Table) -> Any:
        def report(row: Row) -> None:
            self._report.add(
                row[1],
                table.name,
                f"a row of {table.name} is of element {row[0]} since revision {row[1]}, of which "
                f"{version.name} has no row",
            )

        return report

    def _check_interval(self, version: Table, before: Row | None, row: Row) -> None:
        owner, since, until = row[:3]
        if until is not None and not is_end(until, since):
            message = f"{_shown(row, version)} ends before it begins, or in no revision"
            self._report.add(until, version.name, message)
        if before is not None and before[0] == owner and (before[2] is None or before[2] > since):
            self._report.add(
                since, version.name, f"{_shown(row, version)} overlaps the version before it"
            )

    def _fault(
        self,
        kind: str,
        version: tuple[Table, Row],
        children: list[tuple[Table, list[Row]]],
        name: str | None,
    ) -> str | None:
        if name is None:
            return f"there is no row of {kind} for it"
        parts = [_part(*version, name)]
        parts += [_part(table, row) for table, rows in children for row in rows]
        try:
            (definition,) = assemble(kind, parts)
            fault = self._meaning(kind, definition, name, version[1][1])
        except (*UNREADABLE, KantSqlError) as error:
            return f"its rows make no {kind}: {type(error).__name__}: {error}"
        return fault or self._layout(kind, definition, version[1], children)

    def _meaning(self, kind: str, definition: Any, name: str, since: int) -> str | None:
        """Compare what the rows say with the text."""
        fault = self._own_fault(definition, name, since)
        if fault is not None:
            return fault
        text = definition_text(self._names, kind, definition)
        return None if text == definition.text else f"its rows say '{' '.join(text.split()):.200}'"

    def _own_fault(self, definition: Any, name: str, since: int) -> str | None:
        """Find what the text leaves out."""
        if isinstance(definition, FormulaDefinition):
            if formula_name(definition.section, definition.text) != name:
                return "its name is not the hash of its section and its text"
            return formula_fault(definition) or self._tree_fault(definition.tree, (), since)
        if isinstance(definition, DocumentDefinition):
            if definition.name != name:
                return f"a {definition.name} is called {name!r}"
            return document_fault(definition)
        if isinstance(definition, ActionDefinition):
            parameters = parameter_fault(definition.parameters)
            return parameters or self._action_fault(definition, since)
        if isinstance(definition, PredicateDefinition | FunctionDefinition):
            return parameter_fault(definition.parameters)
        return None

    def _action_fault(self, action: ActionDefinition, since: int) -> str | None:
        if action.duration and action.kind != "durative-action":
            return f"a {action.kind} has no duration"
        for part, tree in (("condition", action.condition), ("effect", action.effect)):
            if not tree or tree[0].operator != "and":
                return f"its {part} is no conjunction"
        faults = (self._tree_fault(tree, action.parameters, since) for tree in action.trees)
        return next((fault for fault in faults if fault is not None), None)

    def _tree_fault(self, tree: Any, parameters: Any, since: int) -> str | None:
        return tree_fault(tree, parameters, self._object_functions.at(since))

    def _layout(
        self, kind: str, definition: Any, version: Row, children: list[tuple[Table, list[Row]]]
    ) -> str | None:
        """Compare the rows with those that are written when it is saved."""
        owner, since = version[:2]
        given: Counter[Any] = Counter()
        given[KIND_TABLES[kind].version.table.name, owner, since, None, *version[3:]] += 1
        for table, rows in children:
            given.update((table.name, *row) for row in rows)
        written = KIND_TABLES[kind].rows(self._kb_id, since, definition)
        expected = Counter((table.name, *row[1:]) for table, row in written)
        if given == expected:
            return None
        wrong = [key[0] for key in (given - expected) + (expected - given)]
        return f"rows of {wrong[0]} are not those that it has"


def _shown(row: Row, version: Table) -> str:
    position = list(version.c.keys()).index("text") - 1
    text = " ".join(str(row[position]).split())
    return f"'{text:.200}' since revision {row[1]}"

"""Definitions: the text that was hashed against the rows that the library reads."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Sequence
from math import inf
from typing import Any

from sqlalchemy import Table, select

from ...dto.formulas import ARITHMETIC, ASSIGNMENTS, COMPARISONS, MODALS, TIMES
from ...dto.lexical import fold
from ...errors import UNREADABLE, KantSqlError
from ...knowledge import trees as kinds
from ...knowledge.canonical import canonical_text
from ...knowledge.definitions import (
    DOMAIN,
    KINDS,
    PROBLEM,
    ActionDefinition,
    Definitions,
    DocumentDefinition,
    FormulaDefinition,
    FunctionDefinition,
    PredicateDefinition,
    formula_name,
)
from ...knowledge.trees import ParameterDefinition, Tree, TreeNode, TreeTerm
from ...sql.dialects.base import Row, Session
from ...sql.query import Query
from ...sql.rows import KB, KIND_TABLES, RowsByTable
from .findings import Report
from .identities import (
    ObjectFunctions,
    document_fault,
    formula_fault,
    in_order,
    is_decimal,
    is_end,
    is_word,
    parameter_fault,
    side,
)

_BINDERS = (kinds.FORALL, kinds.EXISTS, kinds.DERIVED)
_LEAVES = (kinds.PREDICATE, kinds.FUNCTION, kinds.NUMBER, kinds.VARIABLE, kinds.TIME)
_NUMBERS = (kinds.NUMBER, kinds.AT)
_DURATION = "?duration"
# There, the text of each assignment is that of an equality.
_AT_A_TIME = (kinds.PREDICATE, kinds.NOT, ASSIGNMENTS[0])
# How many parts a node has: at least, and at most.
_PARTS: dict[str, tuple[float, float]] = {
    **dict.fromkeys((*_LEAVES, kinds.IS_VIOLATED, "total-time"), (0, 0)),
    **dict.fromkeys(COMPARISONS, (2, 2)),
    **dict.fromkeys(ARITHMETIC, (2, inf)),
    "-": (1, 2),
    "/": (2, 2),
    **dict.fromkeys(ASSIGNMENTS, (2, 2)),
    **dict.fromkeys(TIMES, (1, 1)),
    **{operator: (sum(counts),) * 2 for operator, counts in MODALS.items()},
    **dict.fromkeys((kinds.AND, kinds.OR), (0, inf)),
    **dict.fromkeys((kinds.NOT, kinds.FORALL, kinds.EXISTS, kinds.PREFERENCE, kinds.AT), (1, 1)),
    **dict.fromkeys((kinds.IMPLY, kinds.WHEN, kinds.DERIVED), (2, 2)),
    **dict.fromkeys(kinds.OPTIMIZATIONS, (1, 1)),
}


class _Shape:
    """One tree, with what is above and below each of its nodes."""

    def __init__(
        self,
        tree: Tree,
        parameters: Sequence[ParameterDefinition],
        object_functions: Collection[int],
    ) -> None:
        self._tree = tree
        self._parameters = parameters
        self._object_functions = object_functions
        self._below = kinds.children(tree)
        # The nodes that bind each name around the present node, innermost last.
        self._binders: dict[str, list[int]] = {}

    def faults(self) -> Iterator[str]:
        """Yield what is wrong, as far as it goes: the next may rest on what came before."""
        fault = self._order()
        if fault is not None:
            yield fault
            return
        path: list[TreeNode] = []
        for node in self._tree:
            while path and path[-1].position != node.parent:
                for variable in path.pop().variables:
                    self._binders[fold(variable.name)].pop()
            faults = (self._columns(node), self._terms(node), self._parts(node))
            yield from (f"node {node.position}: {each}" for each in faults if each is not None)
            for variable in node.variables:
                self._binders.setdefault(fold(variable.name), []).append(node.position)
            path.append(node)

    def _order(self) -> str | None:
        """Preorder: from 0 without a gap, each below one that is not complete yet."""
        path: list[int] = []
        for position, node in enumerate(self._tree):
            if node.position != position:
                return f"there is no node {position}"
            while path and path[-1] != node.parent:
                path.pop()
            if (position == 0) != (node.parent is None) or (position > 0 and not path):
                return f"node {position} does not stand below node {node.parent}"
            path.append(position)
        return None

    def _columns(self, node: TreeNode) -> str | None:
        operator, value = node.operator, node.value
        if operator not in _PARTS:
            return f"there is no operator {operator!r}"
        if (node.predicate_id is not None) != (operator == kinds.PREDICATE):
            return f"{operator} and predicate_id {node.predicate_id} do not go together"
        if (node.function_id is not None) != (operator == kinds.FUNCTION):
            return f"{operator} and function_id {node.function_id} do not go together"
        if node.variables and operator not in _BINDERS:
            return f"{operator} binds no variables"
        if operator in _NUMBERS:
            return None if is_decimal(value) else f"{value!r} is no number"
        if operator == kinds.VARIABLE:
            return None if value is not None and fold(value) == _DURATION else "it is no ?duration"
        if operator == kinds.IS_VIOLATED:
            return None if value and is_word(value) else f"{value!r} is no preference"
        if value is not None and operator != kinds.PREFERENCE:
            return f"{operator} has no value"
        if value is not None and not is_word(value):
            return f"no preference can be called {value!r}"
        return parameter_fault(node.variables)

    def _parts(self, node: TreeNode) -> str | None:
        values = {term.child for term in node.terms}
        parts = [each for each in self._below.get(node.position, ()) if each.position not in values]
        least, most = _PARTS[node.operator]
        given = len(parts)
        if node.terms and node.operator in ("=", *ASSIGNMENTS):
            given += len(node.terms)
        if not least <= given <= most:
            return f"{node.operator} has {given} parts"
        if node.operator == kinds.AT and parts[0].operator not in _AT_A_TIME:
            return f"{parts[0].operator} happens at no time"
        if node.operator == kinds.DERIVED:
            count = len(node.variables)
            head = tuple(TreeTerm(quantifier=0, variable=each) for each in range(count))
            return None if parts[0].terms == head else "its head is not what it binds"
        if node.operator in COMPARISONS and not node.terms:
            wrong = any(self._is_object(part) for part in parts)
            return "it compares objects as numbers" if wrong else None
        if node.operator in ASSIGNMENTS and self._is_object(parts[0]) != bool(node.terms):
            return "it assigns an object as a number, or a number as an object"
        return None

    def _is_object(self, node: TreeNode) -> bool:
        return node.function_id in self._object_functions

    def _terms(self, node: TreeNode) -> str | None:
        allowed = (
            inf
            if node.operator in (kinds.PREDICATE, kinds.FUNCTION)
            else 2
            if node.operator == kinds.EQUAL
            else 1
            if node.operator in ASSIGNMENTS
            else 0
        )
        if len(node.terms) > allowed or (node.operator == kinds.EQUAL and len(node.terms) == 1):
            return f"{node.operator} has {len(node.terms)} terms"
        below = {each.position: each for each in self._below.get(node.position, ())}
        last = -1
        for number, term in enumerate(node.terms):
            if term.child is not None:
                child = below.get(term.child)
                if child is None or child.operator != kinds.FUNCTION or term.child <= last:
                    return f"term {number} is the value of node {term.child}, which is not its own"
                if not self._is_object(child):
                    return f"term {number} is a number"
                last = term.child
            if not self._is_bound(term):
                return f"term {number} is not what its name means there"
        return None

    def _is_bound(self, term: TreeTerm) -> bool:
        """Return whether a term is one of the four, and the innermost variable of its name."""
        given = (term.parameter, term.object_id, term.variable, term.child)
        if sum(each is not None for each in given) != 1:
            return False
        if (term.quantifier is None) != (term.variable is None):
            return False
        if term.parameter is not None:
            if not 0 <= term.parameter < len(self._parameters):
                return False
            return self._binder(self._parameters[term.parameter].name) is None
        if term.quantifier is None or term.variable is None:
            return True
        if not 0 <= term.quantifier < len(self._tree):
            return False
        bound = self._tree[term.quantifier].variables
        if not 0 <= term.variable < len(bound):
            return False
        return self._binder(bound[term.variable].name) == term.quantifier

    def _binder(self, name: str) -> int | None:
        """Find the innermost node around the present one that binds a name."""
        binders = self._binders.get(fold(name))
        return binders[-1] if binders else None


def tree_fault(
    tree: Tree, parameters: Sequence[ParameterDefinition], object_functions: Collection[int]
) -> str | None:
    """Find what is wrong with the rows of a tree."""
    return next(_Shape(tree, parameters, object_functions).faults(), None)


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
        """Make it."""
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
        # Definitions are made of rows without the revisions.
        table, own = version
        rows = {table: [(own[0], name, *own[3:])]}
        for child, given in children:
            rows[child] = [(row[0], *row[2:]) for row in given]
        try:
            (definition,) = KIND_TABLES[kind].definitions(rows)
            fault = self._meaning(definition, name, version[1][1])
        except (*UNREADABLE, KantSqlError) as error:
            return f"its rows make no {kind}: {type(error).__name__}: {error}"
        return fault or self._layout(kind, definition, version[1], children)

    def _meaning(self, definition: Any, name: str, since: int) -> str | None:
        """Compare what the rows say with the text."""
        fault = self._own_fault(definition, name, since)
        if fault is not None:
            return fault
        text = canonical_text(self._names, definition)
        return None if text == definition.text else f"its rows say '{' '.join(text.split()):.200}'"

    def _own_fault(self, definition: Any, name: str, since: int) -> str | None:
        """Find what the text leaves out."""
        if isinstance(definition, FormulaDefinition):
            if formula_name(definition.section, definition.text) != name:
                return "its name is not the hash of its section and its text"
            return formula_fault(definition) or self._tree_fault(definition.tree, (), since)
        if isinstance(definition, DocumentDefinition):
            expected = DOMAIN if definition.domain is None else PROBLEM
            if name != expected:
                return f"a {expected} is called {name!r}"
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
        written: RowsByTable = defaultdict(list)
        KIND_TABLES[kind].add_rows(written, self._kb_id, since, definition)
        expected = Counter(
            (table.name, *row[1:]) for table, rows in written.items() for row in rows
        )
        if given == expected:
            return None
        wrong = [key[0] for key in (given - expected) + (expected - given)]
        return f"rows of {wrong[0]} are not those that it has"


def _shown(row: Row, version: Table) -> str:
    position = list(version.c.keys()).index("text") - 1
    text = " ".join(str(row[position]).split())
    return f"'{text:.200}' since revision {row[1]}"

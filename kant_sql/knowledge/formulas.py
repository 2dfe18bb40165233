"""Conversion between expression trees, which refer to elements by id, and formulas with names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import Any

from ..dto import formulas as f
from ..dto.formulas import Term as FormulaTerm
from ..dto.lexical import decimal_text, fold
from ..pddl.document import Action
from . import trees as kinds
from .definitions import ActionDefinition, Definition, Definitions
from .trees import ParameterDefinition, Tree, TreeNode, TreeTerm, children

_Build = Callable[[TreeNode, tuple[Any, ...]], Any]
# Operators that need nothing but the node and its parts.
_BUILDERS: dict[str, _Build] = {
    kinds.NUMBER: lambda node, _: f.Number(Decimal(node.value or "")),
    kinds.VARIABLE: lambda node, _: f.Variable((node.value or "")[1:]),
    kinds.TIME: lambda *_: f.ContinuousTime(),
    kinds.IS_VIOLATED: lambda node, _: f.IsViolated(node.value or ""),
    kinds.AND: lambda _, parts: f.And(parts),
    kinds.OR: lambda _, parts: f.Or(parts),
    kinds.NOT: lambda _, parts: f.Not(*parts),
    kinds.IMPLY: lambda _, parts: f.Imply(*parts),
    kinds.WHEN: lambda _, parts: f.When(*parts),
    kinds.PREFERENCE: lambda node, parts: f.Preference(node.value, *parts),
    kinds.AT: lambda node, parts: f.TimedLiteral(f.Number(Decimal(node.value or 0)), *parts),
    **dict.fromkeys(f.COMPARISONS, lambda node, parts: f.Comparison(node.operator, *parts)),
    **dict.fromkeys(f.ARITHMETIC, lambda node, parts: f.Arithmetic(node.operator, parts)),
    **dict.fromkeys(f.TIMES, lambda node, parts: f.Timed(node.operator, *parts)),
    **dict.fromkeys(kinds.OPTIMIZATIONS, lambda node, parts: f.Metric(node.operator, *parts)),
}


def typed_name(definitions: Definitions, parameter: ParameterDefinition) -> f.TypedName:
    """Name a parameter and its types."""
    live = definitions.types.live
    return f.TypedName(parameter.name, tuple(live(id_).name for id_ in parameter.type_ids))


class TreeReader:
    """Reads one tree."""

    def __init__(
        self, definitions: Definitions, tree: Tree, parameters: Sequence[ParameterDefinition] = ()
    ) -> None:
        self._definitions = definitions
        self._tree = tree
        self._parameters = parameters
        self._read: list[Any] = [None] * len(tree)

    def formula(self) -> Any:
        """Read the tree as a formula."""
        below = children(self._tree)
        # Descendants follow their node in preorder, so this needs no recursion.
        for node in reversed(self._tree):
            # Function nodes that are the values of terms are read with the terms.
            values = {term.child for term in node.terms}
            parts = tuple(
                self._read[child.position]
                for child in below.get(node.position, ())
                if child.position not in values
            )
            self._read[node.position] = self._node(node, parts)
        return self._read[0]

    def conjuncts(self) -> tuple[Any, ...]:
        """Read the tree as the conjuncts of its root."""
        if not self._tree:
            return ()
        formula = self.formula()
        return formula.formulas if isinstance(formula, f.And) else (formula,)

    def _node(self, node: TreeNode, parts: tuple[Any, ...]) -> Any:
        operator = node.operator
        if operator == kinds.PREDICATE:
            predicate = self._definitions.predicates.live(node.predicate_id or 0)
            return f.Atom(predicate.name, self._terms(node))
        if operator == kinds.FUNCTION:
            function = self._definitions.functions.live(node.function_id or 0)
            return f.Fluent(function.name, self._terms(node))
        if operator == kinds.EQUAL and node.terms:
            return f.Equal(*self._terms(node))
        if operator in f.ASSIGNMENTS:
            return f.Assign(operator, *parts, *self._terms(node))
        if operator in f.MODALS:
            numbers = f.MODALS[operator][0]
            return f.Modal(operator, parts[:numbers], parts[numbers:])
        if operator in _BUILDERS:
            return _BUILDERS[operator](node, parts)
        variables = tuple(typed_name(self._definitions, bound) for bound in node.variables)
        if operator in (kinds.FORALL, kinds.EXISTS):
            return (f.Forall if operator == kinds.FORALL else f.Exists)(variables, *parts)
        if operator in f.COUNTS:
            return f.Count(variables, parts[0], operator)
        if operator == kinds.DERIVED:
            return f.Derived(parts[0].predicate, variables, parts[1])
        # An undeclared function, such as `total-time`, is its own operator.
        return f.Fluent(operator)

    def _terms(self, node: TreeNode) -> tuple[FormulaTerm, ...]:
        return tuple(self._term(term) for term in node.terms)

    def _term(self, term: TreeTerm) -> FormulaTerm:
        if term.parameter is not None:
            return f.Variable(self._parameters[term.parameter].name)
        if term.object_id is not None:
            return f.Constant(self._definitions.objects.live(term.object_id).name)
        if term.quantifier is not None:
            return f.Variable(self._tree[term.quantifier].variables[term.variable or 0].name)
        fluent: f.Fluent = self._read[term.child or 0]
        return fluent


class TreeWriter:
    """Makes the trees of one element from checked formulas.

    Args:
        find: finds the definition of a kind by name.
        parameters: the parameters of the action, if any.
    """

    def __init__(
        self,
        find: Callable[[str, str], Definition | None],
        parameters: Sequence[ParameterDefinition] = (),
    ) -> None:
        self._find = find
        self._nodes: list[TreeNode] = []
        # The meanings of variables, innermost last.
        self._scope: dict[str, list[TreeTerm]] = {
            fold(one.name): [TreeTerm(parameter=number)] for number, one in enumerate(parameters)
        }

    def tree(self, formula: f.Node) -> Tree:
        """Make the tree of a formula."""
        self._nodes = []
        self._add(formula, None)
        return tuple(self._nodes)

    def _open(self, parent: int | None, operator: str, **fields: Any) -> int:
        position = len(self._nodes)
        self._nodes.append(TreeNode(position, parent, operator, **fields))
        return position

    def _add(self, node: Any, parent: int | None) -> None:
        """Add a formula or a number, with its parts."""
        match node:
            case f.Atom(name, terms):
                id_ = self._id("predicate", name)
                self._apply(parent, terms, kinds.PREDICATE, predicate_id=id_)
            case f.Fluent(name, terms) if function := self._find("function", name):
                self._apply(parent, terms, kinds.FUNCTION, function_id=function.id)
            case f.Equal(left, right):
                self._apply(parent, (left, right), kinds.EQUAL)
            case f.Assign(operator, fluent, value):
                position = self._open(parent, operator)
                self._add(fluent, position)
                declared: Any = self._find("function", fluent.function)
                if declared is not None and declared.type_ids:
                    self._set_terms(position, (value,))
                else:
                    self._add(value, position)
            case f.Forall() | f.Exists() | f.Count() | f.Derived():
                self._quantify(node, parent)
            case _:
                operator, fields, parts = _plain(node)
                position = self._open(parent, operator, **fields)
                for part in parts:
                    self._add(part, position)

    def _quantify(
        self, node: f.Forall | f.Exists | f.Count | f.Derived, parent: int | None
    ) -> None:
        operator = node.operator if isinstance(node, f.Count) else _QUANTIFIERS[type(node)]
        bound = tuple(
            [
                ParameterDefinition(one.name, tuple([self._id("type", each) for each in one.types]))
                for one in node.variables
            ]
        )
        position = self._open(parent, operator, variables=bound)
        for index, one in enumerate(bound):
            term = TreeTerm(quantifier=position, variable=index)
            self._scope.setdefault(fold(one.name), []).append(term)
        if isinstance(node, f.Derived):
            parameters = tuple([f.Variable(one.name) for one in node.variables])
            self._add(f.Atom(node.predicate, parameters), position)
        self._add(node.formula, position)
        for one in bound:
            self._scope[fold(one.name)].pop()

    def _apply(
        self, parent: int | None, terms: Sequence[object], operator: str, **fields: int
    ) -> int:
        """Add a node with terms."""
        position = self._open(parent, operator, **fields)
        self._set_terms(position, terms)
        return position

    def _set_terms(self, position: int, terms: Sequence[object]) -> None:
        made = tuple([self._term(term, position) for term in terms])
        self._nodes[position] = self._nodes[position]._replace(terms=made)

    def _term(self, term: Any, position: int) -> TreeTerm:
        """Return a term; add the nodes of its fluents."""
        if isinstance(term, f.Variable):
            return self._scope[fold(term.name)][-1]
        if isinstance(term, f.Constant):
            return TreeTerm(object_id=self._id("object", term.name))
        id_ = self._id("function", term.function)
        child = self._apply(position, term.terms, kinds.FUNCTION, function_id=id_)
        return TreeTerm(child=child)

    def _id(self, kind: str, name: str) -> int:
        definition = self._find(kind, name)
        assert definition is not None
        return definition.id


_QUANTIFIERS: dict[type, str] = {
    f.Forall: kinds.FORALL,
    f.Exists: kinds.EXISTS,
    f.Derived: kinds.DERIVED,
}


def _plain(node: Any) -> tuple[str, dict[str, str | None], Sequence[f.Node]]:
    """Return the operator, the value and the parts of a node without terms and scope."""
    match node:
        case f.Number(value):
            return kinds.NUMBER, {"value": decimal_text(value)}, ()
        case f.Variable(name):
            return kinds.VARIABLE, {"value": f"?{name}"}, ()
        case f.ContinuousTime():
            return kinds.TIME, {}, ()
        case f.IsViolated(name):
            return kinds.IS_VIOLATED, {"value": name}, ()
        case f.Preference(name, formula):
            return kinds.PREFERENCE, {"value": name}, (formula,)
        case f.TimedLiteral(time, effect):
            return kinds.AT, {"value": decimal_text(time.value)}, (effect,)
        case f.Fluent():
            return f.TOTAL_TIME, {}, ()
    return f.head(node), {}, f.children(node)


def action_of(definitions: Definitions, action: ActionDefinition) -> Action:
    """Read an action."""
    parts = [TreeReader(definitions, tree, action.parameters).conjuncts() for tree in action.trees]
    variables = tuple([typed_name(definitions, each) for each in action.parameters])
    return Action(action.kind, action.name, variables, *parts)

"""From trees, which refer to what they mention, back to formulas, which name it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import Any

from ..dto import formulas as f
from ..dto.formulas import Node as Formula
from ..dto.formulas import Term as FormulaTerm
from . import trees as kinds
from .definitions import Definitions
from .trees import ParameterDefinition, Tree, TreeNode, TreeTerm, children

_OF_MANY: dict[str, Callable[..., Any]] = {kinds.AND: f.And, kinds.OR: f.Or}
_OF_PARTS: dict[str, Callable[..., Any]] = {
    kinds.NOT: f.Not,
    kinds.IMPLY: f.Imply,
    kinds.WHEN: f.When,
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
        """Make it."""
        self._definitions = definitions
        self._tree = tree
        self._parameters = parameters
        self._read: list[Any] = [None] * len(tree)

    def formula(self) -> Any:
        """Read the tree as a formula."""
        below = children(self._tree)
        # In preorder, what is below a node comes after it; so no depth is too much.
        for node in reversed(self._tree):
            # Function nodes that are the values of terms are read where the terms are.
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
        if operator in (kinds.NUMBER, kinds.VARIABLE, kinds.TIME, kinds.IS_VIOLATED):
            return _leaf(node)
        if operator == kinds.EQUAL and node.terms:
            return f.Equal(*self._terms(node))
        if operator in f.COMPARISONS:
            return f.Comparison(operator, *parts)
        if operator in f.ARITHMETIC:
            return f.Arithmetic(operator, parts)
        if operator in f.ASSIGNMENTS:
            return f.Assign(operator, *parts, *self._terms(node))
        if operator in f.TIMES:
            return f.Timed(operator, *parts)
        if operator in f.MODALS:
            numbers = f.MODALS[operator][0]
            return f.Modal(operator, parts[:numbers], parts[numbers:])
        return self._special(node, parts)

    def _special(self, node: TreeNode, parts: tuple[Any, ...]) -> Any:
        if node.operator in _OF_MANY:
            return _OF_MANY[node.operator](parts)
        if node.operator in _OF_PARTS:
            return _OF_PARTS[node.operator](*parts)
        variables = tuple(typed_name(self._definitions, bound) for bound in node.variables)
        match node.operator:
            case kinds.FORALL:
                return f.Forall(variables, *parts)
            case kinds.EXISTS:
                return f.Exists(variables, *parts)
            case kinds.PREFERENCE:
                return f.Preference(node.value, *parts)
            case kinds.DERIVED:
                return f.Derived(parts[0].predicate, variables, parts[1])
            case kinds.AT:
                return f.TimedLiteral(f.Number(Decimal(node.value or 0)), *parts)
            case "minimize" | "maximize":
                return f.Metric(node.operator, *parts)
            case _:
                # What is declared nowhere, as `total-time`, is its own operator.
                return f.Fluent(node.operator)

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


def _leaf(node: TreeNode) -> Formula:
    value = node.value or ""
    if node.operator == kinds.NUMBER:
        return f.Number(Decimal(value))
    if node.operator == kinds.VARIABLE:
        return f.Variable(value[1:])
    if node.operator == kinds.IS_VIOLATED:
        return f.IsViolated(value)
    return f.ContinuousTime()

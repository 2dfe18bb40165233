"""Expression trees, which refer to elements by id, read as formulas, which name them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import Any

from ..dto import formulas as f
from ..dto.formulas import Term as FormulaTerm
from ..pddl.document import Action
from . import trees as kinds
from .definitions import ActionDefinition, Definitions
from .trees import ParameterDefinition, Tree, TreeNode, TreeTerm, children

_Build = Callable[[TreeNode, tuple[Any, ...]], Any]
# Operators that need only the node and its parts.
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


def action_of(definitions: Definitions, action: ActionDefinition) -> Action:
    """Read an action."""
    parts = [TreeReader(definitions, tree, action.parameters).conjuncts() for tree in action.trees]
    variables = tuple([typed_name(definitions, each) for each in action.parameters])
    return Action(action.kind, action.name, variables, *parts)

"""Formulas, terms and expressions as expressions of unified-planning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import reduce
from itertools import product
from typing import TYPE_CHECKING

from ..dto.formula import (
    And,
    Arithmetic,
    Atom,
    Comparison,
    Constant,
    Equal,
    Exists,
    Expression,
    Fluent,
    Forall,
    Formula,
    Imply,
    Not,
    Number,
    Or,
    Term,
    TypedName,
    Variable,
)
from ..dto.name import fold
from .context import Context, Scope
from .names import FUNCTION, PREDICATE

if TYPE_CHECKING:
    from unified_planning.model import FNode
    from unified_planning.model import Variable as UpVariable


class Formulas:
    """Converts formulas; a derived predicate is replaced by what it follows from."""

    def __init__(self, context: Context) -> None:
        """Convert within a context.

        Args:
            context: the elements that formulas name.
        """
        self._context = context
        self._manager = context.environment.expression_manager
        self._expanding: list[str] = []
        self._expanded: dict[tuple[str, tuple[FNode, ...]], FNode] = {}

    def formula(self, node: Formula, scope: Scope) -> FNode:
        """Convert a condition.

        Args:
            node: the condition.
            scope: the variables that it may mention.

        Returns:
            The expression, a Boolean.

        Raises:
            UnsupportedConstructError: it has no exact counterpart.
        """
        match node:
            case Atom():
                return self._atom(node, scope)
            case Not(inner):
                return self._manager.Not(self.formula(inner, scope))
            case And(parts):
                return self._manager.And([self.formula(part, scope) for part in parts])
            case Or(parts):
                return self._manager.Or([self.formula(part, scope) for part in parts])
            case Imply(condition, inner):
                return self._manager.Implies(
                    self.formula(condition, scope), self.formula(inner, scope)
                )
            case Forall(variables, inner) | Exists(variables, inner):
                return self._quantified(isinstance(node, Forall), variables, inner, scope)
            case Equal(left, right):
                return self._equal(node, self.term(left, scope), self.term(right, scope))
            case Comparison():
                return self._comparison(node, scope)
        raise self._context.unsupported(node, "it is no condition on a state")

    def term(self, node: Term, scope: Scope) -> FNode:
        """Convert a term.

        Args:
            node: the term.
            scope: the variables that it may mention.

        Returns:
            The expression: an object, a parameter, a variable or an object fluent.

        Raises:
            UnsupportedConstructError: it has no exact counterpart.
        """
        match node:
            case Variable(name):
                if fold(name) in scope.bound:
                    return scope.bound[fold(name)]
                reason = "nothing that it could stand for is known here"
                raise self._context.unsupported(node, reason)
            case Constant(name):
                if fold(name) in self._context.objects:
                    return self._manager.ObjectExp(self._context.objects[fold(name)])
                raise self._context.unsupported(node, "it is no object of the problem")
        return self.fluent(node, scope)

    def fluent(self, node: Fluent, scope: Scope) -> FNode:
        """Convert a function applied to terms.

        Args:
            node: the function and its terms.
            scope: the variables that it may mention.

        Returns:
            The expression.

        Raises:
            UnsupportedConstructError: it has no exact counterpart.
        """
        return self._applied(FUNCTION, node.function, node, node.terms, scope)

    def expression(self, node: Expression, scope: Scope) -> FNode:
        """Convert a number's expression.

        Args:
            node: the expression.
            scope: the variables that it may mention.

        Returns:
            The expression.

        Raises:
            UnsupportedConstructError: it has no exact counterpart.
        """
        match node:
            case Number(value):
                fraction = Fraction(value)
                if fraction.denominator == 1:
                    return self._manager.Int(fraction.numerator)
                return self._manager.Real(fraction)
            case Arithmetic():
                return self._arithmetic(node, scope)
            case Fluent() | Variable():
                value = self.term(node, scope)
                if value.type.is_real_type() or value.type.is_int_type():
                    return value
        raise self._context.unsupported(node, "it is no number that a state holds")

    def variables(
        self, names: Sequence[TypedName], scope: Scope
    ) -> Iterator[tuple[tuple[UpVariable, ...], Scope]]:
        """Bind what a quantifier binds.

        Args:
            names: the variables.
            scope: the scope around.

        Yields:
            The variables and the scope within: once, or for `either` once for each choice of types.
        """
        from unified_planning.model import Variable as UpVariable

        for types in product(*(self._context.types.branches(name.types) for name in names)):
            bound, within = [], scope
            for name, chosen in zip(names, types, strict=True):
                variable = UpVariable(within.fresh(name.name), chosen, self._context.environment)
                within = within.bind(name.name, self._manager.VariableExp(variable))
                bound.append(variable)
            yield tuple(bound), within

    def conjunction(self, nodes: Iterable[FNode]) -> FNode:
        """Join conditions.

        Args:
            nodes: the conditions.

        Returns:
            Their conjunction.
        """
        return self._manager.And(list(nodes))

    def _quantified(
        self, universal: bool, names: Sequence[TypedName], inner: Formula, scope: Scope
    ) -> FNode:
        parts = []
        for variables, within in self.variables(names, scope):
            part = self.formula(inner, within)
            if variables:
                quantifier = self._manager.Forall if universal else self._manager.Exists
                part = quantifier(part, *variables)
            parts.append(part)
        return self._manager.And(parts) if universal else self._manager.Or(parts)

    def _equal(self, node: Equal, left: FNode, right: FNode) -> FNode:
        if not (left.type.is_user_type() and right.type.is_user_type()):
            raise self._context.unsupported(node, "its terms are no objects")
        roots = [list(node.type.ancestors)[-1] for node in (left, right)]
        if roots[0] != roots[1]:
            return self._manager.FALSE()
        return self._manager.Equals(left, right)

    def _comparison(self, node: Comparison, scope: Scope) -> FNode:
        compare = {
            "<": self._manager.LT,
            "<=": self._manager.LE,
            "=": self._manager.Equals,
            ">=": self._manager.GE,
            ">": self._manager.GT,
        }[node.operator]
        return compare(self.expression(node.left, scope), self.expression(node.right, scope))

    def _arithmetic(self, node: Arithmetic, scope: Scope) -> FNode:
        operands = [self.expression(operand, scope) for operand in node.operands]
        if node.operator == "-" and len(operands) == 1:
            return self._manager.Times(-1, operands[0])
        if node.operator == "/" and any(
            divisor.is_constant() and divisor.constant_value() == 0 for divisor in operands[1:]
        ):
            raise self._context.unsupported(node, "it divides by zero")
        if node.operator in {"+", "*"}:
            join = self._manager.Plus if node.operator == "+" else self._manager.Times
            return join(operands)
        return reduce(self._manager.Minus if node.operator == "-" else self._manager.Div, operands)

    def _atom(self, node: Atom, scope: Scope) -> FNode:
        if fold(node.predicate) in self._context.rules:
            return self._derived(node, scope)
        return self._applied(PREDICATE, node.predicate, node, node.terms, scope)

    def _applied(
        self, category: str, name: str, node: object, terms: Sequence[Term], scope: Scope
    ) -> FNode:
        fluent = self._context.fluents.get((category, fold(name)))
        if fluent is None:
            raise self._context.unsupported(node, f"{category} {name} is no fluent there")
        arguments = [self.term(term, scope) for term in terms]
        if len(arguments) != fluent.arity:
            reason = f"{name} has {fluent.arity} parameters"
            raise self._context.unsupported(node, reason)
        for parameter, argument in zip(fluent.signature, arguments, strict=True):
            if not parameter.type.is_compatible(argument.type):
                reason = f"{argument} is of type {argument.type}, not of {parameter.type}"
                raise self._context.unsupported(node, reason)
        return self._manager.FluentExp(fluent, arguments)

    def _derived(self, node: Atom, scope: Scope) -> FNode:
        key = fold(node.predicate)
        if key in self._expanding:
            reason = "a derived predicate that rests on itself has no counterpart"
            raise self._context.unsupported(node, reason)
        arguments = tuple(self.term(term, scope) for term in node.terms)
        if (key, arguments) not in self._expanded:
            self._expanding.append(key)
            bodies = [
                self._body(rule.variables, rule.formula, arguments, scope)
                for rule in self._context.rules[key]
            ]
            self._expanding.pop()
            self._expanded[key, arguments] = self._manager.Or(bodies)
        return self._expanded[key, arguments]

    def _body(
        self,
        head: Sequence[TypedName],
        body: Formula,
        arguments: Sequence[FNode],
        scope: Scope,
    ) -> FNode:
        within = Scope({}, scope.names)
        for name, argument in zip(head, arguments, strict=True):
            branches = self._context.types.branches(name.types)
            if not any(branch.is_compatible(argument.type) for branch in branches):
                reason = f"its rule holds for {name.type_text} only, a narrower type"
                raise self._context.unsupported(argument, reason)
            within = within.bind(name.name, argument)
        return self.formula(body, within)

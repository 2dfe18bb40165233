"""Expressions of unified-planning as formulas, terms and expressions of a document."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
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
    Modal,
    Not,
    Or,
    Term,
    TypedName,
    Variable,
)
from ..dto.name import ROOT_TYPE, fold
from ..errors import UnsupportedConstructError
from .from_names import VARIABLE, PddlNames, pddl_name
from .from_numbers import number
from .names import FUNCTION, OBJECT, PREDICATE, TYPE

if TYPE_CHECKING:
    from unified_planning.model import Fluent as UpFluent
    from unified_planning.model import FNode, Parameter, Type
    from unified_planning.model import Variable as UpVariable


@dataclass(frozen=True, slots=True)
class Bound:
    """The parameters and variables that an expression may mention.

    Attributes:
        names: what each is called in PDDL.
    """

    names: dict[Parameter | UpVariable, str] = field(default_factory=dict)

    def bind(self, variables: Iterable[Parameter | UpVariable]) -> Bound:
        """Bind more variables, under names that nothing around has.

        Args:
            variables: the variables.

        Returns:
            What is bound within.
        """
        names = dict(self.names)
        for variable in variables:
            wanted = candidate = pddl_name(VARIABLE, variable.name)
            number, taken = 2, {fold(name) for name in names.values()}
            while fold(candidate) in taken:
                candidate, number = f"{wanted}_{number}", number + 1
            names[variable] = candidate
        return Bound(names)


def category_of(fluent: UpFluent) -> str:
    """Tell what a fluent is in PDDL.

    Args:
        fluent: the fluent.

    Returns:
        A predicate, or a function.
    """
    return PREDICATE if fluent.type.is_bool_type() else FUNCTION


class Expressions:
    """Converts expressions of one problem."""

    def __init__(self, names: PddlNames) -> None:
        """Convert with the names of a problem.

        Args:
            names: what its elements are called.
        """
        self._names = names
        self.where = "the problem"

    def unsupported(self, construct: object, reason: str) -> UnsupportedConstructError:
        """Make the error for what PDDL cannot express.

        Args:
            construct: the construct.
            reason: why PDDL cannot express it.

        Returns:
            The error, which says where the construct is.
        """
        text = " ".join(str(construct).split())
        shown = text if len(text) <= 120 else text[:117] + "..."
        return UnsupportedConstructError(f"PDDL cannot express {shown} in {self.where}: {reason}")

    def type_name(self, type_: Type) -> str:
        """Give the name of a type.

        Args:
            type_: the type.

        Returns:
            Its name in PDDL.

        Raises:
            UnsupportedConstructError: it is no type of objects.
        """
        if not type_.is_user_type():
            raise self.unsupported(f"a parameter of type {type_}", "parameters are objects")
        if type_.father is None and fold(type_.name) == ROOT_TYPE:
            return ROOT_TYPE
        return self._names.of(TYPE, type_.name)

    def typed(
        self, variables: Iterable[Parameter | UpVariable], bound: Bound
    ) -> tuple[TypedName, ...]:
        """Write variables with their types.

        Args:
            variables: the variables.
            bound: what they are called.

        Returns:
            The typed names, in order.
        """
        return tuple(
            TypedName(bound.names[variable], (self.type_name(variable.type),))
            for variable in variables
        )

    def conjuncts(self, nodes: Iterable[FNode], bound: Bound) -> tuple[Formula, ...]:
        """Convert conditions to a list of conjuncts.

        Args:
            nodes: the conditions.
            bound: what they may mention.

        Returns:
            The conjuncts; those of a conjunction stand for themselves.
        """
        found: list[Formula] = []
        for node in nodes:
            if node.is_and():
                found.extend(self.conjuncts(node.args, bound))
            elif not node.is_true():
                found.append(self.formula(node, bound))
        return tuple(found)

    def formula(self, node: FNode, bound: Bound) -> Formula:
        """Convert a condition or a constraint.

        Args:
            node: the expression, a Boolean.
            bound: what it may mention.

        Returns:
            The formula.

        Raises:
            UnsupportedConstructError: PDDL cannot express it.
        """
        from unified_planning.model import OperatorKind

        kind = node.node_type
        if kind in {OperatorKind.FORALL, OperatorKind.EXISTS}:
            within = bound.bind(node.variables())
            quantifier = Forall if kind == OperatorKind.FORALL else Exists
            variables = self.typed(node.variables(), within)
            return quantifier(variables, self.formula(node.arg(0), within))
        if kind == OperatorKind.BOOL_CONSTANT:
            return And() if node.is_true() else Or()
        if kind in {OperatorKind.LE, OperatorKind.LT} or (
            kind == OperatorKind.EQUALS and not node.arg(0).type.is_user_type()
        ):
            sign = {OperatorKind.LE: "<=", OperatorKind.LT: "<"}.get(kind, "=")
            left, right = (self.expression(part, bound) for part in node.args)
            return Comparison(sign, left, right)
        if kind == OperatorKind.EQUALS:
            return Equal(*(self.term(part, bound) for part in node.args))
        if kind == OperatorKind.FLUENT_EXP:
            terms = tuple(self.term(part, bound) for part in node.args)
            return Atom(self._names.of(PREDICATE, node.fluent().name), terms)
        return self._connective(node, bound)

    def _connective(self, node: FNode, bound: Bound) -> Formula:
        from unified_planning.model import OperatorKind

        kind = node.node_type
        modals = {
            OperatorKind.ALWAYS: "always",
            OperatorKind.SOMETIME: "sometime",
            OperatorKind.AT_MOST_ONCE: "at-most-once",
            OperatorKind.SOMETIME_BEFORE: "sometime-before",
            OperatorKind.SOMETIME_AFTER: "sometime-after",
        }
        connectives = {OperatorKind.AND, OperatorKind.OR, OperatorKind.NOT}
        if kind not in connectives | {OperatorKind.IMPLIES, OperatorKind.IFF, *modals}:
            raise self.unsupported(node, "it is no formula of PDDL")
        parts = tuple(self.formula(part, bound) for part in node.args)
        if kind in modals:
            return Modal(modals[kind], (), parts)
        if kind == OperatorKind.NOT:
            return Not(parts[0])
        if kind == OperatorKind.IMPLIES:
            return Imply(*parts)
        if kind == OperatorKind.IFF:
            return And((Imply(*parts), Imply(*reversed(parts))))
        return And(parts) if kind == OperatorKind.AND else Or(parts)

    def term(self, node: FNode, bound: Bound) -> Term:
        """Convert a term.

        Args:
            node: the expression, of a type of objects.
            bound: what it may mention.

        Returns:
            The term.

        Raises:
            UnsupportedConstructError: PDDL cannot express it.
        """
        if node.is_object_exp():
            return Constant(self._names.of(OBJECT, node.object().name))
        if node.type.is_user_type():
            if node.is_parameter_exp():
                return Variable(bound.names[node.parameter()])
            if node.is_variable_exp():
                return Variable(bound.names[node.variable()])
            if node.is_fluent_exp():
                return self.fluent(node, bound)
        raise self.unsupported(node, "it is no object")

    def fluent(self, node: FNode, bound: Bound) -> Fluent:
        """Convert a number's or an object's fluent.

        Args:
            node: the expression.
            bound: what it may mention.

        Returns:
            The function, applied to its terms.
        """
        terms = tuple(self.term(part, bound) for part in node.args)
        return Fluent(self._names.of(FUNCTION, node.fluent().name), terms)

    def expression(self, node: FNode, bound: Bound) -> Expression:
        """Convert a number's expression.

        Args:
            node: the expression.
            bound: what it may mention.

        Returns:
            The expression.

        Raises:
            UnsupportedConstructError: PDDL cannot express it.
        """
        from unified_planning.model import OperatorKind

        operators = {
            OperatorKind.PLUS: "+",
            OperatorKind.MINUS: "-",
            OperatorKind.TIMES: "*",
            OperatorKind.DIV: "/",
        }
        if node.is_int_constant() or node.is_real_constant():
            return number(node.constant_value())
        if node.is_fluent_exp() and not node.type.is_user_type():
            return self.fluent(node, bound)
        if node.node_type in operators:
            operands = tuple(self.expression(part, bound) for part in node.args)
            return Arithmetic(operators[node.node_type], operands)
        raise self.unsupported(node, "it is no number")

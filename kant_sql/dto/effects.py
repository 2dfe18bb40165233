"""Effects as nodes, and what stands on its own in a domain or a problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..arguments import expect
from .conditions import Atom, Not
from .node import Branch, FormulaNode, Node
from .terms import (
    EXPRESSIONS,
    TERMS,
    Expression,
    Fluent,
    Number,
    Term,
    TypedName,
    list_text,
    variables_text,
)

if TYPE_CHECKING:
    from .formula import Formula


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class When(Branch, FormulaNode):
    """A conditional effect.

    Attributes:
        condition: when it happens.
        effect: what happens.
    """

    condition: Formula
    effect: Formula

    def __post_init__(self) -> None:
        expect(self.condition, FormulaNode, "the condition of a When")
        expect(self.effect, FormulaNode, "the effect of a When")

    def _head(self) -> str:
        return "when"


@dataclass(frozen=True, slots=True)
class Assign(FormulaNode):
    """An effect on a fluent.

    Attributes:
        operator: `assign`, `increase`, `decrease`, `scale-up` or `scale-down`.
        fluent: the fluent.
        value: a number's expression, or for an object fluent a term.
    """

    operator: str
    fluent: Fluent
    value: Expression | Term

    def __post_init__(self) -> None:
        expect(self.operator, str, "the operator of an Assign")
        expect(self.fluent, Fluent, "the fluent of an Assign")
        expect(self.value, (*EXPRESSIONS, *TERMS), "the value of an Assign")

    def __str__(self) -> str:
        return list_text(self.operator, self.fluent, self.value)


@dataclass(frozen=True, slots=True)
class Derived(Node):
    """A rule for a derived predicate (PDDL 2.2, section 3.1).

    Attributes:
        predicate: the predicate's name.
        variables: the predicate's parameters, as the rule names and types them.
        formula: what it follows from.
    """

    predicate: str
    variables: tuple[TypedName, ...]
    formula: Formula

    def __post_init__(self) -> None:
        expect(self.predicate, str, "the predicate of a Derived")
        self._keep("variables", TypedName, "the variables of a Derived")
        expect(self.formula, FormulaNode, "the formula of a Derived")

    def __str__(self) -> str:
        head = " ".join(part for part in (self.predicate, variables_text(self.variables)) if part)
        return f"(:derived ({head}) {self.formula})"


@dataclass(frozen=True, slots=True)
class TimedLiteral(Node):
    """A timed initial literal (PDDL 2.2, section 3.2), or a timed initial value.

    Attributes:
        time: when, in the planner's units of time.
        effect: an `Atom`, `Not` of one, or an `Assign`, written `(= (fluent) value)`.
    """

    time: Number
    effect: Atom | Not | Assign

    def __post_init__(self) -> None:
        expect(self.time, Number, "the time of a TimedLiteral")
        expect(self.effect, (Atom, Not, Assign), "the effect of a TimedLiteral")

    def __str__(self) -> str:
        effect: object = self.effect
        if isinstance(effect, Assign):
            effect = list_text("=", effect.fluent, effect.value)
        return f"(at {self.time} {effect})"


@dataclass(frozen=True, slots=True)
class Metric(Node):
    """What a plan is measured by (PDDL 2.1, section 4.1).

    Attributes:
        optimization: `minimize` or `maximize`.
        expression: the quantity.
    """

    optimization: str
    expression: Expression

    def __post_init__(self) -> None:
        expect(self.optimization, str, "the optimization of a Metric")
        expect(self.expression, EXPRESSIONS, "the expression of a Metric")

    def __str__(self) -> str:
        return f"(:metric {self.optimization} {self.expression})"

"""Conditions and constraints as nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..arguments import expect
from .node import Branch, FormulaNode
from .terms import (
    EXPRESSIONS,
    TERMS,
    Expression,
    Number,
    Term,
    TypedName,
    list_text,
    variables_text,
)

if TYPE_CHECKING:
    from .formula import Formula

_new, _set = object.__new__, object.__setattr__


@dataclass(frozen=True, slots=True)
class Atom(FormulaNode):
    """A predicate applied to terms.

    Attributes:
        predicate: the predicate's name.
        terms: the terms, in order.
    """

    predicate: str
    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        expect(self.predicate, str, "the predicate of an Atom")
        self._keep("terms", TERMS, "the terms of an Atom")

    def __str__(self) -> str:
        return list_text(self.predicate, *self.terms)


def trusted_atom(predicate: str, terms: tuple[Term, ...]) -> Atom:
    """Make an atom of what is known to be right: a document has hundreds of thousands.

    Args:
        predicate: the predicate's name.
        terms: the terms, in order.

    Returns:
        The atom, unchecked.
    """
    atom = _new(Atom)
    _set(atom, "predicate", predicate)
    _set(atom, "terms", terms)
    return atom


@dataclass(frozen=True, slots=True)
class Equal(FormulaNode):
    """Two terms that denote one object.

    Attributes:
        left: the one term.
        right: the other.
    """

    left: Term
    right: Term

    def __post_init__(self) -> None:
        expect(self.left, TERMS, "the left of an Equal")
        expect(self.right, TERMS, "the right of an Equal")

    def __str__(self) -> str:
        return list_text("=", self.left, self.right)


@dataclass(frozen=True, slots=True)
class Comparison(FormulaNode):
    """Two numbers that are compared; a duration's constraint is one, too.

    Attributes:
        operator: `<`, `<=`, `=`, `>=` or `>`.
        left: the one number.
        right: the other.
    """

    operator: str
    left: Expression
    right: Expression

    def __post_init__(self) -> None:
        expect(self.operator, str, "the operator of a Comparison")
        expect(self.left, EXPRESSIONS, "the left of a Comparison")
        expect(self.right, EXPRESSIONS, "the right of a Comparison")

    def __str__(self) -> str:
        return list_text(self.operator, self.left, self.right)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Not(Branch, FormulaNode):
    """A negation; as an effect, a delete.

    Attributes:
        formula: what does not hold.
    """

    formula: Formula

    def __post_init__(self) -> None:
        expect(self.formula, FormulaNode, "the formula of a Not")

    def _head(self) -> str:
        return "not"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class And(Branch, FormulaNode):
    """A conjunction.

    Attributes:
        formulas: the conjuncts, in order.
    """

    formulas: tuple[Formula, ...] = ()

    def __post_init__(self) -> None:
        self._keep("formulas", FormulaNode, "the formulas of an And")

    def _head(self) -> str:
        return "and"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Or(Branch, FormulaNode):
    """A disjunction.

    Attributes:
        formulas: the disjuncts, in order.
    """

    formulas: tuple[Formula, ...] = ()

    def __post_init__(self) -> None:
        self._keep("formulas", FormulaNode, "the formulas of an Or")

    def _head(self) -> str:
        return "or"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Imply(Branch, FormulaNode):
    """An implication.

    Attributes:
        condition: the antecedent.
        formula: the consequent.
    """

    condition: Formula
    formula: Formula

    def __post_init__(self) -> None:
        expect(self.condition, FormulaNode, "the condition of an Imply")
        expect(self.formula, FormulaNode, "the formula of an Imply")

    def _head(self) -> str:
        return "imply"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Forall(Branch, FormulaNode):
    """A formula, or an effect, for all objects.

    Attributes:
        variables: what is bound, in order.
        formula: what holds, or happens, for all of them.
    """

    variables: tuple[TypedName, ...]
    formula: Formula

    def __post_init__(self) -> None:
        self._keep("variables", TypedName, "the variables of a Forall")
        expect(self.formula, FormulaNode, "the formula of a Forall")

    def _head(self) -> str:
        return f"forall ({variables_text(self.variables)})"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Exists(Branch, FormulaNode):
    """A formula that holds for some objects.

    Attributes:
        variables: what is bound, in order.
        formula: what holds for some of them.
    """

    variables: tuple[TypedName, ...]
    formula: Formula

    def __post_init__(self) -> None:
        self._keep("variables", TypedName, "the variables of an Exists")
        expect(self.formula, FormulaNode, "the formula of an Exists")

    def _head(self) -> str:
        return f"exists ({variables_text(self.variables)})"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Timed(Branch, FormulaNode):
    """A condition or an effect at a time of a durative action; `at end`, a constraint's too.

    Attributes:
        time: `at start`, `over all` or `at end`.
        formula: what holds, or happens, then.
    """

    time: str
    formula: Formula

    def __post_init__(self) -> None:
        expect(self.time, str, "the time of a Timed")
        expect(self.formula, FormulaNode, "the formula of a Timed")

    def _head(self) -> str:
        return self.time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Preference(Branch, FormulaNode):
    """A soft goal, precondition or constraint (PDDL 3.0, section 3).

    Attributes:
        name: its name, which others may share; None when it has none.
        formula: what is preferred.
    """

    name: str | None
    formula: Formula

    def __post_init__(self) -> None:
        if self.name is not None:
            expect(self.name, str, "the name of a Preference")
        expect(self.formula, FormulaNode, "the formula of a Preference")

    def _head(self) -> str:
        return "preference" if self.name is None else f"preference {self.name}"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Modal(Branch, FormulaNode):
    """A constraint on the trajectory (PDDL 3.0, section 2).

    Attributes:
        operator: `always`, `sometime`, `at-most-once`, `sometime-after`, `sometime-before`,
            `within`, `always-within`, `hold-during` or `hold-after`.
        numbers: the times that it takes, in the planner's units.
        formulas: the formulas that it takes.
    """

    operator: str
    numbers: tuple[Number, ...]
    formulas: tuple[Formula, ...]

    def __post_init__(self) -> None:
        expect(self.operator, str, "the operator of a Modal")
        self._keep("numbers", Number, "the numbers of a Modal")
        self._keep("formulas", FormulaNode, "the formulas of a Modal")

    def _head(self) -> str:
        return self.operator

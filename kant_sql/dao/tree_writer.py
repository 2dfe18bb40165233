"""From formulas, which name what they mention, to trees, which refer to it: checked on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import Any

from ..dto.formula import (
    ASSIGNMENTS,
    AT_END,
    COMPARISONS,
    MODALS,
    TIMES,
    And,
    Assign,
    Atom,
    Comparison,
    Derived,
    Equal,
    Exists,
    Forall,
    Imply,
    Metric,
    Modal,
    Not,
    Or,
    Preference,
    Timed,
    TimedLiteral,
    TypedName,
    Variable,
    When,
)
from ..dto.formula import Node as Formula
from ..dto.name import check_name
from ..dto.number import decimal_text
from ..errors import TypeMismatchError
from ..knowledge import tree as kinds
from ..knowledge.tree import Tree
from .term_writer import MAX_DEPTH, TermWriter, shown


class Place(Enum):
    """Where a formula stands, which decides what it may be built of."""

    CONDITION = "a condition"
    EFFECT = "an effect"
    CONSTRAINT = "a constraint"


class TreeWriter(TermWriter):
    """Makes the trees of one element."""

    def conjunction(self, formulas: Iterable[Formula], place: Place) -> Tree:
        """Make the tree whose root is the conjunction of formulas.

        Args:
            formulas: the formulas, in order.
            place: where they stand.

        Returns:
            The tree.

        Raises:
            InvalidKnowledgeError: a formula is not well formed; the message says which and why.
            ArityError: a predicate or function is given more or fewer terms than it has parameters.
            TypeMismatchError: a term does not fit its parameter.
        """
        self._nodes = []
        position = self._open(None, kinds.AND)
        for formula in formulas:
            self._add(formula, position, place)
        return tuple(self._nodes)

    def tree(self, formula: Formula, place: Place) -> Tree:
        """Make the tree of a formula.

        Args:
            formula: the formula; a rule, a timed literal or a metric too.
            place: where it stands.

        Returns:
            The tree.

        Raises:
            InvalidKnowledgeError: as `conjunction`.
            ArityError: as `conjunction`.
            TypeMismatchError: as `conjunction`.
        """
        self._nodes = []
        self._add(formula, None, place)
        return tuple(self._nodes)

    def _add(self, formula: object, parent: int | None, place: Place) -> None:
        handler = _HANDLERS.get(type(formula))
        if handler is None:
            self._fail(
                f"{shown(formula)} has no place in {place.value}, for it is no formula but "
                f"{type(formula).__name__}"
            )
        if self._depth >= MAX_DEPTH:
            self._fail(f"a formula is nested more than {MAX_DEPTH} deep; split it")
        self._depth += 1
        handler(self, formula, parent, place)
        self._depth -= 1

    def _branch(
        self,
        operator: str,
        parts: Iterable[object],
        parent: int | None,
        place: Place,
        **fields: Any,
    ) -> None:
        position = self._open(parent, operator, **fields)
        for part in parts:
            self._add(part, position, place)

    def _expect(self, formula: object, place: Place, *places: Place) -> None:
        if place not in places:
            self._fail(f"{shown(formula)} has no place in {place.value}")

    # Formulas.

    def _atom(self, formula: Atom, parent: int | None, place: Place) -> None:
        predicate = self._definitions.predicates.named(formula.predicate)
        if predicate is None:
            self._fail(
                f"{shown(formula)} is of predicate {formula.predicate!r}, which is not known; "
                "save the predicate first"
            )
        position = self._open(parent, kinds.PREDICATE, predicate_id=predicate.id)
        self._give_terms(position, formula, formula.terms, predicate)

    def _equal(self, formula: Equal, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.CONDITION, Place.CONSTRAINT)
        position = self._open(parent, kinds.EQUAL)
        terms = [self._term(term, position)[0] for term in (formula.left, formula.right)]
        self._nodes[position] = self._nodes[position]._replace(terms=tuple(terms))

    def _comparison(self, formula: Comparison, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.CONDITION, Place.CONSTRAINT)
        if formula.operator not in COMPARISONS:
            self._fail(f"{formula.operator!r} is no comparison; use one of {COMPARISONS}")
        position = self._open(parent, formula.operator)
        self._expression(formula.left, position)
        self._expression(formula.right, position)

    def _not(self, formula: Not, parent: int | None, place: Place) -> None:
        if place is Place.EFFECT and not isinstance(formula.formula, Atom):
            self._fail(f"{shown(formula)} deletes what is not an atom")
        self._branch(kinds.NOT, [formula.formula], parent, place)

    def _and(self, formula: And, parent: int | None, place: Place) -> None:
        self._branch(kinds.AND, formula.formulas, parent, place)

    def _or(self, formula: Or, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.CONDITION)
        self._branch(kinds.OR, formula.formulas, parent, place)

    def _imply(self, formula: Imply, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.CONDITION)
        self._branch(kinds.IMPLY, [formula.condition, formula.formula], parent, place)

    def _quantified(self, formula: Forall | Exists, parent: int | None, place: Place) -> None:
        operator = kinds.FORALL if isinstance(formula, Forall) else kinds.EXISTS
        if operator == kinds.EXISTS:
            self._expect(formula, place, Place.CONDITION)
        self._bind(operator, formula.variables, [formula.formula], parent, place)

    def _timed(self, formula: Timed, parent: int | None, place: Place) -> None:
        if formula.time not in TIMES:
            self._fail(f"{shown(formula)} has the time {formula.time!r}, expected one of {TIMES}")
        if not self._durative and not (place is Place.CONSTRAINT and formula.time == AT_END):
            self._fail(f"{shown(formula)} has a time, but the action is not durative; leave it out")
        below = Place.CONDITION if place is Place.CONSTRAINT else place
        self._branch(formula.time, [formula.formula], parent, below)

    def _preference(self, formula: Preference, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.CONDITION, Place.CONSTRAINT)
        if formula.name is not None:
            check_name("preference", formula.name)
        self._branch(kinds.PREFERENCE, [formula.formula], parent, place, value=formula.name)

    def _modal(self, formula: Modal, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.CONSTRAINT)
        wanted = MODALS.get(formula.operator)
        if wanted != (len(formula.numbers), len(formula.formulas)):
            self._fail(f"{shown(formula)} is no constraint of PDDL 3.0")
        position = self._open(parent, formula.operator)
        for number in formula.numbers:
            self._expression(number, position)
        for part in formula.formulas:
            self._add(part, position, Place.CONDITION)

    def _when(self, formula: When, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.EFFECT)
        position = self._open(parent, kinds.WHEN)
        self._add(formula.condition, position, Place.CONDITION)
        self._add(formula.effect, position, Place.EFFECT)

    def _assign(self, formula: Assign, parent: int | None, place: Place) -> None:
        self._expect(formula, place, Place.EFFECT)
        if formula.operator not in ASSIGNMENTS:
            self._fail(f"{formula.operator!r} is no assignment; use one of {ASSIGNMENTS}")
        position = self._open(parent, formula.operator)
        types = self._fluent(formula.fluent, position).type_ids
        if not types:
            self._expression(formula.value, position)
            return
        if formula.operator != ASSIGNMENTS[0]:
            self._fail(f"{shown(formula)} counts with a function whose values are objects")
        term, given = self._term(formula.value, position)
        if not self._may_fit(given, types):
            raise TypeMismatchError(f"{self._role}: the value in {shown(formula)} does not fit")
        self._nodes[position] = self._nodes[position]._replace(terms=(term,))

    # Formulas that stand on their own.

    def _derived(self, formula: Derived, parent: int | None, place: Place) -> None:
        head = Atom(formula.predicate, tuple(Variable(part.name) for part in formula.variables))
        self._bind(kinds.DERIVED, formula.variables, [head, formula.formula], parent, place)

    def _timed_literal(self, formula: TimedLiteral, parent: int | None, place: Place) -> None:
        position = self._open(parent, kinds.AT, value=decimal_text(formula.time.value))
        self._add(formula.effect, position, Place.EFFECT)

    def _metric(self, formula: Metric, parent: int | None, place: Place) -> None:
        if formula.optimization not in kinds.OPTIMIZATIONS:
            self._fail(f"{formula.optimization!r} is neither minimize nor maximize")
        self._expression(formula.expression, self._open(parent, formula.optimization))

    # What quantifiers bind.

    def _bind(
        self,
        operator: str,
        variables: Sequence[TypedName],
        parts: Sequence[Formula],
        parent: int | None,
        place: Place,
    ) -> None:
        bound = tuple(self._variable(variable) for variable in variables)
        position = self._open(parent, operator, variables=bound)
        self._scopes.append((position, bound))
        for part in parts:
            self._add(part, position, place)
        self._scopes.pop()


_HANDLERS: dict[type, Callable[[TreeWriter, Any, int | None, Place], None]] = {
    Atom: TreeWriter._atom,
    Equal: TreeWriter._equal,
    Comparison: TreeWriter._comparison,
    Not: TreeWriter._not,
    And: TreeWriter._and,
    Or: TreeWriter._or,
    Imply: TreeWriter._imply,
    Forall: TreeWriter._quantified,
    Exists: TreeWriter._quantified,
    Timed: TreeWriter._timed,
    Preference: TreeWriter._preference,
    Modal: TreeWriter._modal,
    When: TreeWriter._when,
    Assign: TreeWriter._assign,
    Derived: TreeWriter._derived,
    TimedLiteral: TreeWriter._timed_literal,
    Metric: TreeWriter._metric,
}

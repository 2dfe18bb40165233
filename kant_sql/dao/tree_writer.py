"""From formulas, which name what they mention, to trees, which refer to it: checked on the way.

What passes the checks is what the reader of PDDL accepts, so that text made of it is read back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from ..dto.formula import (
    ASSIGNMENTS,
    AT_END,
    COMPARISONS,
    MODALS,
    OVER_ALL,
    TIMES,
    And,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Derived,
    Equal,
    Exists,
    Forall,
    Imply,
    Metric,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TimedLiteral,
    Variable,
    When,
)
from ..dto.name import check_name
from ..dto.node import shown, walk
from ..knowledge import tree as kinds
from ..knowledge.tree import Tree
from .term_writer import Bound, Context, Place, TermWriter

_HARD = (Place.CONDITION, Place.TIMED_CONDITION, Place.CONSTRAINT, Place.TRAJECTORY)
_HOLDS = (Place.CONDITION, Place.TRAJECTORY)
_WITHIN_TIMED = {
    Place.TIMED_CONDITION: Place.CONDITION,
    Place.TIMED_EFFECT: Place.EFFECT,
    Place.DURATION: Place.DURATION,
    Place.CONSTRAINT: Place.CONDITION,
    Place.TRAJECTORY: Place.CONDITION,
}
_Parts = Iterable[tuple[object, Context]]


class _Left(NamedTuple):
    """Stands behind what is within a quantifier: its variables are bound no more."""

    bound: Bound


class TreeWriter(TermWriter):
    """Makes the trees of one element."""

    def conjunction(self, formulas: Iterable[Node], place: Place) -> Tree:
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
        root = self._open(None, kinds.AND)
        for formula in formulas:
            self._add(formula, root, Context(place, soft=place in _HARD))
        return tuple(self._nodes)

    def tree(self, formula: Node, place: Place) -> Tree:
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
        self._add(formula, None, Context(place, soft=place in _HARD))
        return tuple(self._nodes)

    def _add(self, formula: object, parent: int | None, context: Context) -> None:
        """Add a formula, with a stack of its own: none is nested too deeply for the interpreter."""
        pending: list[tuple[object, int | None, Context]] = [(formula, parent, context)]
        while pending:
            part, above, around = pending.pop()
            if isinstance(part, _Left):
                self._leave(part.bound)
                continue
            handler = _HANDLERS.get(type(part))
            if handler is None:
                self._fail(f"{shown(part)} is no formula but {type(part).__name__}")
            position = len(self._nodes)
            below = [*handler(self, part, above, around)]
            if bound := self._nodes[position].variables:
                self._enter(position, bound)
                pending.append((_Left(bound), None, context))
            pending += [(child, position, inner) for child, inner in reversed(below)]

    def _expect(self, formula: object, context: Context, *places: Place) -> None:
        if context.place not in places:
            self._fail(f"{shown(formula)} has no place in {context.place.value}")

    # Formulas. Each handler adds its own node, and gives what is to be added below.

    def _atom(self, formula: Atom, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, *_HOLDS, Place.EFFECT, Place.INITIAL)
        predicate = self._definitions.predicates.named(formula.predicate)
        if predicate is None:
            self._fail(
                f"{shown(formula)} is of predicate {formula.predicate!r}, which is not known; "
                "save the predicate first"
            )
        position = self._open(parent, kinds.PREDICATE, predicate_id=predicate.id)
        self._give_terms(position, formula, predicate, context)
        return ()

    def _equal(self, formula: Equal, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, *_HOLDS, Place.INITIAL)
        position = self._open(parent, kinds.EQUAL)
        terms = [self._term(term, position, context)[0] for term in (formula.left, formula.right)]
        self._set_terms(position, terms)
        return ()

    def _comparison(self, formula: Comparison, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, *_HOLDS, Place.DURATION)
        sides = (formula.left, formula.right)
        if formula.operator not in COMPARISONS:
            self._fail(f"{formula.operator!r} is no comparison; use one of {' '.join(COMPARISONS)}")
        if context.place is Place.DURATION and Variable("duration") not in sides:
            self._fail(f"{shown(formula)} is no constraint on ?duration")
        position = self._open(parent, formula.operator)
        for side in sides:
            self._expression(side, position, context)
        return ()

    def _not(self, formula: Not, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, *_HARD, Place.EFFECT, Place.INITIAL)
        part, place = formula.formula, context.place
        if place is Place.EFFECT and not isinstance(part, Atom):
            self._fail(f"{shown(formula)} deletes what is not an atom")
        if place is Place.INITIAL and not isinstance(part, Atom | Equal):
            self._fail(f"{shown(formula)} is no literal, as the initial state asks for")
        self._open(parent, kinds.NOT)
        return [(part, context.hard())]

    def _and(self, formula: And, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, *_HARD, *_WITHIN_TIMED, Place.EFFECT)
        self._open(parent, kinds.AND)
        return [(part, context) for part in formula.formulas]

    def _connective(self, formula: Or | Imply, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, *_HARD)
        if isinstance(formula, Or):
            self._open(parent, kinds.OR)
            return [(part, context.hard()) for part in formula.formulas]
        self._open(parent, kinds.IMPLY)
        return [(part, context.hard()) for part in (formula.condition, formula.formula)]

    def _quantified(self, formula: Forall | Exists, parent: int | None, context: Context) -> _Parts:
        is_all = isinstance(formula, Forall)
        effects = (Place.EFFECT, Place.TIMED_EFFECT) if is_all else ()
        self._expect(formula, context, *_HARD, *effects)
        bound = self._bind(formula.variables)
        operator = kinds.FORALL if is_all else kinds.EXISTS
        self._open(parent, operator, variables=bound)
        return [(formula.formula, context if is_all else context.hard())]

    def _timed(self, formula: Timed, parent: int | None, context: Context) -> _Parts:
        time, place = formula.time, context.place
        if time not in TIMES:
            self._fail(f"{shown(formula)} has the time {time!r}, expected one of {TIMES}")
        inner = _WITHIN_TIMED.get(place)
        # The paper's DTOs may have effects `over all`.
        wrong = place is Place.DURATION and time == OVER_ALL
        wrong = wrong or (place in (Place.CONSTRAINT, Place.TRAJECTORY) and time != AT_END)
        if inner is None or wrong:
            self._fail(f"{shown(formula)} has a time that has no place in {place.value}")
        self._open(parent, time)
        return [(formula.formula, context.hard()._replace(place=inner))]

    def _preference(self, formula: Preference, parent: int | None, context: Context) -> _Parts:
        if not context.soft:
            self._fail(
                f"{shown(formula)} has no place here: a preference stands at the top of a goal, a "
                "precondition or a constraint, or within forall there"
            )
        if formula.name is not None:
            check_name("preference", formula.name)
        self._open(parent, kinds.PREFERENCE, value=formula.name)
        return [(formula.formula, context.hard())]

    def _modal(self, formula: Modal, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, Place.CONSTRAINT, Place.TRAJECTORY)
        wanted = MODALS.get(formula.operator)
        if wanted != (len(formula.numbers), len(formula.formulas)):
            self._fail(f"{shown(formula)} is no constraint of PDDL 3.0")
        position = self._open(parent, formula.operator)
        for number in formula.numbers:
            self._open(position, kinds.NUMBER, value=self._decimal(number))
        inner = context.hard()._replace(place=Place.TRAJECTORY)
        return [(part, inner) for part in formula.formulas]

    def _when(self, formula: When, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, Place.EFFECT, Place.TIMED_EFFECT)
        self._open(parent, kinds.WHEN)
        is_timed = context.place is Place.TIMED_EFFECT
        place = Place.TIMED_CONDITION if is_timed else Place.CONDITION
        return [(formula.condition, context._replace(place=place)), (formula.effect, context)]

    def _assign(self, formula: Assign, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, Place.EFFECT, Place.TIMED_EFFECT)
        if formula.operator not in ASSIGNMENTS:
            known = " ".join(ASSIGNMENTS)
            self._fail(f"{formula.operator!r} is no assignment; use one of {known}")
        position = self._open(parent, formula.operator)
        types = self._fluent(formula.fluent, position, context).type_ids
        if types:
            self._assign_object(formula, position, types, context)
        else:
            self._expression(formula.value, position, context)
        if context.place is Place.TIMED_EFFECT and not any(
            isinstance(part, ContinuousTime) for part in walk(formula.value)
        ):
            self._expect(formula, context, Place.EFFECT)
        return ()

    # Formulas that stand on their own.

    def _derived(self, formula: Derived, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, Place.DERIVED)
        bound = self._bind(formula.variables)
        self._open(parent, kinds.DERIVED, variables=bound)
        head = Atom(formula.predicate, tuple(Variable(part.name) for part in formula.variables))
        inner = Context(Place.CONDITION)
        return [(head, inner), (formula.formula, inner)]

    def _timed_literal(self, formula: TimedLiteral, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, Place.TIMED)
        effect = formula.effect
        self._open(parent, kinds.AT, value=self._decimal(formula.time))
        if isinstance(effect, Assign):
            terms = (*effect.fluent.terms, effect.value)
            is_ground = all(isinstance(term, Constant | Number) for term in terms)
            if effect.operator != ASSIGNMENTS[0] or not is_ground:
                self._fail(f"{shown(formula)} assigns no number and no object to a ground fluent")
            return [(effect, context._replace(place=Place.EFFECT))]
        atom = effect.formula if isinstance(effect, Not) else effect
        if not isinstance(atom, Atom):
            self._fail(f"{shown(formula)} is no timed literal; give an Atom, a Not or an Assign")
        return [(effect, context._replace(place=Place.INITIAL))]

    def _metric(self, formula: Metric, parent: int | None, context: Context) -> _Parts:
        self._expect(formula, context, Place.METRIC)
        if formula.optimization not in kinds.OPTIMIZATIONS:
            self._fail(f"{formula.optimization!r} is neither minimize nor maximize")
        position = self._open(parent, formula.optimization)
        self._expression(formula.expression, position, context)
        return ()


_HANDLERS: dict[type, Callable[[TreeWriter, Any, int | None, Context], _Parts]] = {
    Atom: TreeWriter._atom,
    Equal: TreeWriter._equal,
    Comparison: TreeWriter._comparison,
    Not: TreeWriter._not,
    And: TreeWriter._and,
    Or: TreeWriter._connective,
    Imply: TreeWriter._connective,
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

"""Draws formulas, effects, expressions and constraints, to a depth that keeps them small."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal

from hypothesis import strategies as st

from kant_sql.dto.formula import (
    ARITHMETIC,
    ASSIGNMENTS,
    AT_END,
    AT_START,
    COMPARISONS,
    MODALS,
    TIMES,
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    ContinuousTime,
    Equal,
    Exists,
    Expression,
    Forall,
    Formula,
    Imply,
    Modal,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TypedName,
    Variable,
    When,
)
from kant_sql.dto.name import ROOT_TYPE
from tests.document_world import Scope, Words, bind

DEPTH = 3
GOALS = ("literal", "literal", "comparison", "not", "and", "or", "imply", "quantifier")
DURATION = Variable("duration")
NUMBERS = ("0", "1", "-1", "0.5", "1.50", "-3.25", "007", "1000000000000000000001", "0.1", "1E+3")


class Formulas(Words):
    """Draws what the grammar has, each in the context that the grammar has it in."""

    def several(self, one: Callable[[], Formula], most: int = 3) -> tuple[Formula, ...]:
        return tuple(one() for _ in range(self.draw(st.integers(0, most))))

    def conjuncts(self, one: Callable[[], Formula], most: int = 3) -> tuple[Formula, ...]:
        """What is at the top of a goal, a condition or an effect: no conjunction is within it."""
        found: list[Formula] = []
        stack = [*self.several(one, most)]
        while stack:
            formula = stack.pop(0)
            if isinstance(formula, And):
                stack[:0] = formula.formulas
            else:
                found.append(formula)
        return tuple(found)

    def bound(self, least: int = 1) -> Scope:
        parts = self.draw(self.world.parameters(2))
        return parts if len(parts) >= least else (TypedName("q", (ROOT_TYPE,)),)

    def number(self, least: int | None = None) -> Number:
        number = Number(Decimal(self.pick(NUMBERS)))
        return number if least is None or number.value >= least else Number(Decimal(least))

    def expression(self, scope: Scope, depth: int = 2, duration: bool = False) -> Expression:
        kind = self.pick(["number", "fluent", "fluent", "arithmetic", "duration"])
        if kind == "duration" and duration:
            return DURATION
        if kind == "arithmetic" and depth:
            operator = self.pick(ARITHMETIC)
            most = {"+": 3, "*": 3, "-": 2, "/": 2}[operator]
            count = self.draw(st.integers(1 if operator == "-" else 2, most))
            parts = [self.expression(scope, depth - 1, duration) for _ in range(count)]
            return Arithmetic(operator, tuple(parts))
        return self.number() if kind == "number" else self.fluent(scope) or self.number()

    def literal(self, scope: Scope, basic: bool = False, nested: int = 0) -> Atom | Not:
        atom = self.atom(scope, basic, nested)
        return Not(atom) if self.flip() else atom

    def comparison(self, scope: Scope) -> Formula:
        if self.flip():
            sides = [self.term((ROOT_TYPE,), scope, nested=2) for _ in range(2)]
            if sides[0] is not None and sides[1] is not None:
                return Equal(sides[0], sides[1])
        fluent = self.fluent(scope)
        if fluent is None:
            return self.literal(scope)
        pair = [fluent, self.expression(scope)]
        if self.flip():
            pair.reverse()
        return Comparison(self.pick(COMPARISONS), pair[0], pair[1])

    def goal(self, scope: Scope, depth: int = DEPTH) -> Formula:
        """A goal description: no time, no preference."""
        kind = self.pick(
            [*("literal", "literal", "comparison"), *("not", "and", "or", "imply"), "all"]
        )
        if kind == "comparison":
            return self.comparison(scope)
        if kind == "literal" or not depth:
            return self.literal(scope, nested=2)
        if kind == "not":
            return Not(self.goal(scope, depth - 1))
        if kind == "imply":
            return Imply(self.goal(scope, depth - 1), self.goal(scope, depth - 1))
        if kind == "all":
            parts = self.bound()
            inner = self.goal(bind(scope, parts), depth - 1)
            return Forall(parts, inner) if self.flip() else Exists(parts, inner)
        parts_ = self.several(lambda: self.goal(scope, depth - 1))
        return And(parts_) if kind == "and" else Or(parts_)

    def nest(
        self, one: Callable[[Scope], Formula], scope: Scope, preferences: bool, depth: int = 2
    ) -> Formula:
        """Something, a preference for it, or one or more of these for all objects."""
        kind = self.pick(["one", "one", "one", "preference", "forall", "and"])
        if kind == "forall" and depth:
            parts = self.bound()
            return Forall(parts, self.nest(one, bind(scope, parts), preferences, depth - 1))
        if kind == "and" and depth:
            return And(self.several(lambda: self.nest(one, scope, preferences, depth - 1), 2))
        if kind == "preference" and preferences:
            return Preference(self.pick([None, "p1", "P2", "at", "always1"]), one(scope))
        return one(scope)

    def condition(self, scope: Scope, durative: bool = False, soft: bool = True) -> Formula:
        """A condition of an action; of a durative one, at a time."""
        if durative:
            return self.nest(lambda s: Timed(self.pick(TIMES), self.goal(s, 2)), scope, soft)
        return self.nest(lambda s: self.goal(s, 2), scope, soft)

    def assignment(self, scope: Scope, duration: bool = False) -> Formula:
        if self.flip():
            fluent = self.fluent(scope)
            if fluent is not None:
                value = self.expression(scope, duration=duration)
                return Assign(self.pick(ASSIGNMENTS), fluent, value)
        for function in self.world.functions:
            if not function.types or not self.flip():
                continue
            fluent = self.fluent(scope, function.types)
            value_ = self.term(function.types, scope, nested=2)
            if fluent is not None and value_ is not None and fluent.function == function.name:
                return Assign("assign", fluent, value_)
        return self.literal(scope, basic=True)

    def change(self, scope: Scope, duration: bool = False) -> Formula:
        if self.flip():
            return self.literal(scope, basic=True, nested=2)
        return self.assignment(scope, duration)

    def effect(self, scope: Scope, durative: bool = False, depth: int = 2) -> Formula:
        def one(inner: Scope) -> Formula:
            if durative:
                return Timed(self.pick((AT_START, AT_END)), self.change(inner, duration=True))
            return self.change(inner)

        kind = self.pick(["one", "one", "when", "forall", "and", "continuous"])
        if kind == "continuous" and durative:
            return self.continuous(scope) or one(scope)
        if kind == "when":
            condition = self.condition(scope, durative, soft=False)
            return When(condition, one(scope) if self.flip() else And((one(scope), one(scope))))
        if kind == "forall" and depth:
            parts = self.bound()
            return Forall(parts, self.effect(bind(scope, parts), durative, depth - 1))
        if kind == "and" and depth:
            return And(self.several(lambda: self.effect(scope, durative, depth - 1), 2))
        return one(scope)

    def continuous(self, scope: Scope) -> Assign | None:
        fluent = self.fluent(scope)
        if fluent is None:
            return None
        rate: Expression = ContinuousTime()
        if self.flip():
            pair = (rate, self.expression(scope, 1))
            rate = Arithmetic("*", pair if self.flip() else pair[::-1])
        return Assign(self.pick(("increase", "decrease")), fluent, rate)

    def duration(self, scope: Scope) -> Formula:
        operator = self.pick(("=", "<=", ">="))
        constraint = Comparison(operator, DURATION, self.expression(scope))
        return Timed(self.pick((AT_START, AT_END)), constraint) if self.flip() else constraint

    def modal(self, scope: Scope, depth: int = 1) -> Formula:
        operator = self.pick([AT_END, *MODALS])
        if operator == AT_END:
            return Timed(AT_END, self.goal(scope, 1))
        numbers, formulas = MODALS[operator]
        return Modal(
            operator,
            tuple(self.number(0) for _ in range(numbers)),
            tuple(
                self.modal(scope, depth - 1) if depth and self.flip() else self.goal(scope, 1)
                for _ in range(formulas)
            ),
        )

    def constraint(self, scope: Scope = (), soft: bool = False) -> Formula:
        return self.nest(self.modal, scope, soft)

"""Effects, one by one: each with what quantifies it, its condition and its time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..dto.formula import (
    And,
    Assign,
    Atom,
    Constant,
    Expression,
    Fluent,
    Forall,
    Formula,
    Not,
    Timed,
    Variable,
    When,
)
from ..dto.node import walk
from .context import Context, Scope
from .up_formulas import Formulas

if TYPE_CHECKING:
    from unified_planning.model import FNode
    from unified_planning.model import Variable as UpVariable


@dataclass(frozen=True, slots=True)
class Effect:
    """A single effect, taken out of what is around it.

    Attributes:
        scope: the variables that it may mention.
        variables: what quantifies it.
        conditions: when it happens, each condition with its time; None in an instant.
        time: the time of the effect; None in an instant, and for a continuous one.
        change: what changes.
    """

    scope: Scope
    variables: tuple[UpVariable, ...] = ()
    conditions: tuple[tuple[str | None, Formula, Scope], ...] = ()
    time: str | None = None
    change: Atom | Not | Assign | None = None


def single_effects(
    effect: Formula, context: Context, formulas: Formulas, outer: Effect
) -> Iterator[Effect]:
    """Take an effect apart.

    Args:
        effect: the effect as the document has it.
        context: the conversion.
        formulas: what binds variables.
        outer: what is around the effect.

    Yields:
        The single effects within, in order.

    Raises:
        UnsupportedConstructError: it is no effect.
    """
    match effect:
        case And(parts):
            for part in parts:
                yield from single_effects(part, context, formulas, outer)
        case Forall(names, inner):
            for variables, scope in formulas.variables(names, outer.scope):
                around = replace(outer, scope=scope, variables=outer.variables + variables)
                yield from single_effects(inner, context, formulas, around)
        case When(condition, inner):
            conditions = (*outer.conditions, *_timed(condition, outer))
            yield from single_effects(
                inner, context, formulas, replace(outer, conditions=conditions)
            )
        case Timed(time, inner) if outer.time is None:
            yield from single_effects(inner, context, formulas, replace(outer, time=time))
        case Atom() | Assign() | Not(Atom()):
            yield replace(outer, change=effect)
        case _:
            raise context.unsupported(effect, "it is no effect")


def _timed(condition: Formula, outer: Effect) -> Iterator[tuple[str | None, Formula, Scope]]:
    match condition:
        case And(parts):
            for part in parts:
                yield from _timed(part, outer)
        case Timed(time, inner):
            yield time, inner, outer.scope
        case _:
            yield outer.time, condition, outer.scope


class Change:
    """Says what a single effect does, in expressions of unified-planning."""

    def __init__(self, context: Context, formulas: Formulas) -> None:
        """Convert within a context.

        Args:
            context: the conversion.
            formulas: what converts formulas.
        """
        self._context, self._formulas = context, formulas
        self._manager = context.environment.expression_manager

    def condition(self, effect: Effect) -> FNode:
        """Convert the condition of an effect.

        Args:
            effect: the effect.

        Returns:
            The condition, which holds at the time of the effect.

        Raises:
            UnsupportedConstructError: a condition has another time than the effect.
        """
        for time, condition, _ in effect.conditions:
            if time != effect.time:
                reason = "an effect whose condition has another time than itself has no counterpart"
                raise self._context.unsupported(condition, reason)
        return self._formulas.conjunction(
            self._formulas.formula(condition, scope) for _, condition, scope in effect.conditions
        )

    def target(self, effect: Effect) -> FNode:
        """Convert what an effect changes.

        Args:
            effect: the effect.

        Returns:
            The fluent.

        Raises:
            UnsupportedConstructError: the fluent depends on another one.
        """
        change = effect.change
        fluent = change.fluent if isinstance(change, Assign) else _atom(change)
        if any(isinstance(node, Fluent) for term in fluent.terms for node in walk(term)):
            reason = "an effect on what another fluent denotes has no counterpart"
            raise self._context.unsupported(change, reason)
        if isinstance(fluent, Atom):
            return self._formulas.formula(fluent, effect.scope)
        return self._formulas.fluent(fluent, effect.scope)

    def value(self, effect: Effect, target: FNode) -> tuple[str, FNode]:
        """Convert how an effect changes its target.

        Args:
            effect: the effect.
            target: what it changes.

        Returns:
            `assign`, `increase` or `decrease`, and the operand.

        Raises:
            UnsupportedConstructError: it has no exact counterpart.
        """
        change = effect.change
        if not isinstance(change, Assign):
            return "assign", self._manager.Bool(isinstance(change, Atom))
        if target.type.is_user_type():
            return "assign", self._object(change, effect.scope, target)
        value = self.number(effect)
        if change.operator == "scale-up":
            return "assign", self._manager.Times(target, value)
        if change.operator == "scale-down":
            return "assign", self._manager.Div(target, value)
        return change.operator, value

    def number(self, effect: Effect) -> FNode:
        """Convert the number that an assignment has.

        Args:
            effect: the effect, an assignment.

        Returns:
            The number.

        Raises:
            UnsupportedConstructError: it has no exact counterpart.
        """
        return self._formulas.expression(number_of(effect.change), effect.scope)

    def _object(self, change: Assign, scope: Scope, target: FNode) -> FNode:
        if not isinstance(change.value, Constant | Variable | Fluent):
            raise self._context.unsupported(change, "it assigns what is no object")
        value = self._formulas.term(change.value, scope)
        if not target.type.is_compatible(value.type):
            reason = f"{value} is of type {value.type}, not of {target.type}"
            raise self._context.unsupported(change, reason)
        return value

    def repeats(self, effect: Effect, nodes: Iterable[FNode]) -> int:
        """Tell how often an effect happens beyond what its own variables make of it.

        unified-planning drops the quantified variables that an effect does not mention.

        Args:
            effect: the effect.
            nodes: its fluent, condition and value.

        Returns:
            The number of bindings of the variables that the effect does not mention.
        """
        oracle = self._context.environment.free_vars_oracle
        mentioned = {variable for node in nodes for variable in oracle.get_free_variables(node)}
        count = 1
        for variable in effect.variables:
            if variable not in mentioned:
                count *= sum(
                    variable.type.is_compatible(item.type)
                    for item in self._context.objects.values()
                )
        return count


def number_of(change: Atom | Not | Assign | None) -> Expression:
    """Give the number of an assignment to a number's fluent.

    Args:
        change: the assignment.

    Returns:
        The expression that it has.
    """
    assert isinstance(change, Assign), "only an assignment has a number"
    assert not isinstance(change.value, Constant), "a number's fluent is assigned a number"
    return change.value


def _atom(change: Atom | Not | None) -> Atom:
    inner = change.formula if isinstance(change, Not) else change
    assert isinstance(inner, Atom), "an effect is an atom, its negation or an assignment"
    return inner

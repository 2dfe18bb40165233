"""The initial state of a problem of unified-planning."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import TYPE_CHECKING

from ..dto.formula import Atom, Constant, Number
from ..pddl.document import FunctionValue
from .from_formulas import Bound, Expressions

if TYPE_CHECKING:
    from unified_planning.model import Fluent as UpFluent
    from unified_planning.model import FNode
    from unified_planning.model import Problem as UpProblem


def initial_state(
    problem: UpProblem, expressions: Expressions
) -> tuple[tuple[Atom, ...], tuple[FunctionValue, ...]]:
    """Convert what holds at first.

    Args:
        problem: the problem.
        expressions: what converts expressions.

    Returns:
        The facts, and the values of functions.

    Raises:
        UnsupportedConstructError: PDDL cannot express a value, or it is not known whether a
            predicate holds.
    """
    facts, values = [], []
    for fluent in problem.fluents:
        for target, value in _values(problem, fluent, expressions):
            if fluent.type.is_bool_type():
                fact = expressions.formula(target, Bound())
                if value.is_true() and isinstance(fact, Atom):
                    facts.append(fact)
                continue
            function = expressions.fluent(target, Bound())
            values.append(FunctionValue(function, _value(value, fluent, expressions)))
    return tuple(facts), tuple(values)


def _value(value: FNode, fluent: UpFluent, expressions: Expressions) -> Number | Constant:
    if fluent.type.is_user_type():
        item = expressions.term(value, Bound())
        if isinstance(item, Constant):
            return item
        raise expressions.unsupported(value, "it is no object")
    number = expressions.expression(value, Bound())
    if isinstance(number, Number):
        return number
    raise expressions.unsupported(value, "no decimal number is equal to it")


def _values(
    problem: UpProblem, fluent: UpFluent, expressions: Expressions
) -> Iterator[tuple[FNode, FNode]]:
    from unified_planning.model.fluent import get_all_fluent_exp

    explicit = {
        target: value
        for target, value in problem.explicit_initial_values.items()
        if target.fluent() == fluent
    }
    default = problem.fluents_defaults.get(fluent)
    if default is not None and not default.is_false():
        for target in get_all_fluent_exp(problem, fluent):
            yield target, explicit.get(target, default)
        return
    if fluent.type.is_bool_type() and default is None:
        sizes = (len(list(problem.objects(part.type))) for part in fluent.signature)
        if len(explicit) != prod(sizes):
            reason = "what is not said to hold is false; give it a default initial value"
            raise expressions.unsupported(f"unknown values of {fluent.name}", reason)
    yield from explicit.items()

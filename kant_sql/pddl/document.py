"""Domains and problems as documents: all that a PDDL file says, apart from its layout.

A document is immutable, and compares with `==`: two are equal when they say the same in the same
spelling and the same order. Only the order of the initial state does not count: it is a set.

Names that refer to something are in the spelling of its declaration. A name without a type is of
type `object`. A conjunction at the top of a goal, a condition, an effect or a constraint is the
list of its conjuncts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from ..arguments import expect
from ..dto.formulas import (
    Atom,
    Checked,
    Constant,
    Derived,
    Equal,
    Fluent,
    Formula,
    Metric,
    Not,
    Number,
    TimedLiteral,
    TypedName,
)

ACTION, DURATIVE_ACTION, PROCESS, EVENT = "action", "durative-action", "process", "event"


class PddlWarning(NamedTuple):
    """Something that violates the standard, and was read in the one way that makes sense.

    Attributes:
        source: the file's path, or `<string>`.
        line: the line, from 1.
        column: the column, from 1.
        message: what was found, and how it was read.
    """

    source: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}: warning: {self.message}"


@dataclass(frozen=True, slots=True)
class Predicate(Checked):
    """A predicate's declaration.

    Attributes:
        name: its name.
        parameters: its parameters, in order; names may repeat.
    """

    name: str
    parameters: tuple[TypedName, ...] = ()


@dataclass(frozen=True, slots=True)
class Function(Checked):
    """A function's declaration.

    Attributes:
        name: its name.
        parameters: its parameters, in order; names may repeat.
        types: the types of its values; none for numbers.
    """

    name: str
    parameters: tuple[TypedName, ...] = ()
    types: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Action(Checked):
    """An action, a durative action, a process or an event.

    Attributes:
        kind: `action`, `durative-action`, `process` or `event`.
        name: its name.
        parameters: its parameters, in order.
        duration: a durative action's constraints on its duration; else none.
        condition: the conjuncts of its precondition or condition.
        effect: the conjuncts of its effect.
    """

    kind: str
    name: str
    parameters: tuple[TypedName, ...] = ()
    duration: tuple[Formula, ...] = ()
    condition: tuple[Formula, ...] = ()
    effect: tuple[Formula, ...] = ()


@dataclass(frozen=True)
class Domain(Checked):
    """A domain.

    Attributes:
        name: its name.
        requirements: the requirements as written, each with its colon.
        types: the types, each with the types above it.
        constants: the constants.
        predicates: the predicates.
        functions: the functions.
        constraints: the conjuncts of its constraints.
        derived: the rules for derived predicates.
        actions: actions, durative actions, processes and events, in the order of the file.
        warnings: what violates the standard; does not count in a comparison.
    """

    name: str
    requirements: tuple[str, ...] = ()
    types: tuple[TypedName, ...] = ()
    constants: tuple[TypedName, ...] = ()
    predicates: tuple[Predicate, ...] = ()
    functions: tuple[Function, ...] = ()
    constraints: tuple[Formula, ...] = ()
    derived: tuple[Derived, ...] = ()
    actions: tuple[Action, ...] = ()
    warnings: tuple[PddlWarning, ...] = field(default=(), compare=False)


class FunctionValue(NamedTuple):
    """What a fluent is at first.

    Attributes:
        fluent: the function, applied to constants.
        value: a number, or for an object fluent an object.
    """

    fluent: Fluent
    value: Number | Constant


@dataclass(frozen=True, eq=False)
class Problem(Checked):
    """A problem.

    Attributes:
        name: its name.
        domain: its domain's name.
        requirements: the requirements as written, each with its colon.
        objects: the objects.
        facts: what holds at first.
        literals: what else is written of the initial state: negative literals and equality.
        values: what the fluents are at first.
        timed: timed initial literals and values.
        goal: the conjuncts of the goal.
        constraints: the conjuncts of the constraints.
        metric: what a plan is measured by, if anything.
        warnings: what violates the standard; does not count in a comparison.
    """

    name: str
    domain: str
    requirements: tuple[str, ...] = ()
    objects: tuple[TypedName, ...] = ()
    facts: tuple[Atom, ...] = ()
    literals: tuple[Not | Equal, ...] = ()
    values: tuple[FunctionValue, ...] = ()
    timed: tuple[TimedLiteral, ...] = ()
    goal: tuple[Formula, ...] = ()
    constraints: tuple[Formula, ...] = ()
    metric: Metric | None = None
    warnings: tuple[PddlWarning, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        for value in self.values:
            expect(value.fluent, Fluent, "the fluent of a FunctionValue")
            expect(value.value, (Number, Constant), "the value of a FunctionValue")

    def _said(self) -> tuple[object, ...]:
        return (
            self.name,
            self.domain,
            self.requirements,
            self.objects,
            frozenset(self.facts),
            frozenset(self.literals),
            frozenset(self.values),
            frozenset(self.timed),
            self.goal,
            self.constraints,
            self.metric,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Problem):
            return NotImplemented
        return self._said() == other._said()

    def __hash__(self) -> int:
        return hash((self.name, self.domain, self.goal))

"""Domains and problems as documents: the content of PDDL files without their layout.

A document is immutable. Two are equal (`==`) if their content, spelling and order are equal; the
initial state is a set and has no order.

References have the spelling of the declaration. A name without a type has the type `object`. A
conjunction at the top of a goal, a condition, an effect or a constraint is the tuple of its
conjuncts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import NamedTuple

from ..arguments import expect
from ..dto import formulas as f

ACTION, DURATIVE_ACTION, PROCESS, EVENT = "action", "durative-action", "process", "event"
ACTION_KINDS = (ACTION, DURATIVE_ACTION, PROCESS, EVENT)
# The kinds of steps: processes and events are not steps.
EXECUTABLE = (ACTION, DURATIVE_ACTION)


class PddlWarning(NamedTuple):
    """A violation of the standard with only one sensible reading.

    Attributes:
        source: the file's path, or `<string>`.
        line: the line, from 1.
        column: the column, from 1.
        message: the deviation, and its reading.
    """

    source: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}: warning: {self.message}"


@dataclass(frozen=True, slots=True)
class Predicate(f.Checked):
    """A predicate's declaration.

    Attributes:
        name: its name.
        parameters: its parameters, in order; names may repeat.
    """

    name: str
    parameters: tuple[f.TypedName, ...] = ()


@dataclass(frozen=True, slots=True)
class Function(f.Checked):
    """A function's declaration.

    Attributes:
        name: its name.
        parameters: its parameters, in order; names may repeat.
        types: the types of its values; none for numbers.
    """

    name: str
    parameters: tuple[f.TypedName, ...] = ()
    types: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Action(f.Checked):
    """An action, a durative action, a process or an event.

    Attributes:
        kind: `action`, `durative-action`, `process` or `event`.
        name: its name.
        parameters: its parameters, in order.
        duration: a durative action's constraints on its duration; empty for other actions.
        condition: the conjuncts of its precondition or condition.
        effect: the conjuncts of its effect.
    """

    kind: str
    name: str
    parameters: tuple[f.TypedName, ...] = ()
    duration: tuple[f.Formula, ...] = ()
    condition: tuple[f.Formula, ...] = ()
    effect: tuple[f.Formula, ...] = ()


@dataclass(frozen=True)
class Domain(f.Checked):
    """A domain.

    Attributes:
        name: its name.
        requirements: the requirements as written, each with its colon.
        types: the types, each with its supertypes.
        constants: the constants.
        predicates: the predicates.
        functions: the functions.
        constraints: the conjuncts of its constraints.
        derived: the rules for derived predicates.
        actions: actions, durative actions, processes and events, in the order of the file.
        warnings: violations of the standard; ignored by `==`.
    """

    name: str
    requirements: tuple[str, ...] = ()
    types: tuple[f.TypedName, ...] = ()
    constants: tuple[f.TypedName, ...] = ()
    predicates: tuple[Predicate, ...] = ()
    functions: tuple[Function, ...] = ()
    constraints: tuple[f.Formula, ...] = ()
    derived: tuple[f.Derived, ...] = ()
    actions: tuple[Action, ...] = ()
    warnings: tuple[PddlWarning, ...] = field(default=(), compare=False)


class FunctionValue(NamedTuple):
    """The initial value of a fluent.

    Attributes:
        fluent: the function, applied to constants.
        value: a number, or for an object fluent an object.
    """

    fluent: f.Fluent
    value: f.Number | f.Constant


# The initial state is a set.
_UNORDERED = frozenset({"facts", "literals", "values", "timed"})


@dataclass(frozen=True, eq=False)
class Problem(f.Checked):
    """A problem.

    Attributes:
        name: its name.
        domain: its domain's name.
        requirements: the requirements as written, each with its colon.
        objects: the objects.
        facts: the atoms of the initial state.
        literals: the negative literals and equalities of the initial state.
        values: the initial values of fluents.
        timed: timed initial literals and values.
        goal: the conjuncts of the goal.
        constraints: the conjuncts of the constraints.
        metric: the metric, if any.
        warnings: violations of the standard; ignored by `==`.
    """

    name: str
    domain: str
    requirements: tuple[str, ...] = ()
    objects: tuple[f.TypedName, ...] = ()
    facts: tuple[f.Atom, ...] = ()
    literals: tuple[f.Not | f.Equal, ...] = ()
    values: tuple[FunctionValue, ...] = ()
    timed: tuple[f.TimedLiteral, ...] = ()
    goal: tuple[f.Formula, ...] = ()
    constraints: tuple[f.Formula, ...] = ()
    metric: f.Metric | None = None
    warnings: tuple[PddlWarning, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        for value in self.values:
            expect(value.fluent, f.Fluent, "the fluent of a FunctionValue")
            expect(value.value, (f.Number, f.Constant), "the value of a FunctionValue")

    def _content(self) -> tuple[object, ...]:
        own = ((one.name, getattr(self, one.name)) for one in fields(self) if one.compare)
        return tuple(frozenset(each) if name in _UNORDERED else each for name, each in own)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Problem):
            return NotImplemented
        return self._content() == other._content()

    def __hash__(self) -> int:
        return hash((self.name, self.domain, self.goal))


def formulas(
    domain: Domain, problem: Problem | None = None, *, durations: bool = True
) -> Iterator[f.Node]:
    """Yield the constraints, rules, parts of actions and goals of documents."""
    yield from (*domain.constraints, *domain.derived)
    for action in domain.actions:
        yield from (*(action.duration if durations else ()), *action.condition, *action.effect)
    if problem is not None:
        yield from (*problem.goal, *problem.constraints)


def typed_names(domain: Domain, problem: Problem | None = None) -> Iterator[f.TypedName]:
    """Yield the constants, objects, parameters and variables of documents."""
    yield from (*domain.constants, *(problem.objects if problem else ()))
    for declarations in (domain.predicates, domain.functions, domain.actions):
        for declaration in declarations:
            yield from declaration.parameters
    for node in f.walk(*formulas(domain, problem)):
        yield from getattr(node, "variables", ())

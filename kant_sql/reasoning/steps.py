"""Steps as callers give them, and their actions, prepared for one state."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from itertools import count
from typing import Any, NamedTuple, Protocol, TypeVar

from ..acts import Execution
from ..arguments import shown
from ..dto import formulas as f
from ..dto.lexical import either_text
from ..errors import InvalidKnowledgeError, PlanError, UnsupportedConstructError
from ..knowledge import resolved as r
from ..knowledge.definitions import ActionDefinition, Definitions
from ..knowledge.formulas import action_of
from ..knowledge.symbols import symbols_of
from ..pddl.cursor import hint
from ..pddl.document import DURATIVE_ACTION, EXECUTABLE, Action
from ..pddl.formulas import flatten
from ..pddl.given import read_step
from ..planning import Plan, PlanStep
from .arithmetic import ADDITIVE
from .ask import find_object
from .failures import FailedCondition

T = TypeVar("T")


class UpActionInstance(Protocol):
    """An `ActionInstance` of unified-planning."""

    @property
    def action(self) -> object:
        """The action."""

    @property
    def actual_parameters(self) -> Iterable[object]:
        """The objects."""


Step = str | PlanStep | Execution | UpActionInstance

# A step with its start and its duration, as in a plan.
_TIMES = re.compile(r"^\s*(?:[\d.]+\s*:)?\s*(\(.*\)|[^\[\]]*?)\s*(?:\[\s*([\d.]+)\s*\])?\s*$", re.S)
# The time of effects that last as long as the step.
CONTINUOUS = "continuously"
_DURATION = f.Variable(f.DURATION)
_LASTING = r.Parameter(f.DURATION)
_TIME = r.Parameter("#t")


@dataclass(frozen=True)
class GroundStep:
    """An action with objects for its parameters, and its recorded execution, if any."""

    action: PreparedAction
    ids: tuple[int, ...]
    names: tuple[str, ...]
    duration: Decimal | None = None
    recorded: Execution | None = None

    def __str__(self) -> str:
        return f"({' '.join((self.action.name, *self.names))})"

    @cached_property
    def values(self) -> dict[str, Any]:
        """The values of the parameters in statements."""
        return {f"b{number}": id_ for number, id_ in enumerate(self.ids)}

    @property
    def places(self) -> dict[r.Slot, str]:
        """The parameters in statements."""
        return {bound.slot: f":b{number}" for number, bound in enumerate(self.action.parameters)}

    @cached_property
    def misfits(self) -> list[FailedCondition]:
        """The objects that do not fit their parameters, by the definition of the action."""
        return misfits(self.action.definitions, self)


@dataclass(frozen=True)
class EffectItem:
    """One effect of an action, flattened."""

    operator: str  # `add`, `delete`, or that of an assignment
    head: int  # the id of the predicate or the function
    terms: tuple[r.Place, ...]
    value: r.Quantity | r.Place | None  # the assigned number or object
    bound: tuple[r.Bound, ...]  # the variables that it ranges over
    condition: r.Part  # the condition right before the effect
    earlier: r.Part  # the condition at the start of a durative action
    # Holds if an object fluent in its terms or its value has no value, over the variables of
    # `around`.
    lacking: r.Part
    around: tuple[r.Bound, ...]  # the variables that quantifiers bind
    node: f.Node | None = None  # the effect as in the action

    @cached_property
    def is_certain(self) -> bool:
        """Whether it happens exactly once, in any state."""
        return not self.bound and self.condition == r.AllOf(()) == self.earlier

    @cached_property
    def needs_values(self) -> bool:
        """Whether an object fluent in its terms or its value may have no value."""
        return self.lacking != r.FALSE

    @cached_property
    def numbers(self) -> list[r.NumberOf]:
        """The fluents that its number depends on."""
        if self.value is None or isinstance(self.value, r.Slot | r.Known):
            return []
        found = (each for each in r.parts_of(self.value) if isinstance(each, r.NumberOf))
        return list(dict.fromkeys(found))


class PreparedAction:
    """An action with resolved names: conditions and effects by their times."""

    def __init__(self, definitions: Definitions, node: Action, id_: int | None = None) -> None:
        self.node = node
        self.definitions = definitions
        self.id = id_  # the id of its definition; None in a document
        self.name = node.name
        self.is_durative = node.kind == DURATIVE_ACTION  # whether it has a duration
        self.variables = node.parameters
        self.numbers = count()  # gives the numbers of new variables
        # Resolves names, including those of parameters.
        self.resolver = r.Resolver(definitions, self.numbers)
        self.parameters = self.resolver.variables(self.variables)  # the variables of its parameters
        # The position of each parameter, by the number of its variable.
        self.positions = {each.slot.number: n for n, each in enumerate(self.parameters)}
        self._kept: dict[Hashable, Any] = {}

    def kept(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return something that is made once for this action, such as a statement."""
        found: T | None = self._kept.get(key)
        if found is None:
            found = self._kept[key] = make()
        return found

    @property
    def columns(self) -> tuple[r.Column, ...]:
        """The parameters as columns."""
        return tuple(
            r.Column(variable.name, bound)
            for variable, bound in zip(self.variables, self.parameters, strict=True)
        )

    def nodes(self, time: str) -> list[f.Formula]:
        """Return the hard conditions at a time; untimed ones are at the start."""
        wanted = time if self.is_durative else None
        found = [of_time(node, wanted, self._default) for node in self.node.condition]
        return [node for node in found if node is not None]

    @property
    def _default(self) -> str | None:
        """The time of untimed conditions and effects."""
        return f.AT_START if self.is_durative else None

    def preferences(self, time: str) -> Iterator[Preferred]:
        """Yield the preferences among the conditions at a time."""
        for node in self.node.condition:
            yield from preferred(node, time if self.is_durative else None, self._default)

    def constraints(self, time: str) -> list[f.Comparison]:
        """Return the constraints on the duration at a time; untimed ones are at the start."""
        nodes = [of_time(node, time, f.AT_START) for node in self.node.duration]
        parts = (part for node in nodes if node is not None for part in flatten(node))
        return [part for part in parts if isinstance(part, f.Comparison)]

    def condition(self, time: str) -> r.Part:
        """Return the conjunction of the hard conditions at a time."""
        return self.kept(("condition", time), lambda: self._condition(time))

    def _condition(self, time: str) -> r.Part:
        found = r.all_of(self.resolver.part(node) for node in self.nodes(time))
        r.check_levels(found)
        return found

    @property
    def needs_duration(self) -> bool:
        """Whether a condition or an effect depends on the duration."""
        parts = f.walk(*self.node.condition, *self.node.effect)
        return any(node == _DURATION or isinstance(node, f.ContinuousTime) for node in parts)

    def items(self, time: str) -> tuple[EffectItem, ...]:
        """Return the effects at a time; a continuous one is its rate times the duration."""
        return self.kept(("items", time), lambda: tuple(self._effects(time)))

    def _effects(self, time: str) -> Iterator[EffectItem]:
        wanted = time if self.is_durative or time == CONTINUOUS else None
        for node in self.node.effect:
            yield from self._effect(node, _Around((), r.AllOf(()), r.AllOf(())), wanted)

    def _effect(self, node: f.Node, around: _Around, time: str | None) -> Iterator[EffectItem]:
        """Yield the effects within a node that happen at a time."""
        match node:
            case f.And(parts):
                for part in parts:
                    yield from self._effect(part, around, time)
            case f.Timed(its, inner):
                if time in (its, CONTINUOUS):
                    inside = time if time == CONTINUOUS else None
                    yield from self._effect(inner, around, inside)
            case f.Forall(variables, inner):
                with self.resolver.within(variables) as bound:
                    yield from self._effect(inner, around.binding(bound), time)
            case f.When(condition, inner) if time != CONTINUOUS:
                if _has_effect(inner, time):
                    yield from self._effect(inner, self._when(condition, around, time), time)
            case _:
                yield from self._single(node, around, time)

    def _single(self, node: f.Node, around: _Around, time: str | None) -> Iterator[EffectItem]:
        """Yield the effect of a node whose parts all happen at one time."""
        if time == CONTINUOUS and isinstance(node, f.When):
            for part in f.walk(node.effect):
                if isinstance(part, f.Assign) and _is_continuous(part):
                    _check_continuous(self.name, part, True)
        elif isinstance(node, f.Assign) and _is_continuous(node):
            if time == CONTINUOUS:
                yield self._continuous(node, around)
        elif time is None:
            yield self._leaf(node, around)

    def _continuous(self, node: f.Assign, around: _Around) -> EffectItem:
        _check_continuous(self.name, node, False)
        item = self._leaf(node, around)
        assert not isinstance(item.value, r.Slot | r.Known)
        rate = None if item.value is None else _rate(item.value)
        if rate is None:
            raise UnsupportedConstructError(
                f"the continuous effect {node} is not a multiple of #t; write it as (* #t rate)"
            )
        return replace(item, value=r.Operation("*", (rate, _LASTING)))

    def _when(self, condition: f.Formula, around: _Around, time: str | None) -> _Around:
        if time is None:
            return around.holding(self.resolver.part(condition))
        if of_time(condition, f.OVER_ALL) is not None:
            raise self._other_time(time, f.OVER_ALL, condition)
        now, start = (of_time(condition, each) for each in (time, f.AT_START))
        if time == f.AT_START and of_time(condition, f.AT_END) is not None:
            raise self._other_time(time, f.AT_END, condition)
        if now is not None:
            around = around.holding(self.resolver.part(now))
        if time == f.AT_END and start is not None:
            around = around.after(self.resolver.part(start))
        return around

    def _other_time(self, time: str, other: str, condition: f.Formula) -> Exception:
        return UnsupportedConstructError(
            f"the action {self.name} has an effect {time} with a condition {other}, {condition}; a "
            "condition of an effect is at the same time, or at the start"
        )

    def _leaf(self, node: f.Node, around: _Around) -> EffectItem:
        resolver = self.resolver
        if isinstance(node, f.Assign):
            function, terms, needed = resolver.fluent(node.fluent)
            value = resolver.assigned(node.value, function, needed)
            parts = around.needing(*needed)
            return EffectItem(node.operator, function.id, terms, value, *parts, node)
        operator, atom = ("delete", node.formula) if isinstance(node, f.Not) else ("add", node)
        if not isinstance(atom, f.Atom):
            raise UnsupportedConstructError(f"action {self.name!r} has no such effect: {node}")
        predicate, terms, needed = resolver.atom(atom)
        parts = around.needing(*needed)
        return EffectItem(operator, predicate.id, terms, None, *parts, node)


@dataclass(frozen=True)
class _Around:
    """The variables, conditions, and conditions at the start around an effect."""

    bound: tuple[r.Bound, ...]
    condition: r.Part
    earlier: r.Part

    def binding(self, bound: Sequence[r.Bound]) -> _Around:
        return _Around((*self.bound, *bound), self.condition, self.earlier)

    def holding(self, part: r.Part) -> _Around:
        return _Around(self.bound, r.all_of([self.condition, part]), self.earlier)

    def after(self, part: r.Part) -> _Around:
        return _Around(self.bound, self.condition, r.all_of([self.earlier, part]))

    def needing(
        self, bound: Sequence[r.Bound], needed: Sequence[r.Part]
    ) -> tuple[tuple[r.Bound, ...], r.Part, r.Part, r.Part, tuple[r.Bound, ...]]:
        """Return the parts of an effect that needs the values of object fluents."""
        within = self.binding(bound).holding(r.all_of(needed))
        lacking: r.Part = r.FALSE
        if needed:
            lacking = r.all_of(
                [self.condition, r.negate(r.Witness(tuple(bound), r.all_of(needed)))]
            )
        return within.bound, within.condition, within.earlier, lacking, self.bound


def _is_continuous(node: f.Node) -> bool:
    """Return whether an effect changes a number continuously."""
    return isinstance(node, f.Assign) and f.mentions(f.ContinuousTime, node.value)


def _check_continuous(action: str, effect: f.Assign, is_conditional: bool) -> None:
    """Refuse a continuous effect that is not an unconditional increase or decrease."""
    if is_conditional or effect.operator not in ADDITIVE:
        raise UnsupportedConstructError(
            f"the action {action} has the continuous effect {effect}, which cannot be executed; "
            "only (increase ...) and (decrease ...) without a condition can"
        )


def _rate(quantity: r.Quantity) -> r.Quantity | None:
    """Return the factor of `#t`, or None if the expression is not a multiple of it."""
    if quantity == _TIME:
        return Decimal(1)
    if not isinstance(quantity, r.Operation):
        return None
    rates = [_rate(each) for each in quantity.operands]
    found = tuple(each for each in rates if each is not None)
    if quantity.operator in "+-":
        is_whole = len(found) == len(rates)
    else:
        # One factor, or the dividend.
        is_whole = len(found) == 1 and (quantity.operator == "*" or rates[0] is not None)
        others = zip(quantity.operands, rates, strict=True)
        found = tuple(each if rate is None else rate for each, rate in others)
        is_whole &= not any(_TIME in r.parts_of(each) for each in found)
    return r.Operation(quantity.operator, found) if is_whole else None


def _has_effect(effect: f.Formula, time: str | None) -> bool:
    """Return whether a part of an effect happens at a time."""
    if time is None:
        return True
    return any(isinstance(node, f.Timed) and node.time == time for node in f.walk(effect))


def of_time(node: f.Formula, time: str | None, default: str | None = None) -> f.Formula | None:
    """Return the part of a condition at a time; untimed parts have the default one. Or None."""
    match node:
        case f.Preference():
            return None
        case f.And(formulas):
            found = [of_time(inner, time, default) for inner in formulas]
            parts = tuple([part for part in found if part is not None])
            return f.And(parts) if parts else None
        case f.Forall(variables, formula):
            within = of_time(formula, time, default)
            return None if within is None else f.Forall(variables, within)
        case f.Timed(its, formula):
            return formula if its == time else None
    return node if time == default else None


class Preferred(NamedTuple):
    """A preference, with the variables around it."""

    name: str | None
    variables: tuple[f.TypedName, ...]
    formula: f.Formula


def preferred(
    node: f.Formula,
    time: str | None = None,
    default: str | None = None,
    around: tuple[f.TypedName, ...] = (),
) -> Iterator[Preferred]:
    """Yield the preferences within a condition at a time."""
    match node:
        case f.And(formulas):
            for inner in formulas:
                yield from preferred(inner, time, default, around)
        case f.Forall(variables, formula):
            yield from preferred(formula, time, default, (*around, *variables))
        case f.Preference(name, formula):
            within = of_time(formula, time, default)
            if within is not None:
                yield Preferred(name, around, within)


def prepared(definitions: Definitions, definition: ActionDefinition) -> PreparedAction:
    """Return a prepared action; the definitions keep it."""
    key = (PreparedAction, definition.id)
    found: PreparedAction | None = definitions.derived.get(key)
    if found is None:
        node = action_of(definitions, definition)
        found = definitions.derived[key] = PreparedAction(definitions, node, definition.id)
    return found


def executable(definitions: Definitions) -> Iterator[ActionDefinition]:
    """Yield the actions that can be steps: not processes and events."""
    return (each for each in definitions.actions if each.kind in EXECUTABLE)


def find_action(definitions: Definitions, name: str) -> ActionDefinition:
    """Find an action by name."""
    found = definitions.actions.named(name)
    if found is None:
        names = [each.name for each in executable(definitions)]
        raise InvalidKnowledgeError(f"the action {shown(name)} is not known{hint(name, names)}")
    if found.kind not in EXECUTABLE:
        raise UnsupportedConstructError(
            f"{found.name!r} is of kind {found.kind}, which happens by itself; name an action"
        )
    return found


# The number of texts of steps to keep with the definitions that they were read with.
KEPT_STEPS = 1_000


def ground(definitions: Definitions, step: object) -> GroundStep:
    """Find the action and the objects of a step; whether they fit is checked later."""
    if not isinstance(step, str):
        return _ground(definitions, step)
    # Robots repeat their steps; reading one took an eighth of `apply`.
    kept: dict[str, GroundStep] = definitions.derived.setdefault(GroundStep, {})
    found = kept.get(step)
    if found is None:
        if len(kept) >= KEPT_STEPS:
            kept.clear()
        found = kept[step] = _ground(definitions, step)
    return found


def _ground(definitions: Definitions, step: object) -> GroundStep:
    name, arguments, duration, recorded = _given(definitions, step)
    action = prepared(definitions, find_action(definitions, name))
    # Planners also write durations of instantaneous steps; a user who types one means it.
    if isinstance(step, str) and duration is not None and not action.is_durative:
        raise PlanError(
            f"{action.name!r} is an action without duration, but [{duration:f}] is given; leave "
            "it out"
        )
    if len(arguments) != len(action.parameters):
        wanted = " ".join((action.name, *(f"?{each.name}" for each in action.variables)))
        raise InvalidKnowledgeError(
            f"({' '.join((name, *arguments))}) has {len(arguments)} arguments, expected "
            f"{len(action.parameters)} as in ({wanted})"
        )
    objects = [find_object(definitions, each, " of the step") for each in arguments]
    ids = tuple([each.id for each in objects])
    names_ = tuple([each.name for each in objects])
    return GroundStep(action, ids, names_, duration, recorded)


_Given = tuple[str, Sequence[str], Decimal | None, Execution | None]


def _given(definitions: Definitions, step: object) -> _Given:
    if isinstance(step, str):
        match = _TIMES.match(step)
        text, duration = (step, None) if match is None else match.groups()
        read = read_step(
            text,
            symbols=symbols_of(definitions),
            action=lambda word: getattr(definitions.actions.named(word), "name", None),
            actions=lambda: [each.name for each in definitions.actions],
        )
        return *read, None if duration is None else Decimal(duration), None
    recorded = step if isinstance(step, Execution) else None
    given = recorded or read_plan_step(step)
    return given.action, given.arguments, given.duration, recorded


def read_plan_step(step: object) -> PlanStep:
    """Read a step of a plan, without resolving its names."""
    if isinstance(step, PlanStep):
        return step
    if isinstance(step, Execution):
        return PlanStep(step.start, step.action, step.arguments, step.duration)
    if isinstance(step, str):
        steps = Plan.read(f"{step}\n" if "(" in step else f"({step})").steps
        if len(steps) != 1:
            raise PlanError(f"{shown(step)} has {len(steps)} steps, expected one")
        return steps[0]
    return _of_unified_planning(step)


def _of_unified_planning(step: object) -> PlanStep:
    if type(step).__module__.startswith("unified_planning") and hasattr(step, "actual_parameters"):
        given: Any = step
        arguments = tuple([str(each) for each in given.actual_parameters])
        return PlanStep(None, given.action.name, arguments)
    raise PlanError(
        f"{shown(step)} is not a step; give text such as '(move rb1 hall kitchen)', a PlanStep, a "
        "step of a recorded plan, or an ActionInstance of unified-planning"
    )


def misfits(definitions: Definitions, step: GroundStep) -> list[FailedCondition]:
    """Return the objects that do not fit the parameters of a step."""
    found = []
    live = definitions.types.live
    for variable, bound, id_ in zip(
        step.action.variables, step.action.parameters, step.ids, strict=True
    ):
        object_ = definitions.objects.live(id_)
        own = object_.type_ids
        for types in bound.types:
            if types is not None and types.isdisjoint(own):
                given = either_text(live(each).name for each in own)
                reason = f"{object_.name} is of type {given}, expected {variable.type_text}"
                found.append(FailedCondition(f"?{variable.name} - {variable.type_text}", reason))
                break
    return found

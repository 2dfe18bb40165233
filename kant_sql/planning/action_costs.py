"""Writes action costs into documents: `total-cost`, tables of costs, and no other numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import gcd, lcm
from typing import Any, TypeVar

from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, fold
from ..knowledge.grounding import rebuilt
from ..pddl import document as pddl
from ..pddl.requirements import functions_in, used_requirements
from .names import declared, number, unused_name

TOTAL_COST = f.Fluent(f.TOTAL_COST)
# The maximum number of entries in an action's table of costs.
MOST_COSTS = 50_000


class Objects:
    """The objects and constants of documents, by type."""

    def __init__(self, domain: pddl.Domain, problem: pddl.Problem) -> None:
        self._above = {fold(part.name): tuple(map(fold, part.types)) for part in domain.types}
        given = {fold(part.name): part for part in (*domain.constants, *problem.objects)}
        self._objects = [(part.name, self._ancestors(part.types)) for part in given.values()]
        self._found: dict[tuple[str, ...], tuple[str, ...]] = {}

    def of(self, types: Iterable[str]) -> tuple[str, ...]:
        """Return the names of the objects that fit a parameter of some types."""
        wanted = tuple(map(fold, types))
        if wanted not in self._found:
            self._found[wanted] = tuple(
                name for name, above in self._objects if not above.isdisjoint(wanted)
            )
        return self._found[wanted]

    def _ancestors(self, types: Iterable[str]) -> set[str]:
        found, pending = {ROOT_TYPE}, list(map(fold, types))
        while pending:
            one = pending.pop()
            if one not in found:
                found.add(one)
                pending.extend(self._above.get(one, ()))
        return found


class UnusedNames:
    """Makes names that no element of the documents has."""

    def __init__(self, domain: pddl.Domain, problem: pddl.Problem) -> None:
        self._taken = {fold(name) for _, name in declared(domain, problem)}
        self._taken |= {f.TOTAL_COST, f.TOTAL_TIME}

    def __call__(self, wanted: str) -> str:
        """Return the wanted name, with a number appended if needed."""
        name = unused_name(wanted, self._taken)
        self._taken.add(fold(name))
        return name


# Amounts by the names of objects.
Values = dict[tuple[str, ...], Fraction]


@dataclass(frozen=True)
class ActionCost:
    """The cost of an action."""

    # The parameters on which it depends; none for a constant.
    parameters: tuple[f.TypedName, ...] = ()
    values: Values | None = None  # the cost by the objects of these parameters
    # The objects for which it is undefined: there, the action is not applicable.
    undefined: tuple[tuple[str, ...], ...] = ()

    def plus(self, amount: Fraction) -> Values:
        """Return the costs, increased by an amount."""
        values = {(): Fraction(0)} if self.values is None else self.values
        return {objects: value + amount for objects, value in values.items()}


@dataclass(frozen=True)
class CostedAction:
    """An action, and its contribution to a metric to minimize."""

    action: pddl.Action
    cost: ActionCost = field(default_factory=ActionCost)
    amount: Fraction = Fraction(0)  # the contribution besides `cost`


def write_costs(
    domain: pddl.Domain,
    problem: pddl.Problem,
    actions: Sequence[CostedAction],
    free: frozenset[str],
    unused: Callable[[str], str],
) -> tuple[pddl.Domain, pddl.Problem]:
    """Write actions and their costs, as whole numbers, into documents without `free` functions."""
    kept = [replace(one.action, effect=tuple(_kept(one.action.effect, free))) for one in actions]
    domain = replace(domain, actions=tuple(kept))
    domain, problem = _pruned(*_renamed(domain, problem, unused))
    tables = [costed.cost.plus(costed.amount) for costed in actions]
    writer = _Writer(unused, whole(value for table in tables for value in table.values()))
    made = tuple(
        writer.costed(action, costed.cost, table)
        for action, costed, table in zip(domain.actions, actions, tables, strict=True)
    )
    domain = replace(domain, actions=made, predicates=(*domain.predicates, *writer.predicates))
    problem = replace(problem, facts=(*problem.facts, *writer.facts), requirements=())
    if writer.is_used:
        functions = (*domain.functions, *writer.functions, pddl.Function(f.TOTAL_COST))
        values = (*problem.values, *writer.values, pddl.FunctionValue(TOTAL_COST, f.Number(0)))
        domain = replace(domain, functions=functions)
        metric = f.Metric("minimize", TOTAL_COST)
        problem = replace(problem, values=values, metric=metric)
    return replace(domain, requirements=used_requirements(domain, problem=problem)), problem


class _Writer:
    """Adds costs to actions."""

    def __init__(self, unused: Callable[[str], str], scale: Fraction) -> None:
        self._unused, self._scale = unused, scale
        self.functions: list[pddl.Function] = []
        self.values: list[pddl.FunctionValue] = []
        self.predicates: list[pddl.Predicate] = []
        self.facts: list[f.Atom] = []
        self.is_used = False  # whether an action costs anything

    def costed(self, action: pddl.Action, cost: ActionCost, table: Values) -> pddl.Action:
        """Return an action with the costs of a table."""
        amounts = set(table.values())
        variables = tuple(f.Variable(part.name) for part in cost.parameters)
        if cost.undefined:
            action = self._restricted(action, cost, variables)
        if not any(amounts):
            return action
        value: f.Expression = number(next(iter(amounts)) * self._scale)
        if len(amounts) > 1:
            name = self._unused(f"cost-of-{action.name}")
            self.functions.append(pddl.Function(name, cost.parameters))
            # Planners want a value for all objects.
            values = {**table, **dict.fromkeys(cost.undefined, Fraction(0))}
            self.values += [
                pddl.FunctionValue(
                    f.Fluent(name, tuple(map(f.Constant, objects))),
                    f.Number(int(amount * self._scale)),
                )
                for objects, amount in values.items()
            ]
            value = f.Fluent(name, variables)
        self.is_used = True
        effect: f.Formula = f.Assign("increase", TOTAL_COST, value)
        if action.kind == pddl.DURATIVE_ACTION:
            effect = f.Timed(f.AT_END, effect)
        return replace(action, effect=(*action.effect, effect))

    def _restricted(
        self, action: pddl.Action, cost: ActionCost, variables: tuple[f.Variable, ...]
    ) -> pddl.Action:
        """Restrict an action to the objects for which its cost is defined."""
        name = self._unused(f"costs-{action.name}")
        self.predicates.append(pddl.Predicate(name, cost.parameters))
        self.facts += [
            f.Atom(name, tuple(map(f.Constant, objects))) for objects in cost.values or {}
        ]
        condition: f.Formula = f.Atom(name, variables)
        if action.kind == pddl.DURATIVE_ACTION:
            condition = f.Timed(f.AT_START, condition)
        return replace(action, condition=(*action.condition, condition))


def _kept(effects: Iterable[f.Formula], free: frozenset[str]) -> Iterator[f.Formula]:
    """Yield the effects without those on some functions; these have no conditions."""
    for effect in effects:
        match effect:
            case f.And(parts):
                yield from _kept(parts, free)
            case f.Timed(time, inner):
                yield from (f.Timed(time, one) for one in _kept([inner], free))
            case f.Assign() if fold(effect.fluent.function) in free:
                continue
            case _:
                yield effect


def _pruned(domain: pddl.Domain, problem: pddl.Problem) -> tuple[pddl.Domain, pddl.Problem]:
    """Drop the numeric functions that nothing mentions."""
    nodes = [*pddl.formulas(domain, problem), *problem.timed]
    mentioned = functions_in(*nodes) | {fold(one.name) for one in domain.functions if one.types}
    functions = tuple(one for one in domain.functions if fold(one.name) in mentioned)
    values = tuple(one for one in problem.values if fold(one.fluent.function) in mentioned)
    return replace(domain, functions=functions), replace(problem, values=values)


def _renamed(
    domain: pddl.Domain, problem: pddl.Problem, unused: Callable[[str], str]
) -> tuple[pddl.Domain, pddl.Problem]:
    """Rename elements with the name of the costs, if any."""
    nodes = [*pddl.formulas(domain, problem), *problem.timed]
    if not any(_is_named_total(node) for node in f.walk(*nodes)):
        return domain, problem
    name = unused(f.TOTAL_COST)

    def change(node: f.Node) -> Any:
        made = rebuilt(node, change)
        if isinstance(made, f.Fluent) and _is_named_total(made):
            return f.Fluent(name, made.terms)
        return made

    functions = tuple(
        replace(one, name=name) if fold(one.name) == f.TOTAL_COST else one
        for one in domain.functions
    )
    values = tuple(one._replace(fluent=change(one.fluent)) for one in problem.values)
    actions = tuple(_changed(one, change, _OF_ACTION) for one in domain.actions)
    return (
        replace(_changed(domain, change, _OF_DOMAIN), functions=functions, actions=actions),
        replace(_changed(problem, change, _OF_PROBLEM), values=values),
    )


# The fields that are tuples of nodes.
_OF_ACTION = ("duration", "condition", "effect")
_OF_DOMAIN = ("constraints", "derived")
_OF_PROBLEM = ("timed", "goal", "constraints")
D = TypeVar("D", pddl.Action, pddl.Domain, pddl.Problem)


def _changed(document: D, change: Callable[[f.Node], f.Node], names: Sequence[str]) -> D:
    """Change each node of some fields."""
    fields: dict[str, Any] = {name: tuple(map(change, getattr(document, name))) for name in names}
    return replace(document, **fields)


def _is_named_total(node: f.Node) -> bool:
    return isinstance(node, f.Fluent) and fold(node.function) == f.TOTAL_COST


def functions_read(domain: pddl.Domain, problem: pddl.Problem) -> set[str]:
    """Return the folded names of the functions that affect what is possible."""
    pending = [*pddl.formulas(domain, problem), *(one.effect for one in problem.timed)]
    read: set[str] = set()
    # The functions in the values of each function: they matter if that function matters.
    sources: dict[str, set[str]] = {}
    while pending:
        node = pending.pop()
        if isinstance(node, f.Assign):
            pending.extend(node.fluent.terms)
            sources.setdefault(fold(node.fluent.function), set()).update(functions_in(node.value))
            continue
        if isinstance(node, f.Fluent):
            read.add(fold(node.function))
        pending.extend(f.children(node))
    reached = list(read)
    while reached:
        for name in sources.pop(reached.pop(), set()) - read:
            read.add(name)
            reached.append(name)
    return read


def whole(amounts: Iterable[Fraction]) -> Fraction:
    """Return the factor that makes amounts whole numbers without a common divisor."""
    # Cost planners add up 32-bit integers.
    known = [amount for amount in amounts if amount]
    if not known:
        return Fraction(1)
    scale = lcm(*(amount.denominator for amount in known))
    return Fraction(scale, gcd(*(int(amount * scale) for amount in known)))

"""Metrics: as weighted sums, as costs of actions, and documents that replace others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Protocol

from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import UnsupportedConstructError
from ..pddl.document import DURATIVE_ACTION, EXECUTABLE, Action, Domain, Problem, formulas
from ..pddl.requirements import functions_in, is_function
from ..plugins import Plugins


class NotLinearError(Exception):
    """An expression is not a weighted sum; its argument is the part at fault."""


# The key of the constant.
ONE = f.Number(1)
Sum = dict[f.Node, Fraction]


def linear(node: f.Expression) -> Sum:
    """Return the weights of the fluents and violations in a weighted sum, with folded names."""
    match node:
        case f.Number(value):
            return {ONE: Fraction(value)}
        case f.IsViolated(preference):
            return {f.IsViolated(fold(preference)): Fraction(1)}
        case f.Fluent():
            return {folded(node): Fraction(1)}
        case f.Arithmetic(operator, operands):
            parts = [linear(operand) for operand in operands]
            if operator in {"+", "-"}:
                first = -1 if operator == "-" and len(parts) == 1 else 1
                sign = 1 if operator == "+" else -1
                return _total([(first, parts[0]), *((sign, part) for part in parts[1:])])
            constants = [part for part in parts if part.keys() <= {ONE}]
            if operator == "*" and len(constants) >= len(parts) - 1:
                return _product(parts)
            if operator == "/" and len(parts) == 2 and parts[1].keys() == {ONE} and parts[1][ONE]:
                return _total([(1 / parts[1][ONE], parts[0])])
    raise NotLinearError(node)


def folded(node: f.Fluent) -> f.Fluent:
    """Return a fluent of constants with folded names."""
    terms: list[f.Term] = []
    for term in node.terms:
        if not isinstance(term, f.Constant):
            raise NotLinearError(node)
        terms.append(f.Constant(fold(term.name)))
    return f.Fluent(fold(node.function), tuple(terms))


def _product(parts: Sequence[Sum]) -> Sum:
    result: Sum = {ONE: Fraction(1)}
    for part in parts:
        left, right = (result, part) if part.keys() <= {ONE} else (part, result)
        result = _total([(right.get(ONE, Fraction(0)), left)])
    return result


def _total(parts: Iterable[tuple[Fraction | int, Sum]]) -> Sum:
    total: Sum = {}
    for factor, part in parts:
        for key, weight in part.items():
            total[key] = total.get(key, Fraction(0)) + factor * weight
    return total


def static_functions(domain: Domain, problem: Problem) -> frozenset[str]:
    """Return the functions whose values never change."""
    effects: list[f.Node] = [effect for action in domain.actions for effect in action.effect]
    effects.extend(timed.effect for timed in problem.timed)
    changed = [node.fluent.function for node in f.walk(*effects) if isinstance(node, f.Assign)]
    return frozenset(fold(one.name) for one in domain.functions) - set(map(fold, changed))


def without_unread(domain: Domain, problem: Problem) -> tuple[Domain, Problem]:
    """Leave out functions that nothing but initial values mentions: they affect no plan."""
    mentioned = functions_in(*formulas(domain, problem), *(one.effect for one in problem.timed))
    if problem.metric is not None:
        mentioned |= functions_in(problem.metric)
    functions = tuple(one for one in domain.functions if fold(one.name) in mentioned)
    if len(functions) == len(domain.functions):
        return domain, problem
    values = tuple(one for one in problem.values if fold(one.fluent.function) in mentioned)
    return replace(domain, functions=functions), replace(problem, values=values)


def is_sum_of_costs(domain: Domain, problem: Problem) -> bool:
    """Return whether the metric minimizes the cost of actions and nothing else needs the sum."""
    metric = problem.metric
    if metric is None or metric.optimization != "minimize":
        return False
    if not is_function(metric.expression, f.TOTAL_COST):
        return False
    starts = [value for fluent, value in problem.values if is_function(fluent, f.TOTAL_COST)]
    # Without a value, the sum begins at 0.
    if not all(isinstance(value, f.Number) and value.value == 0 for value in starts):
        return False
    static = static_functions(domain, problem)
    return not any(_mentions(node) for node in _readers(domain, problem)) and all(
        _adds_up(action, static) for action in domain.actions
    )


def _adds_up(action: Action, static: frozenset[str]) -> bool:
    for effect in unconditional(action.effect):
        if not isinstance(effect, f.Assign) or not is_function(effect.fluent, f.TOTAL_COST):
            if _mentions(effect):
                return False
            continue
        functions = functions_in(effect.value)
        if effect.operator != "increase" or f.TOTAL_COST in functions:
            return False
        if action.kind == DURATIVE_ACTION and not functions <= static:
            return False
        if action.kind not in EXECUTABLE:
            return False
    return True


def unconditional(effects: tuple[f.Formula, ...]) -> Iterator[f.Formula]:
    """Yield the effects of a conjunction."""
    for effect in effects:
        if isinstance(effect, f.And):
            yield from unconditional(effect.formulas)
        elif isinstance(effect, f.Timed):
            yield from unconditional((effect.formula,))
        else:
            yield effect


def hard(nodes: Iterable[f.Formula]) -> Iterator[f.Formula]:
    """Yield formulas without their preferences."""
    for node in nodes:
        match node:
            case f.Preference():
                continue
            case f.And(parts) if f.mentions(f.Preference, node):
                yield from hard(parts)
            case f.Forall(variables, inner) if f.mentions(f.Preference, inner):
                rest = tuple(hard([inner]))
                if rest:
                    yield f.Forall(variables, f.And(rest))
            case f.Timed(time, inner) if f.mentions(f.Preference, inner):
                yield from (f.Timed(time, rest) for rest in hard([inner]))
            case _:
                yield node


def _readers(domain: Domain, problem: Problem) -> Iterator[f.Node]:
    for action in domain.actions:
        yield from (*action.condition, *action.duration)
    yield from (rule.formula for rule in domain.derived)
    yield from (*domain.constraints, *problem.goal, *problem.constraints)
    for timed in problem.timed:
        yield timed.effect


def _mentions(node: f.Node) -> bool:
    return any(is_function(part, f.TOTAL_COST) for part in f.walk(node))


# The maximum number of conditional effects to compile away per action: each doubles its copies.
MOST_EFFECTS = 10


@dataclass(frozen=True)
class Variant:
    """Documents that replace others, with fewer or other constructs.

    Attributes:
        steps: the name of the original action of each added action, by folded name; None for a
            step that plans leave out.
        ignored: the missing parts of the metric and the preferences, as readable text.
        most_effects: the maximum number of conditional effects per action to compile away.
        is_costed: whether cheap plans are wanted, from engines that improve theirs for some time.
    """

    domain: Domain
    problem: Problem
    steps: Mapping[str, str | None] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    most_effects: int = MOST_EFFECTS
    is_costed: bool = False

    @property
    def improves(self) -> bool:
        """Whether engines improve their plans."""
        return self.is_costed or bool(self.steps)


class Compilation(Protocol):
    """A plugin of the group `kant_sql.compilations`."""

    def __call__(self, domain: Domain, problem: Problem) -> Iterator[Variant]:
        """Yield replacements for documents with a metric, the most faithful first."""


COMPILATIONS: Plugins[Compilation] = Plugins("kant_sql.compilations")


def variants(domain: Domain, problem: Problem, is_costed: bool = False) -> Iterator[Variant]:
    """Yield the documents, then replacements for a metric that planners do not know."""
    yield Variant(domain, problem, is_costed=is_costed)
    if problem.metric is not None:
        for name in COMPILATIONS.names():
            compilation = COMPILATIONS.get(name)
            if compilation is not None:
                yield from compilation(domain, problem)


def missing_compilation(problem: Problem) -> str:
    """Return a hint if planners do not support a metric; empty if there is none."""
    if problem.metric is None or COMPILATIONS.names():
        return ""
    return (
        f"; no plugin of the group {COMPILATIONS.group} is installed, which could compile the "
        "metric and the preferences"
    )


def hinted(error: UnsupportedConstructError, problem: Problem) -> UnsupportedConstructError:
    """Add the hint to an error."""
    return UnsupportedConstructError(f"{error}{missing_compilation(problem)}")


def refusal(ignored: Sequence[str]) -> UnsupportedConstructError:
    """Make the error for soft goals that planners cannot get."""
    return UnsupportedConstructError(
        f"planners cannot be given all soft goals: {'; '.join(ignored)}; leave these out"
    )

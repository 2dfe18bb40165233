"""What a problem of unified-planning says, apart from how its conjunctions are split up."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from unified_planning.model import Effect, FNode, Problem, Transition


def conjuncts(nodes: Iterable[FNode]) -> frozenset[FNode]:
    found: set[FNode] = set()
    for node in nodes:
        simple = node.simplify()
        if simple.is_and():
            found |= conjuncts(simple.args)
        elif not simple.is_true():
            found.add(simple)
    return frozenset(found)


def effects(given: Iterable[Effect]) -> frozenset[tuple[object, ...]]:
    return frozenset(
        (
            effect.kind,
            effect.fluent,
            effect.value.simplify(),
            conjuncts([effect.condition]),
            frozenset(effect.forall),
        )
        for effect in given
        if not effect.condition.simplify().is_false()
    )


def action(given: Transition) -> tuple[object, ...]:
    parts: list[object] = [type(given).__name__, given.name, tuple(given.parameters)]
    if hasattr(given, "duration"):
        parts.append(given.duration)
        parts.append(
            {
                (span.lower, span.upper, span.is_left_open(), span.is_right_open()): conjuncts(
                    nodes
                )
                for span, nodes in given.conditions.items()
                if conjuncts(nodes)
            }
        )
        parts.append({time: effects(given_) for time, given_ in given.effects.items() if given_})
        parts.append(
            {str(span): effects(given_) for span, given_ in given.continuous_effects.items()}
        )
    else:
        parts.append(conjuncts(given.preconditions))
        parts.append(effects(given.effects))
    return tuple(parts)


def normal_form(problem: Problem) -> dict[str, object]:
    metrics = [
        (
            type(metric).__name__,
            {made.name: cost for made, cost in metric.costs.items()}
            if metric.is_minimize_action_costs()
            else getattr(metric, "expression", getattr(metric, "goals", None)),
        )
        for metric in problem.quality_metrics
    ]
    return {
        "types": set(map(str, problem.user_types)),
        "objects": set(problem.all_objects),
        "fluents": set(problem.fluents),
        "actions": {made.name: action(made) for made in problem.actions},
        "natural": {made.name: action(made) for made in problem.natural_transitions},
        "initial": {
            fluent: value
            for fluent, value in problem.explicit_initial_values.items()
            if not value.is_false()
        },
        "timed": {timing.delay: effects(given) for timing, given in problem.timed_effects.items()},
        "goals": conjuncts(problem.goals),
        "constraints": conjuncts(problem.trajectory_constraints),
        "metrics": metrics,
    }


def spelled(part: object) -> str:
    """The text of a normal form, without what renaming and the root of the types make of it."""
    if isinstance(part, dict):
        items = sorted(f"{spelled(key)}: {spelled(value)}" for key, value in part.items())
        return f"{{{', '.join(items)}}}"
    if isinstance(part, set | frozenset):
        return f"{{{', '.join(sorted(map(spelled, part)))}}}"
    if isinstance(part, tuple | list):
        return f"({', '.join(map(spelled, part))})"
    text = re.sub(r"_(type|predicate|function)\b", "", str(part))
    return re.sub(r" - object\b", "", text)

"""Plans with one thing changed: a step dropped, doubled, swapped, moved or with other arguments."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from decimal import Decimal

from kant_sql import Plan, PlanStep

# Later than whatever happened before by as much as planners leave between steps.
EPSILON = Decimal("0.01")


def plan_of(steps: Sequence[PlanStep]) -> Plan:
    return Plan(tuple(steps), "by hand", "unknown")


def is_timed(steps: Sequence[PlanStep]) -> bool:
    return any(step.start is not None for step in steps)


def _drop(steps: list[PlanStep], chance: random.Random, objects: Sequence[str]) -> None:
    del objects
    del steps[chance.randrange(len(steps))]


def _double(steps: list[PlanStep], chance: random.Random, objects: Sequence[str]) -> None:
    del objects
    at = chance.randrange(len(steps))
    again = steps[at]
    if again.start is not None:
        late = again.start + (again.duration or 0) + EPSILON
        again = replace(again, start=chance.choice((again.start, late)))
    steps.insert(at + 1, again)


def _swap(steps: list[PlanStep], chance: random.Random, objects: Sequence[str]) -> None:
    """Swap two steps, mostly neighbours."""
    del objects
    if len(steps) < 2:
        return
    at = chance.randrange(len(steps) - 1)
    other = at + 1 if chance.random() < 0.7 else chance.randrange(len(steps))
    one, two = steps[at], steps[other]
    steps[at], steps[other] = replace(two, start=one.start), replace(one, start=two.start)


def _argument(steps: list[PlanStep], chance: random.Random, objects: Sequence[str]) -> None:
    """Replace an argument by an object that the plan uses there, or by any."""
    places = [at for at, step in enumerate(steps) if step.arguments]
    if not places:
        return
    at = chance.choice(places)
    step = steps[at]
    number = chance.randrange(len(step.arguments))
    alike = {
        one.arguments[number]
        for one in steps
        if one.action == step.action and len(one.arguments) > number
    }
    known = sorted(alike) if len(alike) > 1 and chance.random() < 0.6 else objects
    arguments = list(step.arguments)
    arguments[number] = chance.choice(known)
    steps[at] = replace(step, arguments=tuple(arguments))


def _shift(steps: list[PlanStep], chance: random.Random, objects: Sequence[str]) -> None:
    """Move a step in time; one without times to another place."""
    del objects
    at = chance.randrange(len(steps))
    step = steps[at]
    if step.start is None:
        steps.insert(chance.randrange(len(steps)), steps.pop(at))
        return
    by = Decimal(chance.choice(("-5", "-1", "-0.01", "0.01", "0.5", "1", "7", "100")))
    steps[at] = replace(step, start=max(step.start + by, Decimal(0)))


def _duration(steps: list[PlanStep], chance: random.Random, objects: Sequence[str]) -> None:
    places = [at for at, step in enumerate(steps) if step.duration is not None]
    if not places:
        _shift(steps, chance, objects)
        return
    at = chance.choice(places)
    duration = steps[at].duration
    assert duration is not None
    by = Decimal(chance.choice(("-3", "-1", "-0.02", "0.005", "0.02", "0.5", "4")))
    steps[at] = replace(steps[at], duration=max(duration + by, Decimal("0.1")))


KINDS: dict[str, Callable[[list[PlanStep], random.Random, Sequence[str]], None]] = {
    "drop": _drop,
    "double": _double,
    "swap": _swap,
    "argument": _argument,
    "shift": _shift,
    "duration": _duration,
}


def mutations(
    plan: Plan, objects: Sequence[str], seed: object, each: int
) -> Iterator[tuple[str, Plan]]:
    """Yield changed plans: so many of each kind, without repetitions, each with a step."""
    chance = random.Random(str(seed))
    seen = {plan.steps}
    for kind, change in KINDS.items():
        for _ in range(each):
            steps = list(plan.steps)
            if steps:
                change(steps, chance, objects)
            # Without a step, VAL takes a timed initial literal for the end of the plan.
            if steps and tuple(steps) not in seen:
                seen.add(tuple(steps))
                yield kind, plan_of(steps)

"""What is chosen at random: steps among those that can be taken, and constraints."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from decimal import Decimal
from itertools import islice

from kant_sql import Plan, PlanStep
from kant_sql.dto import formulas as f
from kant_sql.knowledge.grounding import bound
from kant_sql.pddl import Action, Domain, Problem
from kant_sql.reasoning.actions import Schema, Snap, apply_changes
from kant_sql.reasoning.arithmetic import decimal_of
from kant_sql.reasoning.derived import read_world
from kant_sql.reasoning.evaluate import Compiler, Conditions
from kant_sql.reasoning.validate import validate_plan
from kant_sql.reasoning.world import World
from tests.meaning.plan_mutations import EPSILON, plan_of

# How many ways to take an action are looked at.
MOST = 60
# VAL takes the time of hold-after for 0, and judges hold-during by one state (`trajectory.py`).
OPERATORS = [*sorted(f.MODALS.keys() - {"hold-after", "hold-during"}), "at end"]
LONGEST = Decimal(1000)
# How many of the steps that cannot be executed are taken back.
KEPT = 0.95


def modal(chance: random.Random, pool: Sequence[str]) -> str:
    """Write a constraint over some conditions."""
    operator = chance.choice(OPERATORS)
    times, formulas = f.MODALS.get(operator, (0, 1))
    numbers = " ".join(str(time) for time in sorted(chance.randint(1, 9) for _ in range(times)))
    return f"({operator} {numbers} {' '.join(chance.choice(pool) for _ in range(formulas))})"


def preferences(chance: random.Random, count: int, pool: Sequence[str]) -> list[str]:
    """Write preferences over constraints of each kind, some of them for all objects."""
    return [
        f"(forall (?x) (preference p{number} {modal(chance, [*pool, '(lit ?x)', '(lit ?x)'])}))"
        if number % 3 == 2
        else f"(preference p{number} {modal(chance, pool)})"
        for number in range(count)
    ]


def walk(domain: Domain, problem: Problem, seed: object, length: int) -> Plan:
    """Take random steps from the initial state.

    Durative steps start at random times, so that they overlap. Most of what cannot be executed is
    taken back.
    """
    chance = random.Random(str(seed))
    world = read_world(domain, problem)
    conditions = Conditions(world)
    steps: list[PlanStep] = []
    now = Decimal("0.01")
    for _ in range(length):
        found = _next(world, conditions, domain, chance)
        if found is None:
            break
        action, arguments, duration = found
        start = None if duration is None else now
        step = PlanStep(start, action.name, arguments, duration)
        if chance.random() < KEPT and not _is_executable(domain, problem, [*steps, step]):
            continue
        _take(world, action, arguments, duration)
        steps.append(step)
        if duration is not None:
            gaps = (EPSILON, duration + EPSILON, duration + EPSILON, duration, duration / 2)
            now = round(now + chance.choice(gaps), 3)
    return plan_of(steps)


def _is_executable(domain: Domain, problem: Problem, steps: list[PlanStep]) -> bool:
    return validate_plan(domain, problem, plan_of(steps)).failed_step is None


def _take(
    world: World, action: Action, arguments: tuple[str, ...], duration: Decimal | None
) -> None:
    """Apply the effects of an action, those at its end included."""
    schema = Schema(world, action)
    memory: dict[int, set[tuple[int, ...]]] = {}
    ids = tuple(world.ids[name] for name in arguments)
    for phase in schema.phases:
        snap = Snap(world, schema, ids, phase, 0, duration, memory)
        if not snap.prepare():
            apply_changes(world, [snap.changes])


def _next(
    world: World, conditions: Conditions, domain: Domain, chance: random.Random
) -> tuple[Action, tuple[str, ...], Decimal | None] | None:
    """Choose an action that can be taken."""
    actions = list(domain.actions)
    chance.shuffle(actions)
    for action in actions:
        found = [*islice(_ways(world, action), MOST)]
        if found:
            arguments = chance.choice(sorted(found))
            if action.kind != "durative-action":
                return action, arguments, None
            return action, arguments, _duration(world, conditions, action, arguments, chance)
    return None


def _ways(world: World, action: Action) -> Iterator[tuple[str, ...]]:
    """Yield arguments for which an action can be taken now."""
    schema = Schema(world, action)
    phase = schema.phases.get(f.AT_START) or schema.phases[None]
    compiler = Compiler(world)
    search = compiler.search(schema.action.parameters, phase.condition)
    pick = compiler.picker([one.slot for one in schema.action.parameters])
    env = compiler.env()
    for _ in search(env):
        yield world.names(pick(env))


def _duration(
    world: World,
    conditions: Conditions,
    action: Action,
    arguments: tuple[str, ...],
    chance: random.Random,
) -> Decimal:
    """Choose a duration, which mostly fits."""
    binding = bound(action.parameters, arguments)
    for constraint in action.duration:
        inner = constraint.formula if isinstance(constraint, f.Timed) else constraint
        if isinstance(inner, f.Comparison):
            exact = conditions.exact_number(inner.right, binding)
            if exact is not None:
                value = decimal_of(exact)
                return min(round(value, 3), LONGEST) if chance.random() < 0.95 else value + 1
    return Decimal(chance.randint(1, 9))

"""A world in memory evaluates conditions, and names what fails, as a plain evaluator does."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from fractions import Fraction

from hypothesis import given

from kant_sql.dto.formulas import Atom, Fluent
from kant_sql.dto.lexical import fold
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.reasoning.arithmetic import decimal_of
from kant_sql.reasoning.derived import read_world
from kant_sql.reasoning.evaluate import Conditions
from kant_sql.reasoning.failures import failed_parts
from kant_sql.reasoning.world import World
from tests.support.evaluator import Evaluator
from tests.support.generators.episodes import EPISODES, Episode
from tests.support.profile import PROFILE, hunting


@hunting(5 * PROFILE.episodes)
@given(EPISODES)
def test_a_world_in_memory_is_as_the_plain_evaluator_has_it(episode: Episode) -> None:
    domain = read_domain(write(episode.domain))
    world = read_world(domain, read_problem(write(episode.problem), domain=domain))
    conditions, state = Conditions(world), episode.first
    check(world, conditions, Evaluator(episode.theory, state), episode)
    # What is derived follows what changes.
    for change in episode.changes:
        state = change.of(state)
        for added in change.added:
            world.add(*fact(world, added))
        for removed in change.removed:
            world.remove(*fact(world, removed))
        for fluent, value in change.values:
            put(world, fluent, value)
        check(world, conditions, Evaluator(episode.theory, state), episode)


def check(world: World, conditions: Conditions, plain: Evaluator, episode: Episode) -> None:
    """Check the questions of an episode in one state."""
    spelling = {fold(name): name for name in world.ids}
    for question in episode.questions:
        for bound in plain.bindings(question.columns):
            given = {name: spelling[object_] for name, object_ in bound.items()}
            holds = plain.holds(question.formula, bound)
            about = f"episode({episode.seed}), {given}: {question.formula}"
            assert conditions.holds(question.formula, given) is holds, about
            assert bool(failed_parts(world, question.formula, given)) is not holds, about


def ids(world: World, names: Iterable[object]) -> tuple[int, ...]:
    found = [world.object(str(name)) for name in names]
    return tuple([id_ for id_ in found if id_ is not None])


def fact(world: World, atom: Atom) -> tuple[int, tuple[int, ...]]:
    predicate = world.definitions.predicates.named(atom.predicate)
    assert predicate is not None
    return predicate.id, ids(world, atom.terms)


def put(world: World, fluent: Fluent, value: Fraction | str | None) -> None:
    function = world.definitions.functions.named(fluent.function)
    assert function is not None
    given: Decimal | int | None = decimal_of(value) if isinstance(value, Fraction) else None
    if isinstance(value, str):
        [given] = ids(world, [value])
    world.set(function.id, ids(world, fluent.terms), given)

"""A world in memory evaluates conditions as a plain evaluator does."""

from __future__ import annotations

import pytest
from hypothesis import given

from kant_sql.dto.lexical import fold
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.reasoning.derived import read_world
from kant_sql.reasoning.evaluate import Conditions
from tests.support.evaluator import Evaluator
from tests.support.generators.episodes import EPISODES, Episode
from tests.support.profile import PROFILE, hunting


@pytest.mark.more
@hunting(5 * PROFILE.episodes)
@given(EPISODES)
def test_a_world_in_memory_is_as_the_plain_evaluator_has_it(episode: Episode) -> None:
    domain = read_domain(write(episode.domain))
    world = read_world(domain, read_problem(write(episode.problem), domain=domain))
    spelling = {fold(name): name for name in world.ids}
    conditions, plain = Conditions(world), Evaluator(episode.theory, episode.first)
    for question in episode.questions:
        for bound in plain.bindings(question.columns):
            given = {name: spelling[object_] for name, object_ in bound.items()}
            found = conditions.holds(question.formula, given)
            about = f"episode({episode.seed}), {given}: {question.formula}"
            assert found is plain.holds(question.formula, bound), about

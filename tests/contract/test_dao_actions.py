"""Actions and the rules that they keep, on every backend."""

from __future__ import annotations

import math
import sys
from functools import partial
from typing import Any

import pytest

from kant_sql import (
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
)
from kant_sql.errors import ArityError, InvalidNameError, TypeMismatchError
from tests.support.reading import present, refuses
from tests.support.worlds.robots import ROBOT, ROBOT_AT, WAYPOINT, WP1, assigned, literals

Action = PddlActionDto
Literal = PddlConditionEffectDto
R = PddlObjectDto(ROBOT, "r")
S = PddlObjectDto(WAYPOINT, "s")


def at_start(*objects: PddlObjectDto, predicate: PddlPredicateDto = ROBOT_AT) -> Literal:
    return Literal(predicate, objects, Literal.AT_START)


def test_a_duration_is_read_as_it_was_saved(fresh_kb: KnowledgeBase) -> None:
    durations = [0, 1, 10, 2**80, 0.0, 10.0, 2.5, 0.1, 1e-7, 5e-324, 1e16, 1e23, sys.float_info.max]
    for number, duration in enumerate(durations, start=1):
        fresh_kb.actions.save(Action("a", duration=duration))
        for kb in (fresh_kb, fresh_kb.at(number)):
            found = present(kb.actions.get("a"))
            assert found.duration == duration
            assert type(found.duration) is type(duration)


def test_a_duration_that_is_no_number_of_0_or_more_is_refused(fresh_kb: KnowledgeBase) -> None:
    numbers = [-1, -0.5, math.nan, math.inf, -math.inf, 10**400, 10**5000, -(10**5000)]
    others: list[Any] = [True, False, None, "10", b"10", [10], 1j, object()]
    for duration in [*numbers, *others]:
        action = assigned(Action("a"), duration=duration)
        call = partial(fresh_kb.actions.save, action)
        caught = refuses(fresh_kb, InvalidKnowledgeError, call)
        assert "action 'a': the duration is " in str(caught)
        assert "expected a number of 0 or more" in str(caught)


def test_the_duration_of_an_instantaneous_action_does_not_matter(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.actions.save(Action("a", durative=False, duration=-1))
    found = present(fresh_kb.actions.get("a"))
    assert (found.durative, found.duration) == (False, 10)


# What makes one well formed: times, terms and their types.


@pytest.mark.parametrize(
    "time", [None, "at noon", "AT START", "", 5, ["at start"], Literal.OVER_ALL]
)
def test_a_literal_of_a_durative_action_needs_a_time(fresh_kb: KnowledgeBase, time: object) -> None:
    wrong = assigned(Literal(ROBOT_AT, [R, S]), time=time)
    action = Action("go", [R, S], [at_start(R, S)], [at_start(R, S), wrong])
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "effect 2 of action 'go'" in str(caught)
    assert "expected one of 'at start', 'at end'" in str(caught)


@pytest.mark.parametrize("time", [Literal.AT_START, "at noon", 0])
def test_a_literal_of_an_action_that_is_not_durative_must_have_no_time(
    fresh_kb: KnowledgeBase, time: object
) -> None:
    wrong = assigned(Literal(ROBOT_AT, [R, S]), time=time)
    action = Action("go", [R, S], [wrong], durative=False)
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "condition 1 of action 'go'" in str(caught)
    assert "the action is not durative; leave the time out" in str(caught)


def test_an_empty_time_is_none(fresh_kb: KnowledgeBase) -> None:
    action = Action("go", [R, S], [Literal(ROBOT_AT, [R, S], "")], durative=False)
    assert fresh_kb.actions.save(action) is True
    found = present(fresh_kb.actions.get("go"))
    assert literals(found.conditions)[0].time is None
    assert str(found) == str(action)


@pytest.mark.parametrize("objects", [[], [R], [R, S, S]])
def test_a_literal_with_too_few_or_too_many_terms_is_refused(
    fresh_kb: KnowledgeBase, objects: list[PddlObjectDto]
) -> None:
    action = Action("go", [R, S], [at_start(*objects)])
    caught = refuses(fresh_kb, ArityError, lambda: fresh_kb.actions.save(action))
    assert "condition 1 of action 'go'" in str(caught)
    assert f"has {len(objects)} terms, expected 2 as in (robot_at" in str(caught)


def test_a_term_that_does_not_fit_is_refused_saying_position_got_and_expected(
    fresh_kb: KnowledgeBase,
) -> None:
    action = Action("go", [R, S], [], [at_start(R, S), at_start(R, R)])
    caught = refuses(fresh_kb, TypeMismatchError, lambda: fresh_kb.actions.save(action))
    assert "effect 2 of action 'go': term 2 of (at start (robot_at ?r ?r)), 'r'" in str(caught)
    assert "is of type 'robot', expected 'wp' or a subtype" in str(caught)


def test_a_term_must_be_a_parameter_or_an_object_that_is_known(fresh_kb: KnowledgeBase) -> None:
    action = Action("go", [R], [at_start(R, WP1)])
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "term 2 of condition 1 of action 'go': 'wp1' is neither a parameter" in str(caught)
    fresh_kb.objects.save(WP1)
    assert fresh_kb.actions.save(action) is True
    assert "(at start (robot_at ?r wp1))" in str(fresh_kb.actions.get("go"))


def test_a_term_whose_type_disagrees_with_its_parameter_is_refused(fresh_kb: KnowledgeBase) -> None:
    action = Action("go", [R, S], [at_start(PddlObjectDto(WAYPOINT, "r"), S)])
    caught = refuses(fresh_kb, TypeMismatchError, lambda: fresh_kb.actions.save(action))
    assert "?r is given the type 'wp', but the parameter of this name has 'robot'" in str(caught)


def test_two_parameters_may_not_have_one_name(fresh_kb: KnowledgeBase) -> None:
    action = Action("go", [R, PddlObjectDto(WAYPOINT, "R")])
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "action 'go' has two parameters of the name ?R" in str(caught)


@pytest.mark.parametrize("name", ["", "?r", "a b", "x" * 256, None, 5])
def test_parameters_have_names_that_pddl_can_carry(fresh_kb: KnowledgeBase, name: object) -> None:
    wrong = assigned(PddlObjectDto(ROBOT, "r"), name=name)
    refuses(fresh_kb, InvalidNameError, lambda: fresh_kb.actions.save(Action("go", [wrong])))

"""What makes an action well formed: times, terms and their types, on every backend."""

from __future__ import annotations

import pytest

from kant_sql import (
    ConflictError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlTypeDto,
)
from kant_sql.errors import ArityError, InvalidNameError, TypeMismatchError
from tests.support.reading import refuses
from tests.support.worlds.robots import (
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    assigned,
    literals,
    navigation,
    robot_at,
)

Action = PddlActionDto
Literal = PddlConditionEffectDto
TIAGO = PddlTypeDto("tiago", parent=ROBOT)
R = PddlObjectDto(ROBOT, "r")
S = PddlObjectDto(WAYPOINT, "s")


def at_start(*objects: PddlObjectDto, predicate: PddlPredicateDto = ROBOT_AT) -> Literal:
    return Literal(predicate, objects, Literal.AT_START)


@pytest.mark.parametrize("time", [None, "at noon", "AT START", "", 5, ["at start"]])
def test_a_literal_of_a_durative_action_needs_a_time(fresh_kb: KnowledgeBase, time: object) -> None:
    wrong = assigned(Literal(ROBOT_AT, [R, S]), time=time)
    action = Action("go", [R, S], [at_start(R, S)], [at_start(R, S), wrong])
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "effect 2 of action 'go'" in str(caught.value)
    assert "expected one of 'at start', 'over all', 'at end'" in str(caught.value)


@pytest.mark.parametrize("time", [Literal.AT_START, "at noon", 0])
def test_a_literal_of_an_action_that_is_not_durative_must_have_no_time(
    fresh_kb: KnowledgeBase, time: object
) -> None:
    wrong = assigned(Literal(ROBOT_AT, [R, S]), time=time)
    action = Action("go", [R, S], [wrong], durative=False)
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "condition 1 of action 'go'" in str(caught.value)
    assert "the action is not durative; leave the time out" in str(caught.value)


def test_an_empty_time_is_none(fresh_kb: KnowledgeBase) -> None:
    action = Action("go", [R, S], [Literal(ROBOT_AT, [R, S], "")], durative=False)
    assert fresh_kb.actions.save(action) is True
    found = fresh_kb.actions.get("go")
    assert found is not None
    assert literals(found.conditions)[0].time is None
    assert str(found) == str(action)


@pytest.mark.parametrize("objects", [[], [R], [R, S, S]])
def test_a_literal_with_too_few_or_too_many_terms_is_refused(
    fresh_kb: KnowledgeBase, objects: list[PddlObjectDto]
) -> None:
    action = Action("go", [R, S], [at_start(*objects)])
    caught = refuses(fresh_kb, ArityError, lambda: fresh_kb.actions.save(action))
    assert "condition 1 of action 'go'" in str(caught.value)
    assert f"has {len(objects)} terms, expected 2 as in (robot_at" in str(caught.value)


def test_a_term_that_does_not_fit_is_refused_saying_position_got_and_expected(
    fresh_kb: KnowledgeBase,
) -> None:
    action = Action("go", [R, S], [], [at_start(R, S), at_start(R, R)])
    caught = refuses(fresh_kb, TypeMismatchError, lambda: fresh_kb.actions.save(action))
    assert "effect 2 of action 'go': term 2 of (at start (robot_at ?r ?r)), 'r'" in str(
        caught.value
    )
    assert "is of type 'robot', expected 'wp' or a subtype" in str(caught.value)


def test_a_parameter_of_a_subtype_fits_and_of_a_supertype_does_not(
    fresh_kb: KnowledgeBase,
) -> None:
    t = PddlObjectDto(TIAGO, "t")
    assert fresh_kb.actions.save(Action("go", [t, S], [at_start(t, S)])) is True
    thing = PddlObjectDto(PddlTypeDto("object"), "x")
    refuses(
        fresh_kb,
        TypeMismatchError,
        lambda: fresh_kb.actions.save(Action("stop", [thing, S], [at_start(thing, S)])),
    )


def test_a_term_must_be_a_parameter_or_an_object_that_is_known(fresh_kb: KnowledgeBase) -> None:
    action = Action("go", [R], [at_start(R, WP1)])
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "term 2 of condition 1 of action 'go': 'wp1' is neither a parameter" in str(caught.value)
    fresh_kb.objects.save(WP1)
    assert fresh_kb.actions.save(action) is True
    assert "(at start (robot_at ?r wp1))" in str(fresh_kb.actions.get("go"))


def test_a_parameter_hides_an_object_of_its_name(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.objects.save(PddlObjectDto(WAYPOINT, "r"))
    fresh_kb.actions.save(navigation())
    assert "(at start (robot_at ?r ?s))" in str(fresh_kb.actions.get("navigation"))
    assert fresh_kb.objects.delete(PddlObjectDto(WAYPOINT, "r")) is True
    assert fresh_kb.actions.get("navigation") is not None


def test_a_term_whose_type_disagrees_with_its_parameter_is_refused(
    fresh_kb: KnowledgeBase,
) -> None:
    action = Action("go", [R, S], [at_start(PddlObjectDto(WAYPOINT, "r"), S)])
    caught = refuses(fresh_kb, TypeMismatchError, lambda: fresh_kb.actions.save(action))
    assert "?r is given the type 'wp', but the parameter of this name has 'robot'" in str(
        caught.value
    )


def test_a_term_whose_type_disagrees_with_the_known_object_is_refused_naming_both(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.objects.save_all([WP1, PddlObjectDto(TIAGO, "tiago1")])
    action = Action("go", [R], [at_start(PddlObjectDto(ROBOT, "tiago1"), WP1)])
    caught = refuses(fresh_kb, ConflictError, lambda: fresh_kb.actions.save(action))
    assert "'tiago1 - tiago'" in str(caught.value)
    assert "'tiago1 - robot'" in str(caught.value)


@pytest.mark.parametrize(
    "action",
    [
        Action("go", [PddlObjectDto(PddlTypeDto("robot", parent=PddlTypeDto("x")), "r")]),
        Action("go", [R], [at_start(R, predicate=PddlPredicateDto("robot_at", [ROBOT]))]),
    ],
    ids=["type of a parameter", "predicate of a literal"],
)
def test_what_an_action_refers_to_with_another_definition_is_refused_naming_both(
    fresh_kb: KnowledgeBase, action: PddlActionDto
) -> None:
    fresh_kb.propositions.save(robot_at())
    caught = refuses(fresh_kb, ConflictError, lambda: fresh_kb.actions.save(action))
    assert "is stored as" in str(caught.value)
    assert "refers to it as" in str(caught.value)


def test_two_parameters_may_not_have_one_name(fresh_kb: KnowledgeBase) -> None:
    action = Action("go", [R, PddlObjectDto(WAYPOINT, "R")])
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.actions.save(action))
    assert "action 'go' has two parameters of the name ?R" in str(caught.value)


@pytest.mark.parametrize("name", ["", "?r", "a b", "x" * 256, None, 5])
def test_parameters_have_names_that_pddl_can_carry(fresh_kb: KnowledgeBase, name: object) -> None:
    wrong = assigned(PddlObjectDto(ROBOT, "r"), name=name)
    refuses(fresh_kb, InvalidNameError, lambda: fresh_kb.actions.save(Action("go", [wrong])))

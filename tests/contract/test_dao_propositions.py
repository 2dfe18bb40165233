"""Facts and goals, on every backend."""

from __future__ import annotations

import pytest

from kant_sql import (
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    UnknownNameError,
)
from kant_sql.errors import ArityError, TypeMismatchError
from tests.support.atoms import Atoms
from tests.support.reading import facts, refuses, rows, versions
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, WP1, WP2, robot_at

Proposition = PddlPropositionDto
RAINING = Proposition(PddlPredicateDto("raining"))


@pytest.mark.parametrize("method", ["save", "insert", "update", "delete", "save_all", "delete_all"])
def test_a_goal_given_to_the_facts_is_refused_saying_where_to_give_it(
    fresh_kb: KnowledgeBase, method: str
) -> None:
    fresh_kb.propositions.save(robot_at())
    goal = robot_at(is_goal=True)
    call = getattr(fresh_kb.propositions, method)
    given = [robot_at(RB1, WP2), goal] if method.endswith("_all") else goal
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: call(given))
    assert str(caught) == (
        "(robot_at rb1 wp1) is a goal (is_goal=True), and kb.propositions takes facts; give goals "
        "to kb.goals: kb.goals.save('(robot_at rb1 wp1)')"
    )


def test_propositions_are_read_by_predicate_in_any_spelling(fresh_kb: KnowledgeBase) -> None:
    Atoms(fresh_kb).save_all([robot_at(), RAINING, robot_at(RB1, WP2, is_goal=True)])
    by_predicate = fresh_kb.propositions.get_by_predicate
    assert by_predicate("ROBOT_AT") == [robot_at()]
    assert by_predicate("raining") == [RAINING]
    for unknown in ("robot", "%"):
        with pytest.raises(UnknownNameError):
            by_predicate(unknown)


@pytest.mark.parametrize("objects", [[], [RB1], [RB1, WP1, WP2]])
def test_too_few_or_too_many_arguments_are_refused_saying_how_many_were_expected(
    fresh_kb: KnowledgeBase, objects: list[PddlObjectDto]
) -> None:
    wrong = Proposition(ROBOT_AT, objects)
    for _ in range(2):
        caught = refuses(fresh_kb, ArityError, lambda: fresh_kb.propositions.save(wrong))
        assert str(caught).startswith(f"{wrong} has {len(objects)} arguments, expected 2")
        assert "(robot_at ?r0 - robot ?w1 - wp)" in str(caught)
        fresh_kb.propositions.save(robot_at())


def test_an_argument_that_does_not_fit_is_refused_saying_position_got_and_expected(
    fresh_kb: KnowledgeBase,
) -> None:
    wrong = Proposition(ROBOT_AT, [RB1, PddlObjectDto(ROBOT, "rb2")])
    for _ in range(2):
        caught = refuses(fresh_kb, TypeMismatchError, lambda: fresh_kb.propositions.save(wrong))
        assert str(caught) == (
            "(robot_at rb1 rb2): argument 2, 'rb2', is of type 'robot', expected 'wp' or a "
            "subtype, as in (robot_at ?r0 - robot ?w1 - wp)"
        )
        fresh_kb.propositions.save(robot_at())


def test_a_subtype_fits_and_a_supertype_does_not(fresh_kb: KnowledgeBase) -> None:
    machine = PddlTypeDto("machine")
    robot = PddlTypeDto("robot", parent=machine)
    tiago = PddlTypeDto("tiago", parent=robot)
    at = PddlPredicateDto("at", [robot])
    fresh_kb.propositions.save(Proposition(at, [PddlObjectDto(tiago, "t1")]))
    assert facts(fresh_kb) == ["(at t1)"]
    wrong = Proposition(at, [PddlObjectDto(machine, "m1")])
    caught = refuses(fresh_kb, TypeMismatchError, lambda: fresh_kb.propositions.save(wrong))
    assert "argument 1, 'm1', is of type 'machine', expected 'robot'" in str(caught)


def test_a_fact_that_comes_and_goes_has_one_identity_and_a_version_for_each_time(
    fresh_kb: KnowledgeBase,
) -> None:
    for _ in range(3):
        fresh_kb.propositions.save(robot_at())
        fresh_kb.propositions.delete(robot_at())
    assert versions(fresh_kb, "proposition") == [
        ("(robot_at rb1 wp1)", 1, 2),
        ("(robot_at rb1 wp1)", 3, 4),
        ("(robot_at rb1 wp1)", 5, 6),
    ]
    assert len(rows(fresh_kb, "SELECT * FROM proposition WHERE kb_id = :kb")) == 1


def test_within_one_result_propositions_share_what_they_refer_to(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save_all([robot_at(), robot_at(RB1, WP2)])
    one, other = fresh_kb.propositions.get_all()
    assert one.predicate is other.predicate
    assert one.objects[0] is other.objects[0]
    again = fresh_kb.propositions.get_all()[0]
    assert again.predicate is not one.predicate
    one.predicate.name = "changed"
    assert str(fresh_kb.propositions.get_all()[0]) == "(robot_at rb1 wp1)"

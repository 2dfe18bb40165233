"""Facts and goals, on every backend."""

from __future__ import annotations

import pytest

from kant_sql import (
    ConflictError,
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
from tests.support.reading import (
    facts,
    last_changes,
    nothing_changes,
    refuses,
    rows,
    state,
    versions,
)
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, WAYPOINT, WP1, WP2, robot_at, waypoint

Proposition = PddlPropositionDto
RAINING = Proposition(PddlPredicateDto("raining"))


def test_a_fact_is_saved_read_and_deleted(fresh_kb: KnowledgeBase) -> None:
    propositions = fresh_kb.propositions
    assert propositions.save(robot_at()) is True
    found = propositions.get_all()
    assert found == [robot_at()]
    assert (found[0].predicate, found[0].objects, found[0].is_goal) == (ROBOT_AT, [RB1, WP1], False)
    assert found[0].predicate.types == [ROBOT, WAYPOINT]
    assert [object_.type for object_ in found[0].objects] == [ROBOT, WAYPOINT]
    assert propositions.delete(robot_at()) is True
    assert propositions.get_all() == []
    assert propositions.delete(robot_at()) is False


def test_what_a_fact_refers_to_is_saved_along_when_it_is_missing(fresh_kb: KnowledgeBase) -> None:
    tiago = PddlObjectDto(PddlTypeDto("tiago", parent=ROBOT), "tiago1")
    fresh_kb.propositions.save(robot_at(tiago))
    assert state(fresh_kb) == {
        "types": ["robot", "wp", "tiago - robot"],
        "objects": ["tiago1 - tiago", "wp1 - wp"],
        "predicates": ["(robot_at ?r0 - robot ?w1 - wp)"],
        "actions": [],
        "facts": ["(robot_at tiago1 wp1)"],
        "goals": [],
    }
    assert fresh_kb.revision == 1
    assert last_changes(fresh_kb) == [
        "+ fact (robot_at tiago1 wp1)",
        "+ object tiago1 - tiago",
        "+ object wp1 - wp",
        "+ predicate (robot_at ?r0 - robot ?w1 - wp)",
        "+ type robot",
        "+ type tiago - robot",
        "+ type wp",
    ]


def test_a_proposition_is_a_fact_and_a_goal_at_once(fresh_kb: KnowledgeBase) -> None:
    fact, goal = robot_at(), robot_at(is_goal=True)
    propositions, goals = fresh_kb.propositions, fresh_kb.goals
    assert propositions.insert(fact) is True
    assert goals.insert(goal) is True
    assert propositions.get_all() == [fact]
    assert goals.get_propositions() == [goal]
    assert propositions.get_by_predicate("robot_at") == [fact]
    assert propositions.get_by_object("rb1") == [fact]
    assert last_changes(fresh_kb) == ["+ goal (robot_at rb1 wp1)"]
    assert propositions.delete(fact) is True
    assert propositions.get_all() == []
    assert propositions.delete(fact) is False
    assert goals.get_propositions() == [goal]
    assert goals.delete(goal) is True


@pytest.mark.parametrize("method", ["save", "insert", "update", "delete", "save_all", "delete_all"])
def test_a_goal_given_to_the_facts_is_refused_saying_where_to_give_it(
    fresh_kb: KnowledgeBase, method: str
) -> None:
    fresh_kb.propositions.save(robot_at())
    goal = robot_at(is_goal=True)
    call = getattr(fresh_kb.propositions, method)
    given = [robot_at(RB1, WP2), goal] if method.endswith("_all") else goal
    caught = refuses(fresh_kb, InvalidKnowledgeError, lambda: call(given))
    assert str(caught.value) == (
        "(robot_at rb1 wp1) is a goal (is_goal=True), and kb.propositions takes facts; give goals "
        "to kb.goals: kb.goals.save('(robot_at rb1 wp1)')"
    )


def test_a_goal_is_inserted_once_with_whichever_definition(fresh_kb: KnowledgeBase) -> None:
    assert fresh_kb.goals.insert(robot_at()) is True
    other = Proposition(PddlPredicateDto("robot_at", [WAYPOINT, ROBOT]), [RB1, WP1])
    with nothing_changes(fresh_kb):
        assert fresh_kb.goals.insert(robot_at(is_goal=True)) is False
        assert fresh_kb.goals.insert(other) is False


def test_propositions_are_read_by_predicate_in_any_spelling(fresh_kb: KnowledgeBase) -> None:
    Atoms(fresh_kb).save_all([robot_at(), RAINING, robot_at(RB1, WP2, is_goal=True)])
    by_predicate = fresh_kb.propositions.get_by_predicate
    assert by_predicate("ROBOT_AT") == [robot_at()]
    assert by_predicate("raining") == [RAINING]
    for unknown in ("robot", "%"):
        with pytest.raises(UnknownNameError):
            by_predicate(unknown)


def test_insert_refuses_what_holds_and_update_what_does_not(fresh_kb: KnowledgeBase) -> None:
    propositions = fresh_kb.propositions
    assert propositions.update(robot_at()) is False
    assert state(fresh_kb)["predicates"] == []
    assert propositions.insert(robot_at()) is True
    assert propositions.update(robot_at(RB1, WP2)) is False
    assert fresh_kb.objects.get("wp2") is None
    with nothing_changes(fresh_kb):
        assert propositions.insert(robot_at()) is False
        assert propositions.update(robot_at()) is True
        assert propositions.save(robot_at()) is True
        assert fresh_kb.goals.delete(robot_at(is_goal=True)) is False
        assert propositions.delete(Proposition(PddlPredicateDto("unknown"))) is False
        assert propositions.delete(robot_at(RB1, waypoint(99))) is False
        assert propositions.delete(Proposition(ROBOT_AT, [RB1])) is False


def test_a_fact_without_arguments_is_a_fact(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(RAINING)
    assert facts(fresh_kb) == ["(raining)"]
    with nothing_changes(fresh_kb):
        assert fresh_kb.propositions.insert(RAINING) is False
    assert fresh_kb.propositions.delete(RAINING) is True


def test_a_fact_may_mention_an_object_twice(fresh_kb: KnowledgeBase) -> None:
    near = PddlPredicateDto("near", [WAYPOINT, WAYPOINT])
    twice = Proposition(near, [WP1, WP1])
    fresh_kb.propositions.save_all([twice, Proposition(near, [WP1, WP2])])
    assert facts(fresh_kb) == ["(near wp1 wp1)", "(near wp1 wp2)"]
    fresh_kb.objects.delete(WP2)
    assert facts(fresh_kb) == ["(near wp1 wp1)"]


def test_arguments_are_told_apart_by_their_order(fresh_kb: KnowledgeBase) -> None:
    near = PddlPredicateDto("near", [WAYPOINT, WAYPOINT])
    fresh_kb.propositions.save(Proposition(near, [WP1, WP2]))
    assert fresh_kb.propositions.insert(Proposition(near, [WP2, WP1])) is True
    assert fresh_kb.propositions.delete(Proposition(near, [WP1, WP2])) is True
    assert facts(fresh_kb) == ["(near wp2 wp1)"]


@pytest.mark.parametrize("objects", [[], [RB1], [RB1, WP1, WP2]])
def test_too_few_or_too_many_arguments_are_refused_saying_how_many_were_expected(
    fresh_kb: KnowledgeBase, objects: list[PddlObjectDto]
) -> None:
    wrong = Proposition(ROBOT_AT, objects)
    for _ in range(2):
        caught = refuses(fresh_kb, ArityError, lambda: fresh_kb.propositions.save(wrong))
        assert str(caught.value).startswith(f"{wrong} has {len(objects)} arguments, expected 2")
        assert "(robot_at ?r0 - robot ?w1 - wp)" in str(caught.value)
        fresh_kb.propositions.save(robot_at())


def test_an_argument_that_does_not_fit_is_refused_saying_position_got_and_expected(
    fresh_kb: KnowledgeBase,
) -> None:
    wrong = Proposition(ROBOT_AT, [RB1, PddlObjectDto(ROBOT, "rb2")])
    for _ in range(2):
        caught = refuses(fresh_kb, TypeMismatchError, lambda: fresh_kb.propositions.save(wrong))
        assert str(caught.value) == (
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
    assert "argument 1, 'm1', is of type 'machine', expected 'robot'" in str(caught.value)


def test_the_spellings_of_a_reference_do_not_matter(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    shouted = Proposition(
        PddlPredicateDto("ROBOT_AT", [PddlTypeDto("Robot"), PddlTypeDto("WP")]),
        [PddlObjectDto(PddlTypeDto("ROBOT"), "RB1"), PddlObjectDto(PddlTypeDto("Wp"), "Wp1")],
    )
    with nothing_changes(fresh_kb):
        assert fresh_kb.propositions.insert(shouted) is False
        assert fresh_kb.propositions.update(shouted) is True
    assert fresh_kb.propositions.delete(shouted) is True


def test_update_checks_what_it_is_given(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    other = Proposition(PddlPredicateDto("robot_at", [WAYPOINT, ROBOT]), [RB1, WP1])
    refuses(fresh_kb, ConflictError, lambda: fresh_kb.propositions.update(other))


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


def test_delete_all_retracts_facts_and_keeps_the_rest(fresh_kb: KnowledgeBase) -> None:
    Atoms(fresh_kb).save_all([robot_at(), robot_at(is_goal=True), RAINING])
    before = state(fresh_kb)
    assert fresh_kb.propositions.delete_all() == 2
    assert state(fresh_kb) == {**before, "facts": []}
    assert fresh_kb.goals.delete_all() == 1
    assert state(fresh_kb) == {**before, "facts": [], "goals": []}
    assert fresh_kb.revision == 3
    with nothing_changes(fresh_kb):
        assert fresh_kb.propositions.delete_all() == fresh_kb.goals.delete_all() == 0


def test_propositions_are_read_in_the_order_in_which_they_were_first_known(
    fresh_kb: KnowledgeBase,
) -> None:
    three = [robot_at(RB1, waypoint(number)) for number in (3, 1, 2)]
    fresh_kb.propositions.save_all(three)
    fresh_kb.propositions.delete(three[0])
    fresh_kb.propositions.save(three[0])
    assert fresh_kb.propositions.get_all() == three


def test_within_one_result_propositions_share_what_they_refer_to(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save_all([robot_at(), robot_at(RB1, WP2)])
    one, other = fresh_kb.propositions.get_all()
    assert one.predicate is other.predicate
    assert one.objects[0] is other.objects[0]
    again = fresh_kb.propositions.get_all()[0]
    assert again.predicate is not one.predicate
    one.predicate.name = "changed"
    assert str(fresh_kb.propositions.get_all()[0]) == "(robot_at rb1 wp1)"

"""Blame: who asserted what holds now, why, and since when."""

from __future__ import annotations

import pytest

from kant_sql import (
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlFunctionDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.dto.formulas import Comparison
from tests.support.reading import undone
from tests.support.statements import count
from tests.support.worlds.depot import fuel, number
from tests.support.worlds.robots import RB1, ROBOT, WAYPOINT, WP1, WP2, robot_at, waypoint


def test_it_names_the_revision_that_asserted_it(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.delete(robot_at())
    with fresh_kb.transaction(actor="camera", reason="seen", source={"frame": 7}):
        fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.save(robot_at(RB1, WP2))
    blamed = fresh_kb.blame(robot_at())
    assert blamed is not None
    assert blamed.since == fresh_kb.store.revisions()[2]
    assert (blamed.since.actor, blamed.since.reason) == ("camera", "seen")
    assert (blamed.kind, blamed.text, blamed.until) == ("fact", "(robot_at rb1 wp1)", None)
    assert fresh_kb.blame("(ROBOT_AT RB1 WP1)") == blamed


def test_what_does_not_hold_is_nobody_s(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.delete(robot_at())
    assert fresh_kb.blame(robot_at()) is None
    assert fresh_kb.blame(robot_at(RB1, WP2)) is None
    assert fresh_kb.at(1).blame(robot_at()) is not None


def test_what_holds_comes_before_what_is_wanted(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.goals.save(robot_at(is_goal=True))
    text = "(robot_at rb1 wp1)"
    for kind in ("goal", "fact"):
        blamed = fresh_kb.blame(text)
        assert blamed is not None
        assert blamed.kind == kind
        fresh_kb.propositions.save(robot_at())
    of_goal = fresh_kb.blame(robot_at(is_goal=True))
    assert of_goal is not None
    assert (of_goal.kind, of_goal.since.number) == ("goal", 1)


def test_each_element_has_its_own(depot_kb: KnowledgeBase) -> None:
    depot_kb.function_values.set("fuel", objects=["t1"], value=3)
    goal = Comparison(">", fuel(), number("1"))
    depot_kb.goals.save(goal)
    depot_kb.types.save(PddlTypeDto("drone"))
    for element, text, since in (
        ("(fuel t1)", "(= (fuel t1) 3)", 2),
        (goal, "(> (fuel t1) 1)", 3),
        ("drone", "drone", 4),
        ("t1", "t1 - truck", 1),
    ):
        blamed = depot_kb.blame(element)
        assert blamed is not None
        assert (blamed.text, blamed.since.number) == (text, since)


def test_what_stands_for_several_things_is_refused(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(PddlTypeDto("home"))
    fresh_kb.functions.save(PddlFunctionDto("home", [ROBOT]))
    with pytest.raises(
        InvalidKnowledgeError,
        match=r"^'home' matches several elements: type home, function \(home \?r0 - robot\); "
        r"give a DTO of one of them$",
    ):
        fresh_kb.blame("home")
    fresh_kb.types.delete(PddlTypeDto("home"))
    blamed = fresh_kb.blame("home")
    assert blamed is not None
    assert blamed.kind == "function"


@pytest.mark.parametrize("at", [1, 2, 3, 4])
def test_a_view_of_the_past_tells_who_had_asserted_it(fresh_kb: KnowledgeBase, at: int) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.save(robot_at(RB1, WP2))
    fresh_kb.propositions.delete(robot_at())
    fresh_kb.propositions.save(robot_at())
    blamed = fresh_kb.at(at).blame(robot_at(RB1, WP1))
    assert (None if blamed is None else blamed.since.number) == {1: 1, 2: 1, 3: None, 4: 4}[at]
    assert blamed is None or blamed.until is None


def test_what_is_not_committed_is_not_told(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    blamed = fresh_kb.blame(robot_at())
    with undone(fresh_kb):
        fresh_kb.propositions.delete(robot_at())
        fresh_kb.propositions.save(robot_at(RB1, WP2))
        fresh_kb.propositions.get_all()
        assert blamed is not None
        assert fresh_kb.blame(robot_at()) == blamed
        assert fresh_kb.history(robot_at()) == [blamed]
        assert fresh_kb.blame(robot_at(RB1, WP2)) is None
        assert fresh_kb.history("wp2") == []


def test_a_text_may_have_many_arguments(fresh_kb: KnowledgeBase) -> None:
    stops = [waypoint(each) for each in range(100)]
    for length in (8, 100):
        tour = PddlPredicateDto(f"tour{length}", [WAYPOINT] * length)
        fresh_kb.propositions.save(PddlPropositionDto(tour, stops[:length]))
        blamed = fresh_kb.blame(f"(TOUR{length} {' '.join(each.name for each in stops[:length])})")
        assert blamed is not None
        assert blamed.kind == "fact"


def test_statements_do_not_grow_with_versions(kb: KnowledgeBase) -> None:
    taken = set()
    for times in (1, 50):
        for _ in range(times):
            kb.propositions.delete(robot_at())
            kb.propositions.save(robot_at())
        taken.add(count(lambda: kb.blame(robot_at())))
    # The fact, and what is known of who confirmed it and of which acts it is an effect.
    assert taken == {2}

"""The versions of an element, and who asserted and retracted it; blame: who asserted what holds."""

from __future__ import annotations

from typing import Any

import pytest

from kant_sql import (
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    UnknownNameError,
)
from kant_sql.dto import formulas as f
from kant_sql.dto.formulas import Comparison
from tests.support.reading import present
from tests.support.worlds import depot, robots

Told = list[tuple[str, str, int, int | None]]


def told(kb: KnowledgeBase, element: Any) -> Told:
    """Kind, text, first revision and the one that ended it, of each version."""
    return [
        (each.kind, each.text, each.since.number, None if each.until is None else each.until.number)
        for each in kb.history(element)
    ]


@pytest.fixture
def kb_with_past(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A robot that goes, a battery that drains, and definitions that change."""
    kb = fresh_kb
    kb.propositions.save(robots.robot_at())  # 1
    kb.goals.save(robots.robot_at(is_goal=True))  # 2
    with kb.transaction(actor="driver", reason="off it goes", source={"step": 3}):
        kb.propositions.delete(robots.robot_at())  # 3
        kb.propositions.save(robots.robot_at(robots.RB1, robots.WP2))
    kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=90)  # 4
    kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=80)  # 5
    kb.propositions.save(robots.robot_at())  # 6
    kb.types.save(PddlTypeDto("wp", parent=PddlTypeDto("place")), cascade=True)  # 7
    kb.actions.save(robots.navigation())  # 8
    kb.objects.delete(robots.WP1)  # 9
    return kb


def test_a_fact_has_a_version_for_each_time_that_it_held(kb_with_past: KnowledgeBase) -> None:
    versions = kb_with_past.history(robots.robot_at())
    revisions = kb_with_past.store.revisions()
    assert [(each.since, each.until) for each in versions] == [
        (revisions[0], revisions[2]),
        (revisions[5], revisions[6]),
    ]
    assert {(each.kind, each.text) for each in versions} == {("fact", "(robot_at rb1 wp1)")}
    ended = present(versions[0].until)
    assert (ended.actor, ended.reason, ended.source) == ("driver", "off it goes", {"step": 3})


def test_fact_and_goal_are_two_elements(kb_with_past: KnowledgeBase) -> None:
    fact, goal = "(robot_at rb1 wp1)", robots.robot_at(is_goal=True)
    assert told(kb_with_past, robots.robot_at()) == [("fact", fact, 1, 3), ("fact", fact, 6, 7)]
    assert told(kb_with_past, goal) == [("goal", fact, 2, 7)]
    assert told(kb_with_past, fact) == [
        ("fact", fact, 1, 3),
        ("goal", fact, 2, 7),
        ("fact", fact, 6, 7),
    ]


@pytest.mark.parametrize(
    "text",
    [
        "(robot_at rb1 wp2)",
        "(ROBOT_AT Rb1 wP2)",
        "  ( robot_at\n rb1\twp2 ) ",
        f.Atom("Robot_At", (f.Constant("rb1"), f.Constant("WP2"))),
        PddlPropositionDto(
            PddlPredicateDto("ROBOT_AT"),
            [PddlObjectDto(robots.ROBOT, "RB1"), PddlObjectDto(robots.ROBOT, "WP2")],
        ),
    ],
    ids=["as stored", "spelled otherwise", "blanks", "a formula", "a DTO of names alone"],
)
def test_any_spelling_finds_it(kb_with_past: KnowledgeBase, text: Any) -> None:
    assert told(kb_with_past, text) == [("fact", "(robot_at rb1 wp2)", 3, 7)]


@pytest.mark.parametrize(
    "element",
    [
        "(battery rb1)",
        "(= (battery rb1) 90)",
        "(= (BATTERY RB1) 12345)",
        PddlFunctionValueDto(robots.BATTERY, [robots.RB1], 7),
        PddlFunctionValueDto(robots.BATTERY, [robots.RB1]),
        f.Fluent("battery", (f.Constant("rb1"),)),
    ],
    ids=str,
)
def test_of_a_fluent_all_its_values_are_told(kb_with_past: KnowledgeBase, element: Any) -> None:
    assert told(kb_with_past, element) == [
        ("value", "(= (battery rb1) 90)", 4, 5),
        ("value", "(= (battery rb1) 80)", 5, None),
    ]


def test_each_kind_of_definition_has_versions(kb_with_past: KnowledgeBase) -> None:
    kb = kb_with_past
    assert told(kb, robots.WAYPOINT) == [("type", "wp", 1, 7), ("type", "wp - place", 7, None)]
    assert told(kb, "wp1 - wp") == [("object", "wp1 - wp", 1, 9)]
    assert told(kb, robots.BATTERY) == [("function", "(battery ?r0 - robot)", 4, None)]
    assert told(kb, robots.ROBOT_AT) == [("predicate", "(robot_at ?r0 - robot ?w1 - wp)", 1, None)]
    action = PddlActionDto("NAVIGATION")
    assert [(entry[0], *entry[2:]) for entry in told(kb, action)] == [("action", 8, None)]


@pytest.mark.parametrize("element", ["WP1", robots.WP1])
def test_of_an_object_all_that_involved_it_is_told(
    kb_with_past: KnowledgeBase, element: Any
) -> None:
    expected: Told = [
        ("fact", "(robot_at rb1 wp1)", 1, 3),
        ("object", "wp1 - wp", 1, 9),
        ("goal", "(robot_at rb1 wp1)", 2, 7),
        ("fact", "(robot_at rb1 wp1)", 6, 7),
    ]
    assert told(kb_with_past, element) == expected
    assert present(kb_with_past.at(2).blame(element)).text == "wp1 - wp"


def test_a_name_stands_for_all_definitions_of_it(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(PddlTypeDto("home"))
    fresh_kb.objects.save(PddlObjectDto(robots.ROBOT, "Home"))
    fresh_kb.predicates.save(PddlPredicateDto("home", [robots.ROBOT]))
    fresh_kb.functions.save(PddlFunctionDto("HOME"))
    fresh_kb.actions.save(PddlActionDto("home", durative=False))
    fresh_kb.objects.delete(PddlObjectDto(robots.ROBOT, "home"))
    assert [entry[0:1] + entry[2:] for entry in told(fresh_kb, "hOmE")] == [
        *(("type", 1, None), ("object", 2, 6), ("predicate", 3, None), ("function", 4, None)),
        ("action", 5, None),
    ]


def test_the_text_of_any_change_finds_what_it_is_of(depot_kb: KnowledgeBase) -> None:
    depot_kb.goals.save(robots.robot_at(is_goal=True))
    depot_kb.actions.save_all([robots.navigation(), PddlActionDto("wait", durative=False)])
    depot_kb.goals.save(f.Comparison(">", depot.fuel(), depot.number("2.50")))
    depot_kb.goals.save(f.Equal(depot.home(), depot.HUB))
    depot_kb.pddl.timed_initial_literals.save(f.TimedLiteral(depot.number("5"), depot.at()))
    depot_kb.pddl.initial_literals.save(f.Not(depot.IDLE))
    depot_kb.pddl.constraints.save(f.Modal("always", (), (depot.IDLE,)))
    depot_kb.pddl.domain_constraints.save(f.Modal("sometime", (), (depot.IDLE,)))
    depot_kb.pddl.metric.set(f.Metric("minimize", depot.fuel()))
    depot_kb.pddl.derived_predicates.save(
        f.Derived("reachable", (depot.PLACE,), f.Exists((depot.TRUCK,), depot.at(depot.T, depot.P)))
    )
    kinds = set()
    for entry in depot_kb.log():
        for _, kind, text in entry.changes:
            kinds.add(kind)
            if text in ("(idle)", "(total-cost)"):
                # Without parameters it is written like the fact, or the fluent, and means that.
                assert told(depot_kb, text) == []
                continue
            for spelled in (text, text.upper()):
                found = told(depot_kb, spelled)
                assert (kind, text, entry.revision.number, None) in found, spelled
    assert len(kinds) == 15


FORMULAS: list[tuple[Any, list[str]]] = [
    (f.Comparison(">", depot.fuel(), depot.number("2.5")), ["goal"]),
    ("(> (Fuel t1) 2.500)", ["goal"]),
    (f.Not(depot.IDLE), ["initial", "goal"]),
    ("(not (idle))", ["initial", "goal"]),
    (
        f.And((f.Not(depot.IDLE), f.Comparison(">", depot.fuel(), depot.number("2.50")))),
        ["goal", "initial", "goal"],
    ),
    ("(and (and) (not (idle)))", ["initial", "goal"]),
    (f.Comparison(">", depot.fuel(), depot.number("3")), []),
    ("(and)", []),
    ("(not (nowhere))", []),
    (depot.at(depot.T1, depot.home()), []),
]


def test_a_formula_is_found_in_whatever_section(depot_kb: KnowledgeBase) -> None:
    depot_kb.goals.save(f.Comparison(">", depot.fuel(), depot.number("2.50")))
    depot_kb.pddl.initial_literals.save(f.Not(depot.IDLE))
    depot_kb.goals.save(f.Not(depot.IDLE))
    depot_kb.goals.delete_all()
    for formula, kinds in FORMULAS:
        found = told(depot_kb, formula)
        assert [entry[0] for entry in found] == kinds
        assert all(entry[3] == 5 for entry in found if entry[0] == "goal")


def test_an_equation_may_be_a_value_and_a_goal(depot_kb: KnowledgeBase) -> None:
    depot_kb.goals.save(f.Comparison("=", depot.fuel(), depot.number("7")))
    assert told(depot_kb, "(= (fuel t1) 7)") == [
        ("value", "(= (fuel t1) 7.50)", 1, None),
        ("goal", "(= (fuel t1) 7)", 2, None),
    ]


UNKNOWN = [
    *("nobody", "(robot_at rb1 nowhere)", "(nothing)", "(nothing ?x - place)", "nobody - robot")
]
NEVER: list[Any] = [
    *("(robot_at \ud800 wp1)", "(robot_at wp1 rb1)", "(robot_at rb1)", "(robot_at)"),
    *("(battery wp1)", "(= (battery wp1) 3)", "(> (battery rb9) 3)"),
    *(
        PddlTypeDto("nothing"),
        f.Constant("nobody"),
        robots.robot_at(robots.RB1, robots.waypoint(77)),
    ),
    *(PddlObjectDto(robots.ROBOT, name) for name in ("robot", "\ud800", "")),
    PddlFunctionValueDto(PddlFunctionDto("robot_at"), [robots.RB1, robots.WP1]),
    PddlPropositionDto(PddlPredicateDto("battery"), [robots.RB1]),
]


def test_what_never_was_has_no_version(kb_with_past: KnowledgeBase) -> None:
    for element in NEVER:
        assert kb_with_past.history(element) == []
        assert kb_with_past.blame(element) is None
        assert list(kb_with_past.log(element=element)) == []


def test_a_text_with_a_name_that_never_was_is_refused(kb_with_past: KnowledgeBase) -> None:
    for text in UNKNOWN:
        for call in (
            kb_with_past.history,
            kb_with_past.blame,
            lambda element: list(kb_with_past.log(element=element)),
            kb_with_past.at(1).blame,
        ):
            with pytest.raises(UnknownNameError, match="has never had a"):
                call(text)


REFUSED: list[Any] = [
    *(None, 3, b"rb1", ["rb1"], ("robot_at", "rb1"), PddlTypeDto, f.Variable("x")),
    *("", "  ", "two words", "?x", "a\0b", "(", ")", "()", "(())", "((robot_at) rb1)"),
    *("(robot_at rb1 wp1", "(robot_at rb1 wp1))", "(robot_at rb1 wp1) (robot_at rb1 wp2)"),
    PddlConditionEffectDto(robots.ROBOT_AT, [robots.RB1, robots.WP1]),
]


def test_what_is_no_element_is_refused(kb_with_past: KnowledgeBase) -> None:
    for element in REFUSED:
        for call in (kb_with_past.history, kb_with_past.blame):
            with pytest.raises(InvalidKnowledgeError, match=r"give a DTO of a type, .* or a name"):
                call(element)


WRONG: list[Any] = [
    robots.assigned(PddlTypeDto("three"), name=3),
    robots.assigned(robots.robot_at(), predicate="robot_at"),
    robots.assigned(robots.robot_at(), objects=["rb1"]),
    robots.assigned(PddlFunctionValueDto(robots.BATTERY, [robots.RB1]), function="battery"),
    robots.assigned(PddlFunctionValueDto(robots.BATTERY), objects=["rb1"]),
]


def test_a_dto_of_the_wrong_things_is_refused(kb_with_past: KnowledgeBase) -> None:
    for dto in WRONG:
        with pytest.raises(InvalidKnowledgeError):
            kb_with_past.history(dto)


def test_names_that_are_gone_are_still_known_to_a_newcomer(kb_with_past: KnowledgeBase) -> None:
    kb_with_past.types.delete_all()
    newcomer = depot.again(kb_with_past)
    assert told(newcomer, robots.robot_at())[0] == ("fact", "(robot_at rb1 wp1)", 1, 3)
    assert told(newcomer, "rb1 - robot") == [("object", "rb1 - robot", 1, 10)]


def test_it_names_the_revision_that_asserted_it(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robots.robot_at())
    fresh_kb.propositions.delete(robots.robot_at())
    with fresh_kb.transaction(actor="camera", reason="seen", source={"frame": 7}):
        fresh_kb.propositions.save(robots.robot_at())
    fresh_kb.propositions.save(robots.robot_at())
    fresh_kb.propositions.save(robots.robot_at(robots.RB1, robots.WP2))
    blamed = present(fresh_kb.blame(robots.robot_at()))
    assert blamed.since == fresh_kb.store.revisions()[2]
    assert (blamed.since.actor, blamed.since.reason) == ("camera", "seen")
    assert (blamed.kind, blamed.text, blamed.until) == ("fact", "(robot_at rb1 wp1)", None)
    assert fresh_kb.blame("(ROBOT_AT RB1 WP1)") == blamed


def test_what_does_not_hold_is_nobody_s(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robots.robot_at())
    fresh_kb.propositions.delete(robots.robot_at())
    assert fresh_kb.blame(robots.robot_at()) is None
    assert fresh_kb.blame(robots.robot_at(robots.RB1, robots.WP2)) is None
    assert fresh_kb.at(1).blame(robots.robot_at()) is not None


def test_what_holds_comes_before_what_is_wanted(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.goals.save(robots.robot_at(is_goal=True))
    text = "(robot_at rb1 wp1)"
    for kind in ("goal", "fact"):
        assert present(fresh_kb.blame(text)).kind == kind
        fresh_kb.propositions.save(robots.robot_at())
    of_goal = present(fresh_kb.blame(robots.robot_at(is_goal=True)))
    assert (of_goal.kind, of_goal.since.number) == ("goal", 1)


def test_each_element_has_its_own(depot_kb: KnowledgeBase) -> None:
    depot_kb.function_values.set("fuel", objects=["t1"], value=3)
    goal = Comparison(">", depot.fuel(), depot.number("1"))
    depot_kb.goals.save(goal)
    depot_kb.types.save(PddlTypeDto("drone"))
    for element, text, since in (
        ("(fuel t1)", "(= (fuel t1) 3)", 2),
        (goal, "(> (fuel t1) 1)", 3),
        ("drone", "drone", 4),
        ("t1", "t1 - truck", 1),
    ):
        blamed = present(depot_kb.blame(element))
        assert (blamed.text, blamed.since.number) == (text, since)


def test_what_stands_for_several_things_is_refused(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(PddlTypeDto("home"))
    fresh_kb.functions.save(PddlFunctionDto("home", [robots.ROBOT]))
    with pytest.raises(
        InvalidKnowledgeError,
        match=r"^'home' matches several elements: type home, function \(home \?r0 - robot\); "
        r"give a DTO of one of them$",
    ):
        fresh_kb.blame("home")
    fresh_kb.types.delete(PddlTypeDto("home"))
    assert present(fresh_kb.blame("home")).kind == "function"


def test_a_text_may_have_many_arguments(fresh_kb: KnowledgeBase) -> None:
    stops = [robots.waypoint(each) for each in range(100)]
    for length in (8, 100):
        tour = PddlPredicateDto(f"tour{length}", [robots.WAYPOINT] * length)
        fresh_kb.propositions.save(PddlPropositionDto(tour, stops[:length]))
        blamed = fresh_kb.blame(f"(TOUR{length} {' '.join(each.name for each in stops[:length])})")
        assert present(blamed).kind == "fact"

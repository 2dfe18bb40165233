"""Each effect and duration; actions, processes and events, on every backend."""

from __future__ import annotations

from decimal import Decimal

import pytest

from kant_sql import KnowledgeBase, PddlActionDto, PddlEventDto, PddlObjectDto, PddlProcessDto
from kant_sql import PddlTypeDto as Type
from kant_sql.dto.formulas import And, Assign, Comparison, ContinuousTime, Formula, Not, Timed
from kant_sql.errors import ConflictError, InvalidKnowledgeError
from kant_sql.pddl.document import Action, Domain
from tests.support.reading import last_changes, nothing_changes, rows
from tests.support.worlds.depot import (
    DURATION,
    DURATIONS,
    EFFECTS,
    IDLE,
    P2,
    PLACE,
    T2,
    TIMED_EFFECTS,
    TRUCK,
    P,
    T,
    again,
    at,
    calculated,
    check_text,
    distance,
    fuel,
    home,
    load,
    number,
)

PARAMETERS = [PddlObjectDto(Type("truck"), "t"), PddlObjectDto(Type("place"), "p")]
END = Timed("at end", IDLE)
# Whether an action is durative, its duration, its effect.
Parts = tuple[bool, tuple[Formula, ...], tuple[Formula, ...]]
CHARGE = PddlProcessDto(
    "charge",
    PARAMETERS,
    [at(T, P)],
    [Assign("increase", fuel(T), calculated("*", ContinuousTime(), number("0.5")))],
)
FULL = PddlEventDto(
    "full",
    PARAMETERS,
    [Comparison(">=", fuel(T), number("100"))],
    [Not(at(T, P)), Assign("assign", fuel(T), number("0"))],
)


def only_action(domain: Domain) -> Action:
    (action,) = domain.actions
    return action


def check(kb: KnowledgeBase, parts: list[Parts]) -> None:
    """Save actions of such parts in every way of asking, and delete them."""
    world = load(kb)
    dtos = [
        PddlActionDto(f"a{number}", PARAMETERS, [], effect, durative, duration=duration)
        for number, (durative, duration, effect) in enumerate(parts)
    ]
    wanted = tuple(
        Action(
            "durative-action" if durative else "action",
            f"a{number}",
            (TRUCK, PLACE),
            tuple(duration),
            (),
            tuple(effect),
        )
        for number, (durative, duration, effect) in enumerate(parts)
    )
    assert kb.actions.save_all(dtos) == len(dtos)
    made = [line for line in last_changes(kb) if line.startswith("+ action")]
    assert made == sorted(f"+ action {dto}" for dto in dtos)
    for reader in (kb, again(kb), kb.at(world + 1)):
        assert reader.pddl.domain().actions == wanted
        check_text(reader)
        found = reader.actions.get_all()
        assert [str(dto) for dto in found] == [str(dto) for dto in dtos]
    # What is read can be saved: it says the same.
    assert kb.actions.save_all(found) == 0
    for dto in dtos:
        assert kb.actions.delete(dto) is True
    assert kb.pddl.domain().actions == ()
    assert kb.at(world + 1).pddl.domain().actions == wanted
    live = "SELECT count(*) FROM action_version WHERE kb_id = :kb AND until IS NULL"
    assert rows(kb, live) == [(0,)]


def test_each_effect_is_kept(fresh_kb: KnowledgeBase) -> None:
    check(fresh_kb, [(False, (), (effect, IDLE)) for effect in EFFECTS.values()])


def test_each_effect_with_a_time_is_kept(fresh_kb: KnowledgeBase) -> None:
    fixed = (Comparison("=", DURATION, number("10")),)
    check(fresh_kb, [(True, fixed, (effect, END)) for effect in TIMED_EFFECTS.values()])


def test_each_duration_is_kept(fresh_kb: KnowledgeBase) -> None:
    check(fresh_kb, [(True, duration, (END,)) for duration in DURATIONS.values()])


def test_a_fixed_duration_is_read_as_the_number_that_it_is(depot_kb: KnowledgeBase) -> None:
    for given in (5, 2.5, Decimal("0.10"), Decimal("1E+2")):
        depot_kb.actions.save(PddlActionDto("act", PARAMETERS, [], [END], duration=given))
        found = depot_kb.actions.get("act")
        assert found is not None
        assert found.duration == given
        (constraint,) = only_action(depot_kb.pddl.domain()).duration
        assert constraint == Comparison("=", DURATION, number(str(given)))


def test_processes_and_events_have_daos_of_their_own(depot_kb: KnowledgeBase) -> None:
    with depot_kb.transaction():
        depot_kb.pddl.processes.save(CHARGE)
        depot_kb.pddl.events.save(FULL)
    assert last_changes(depot_kb) == [f"+ action {FULL}", f"+ action {CHARGE}"]
    made = depot_kb.revision
    assert depot_kb.actions.get_all() == []
    assert depot_kb.actions.get("charge") is None
    for reader in (depot_kb, again(depot_kb), depot_kb.at(made)):
        assert [str(dto) for dto in reader.pddl.processes.get_all()] == [str(CHARGE)]
        assert [str(dto) for dto in reader.pddl.events.get_all()] == [str(FULL)]
        kinds = [(action.kind, action.name) for action in reader.pddl.domain().actions]
        assert kinds == [("process", "charge"), ("event", "full")]
        check_text(reader)
    assert ":time" in depot_kb.pddl.requirements()
    assert rows(depot_kb, "SELECT kind FROM action_version WHERE kb_id = :kb ORDER BY kind") == [
        ("event",),
        ("process",),
    ]
    with nothing_changes(depot_kb):
        with pytest.raises(ConflictError, match="is a stored process"):
            depot_kb.actions.save(PddlActionDto("Charge", durative=False))
        with pytest.raises(InvalidKnowledgeError, match="has a DAO of its own"):
            depot_kb.actions.save(FULL)
        assert depot_kb.pddl.events.delete(PddlEventDto("charge")) is False
    assert depot_kb.pddl.processes.delete(CHARGE) is True
    assert depot_kb.pddl.events.delete_all() == 1
    assert depot_kb.pddl.domain().actions == ()
    assert len(depot_kb.at(made).pddl.domain().actions) == 2


def test_conjunctions_within_a_list_are_its_items(depot_kb: KnowledgeBase) -> None:
    nested = And((at(T, P), And((IDLE, And(())))))
    dto = PddlActionDto("act", PARAMETERS, [nested], [nested], durative=False)
    depot_kb.actions.save(dto)
    action = only_action(depot_kb.pddl.domain())
    assert action.condition == action.effect == (at(T, P), IDLE)
    check_text(depot_kb)


def test_which_actions_can_make_an_atom_false_is_one_join(depot_kb: KnowledgeBase) -> None:
    depot_kb.actions.save_all(
        PddlActionDto(name, PARAMETERS, [at(T, P)], [effect], durative=False)
        for name, effect in EFFECTS.items()
        if " " not in name
    )
    depot_kb.pddl.events.save(FULL)
    sql = (
        "SELECT DISTINCT action.name FROM action_version AS version "
        "JOIN action ON (action.kb_id, action.id) = (version.kb_id, version.action_id) "
        "JOIN action_node AS atom ON (atom.kb_id, atom.action_id, atom.since) "
        "= (version.kb_id, version.action_id, version.since) "
        "JOIN predicate ON (predicate.kb_id, predicate.id) = (atom.kb_id, atom.predicate_id) "
        "JOIN action_node AS above ON (above.kb_id, above.action_id, above.since, above.section, "
        "above.position) = (atom.kb_id, atom.action_id, atom.since, atom.section, atom.parent) "
        "WHERE version.kb_id = :kb AND version.until IS NULL AND atom.section = 'effect' "
        "AND predicate.key = 'at' AND above.operator = 'not' ORDER BY action.name"
    )
    assert [name for (name,) in rows(depot_kb, sql)] == ["delete", "forall", "full"]


def test_an_object_that_an_action_mentions_is_a_constant_of_the_domain(
    depot_kb: KnowledgeBase,
) -> None:
    depot_kb.actions.save(PddlActionDto("act", [], [at(T2, P2)], [], durative=False))
    assert [part.name for part in depot_kb.pddl.domain().constants] == ["hub", "t2", "p2"]
    assert [part.name for part in depot_kb.pddl.problem().objects] == ["t1", "c1", "p1"]
    check_text(depot_kb)
    text, problem = depot_kb.domain_pddl(), depot_kb.problem_pddl()
    # A problem does not retract what the domain needs.
    depot_kb.load_problem(problem)
    assert (depot_kb.domain_pddl(), depot_kb.problem_pddl()) == (text, problem)
    depot_kb.load_domain(text, mode="merge")
    found = depot_kb.objects.get("t2")
    assert found is not None
    assert found.is_constant
    assert (depot_kb.domain_pddl(), depot_kb.problem_pddl()) == (text, problem)


def test_a_redefined_action_keeps_its_history(depot_kb: KnowledgeBase) -> None:
    one = PddlActionDto("act", PARAMETERS, [], [at(T, P)], durative=False)
    other = PddlActionDto(
        "Act", PARAMETERS, [], [END], duration=(Comparison("<=", DURATION, distance(P, home(T))),)
    )
    depot_kb.actions.save(one)
    before = depot_kb.domain_pddl()
    depot_kb.actions.save(other)
    assert only_action(depot_kb.pddl.domain()).kind == "durative-action"
    assert only_action(depot_kb.pddl.domain()).name == "act"
    check_text(depot_kb)
    assert depot_kb.at(depot_kb.revision - 1).domain_pddl() == before
    depot_kb.actions.save(one)
    assert depot_kb.domain_pddl() == before

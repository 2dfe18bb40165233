"""Facts, values, goals and constraints are given as PDDL text or as nodes, and found by names."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from operator import attrgetter
from typing import Any

import pytest

from kant_sql import (
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlActionDto,
    PddlError,
    PddlEventDto,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlPropositionDto,
    PddlTypeDto,
    UnknownNameError,
)
from kant_sql.dto.formulas import Atom, Comparison, Constant, Fluent, Not, Number, Or, Variable
from tests.support.parts import dao_of
from tests.support.reading import last_changes, loaded, nothing_changes, refuses
from tests.support.worlds.robots import ROBOT, navigation, robot_at

pytestmark = pytest.mark.every_backend

DOMAIN = """(define (domain d) (:requirements :typing :numeric-fluents :object-fluents :constraints)
 (:types dock - wp robot wp - object)
 (:predicates (idle) (robot_at ?r - robot ?w - wp) (between ?w ?a ?b - wp))
 (:functions (battery ?r - robot) - number (home ?r - robot) - wp (cost) - number))"""
PROBLEM = """(define (problem p) (:domain d)
 (:objects rb1 rb2 - robot wp1 wp2 - wp dock1 - dock) (:init (robot_at rb1 wp1)) (:goal (and)))"""


def at(robot: str, place: str) -> Atom:
    return Atom("robot_at", (Constant(robot), Constant(place)))


@pytest.fixture
def world(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with names, and `(robot_at rb1 wp1)`."""
    return loaded(fresh_kb, DOMAIN, PROBLEM)


def facts(kb: KnowledgeBase) -> list[str]:
    return [str(dto) for dto in kb.propositions.get_all()]


@pytest.mark.parametrize(
    "given", ["(robot_at rb1 dock1)", "( ROBOT_AT\n rb1 Dock1 )", at("RB1", "dock1")]
)
def test_a_fact_is_saved_and_deleted_as_text_or_as_an_atom(
    world: KnowledgeBase, given: str | Atom
) -> None:
    dao = world.propositions
    assert dao.update(given) is False
    assert dao.insert(given) is True
    assert last_changes(world) == ["+ fact (robot_at rb1 dock1)"]
    with nothing_changes(world):
        assert (dao.insert(given), dao.update(given), dao.save(given)) == (False, True, True)
    assert dao.delete(given) is True
    assert last_changes(world) == ["- fact (robot_at rb1 dock1)"]
    with nothing_changes(world):
        assert dao.delete(given) is False


def test_texts_atoms_and_dtos_are_saved_together(world: KnowledgeBase) -> None:
    [dto] = world.propositions.get_all()
    new = PddlObjectDto(dto.objects[1].type, "wp9")
    given: list[Any] = [
        "(idle)",
        dto,
        at("rb2", "wp2"),
        PddlPropositionDto(dto.predicate, [dto.objects[0], new]),
    ]
    # What a DTO brings in is known to the texts after it.
    assert world.propositions.save_all([*given, "(between wp9 wp1 dock1)"]) == 4
    assert facts(world) == [
        *("(robot_at rb1 wp1)", "(idle)", "(robot_at rb2 wp2)", "(robot_at rb1 wp9)"),
        "(between wp9 wp1 dock1)",
    ]
    with nothing_changes(world), pytest.raises(PddlError, match="'wp8'"):
        world.propositions.save_all(["(robot_at rb2 wp1)", "(robot_at rb1 wp8)"])


def test_within_a_transaction_text_names_what_is_pending(world: KnowledgeBase) -> None:
    with world.transaction():
        [dto] = world.propositions.get_all()
        world.objects.save(PddlObjectDto(dto.objects[1].type, "wp9"))
        world.propositions.save("(robot_at rb2 wp9)")
        assert world.propositions.delete("(robot_at rb2 wp9)") is True
        world.propositions.save("(robot_at rb2 wp9)")
    assert facts(world) == ["(robot_at rb1 wp1)", "(robot_at rb2 wp9)"]


NO_FACTS: dict[str, tuple[Any, type[Exception], str]] = {
    "unknown predicate": ("(robotat rb1 wp1)", PddlError, ":1:2: .*did you mean robot_at"),
    "unknown object": ("(robot_at rb1\n wp11)", PddlError, ":2:2: .*did you mean wp1"),
    "unknown object of an atom": (at("rb11", "wp1"), PddlError, "'rb11'.*did you mean rb1"),
    "arity": ("(robot_at rb1)", PddlError, "found 1, expected 2 arguments of robot_at"),
    "type": ("(robot_at wp1 wp1)", InvalidKnowledgeError, "wp1.*robot"),
    "variable": ("(robot_at rb1 ?w)", PddlError, r":1:15: .*'\?w'"),
    "variable of an atom": (Atom("robot_at", (Constant("rb1"), Variable("w"))), PddlError, "w"),
    "negation": ("(not (idle))", PddlError, "a fact such as"),
    "conjunction": ("(and (idle))", PddlError, "a fact such as"),
    "value": ("(= (idle) 3)", PddlError, "a fact such as"),
    "disjunction": ("(or (idle))", PddlError, "a fact such as"),
    "no parentheses": ("idle", PddlError, "a fact such as"),
    "nothing": ("", PddlError, "a fact such as"),
    "two": ("(idle) (idle)", PddlError, ":1:8: "),
    "open": ("(idle", PddlError, "in the fact"),
    "no text": (
        5,
        InvalidKnowledgeError,
        r"a fact, for example '\(robot_at rb1 wp1\)', not int: 5",
    ),
    "bytes": (b"(idle)", InvalidKnowledgeError, "not bytes"),
}


@pytest.mark.parametrize(("given", "error", "message"), NO_FACTS.values(), ids=NO_FACTS)
def test_what_is_no_fact_is_refused(
    world: KnowledgeBase, given: Any, error: type[Exception], message: str
) -> None:
    dao = world.propositions
    for call in (dao.save, dao.insert, dao.update, dao.delete, lambda it: dao.save_all([it])):
        with nothing_changes(world), pytest.raises(error, match=rf"(?s){message}"):
            call(given)


def test_what_names_something_deleted_is_gone_and_cannot_be_saved(world: KnowledgeBase) -> None:
    world.propositions.save("(robot_at rb1 dock1)")
    world.function_values.save("(= (home rb2) dock1)")
    world.goals.save("(or (idle) (robot_at rb1 dock1))")
    world.objects.delete(world.objects.get("dock1"))  # type: ignore[arg-type]
    with nothing_changes(world):
        assert world.propositions.delete("(robot_at rb1 dock1)") is False
        assert world.propositions.update("(robot_at rb1 dock1)") is False
        assert world.function_values.delete("(= (home rb2) dock1)") is False
        assert world.goals.delete("(or (idle) (robot_at rb1 dock1))") is False
        for call in (world.propositions.save, world.propositions.insert, world.goals.save):
            with pytest.raises(PddlError, match="'dock1'"):
                call("(robot_at rb1 dock1)")
        with pytest.raises(PddlError, match="'dock2'"):
            world.propositions.delete("(robot_at rb1 dock2)")


def test_values_are_set_and_unset_as_text_and_nodes(world: KnowledgeBase) -> None:
    values = world.function_values
    battery = Fluent("battery", (Constant("rb1"),))
    assert values.insert("(= (battery rb1) 80)") is True
    assert values.insert("(= (battery rb1) 90)") is False
    assert values.update(Comparison("=", battery, Number(Decimal("90.5")))) is True
    assert values.update("(= (battery rb2) 1)") is False
    assert values.save_all(["(= (home rb1) wp1)", "(= (cost) 7)", *values.get_all()]) == 2
    assert values.get("battery", objects=["rb1"]) == Decimal("90.5")
    assert values.get("home", objects=["rb1"]) == world.objects.get("wp1")
    assert values.delete("(battery rb1)") is True
    assert values.delete(battery) is False
    assert values.delete("(= (home rb1) wp2)") is True
    assert [str(dto) for dto in values.get_all()] == ["(= (cost) 7)"]


NO_VALUES: dict[str, tuple[Any, type[Exception], str]] = {
    "unknown function": ("(= (batery rb1) 3)", PddlError, "did you mean battery"),
    "unknown object": ("(= (battery rb11) 3)", PddlError, "did you mean rb1"),
    "object for a number": ("(= (battery rb1) wp1)", InvalidKnowledgeError, "a number"),
    "number for an object": ("(= (home rb1) 3)", InvalidKnowledgeError, "3"),
    "wrong type": ("(= (home rb1) rb1)", InvalidKnowledgeError, "rb1"),
    "no value": ("(battery rb1)", InvalidKnowledgeError, "has no value; give one"),
    "another comparison": ("(> (battery rb1) 3)", PddlError, "expected a function"),
    "a fact": ("(idle)", PddlError, "expected a function"),
    "a fluent of a fluent": ("(= (battery rb1) (battery rb2))", PddlError, "a value such as"),
    "no text": (5, InvalidKnowledgeError, r"a value, for example '\(= \(battery rb1\) 80\)'"),
}


@pytest.mark.parametrize(("given", "error", "message"), NO_VALUES.values(), ids=NO_VALUES)
def test_what_is_no_value_is_refused(
    world: KnowledgeBase, given: Any, error: type[Exception], message: str
) -> None:
    dao = world.function_values
    for call in (dao.save, dao.insert, lambda it: dao.save_all([it])):
        with nothing_changes(world), pytest.raises(error, match=message):
            call(given)


def test_goals_are_given_as_text_nodes_and_dtos(world: KnowledgeBase) -> None:
    goals = world.goals
    [dto] = world.propositions.get_all()
    assert goals.save("(and (idle) (or (idle) (robot_at rb1 wp2)))") is True
    assert goals.insert(dto) is True
    assert goals.insert("(robot_at rb1 wp1)") is False
    either = Or((at("rb1", "wp2"), Not(Atom("idle", ()))))
    assert goals.save_all([either, "(preference p (idle))", dto]) == 2
    assert [str(goal) for goal in goals.get_all()] == [
        *("(idle)", "(robot_at rb1 wp1)", "(or (idle) (robot_at rb1 wp2))", str(either)),
        "(preference p (idle))",
    ]
    assert facts(world) == ["(robot_at rb1 wp1)"]
    assert goals.delete(dto) is goals.delete("(OR (idle) (robot_at rb1 wp2))") is True
    assert goals.delete(dto) is goals.delete("(or (idle) (robot_at rb1 wp2))") is False
    assert goals.delete("(and (idle) (preference p (idle)))") is True
    assert goals.get_all() == [either]


def test_constraints_are_given_as_text(world: KnowledgeBase) -> None:
    text = "(and (always (not (idle))) (sometime (robot_at rb1 wp2)))"
    assert world.pddl.constraints.save(text) is True
    assert [str(each) for each in world.pddl.constraints.get_all()] == [
        "(always (not (idle)))",
        "(sometime (robot_at rb1 wp2))",
    ]
    assert world.pddl.constraints.delete("(always (not (idle)))") is True
    with pytest.raises(PddlError, match=r"did you mean idle"):
        world.pddl.constraints.save("(always (idel))")


@pytest.mark.parametrize(
    ("dao", "given", "message"),
    [
        ("goals", "(robot_at rb1 ?w)", r"'\?w'"),
        ("goals", "(robot_at rb1 wp11)", "did you mean wp1"),
        ("goals", "(robot_at wp1 rb1)", "wp1 of type wp, expected robot"),
        ("goals", 5, r"takes a goal, for example '\(robot_at rb1 wp1\)', not int"),
        ("pddl.constraints", "(idle)", "in the constraints"),
        ("pddl.constraints", None, "takes a constraint, for example"),
        ("pddl.derived_predicates", "(idle)", "expected :derived"),
        ("pddl.derived_predicates", "(:derived (idle) (idle)) (idle)", "the end of the text"),
        ("pddl.derived_predicates", "(:derived (far ?x) (idle))", "far"),
        ("pddl.initial_literals", "(idle)", "kb.propositions takes facts"),
        ("pddl.initial_literals", "(not (idle)) (idle)", "the end of the text"),
        ("pddl.timed_initial_literals", "(idle)", "a timed literal such as"),
        ("pddl.timed_initial_literals", "(at 5 (robot_at rb1 wp11))", "did you mean wp1"),
        ("pddl.timed_initial_literals", 5, "takes a timed, for example"),
    ],
)
def test_what_is_no_formula_of_the_section_is_refused(
    world: KnowledgeBase, dao: str, given: Any, message: str
) -> None:
    for method in ("save", "insert", "delete"):
        with nothing_changes(world), pytest.raises(InvalidKnowledgeError, match=message):
            getattr(attrgetter(dao)(world), method)(given)


def test_objects_are_found_by_type_with_those_of_its_subtypes(world: KnowledgeBase) -> None:
    def names(type_: str, kb: KnowledgeBase = world) -> list[str]:
        return [dto.name for dto in kb.objects.get_by_type(type_)]

    assert names("WP") == ["wp1", "wp2", "dock1"]
    assert names("dock") == ["dock1"]
    assert names("object") == ["rb1", "rb2", "wp1", "wp2", "dock1"]
    with world.transaction():
        world.objects.delete(world.objects.get("wp1"))  # type: ignore[arg-type]
        assert names("wp") == ["wp2", "dock1"]
        world.types.delete(world.types.get("dock"))  # type: ignore[arg-type]
        assert names("dock") == []
    assert (names("wp"), names("dock")) == (["wp2"], [])
    assert names("wp", world.at(2)) == ["wp1", "wp2", "dock1"]
    assert (names("wp", world.at(1)), names("wp", world.at(0))) == ([], [])


def test_facts_are_found_by_an_object(world: KnowledgeBase) -> None:
    def of(name: str, kb: KnowledgeBase = world) -> list[str]:
        return [str(dto) for dto in kb.propositions.get_by_object(name)]

    world.propositions.save_all(["(between wp1 wp2 wp1)", "(robot_at rb2 wp2)", "(idle)"])
    world.goals.save("(robot_at rb1 wp1)")
    every = ["(robot_at rb1 wp1)", "(between wp1 wp2 wp1)"]
    assert of("WP1") == every
    assert of("dock1") == []
    for _ in range(3):
        world.propositions.delete("(robot_at rb1 wp1)")
        world.propositions.save("(robot_at rb1 wp1)")
    before = world.revision
    with world.transaction():
        world.propositions.delete("(between wp1 wp2 wp1)")
        assert of("wp1") == ["(robot_at rb1 wp1)"]
        world.objects.delete(world.objects.get("rb1"))  # type: ignore[arg-type]
        assert (of("wp1"), of("rb1")) == ([], [])
    assert of("rb1") == []
    assert of("wp1", world.at(before)) == every
    assert of("wp1", world.at(before - 1)) == every[1:]
    assert of("wp1", world.at(2)) == every[:1]
    assert of("wp1", world.at(1)) == []


# Calls by their path, what kind of name they take, one that there is, and what they take besides.
NAMED: dict[str, tuple[str, str, dict[str, Any]]] = {
    "propositions.get_by_predicate": ("predicate", "robot_at", {}),
    "propositions.get_by_object": ("object", "rb1", {}),
    "objects.get_by_type": ("type", "robot", {}),
    "function_values.get_by_function": ("function", "battery", {}),
    "function_values.get": ("function", "battery", {"objects": ["rb1"]}),
    "function_values.unset": ("function", "battery", {"objects": ["rb1"]}),
    "history": ("element", "robot_at", {}),
    "blame": ("element", "robot_at", {}),
    "log": ("element", "robot_at", {}),
    "of an object": ("object", "rb1", {}),
}


def call(kb: KnowledgeBase, path: str, name: str, given: dict[str, Any]) -> None:
    if path == "of an object":
        kb.function_values.get("battery", objects=[name])
    elif path == "log":
        list(kb.log(element=name))
    else:
        attrgetter(path)(kb)(name, **given)


@pytest.mark.parametrize("path", NAMED)
def test_a_name_that_never_was_is_refused_and_one_that_was_is_not(
    world: KnowledgeBase, path: str
) -> None:
    kind, name, given = NAMED[path]
    said = rf"has never had an? {kind} '{name}s' \(did you mean {name}\?\)"
    views = [world, *([] if path.endswith("unset") else [world.at(1)])]
    for kb in views:
        with pytest.raises(UnknownNameError, match=said):
            call(kb, path, f"{name}s", given)
    with world.transaction():
        with pytest.raises(UnknownNameError, match=said):
            call(world, path, f"{name}s", given)
        call(world, path, name, given)
    world.types.delete_all()
    world.functions.delete_all()
    for kb in views:
        call(kb, path, name.upper(), given)


def test_what_a_dto_describes_may_be_saved_later(world: KnowledgeBase) -> None:
    [dto] = world.propositions.get_all()
    new = PddlObjectDto(dto.objects[0].type, "rb9")
    assert world.history(new) == []
    assert world.function_values.get("battery", objects=[new]) is None
    assert world.function_values.unset("battery", objects=[new]) is False
    assert (
        world.propositions.delete(PddlPropositionDto(dto.predicate, [new, dto.objects[1]])) is False
    )


# Declarations: their text does what their DTO does.

R = PddlObjectDto(ROBOT, "r")
PLACE, FLOOR = PddlTypeDto("place"), PddlTypeDto("floor")
# The DAO: an element, and another definition of it.
DECLARED: dict[str, tuple[Any, Any]] = {
    "types": (PddlTypeDto("room", parent=PLACE), PddlTypeDto("ROOM", parent=FLOOR)),
    "objects": (PddlObjectDto(ROBOT, "rb9"), PddlObjectDto(FLOOR, "RB9")),
    "predicates": (PddlPredicateDto("near", [ROBOT, PLACE]), PddlPredicateDto("NEAR", [FLOOR])),
    "functions": (PddlFunctionDto("load", [PLACE]), PddlFunctionDto("LOAD", value_types=[ROBOT])),
    "actions": (navigation(), PddlActionDto("NAVIGATION", [R])),
    "processes": (PddlProcessDto("drain", [R]), PddlProcessDto("DRAIN")),
    "events": (PddlEventDto("crash", [R]), PddlEventDto("CRASH")),
}


@pytest.fixture
def declared(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    fresh_kb.propositions.save(robot_at())
    return fresh_kb


@pytest.mark.parametrize("form", [lambda dto: dto, str], ids=["dto", "text"])
@pytest.mark.parametrize("name", DECLARED)
def test_a_declaration_is_given_as_text_wherever_its_dto_is(
    declared: KnowledgeBase, name: str, form: Callable[[Any], Any]
) -> None:
    dao, (dto, changed) = dao_of(declared, name), DECLARED[name]
    given, other, called = form(dto), form(changed), changed.name
    assert dao.get(called) is None
    with nothing_changes(declared):
        assert dao.update(given) is False
        assert dao.delete(given) is False
    assert dao.insert(given) is True
    assert (dao.get(called), str(dao.get(called))) == (dto, str(dto))
    assert dao.get_all()[-1] == dto
    with nothing_changes(declared):
        assert dao.insert(given) is dao.insert(other) is False
        assert dao.save(given) is dao.save([given, dto]) is dao.update(given) is True
        assert dao.save_all([given, dto]) == 0
    assert dao.update(other) is True
    assert str(dao.get(called)).lower() == str(changed).lower()
    assert dao.save_all(iter([given])) == 1
    assert str(dao.get(called)) == str(dto)
    assert dao.delete(given) is True
    assert dao.delete(given) is dao.delete(called) is False
    assert dao.save(given) is dao.delete(called) is True
    assert dao.save(given) is True
    assert dao.delete_all([given, dto, called]) == 1
    assert dao.get(called) is None


@pytest.mark.parametrize("name", DECLARED)
def test_a_declaration_that_cannot_be_read_is_refused_with_its_position(
    declared: KnowledgeBase, name: str
) -> None:
    dao = dao_of(declared, name)
    for wrong in (f"{DECLARED[name][0]} (x", "", "(", ")"):
        for call in (dao.save, dao.insert, dao.update):
            caught = refuses(declared, PddlError, call, wrong)
            assert str(caught).startswith("<string>:")
        refuses(declared, PddlError, dao.save_all, [DECLARED[name][0], wrong])


def test_what_a_declaration_refers_to_is_saved_when_it_is_missing(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.objects.save("rb1 - robot")
    fresh_kb.predicates.save("(robot_at ?r - robot ?p - (either room place))")
    fresh_kb.functions.save(["(battery ?r - robot)", "(home ?r - robot) - place"])
    assert [str(dto) for dto in fresh_kb.types.get_all()] == ["robot", "room", "place"]
    assert [str(dto) for dto in fresh_kb.functions.get_all()] == [
        "(battery ?r - robot)",
        "(home ?r - robot) - place",
    ]
    fresh_kb.types.save("robot - machine", cascade=True)
    assert str(fresh_kb.types.get("robot")) == "robot - machine"
    caught = refuses(fresh_kb, PddlError, fresh_kb.actions.save, "(:action a :effect (lit))")
    assert "the predicate 'lit'" in str(caught)


def test_the_text_of_an_action_is_of_its_own_dao(declared: KnowledgeBase) -> None:
    refuses(declared, InvalidKnowledgeError, declared.pddl.events.save, str(navigation()))
    refuses(declared, InvalidKnowledgeError, declared.actions.save, "(:event crash)")


@pytest.mark.parametrize(
    ("dao", "text", "other"),
    [
        ("derived_predicates", "(:derived (idle) (robot_at rb1 wp1))", "(:derived (idle) (idle))"),
        ("initial_literals", "(not (robot_at rb2 wp1))", "(= rb1 rb2)"),
        ("timed_initial_literals", "(at 5 (idle))", "(at 7.5 (= (battery rb1) 3))"),
    ],
)
def test_a_formula_of_a_rarer_section_is_given_as_text(
    world: KnowledgeBase, dao: str, text: str, other: str
) -> None:
    of = dao_of(world, dao)
    assert of.insert(text) is True
    assert of.insert(text) is False
    assert of.save([text, other]) is True
    assert len(of.get_all()) == 2
    with nothing_changes(world):
        assert of.save_all([*of.get_all(), text, *map(str, of.get_all())]) == 0
    assert of.delete(text) is True
    assert of.delete(text) is False
    assert of.delete_all([other, text]) == 1


def test_the_metric_is_given_as_text(world: KnowledgeBase) -> None:
    metric = world.pddl.metric
    assert metric.set("(:metric maximize (battery rb1))") is True
    assert str(metric.get()) == "(:metric maximize (battery rb1))"
    assert metric.set("( :METRIC MAXIMIZE (Battery RB1))") is False
    for wrong in (
        *("(battery rb1)", "(:metric maximize (batery rb1))", "(:metric maximize 1) x", "("),
    ):
        refuses(world, PddlError, metric.set, wrong)
    assert metric.set(None) is True


@pytest.mark.parametrize(
    "text", ["rb1 - robot", " rb1 ", "rb1\t- robot", "rb1\n-\nrobot", "rb1;\n"]
)
def test_a_text_in_delete_is_told_from_a_name_by_any_space(world: KnowledgeBase, text: str) -> None:
    assert world.objects.delete(text) is True
    assert world.objects.get("rb1") is None
    with nothing_changes(world), pytest.raises(PddlError):
        world.objects.delete("rb2 wp1")


def test_an_object_that_is_given_as_text_stays_a_constant(world: KnowledgeBase) -> None:
    hub = PddlObjectDto(PddlTypeDto("wp"), "hub", is_constant=True)
    world.objects.save(hub)
    with nothing_changes(world):
        world.objects.save(str(hub))
        world.objects.save_all(["HUB - wp"])
        world.objects.update("hub - wp")
    assert [each.name for each in world.objects.get_all() if each.is_constant] == ["hub"]


def test_an_action_is_deleted_by_a_text_that_names_what_is_gone(world: KnowledgeBase) -> None:
    leave = "(:action leave :parameters (?r - robot) :effect (not (idle)))"
    world.actions.save(leave)
    assert world.actions.delete(leave.replace("idle", "never")) is True
    world.actions.save(leave)
    world.types.delete("robot")
    with nothing_changes(world):
        assert world.actions.delete(leave) is False


def test_each_dao_of_actions_deletes_by_texts_of_its_own_kind(world: KnowledgeBase) -> None:
    world.pddl.events.save("(:event stop :effect (not (idle)))")
    with nothing_changes(world):
        with pytest.raises(InvalidKnowledgeError, match="'stop' is an event, which has a DAO"):
            world.actions.delete("(:event stop)")
        with pytest.raises(InvalidKnowledgeError, match="PddlEventDto, or its text, not"):
            world.pddl.events.delete("(:action stop)")
    assert world.pddl.events.delete("stop\n") is True

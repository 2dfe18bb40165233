"""Functions and their values; named parameters and `either`, on every backend."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from typing import Any

import pytest

from kant_sql import (
    ConflictError,
    DependantsError,
    InvalidKnowledgeError,
    KantSqlError,
    KnowledgeBase,
    PddlEitherTypeDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    ReadOnlyError,
    UnknownNameError,
)
from kant_sql.errors import ArityError, InvalidNameError, TypeMismatchError
from tests.contract.test_function_values_shared import FLUENTS, READ, check
from tests.support.reading import (
    last_changes,
    nothing_changes,
    present,
    refuses,
    rows,
    undone,
    versions,
)
from tests.support.worlds.depot import again
from tests.support.worlds.robots import (
    BATTERY,
    DISTANCE,
    LOCATION,
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    assigned,
    distance,
    navigation,
    robot_at,
)

Function = PddlFunctionDto
HUMAN = PddlTypeDto("human")
ANYBODY = PddlEitherTypeDto([ROBOT, HUMAN])


def declared(kb: KnowledgeBase) -> list[str]:
    return [str(dto) for dto in kb.functions.get_all()]


def test_a_function_is_saved_read_and_deleted(fresh_kb: KnowledgeBase) -> None:
    functions = fresh_kb.functions
    assert functions.get("distance") is None
    assert functions.save(DISTANCE) is True
    assert last_changes(fresh_kb) == ["+ function (distance ?w0 - wp ?w1 - wp)", "+ type wp"]
    functions.save(LOCATION)
    found = present(functions.get("LOC"))
    assert (found.name, found.types, found.value_types) == ("loc", [ROBOT], [WAYPOINT])
    assert found.parameter_names is None
    assert declared(fresh_kb) == ["(distance ?w0 - wp ?w1 - wp)", "(loc ?r0 - robot) - wp"]
    assert functions.delete(Function("Distance")) is True
    assert functions.delete(DISTANCE) is False
    assert functions.delete_all() == 1
    assert functions.get_all() == []
    assert [str(dto) for dto in fresh_kb.at(2).functions.get_all()] == [
        "(distance ?w0 - wp ?w1 - wp)",
        "(loc ?r0 - robot) - wp",
    ]
    assert versions(fresh_kb, "function") == [
        ("(distance ?w0 - wp ?w1 - wp)", 1, 3),
        ("(loc ?r0 - robot) - wp", 2, 4),
    ]


def test_a_function_keeps_all_that_was_said_of_it(fresh_kb: KnowledgeBase) -> None:
    said = [
        Function("total-cost"),
        Function("d", [WAYPOINT, WAYPOINT], parameter_names=["from", "to"]),
        Function("same", [WAYPOINT, WAYPOINT], parameter_names=["x", "x"]),
        Function("boss", [ANYBODY], value_types=[HUMAN, ROBOT], parameter_names=["of"]),
    ]
    assert fresh_kb.functions.save_all(said) == 4
    wanted = [
        "(total-cost)",
        "(d ?from - wp ?to - wp)",
        "(same ?x - wp ?x - wp)",
        "(boss ?of - (either robot human)) - (either human robot)",
    ]
    assert declared(fresh_kb) == wanted
    newcomer = again(fresh_kb)
    assert declared(newcomer) == wanted
    found = present(newcomer.functions.get("boss"))
    assert isinstance(found.types[0], PddlEitherTypeDto)
    assert found.types[0].types == [ROBOT, HUMAN]
    assert found.value_types == [HUMAN, ROBOT]
    with nothing_changes(fresh_kb):
        assert fresh_kb.functions.save_all(newcomer.functions.get_all()) == 0


def test_another_name_of_a_parameter_is_no_redefinition(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.actions.save(navigation())
    fresh_kb.function_values.set(DISTANCE, objects=[WP1, WP2], value=10)
    named: list[tuple[Any, str, str]] = [
        (fresh_kb.predicates, "robot_at", "(robot_at ?r - robot ?at - wp)"),
        (fresh_kb.functions, "distance", "(distance ?from - wp ?to - wp)"),
    ]
    for dao, name, text in named:
        dao.save(text)
        assert str(dao.get(name)) == text
        assert len(last_changes(fresh_kb)) == 2
    with nothing_changes(fresh_kb):
        # Nothing said of the names, or only referred to.
        fresh_kb.predicates.save(ROBOT_AT)
        fresh_kb.functions.save(DISTANCE)
        fresh_kb.propositions.save(robot_at())
        fresh_kb.function_values.set(DISTANCE, objects=[WP1, WP2], value=10)
    wider = Function("distance", [WAYPOINT, WAYPOINT, WAYPOINT])
    fresh_kb.functions.save(wider, cascade=True)
    assert declared(fresh_kb) == ["(distance ?w0 - wp ?w1 - wp ?w2 - wp)"]


def test_either_fits_objects_of_each_type(fresh_kb: KnowledgeBase) -> None:
    near = PddlPredicateDto("near", [ANYBODY, WAYPOINT])
    ann = PddlObjectDto(HUMAN, "ann")
    facts = [PddlPropositionDto(near, [who, WP1]) for who in (RB1, ann)]
    assert fresh_kb.propositions.save_all(facts) == 2
    assert str(fresh_kb.predicates.get("near")) == "(near ?r0 - (either robot human) ?w1 - wp)"
    assert fresh_kb.propositions.get_all() == facts
    other_way = PddlPredicateDto("near", [PddlEitherTypeDto([HUMAN, ROBOT]), WAYPOINT])
    with nothing_changes(fresh_kb):
        fresh_kb.propositions.save(PddlPropositionDto(other_way, [ann, WP1]))
    wrong = PddlPropositionDto(near, [WP2, WP1])
    caught = refuses(fresh_kb, TypeMismatchError, fresh_kb.propositions.save, wrong)
    assert "argument 1, 'wp2', is of type 'wp', expected '(either robot human)'" in str(caught)
    narrow = PddlPropositionDto(PddlPredicateDto("near", [ROBOT, WAYPOINT]), [RB1, WP1])
    refuses(fresh_kb, ConflictError, fresh_kb.propositions.save, narrow)
    fresh_kb.types.delete(HUMAN)
    assert fresh_kb.predicates.get("near") is None


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (Function("+"), "'+' cannot name a function: the word is reserved"),
        (Function("a b"), "'a b' cannot name a function"),
        (Function("f", [WAYPOINT], parameter_names=["?x"]), "'?x' cannot name a parameter"),
        (Function("f", [WAYPOINT], parameter_names=[]), "has 0 parameter names for 1 types"),
        (Function("f", value_types=[PddlTypeDto("Number")]), "give no value types for numbers"),
        (Function("f", [PddlEitherTypeDto([])]), "'either' of no types"),
        (assigned(Function("f"), types=["wp"]), "is a PddlTypeDto, not str"),
        (Function("f", [WAYPOINT] * 101), "has 101 parameters, 100 at most"),
        (
            assigned(Function("f", [WAYPOINT]), parameter_names=[1]),
            "each item of the list of parameter names of function 'f' is a str",
        ),
    ],
)
def test_a_function_that_is_not_well_formed_is_refused(
    fresh_kb: KnowledgeBase, wrong: PddlFunctionDto, message: str
) -> None:
    with nothing_changes(fresh_kb), pytest.raises(InvalidKnowledgeError) as caught:
        fresh_kb.functions.save(wrong)
    assert message in str(caught.value)
    with nothing_changes(fresh_kb), pytest.raises(InvalidKnowledgeError):
        fresh_kb.function_values.set(wrong, objects=[], value=1)
    assert declared(fresh_kb) == []


def test_parameters_of_predicates_are_checked_too(fresh_kb: KnowledgeBase) -> None:
    one = PddlPredicateDto("p", [ROBOT], parameter_names=["x", "y"])
    refuses(fresh_kb, ArityError, fresh_kb.predicates.save, one)
    other = PddlPredicateDto("p", [ROBOT], parameter_names=["x)"])
    refuses(fresh_kb, InvalidNameError, fresh_kb.predicates.save, other)


def test_several_types_are_no_type_that_can_be_saved(fresh_kb: KnowledgeBase) -> None:
    with nothing_changes(fresh_kb), pytest.raises(InvalidKnowledgeError):
        fresh_kb.types.save(ANYBODY)


def test_redefining_a_function_with_values_is_refused_with_the_list_or_cascades(
    fresh_kb: KnowledgeBase,
) -> None:
    values = fresh_kb.function_values
    values.set(DISTANCE, objects=[WP1, WP2], value=10)
    values.set(DISTANCE, objects=[WP2, WP1], value=12)
    as_object = Function("distance", [WAYPOINT, WAYPOINT], value_types=[WAYPOINT])
    caught = refuses(fresh_kb, DependantsError, fresh_kb.functions.save, as_object)
    assert caught.dependants == (
        "value (= (distance wp1 wp2) 10)",
        "value (= (distance wp2 wp1) 12)",
    )
    assert len(values.get_all()) == 2
    fresh_kb.functions.save(as_object, cascade=True)
    assert last_changes(fresh_kb) == [
        "+ function (distance ?w0 - wp ?w1 - wp) - wp",
        "- function (distance ?w0 - wp ?w1 - wp)",
        "- value (= (distance wp1 wp2) 10)",
        "- value (= (distance wp2 wp1) 12)",
    ]
    values.set("distance", objects=[WP1, WP2], value=WP2)
    assert values.get("distance", objects=[WP1, WP2]) == WP2
    assert [str(dto) for dto in fresh_kb.at(2).function_values.get_all()] == [
        "(= (distance wp1 wp2) 10)",
        "(= (distance wp2 wp1) 12)",
    ]


def test_values_go_with_their_function_objects_and_types(fresh_kb: KnowledgeBase) -> None:
    values = fresh_kb.function_values

    def fill() -> None:
        values.set(DISTANCE, objects=[WP1, WP2], value=10)
        values.set(DISTANCE, objects=[WP1, WP1], value=0)
        values.save(PddlFunctionValueDto(LOCATION, [RB1], WP2))

    fill()
    fresh_kb.objects.delete(WP2)
    assert [str(dto) for dto in values.get_all()] == ["(= (distance wp1 wp1) 0)"]
    assert last_changes(fresh_kb) == [
        "- object wp2 - wp",
        "- value (= (distance wp1 wp2) 10)",
        "- value (= (loc rb1) wp2)",
    ]
    fill()
    fresh_kb.functions.delete(DISTANCE)
    assert [str(dto) for dto in values.get_all()] == ["(= (loc rb1) wp2)"]
    fill()
    fresh_kb.types.delete(WAYPOINT)
    assert values.get_all() == fresh_kb.functions.get_all() == []
    fill()
    with undone(fresh_kb):
        fresh_kb.types.delete_all()
        assert values.get_all() == []
    assert len(values.get_all()) == 3
    refuses(fresh_kb, DependantsError, fresh_kb.objects.save, PddlObjectDto(ROBOT, "wp2"))
    fresh_kb.objects.save(PddlObjectDto(ROBOT, "wp2"), cascade=True)
    assert [str(dto) for dto in values.get_all()] == ["(= (distance wp1 wp1) 0)"]


def test_a_function_and_a_predicate_may_share_a_name(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.function_values.set(
        Function("robot_at", [ROBOT], value_types=[WAYPOINT]), objects=[RB1], value=WP1
    )
    fresh_kb.functions.delete(Function("robot_at"))
    assert fresh_kb.propositions.get_all() == [robot_at()]


Value = PddlFunctionValueDto
COST = PddlFunctionDto("total-cost")
RB2 = PddlObjectDto(ROBOT, "rb2")


def texts(kb: KnowledgeBase) -> list[str]:
    return [str(dto) for dto in kb.function_values.get_all()]


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with a battery at 10, and a robot at wp1; at revision 2."""
    fresh_kb.function_values.set(BATTERY, objects=[RB1], value=10)
    fresh_kb.function_values.set(LOCATION, objects=[RB1], value=WP1)
    return fresh_kb


def test_a_value_is_set_and_read(fresh_kb: KnowledgeBase) -> None:
    values = fresh_kb.function_values
    assert values.get(BATTERY, objects=[RB1]) is None
    assert values.set(BATTERY, objects=[RB1], value=10) is True
    assert last_changes(fresh_kb) == [
        "+ function (battery ?r0 - robot)",
        "+ object rb1 - robot",
        "+ type robot",
        "+ value (= (battery rb1) 10)",
    ]
    assert values.set("Battery", objects=("RB1",), value=Decimal("9.50")) is True
    assert last_changes(fresh_kb) == [
        "+ value (= (battery rb1) 9.50)",
        "- value (= (battery rb1) 10)",
    ]
    got = values.get(BATTERY, objects=[RB1])
    assert isinstance(got, Decimal)
    assert str(got) == "9.50"
    assert values.set(COST, objects=[], value=0) is True
    assert values.get("total-cost") == 0
    assert values.set(LOCATION, objects=[RB1], value=WP2) is True
    assert values.get("loc", objects=["rb1"]) == WP2
    assert values.set("loc", objects=["rb1"], value="WP2") is False
    (found,) = values.get_by_function("LOC")
    assert (found.function, found.objects, found.value) == (LOCATION, [RB1], WP2)
    assert texts(fresh_kb) == ["(= (battery rb1) 9.50)", "(= (total-cost) 0)", "(= (loc rb1) wp2)"]
    with pytest.raises(UnknownNameError, match="has never had a function 'speed'"):
        values.get_by_function("speed")


@pytest.mark.parametrize(
    "same", [10, 10.0, Decimal("10"), Decimal("10.000"), Decimal("1E+1")], ids=repr
)
def test_an_equal_number_is_no_change(kb: KnowledgeBase, same: Any) -> None:
    assert kb.function_values.set(BATTERY, objects=[RB1], value=same) is False
    assert kb.function_values.save(Value(BATTERY, [RB1], same)) is True
    assert kb.function_values.increase(BATTERY, objects=[RB1], by=0) == 10
    assert kb.function_values.scale_up(BATTERY, objects=[RB1], by=1) == 10
    assert kb.function_values.set(LOCATION, objects=[RB1], value=WP1) is False
    assert (kb.revision, texts(kb)[0]) == (2, "(= (battery rb1) 10)")


@pytest.mark.parametrize("given", ["(battery rb1)", " ( BATTERY  rb1 ) "])
def test_a_fluent_is_given_as_text(kb: KnowledgeBase, given: str) -> None:
    values = kb.function_values
    for at in (kb, kb.at(kb.revision)):
        assert at.function_values.get(given) == 10
    assert values.set(given, value=20)
    assert values.increase(given, by=1) == 21
    with kb.transaction():
        assert values.get(given) == 21
        assert values.unset(given)
    assert values.get(given) is None
    with pytest.raises(UnknownNameError):
        values.get("(battery never)")


@pytest.mark.parametrize("given", ["(= (battery rb1) 1)", "(battery rb1", "()", "(battery rb1) x"])
def test_a_text_that_is_no_fluent_is_refused(kb: KnowledgeBase, given: str) -> None:
    with pytest.raises(InvalidKnowledgeError, match=r"is not a fluent; write '\(battery rb1\)'"):
        kb.function_values.get(given)
    with pytest.raises(InvalidKnowledgeError, match="leave out objects="):
        kb.function_values.get("(battery rb1)", objects=["rb1"])


def test_a_function_without_arguments_needs_no_list_of_them(kb: KnowledgeBase) -> None:
    kb.functions.save(PddlFunctionDto("y"))
    assert kb.function_values.set("y", value=3)
    assert kb.function_values.increase("y", by=2) == 5
    assert kb.function_values.decrease("y", by=1) == 4
    assert kb.function_values.scale_up("y", by=3) == 12
    assert kb.function_values.scale_down("y", by=4) == 3
    with pytest.raises(ArityError):
        kb.function_values.set("battery", value=3)


def test_a_value_is_unset_and_set_again(kb: KnowledgeBase) -> None:
    values = kb.function_values
    assert values.unset("battery", objects=["rb1"]) is True
    assert last_changes(kb) == ["- value (= (battery rb1) 10)"]
    assert values.unset(BATTERY, objects=[RB1]) is False
    assert values.get(BATTERY, objects=[RB1]) is None
    for function, robot in (("speed", "rb1"), ("battery", "rb9")):
        for call in (values.unset, values.get):
            with pytest.raises(UnknownNameError):
                call(function, objects=[robot])
    assert values.delete(Value(LOCATION, [RB1])) is True
    assert values.delete(Value(LOCATION, [RB1])) is False
    assert values.set("battery", objects=["rb1"], value=10) is True
    assert versions(kb, "function_value") == [
        ("(= (battery rb1) 10)", 1, 3),
        ("(= (loc rb1) wp1)", 2, 4),
        ("(= (battery rb1) 10)", 5, None),
    ]
    assert rows(kb, "SELECT text FROM function_value WHERE kb_id = :kb ORDER BY id") == [
        ("(battery rb1)",),
        ("(loc rb1)",),
    ]


def test_insert_needs_a_fluent_without_and_update_one_with_a_value(kb: KnowledgeBase) -> None:
    values = kb.function_values
    assert values.insert(Value(BATTERY, [RB1], 11)) is False
    assert values.update(Value(BATTERY, [RB2], 11)) is False
    assert kb.objects.get("rb2") is None
    assert kb.revision == 2
    assert values.update(Value(BATTERY, [RB1], 11)) is True
    assert values.insert(Value(BATTERY, [RB2], 12)) is True
    assert values.save_all([Value(BATTERY, [RB1], 11), Value(BATTERY, [RB2], 13)]) == 1
    assert values.save_all([Value(BATTERY, [RB2], number) for number in (14, 14, 15)]) == 2
    assert texts(kb) == ["(= (battery rb1) 11)", "(= (loc rb1) wp1)", "(= (battery rb2) 15)"]
    assert values.delete_all() == 3
    assert values.delete_all() == 0
    assert texts(kb) == []


def test_numbers_are_changed_exactly(kb: KnowledgeBase) -> None:
    values = kb.function_values
    assert str(values.decrease("battery", objects=["rb1"], by=0.1)) == "9.9"
    assert str(values.increase("battery", objects=["rb1"], by=Decimal("0.20"))) == "10.10"
    assert str(values.scale_up("battery", objects=["rb1"], by=3)) == "30.30"
    assert str(values.scale_down("battery", objects=["rb1"], by=4)) == "7.575"
    assert str(values.scale_down("battery", objects=["rb1"], by=3)) == "2.525"
    assert str(values.decrease("battery", objects=["rb1"], by=2.525)) == "0.000"
    assert str(values.scale_up("battery", objects=["rb1"], by=-7)) == "0.000"
    values.set("battery", objects=["rb1"], value=1)
    assert str(values.scale_down("battery", objects=["rb1"], by=3)) == f"0.{'3' * 28}"
    values.set("battery", objects=["rb1"], value=10**399)
    assert values.increase("battery", objects=["rb1"], by=1) == 10**399 + 1
    assert values.get("battery", objects=["rb1"]) == 10**399 + 1
    stored = "SELECT value, number FROM function_value_version WHERE kb_id = :kb AND since = 4"
    assert rows(kb, stored) == [("10.10", 10.1)]


def test_the_past_of_values_is_not_written(kb: KnowledgeBase) -> None:
    kb.function_values.delete_all()
    past = kb.at(1).function_values
    assert [str(dto) for dto in past.get_by_function("battery")] == ["(= (battery rb1) 10)"]
    writes: list[Callable[[], object]] = [
        lambda: past.set("(battery rb1)", value=1),
        lambda: past.unset("(battery rb1)"),
        lambda: past.increase("(battery rb1)", by=1),
    ]
    for write in writes:
        with pytest.raises(ReadOnlyError):
            write()


REFUSED: dict[str, tuple[type[KantSqlError], Callable[[Any], object], str]] = {
    "unknown function": (
        InvalidKnowledgeError,
        lambda values: values.set("speed", objects=["rb1"], value=1),
        "a function value refers to function 'speed', which is not known; save it first, or give "
        "a PddlFunctionDto",
    ),
    "unknown object": (
        InvalidKnowledgeError,
        lambda values: values.set("battery", objects=["rb7"], value=1),
        "a function value refers to object 'rb7', which is not known (did you mean rb1?); save it "
        "first, or give a PddlObjectDto",
    ),
    "unknown value": (
        InvalidKnowledgeError,
        lambda values: values.set("loc", objects=["rb1"], value="wp7"),
        "a function value refers to object 'wp7', which is not known (did you mean wp1?); save it "
        "first, or give a PddlObjectDto",
    ),
    "too many": (
        ArityError,
        lambda values: values.set("battery", objects=["rb1", WP2], value=1),
        "(battery rb1 wp2) has 2 arguments, expected 1 as in (battery ?r0 - robot)",
    ),
    "wrong argument": (
        TypeMismatchError,
        lambda values: values.set("battery", objects=[WP2], value=1),
        "(battery wp2): argument 1, 'wp2', is of type 'wp', expected 'robot' or a subtype, as in "
        "(battery ?r0 - robot)",
    ),
    "wrong type of value": (
        TypeMismatchError,
        lambda values: values.set("loc", objects=["rb1"], value=RB2),
        "(loc rb1): the value, 'rb2', is of type 'robot', expected 'wp' or a subtype, as in "
        "(loc ?r0 - robot) - wp",
    ),
    "an object for a number": (
        TypeMismatchError,
        lambda values: values.set("battery", objects=["rb1"], value="wp1"),
        "(battery rb1): the value is 'wp1', expected a number, as in (battery ?r0 - robot)",
    ),
    "a number for an object": (
        TypeMismatchError,
        lambda values: values.set("loc", objects=["rb1"], value=1),
        "(loc rb1): the value is 1, expected an object, as in (loc ?r0 - robot) - wp",
    ),
    "a truth value": (
        TypeMismatchError,
        lambda values: values.set("battery", objects=["rb1"], value=True),
        "(battery rb1): the value is True, expected a number, as in (battery ?r0 - robot)",
    ),
    "an object increased": (
        TypeMismatchError,
        lambda values: values.increase("loc", objects=["rb1"], by=1),
        "(loc rb1): the value is 1, expected an object, as in (loc ?r0 - robot) - wp",
    ),
    "not a number": (
        InvalidKnowledgeError,
        lambda values: values.set("battery", objects=["rb1"], value=float("nan")),
        "(battery rb1): PDDL text cannot express the number NaN; give a finite number of at most "
        "400 digits",
    ),
    "too large": (
        InvalidKnowledgeError,
        lambda values: values.set("battery", objects=["rb1"], value=Decimal("1E+1000000")),
        "(battery rb1): PDDL text cannot express the number 1E+1000000; give a finite number of at "
        "most 400 digits",
    ),
    "unset": (
        InvalidKnowledgeError,
        lambda values: values.increase("battery", objects=[RB2], by=1),
        "(battery rb2) has no value that could be increased; set it first",
    ),
    "divided by zero": (
        InvalidKnowledgeError,
        lambda values: values.scale_down("battery", objects=["rb1"], by=0),
        "(battery rb1) is 10 and cannot be scaled down by 0: no number can be divided by 0",
    ),
    "grown too large": (
        InvalidKnowledgeError,
        lambda values: values.scale_up("battery", objects=["rb1"], by=10**399),
        f"(battery rb1) is 10 and cannot be scaled up by 1{'0' * 39}: PDDL text cannot express the "
        f"number 1.{'0' * 58}; give a finite number of at most 400 digits",
    ),
    "one string for a list": (
        InvalidKnowledgeError,
        lambda values: values.set("battery", objects="rb1", value=1),
        "the list of objects of a function value is a list, not str: 'rb1'",
    ),
    "no function": (
        InvalidKnowledgeError,
        lambda values: values.get(7),
        "the function of a function value is a name or a PddlFunctionDto, not int: 7",
    ),
    "names in a DTO": (
        InvalidKnowledgeError,
        lambda values: values.save(assigned(Value(BATTERY, [RB1], 1), function="battery")),
        "the function of a function value is a PddlFunctionDto, not str: 'battery'",
    ),
    "no DTO": (
        InvalidKnowledgeError,
        lambda values: values.save_all([distance(1), 7]),
        "the function value DAO takes a value, for example '(= (battery rb1) 80)', not int: 7",
    ),
    "no name": (
        InvalidNameError,
        lambda values: values.save_all([distance(1), Value(BATTERY, [PddlObjectDto(ROBOT, "(")])]),
        "'(' cannot name an object: it has '(' (LEFT PARENTHESIS) at position 0; choose another "
        "name",
    ),
}


@pytest.mark.parametrize(("error", "call", "message"), REFUSED.values(), ids=REFUSED)
def test_what_is_wrong_is_refused_in_one_line_and_leaves_nothing(
    kb: KnowledgeBase, error: type[Exception], call: Callable[[Any], object], message: str
) -> None:
    for _ in range(2):
        before = texts(kb)
        with pytest.raises(error) as caught:
            call(kb.function_values)
        assert type(caught.value) is error
        assert str(caught.value) == message
        assert (kb.revision, texts(kb)) == (2, before)
        assert (kb.functions.get("distance"), kb.objects.get("rb2")) == (None, None)
    with kb.transaction():
        with pytest.raises(error):
            call(kb.function_values)
        assert kb.function_values.increase("battery", objects=["rb1"], by=1) == 11
    assert last_changes(kb) == ["+ value (= (battery rb1) 11)", "- value (= (battery rb1) 10)"]


def test_an_object_of_a_subtype_is_a_value(kb: KnowledgeBase) -> None:
    dock = PddlObjectDto(PddlTypeDto("dock", parent=WAYPOINT), "dock1")
    assert kb.function_values.set("loc", objects=["rb1"], value=dock) is True
    assert kb.function_values.get("loc", objects=["rb1"]) == dock


# Within a transaction: between the calls nothing, a read of what is pending, or what is undone.

ONE, TWO = FLUENTS[:2]
FAILING = (True, [("unset", ONE, 0), ("set", TWO, 1), (True, [("set", ONE, 7), READ]), READ])
BETWEEN: dict[str, list[Any]] = {
    "nothing": [],
    "get": [("get", ONE, 0)],
    "get_all": [READ],
    "failing": [FAILING],
}
BLOCKS = {
    "set back": [("set", ONE, 2), ("set", ONE, 0), ("set", ONE, 1)],
    "set back beside another change": [
        *(("set", ONE, 2), ("unset", TWO, 0), ("set", ONE, 1), ("set", TWO, 1), ("set", TWO, 0))
    ],
    "unset and set otherwise": [("unset", ONE, 0), ("set", ONE, 2), ("unset", TWO, 0)],
    "increased often": [("increase", ONE, 1), ("increase", ONE, 2), ("increase", TWO, 1)],
}


@pytest.mark.parametrize("between", BETWEEN.values(), ids=BETWEEN)
@pytest.mark.parametrize("calls", BLOCKS.values(), ids=BLOCKS)
def test_what_a_transaction_leaves_of_values_is_what_a_dict_has(
    fresh_kb: KnowledgeBase, calls: list[Any], between: list[Any]
) -> None:
    block = (False, [each for call in calls for each in (call, *between)])
    check(fresh_kb, [("set", ONE, 1), ("set", TWO, 1), block, FAILING, ("increase", ONE, 1)])


def test_what_a_failing_call_did_is_undone_alone(kb: KnowledgeBase) -> None:
    with kb.transaction():
        kb.function_values.increase("battery", objects=["rb1"], by=1)
        with pytest.raises(InvalidKnowledgeError):
            kb.function_values.save_all([*map(distance, range(3)), Value(BATTERY, [WP1], 1)])
        assert kb.function_values.get("battery", objects=["rb1"]) == 11
    assert (len(last_changes(kb)), texts(kb)[0]) == (2, "(= (battery rb1) 11)")

"""The values of functions, numbers and objects, on every backend."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from typing import Any

import pytest

from kant_sql import (
    InvalidKnowledgeError,
    KantSqlError,
    KnowledgeBase,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlTypeDto,
    ReadOnlyError,
    UnknownNameError,
)
from kant_sql.errors import ArityError, InvalidNameError, TypeMismatchError
from tests.support.reading import last_changes, rows, undone, versions
from tests.support.worlds.robots import (
    BATTERY,
    LOCATION,
    RB1,
    ROBOT,
    WAYPOINT,
    WP1,
    WP2,
    assigned,
    distance,
)

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


def test_a_change_of_a_value_is_one_revision_with_the_value_before(kb: KnowledgeBase) -> None:
    kb.function_values.increase(BATTERY, objects=[RB1], by=5)
    assert (kb.revision, last_changes(kb)) == (
        3,
        ["+ value (= (battery rb1) 15)", "- value (= (battery rb1) 10)"],
    )


def test_the_past_is_read_by_the_same_methods_and_not_written(kb: KnowledgeBase) -> None:
    kb.function_values.increase(BATTERY, objects=[RB1], by=5)
    kb.function_values.set(LOCATION, objects=[RB1], value=WP2)
    kb.function_values.delete_all()
    past = [kb.at(revision).function_values for revision in range(6)]
    assert [values.get("battery", objects=["rb1"]) for values in past] == [
        None,
        10,
        10,
        15,
        15,
        None,
    ]
    assert [values.get(LOCATION, objects=[RB1]) for values in past] == [
        None,
        None,
        WP1,
        WP1,
        WP2,
        None,
    ]
    assert [len(values.get_all()) for values in past] == [0, 1, 2, 2, 2, 0]
    assert [str(dto) for dto in past[4].get_by_function("battery")] == ["(= (battery rb1) 15)"]
    writes: list[Callable[[], object]] = [
        lambda: past[1].set("battery", objects=["rb1"], value=1),
        lambda: past[1].unset("battery", objects=["rb1"]),
        lambda: past[1].increase("battery", objects=["rb1"], by=1),
        lambda: past[1].save(Value(BATTERY, [RB1], 1)),
        lambda: past[1].save_all([]),
        past[1].delete_all,
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


# Within a transaction.


def read_all(kb: KnowledgeBase) -> None:
    """Have what is pending written."""
    kb.function_values.get_all()


def read_one(kb: KnowledgeBase) -> None:
    assert kb.function_values.get("battery", objects=["rb1"]) is not None


def fail(kb: KnowledgeBase) -> None:
    """Do much, and have it undone."""
    with undone(kb):
        kb.function_values.delete_all()
        kb.function_values.set(BATTERY, objects=[RB2], value=1)
        with undone(kb):
            kb.function_values.set(BATTERY, objects=[RB1], value=77)
            assert texts(kb) == ["(= (battery rb1) 77)", "(= (battery rb2) 1)"]
        assert kb.function_values.get("battery", objects=["rb1"]) is None
        kb.functions.delete_all()


BETWEEN = [lambda kb: None, read_one, read_all, fail]


@pytest.mark.parametrize("between", BETWEEN, ids=["nothing", "get", "get_all", "failing"])
def test_what_is_set_back_leaves_no_version_and_no_revision(
    kb: KnowledgeBase, between: Callable[[KnowledgeBase], None]
) -> None:
    values, before = kb.function_values, versions(kb, "function_value")
    with kb.transaction():
        for number in (11, 12.5, Decimal("10.00")):
            assert values.set(BATTERY, objects=[RB1], value=number) is True
            between(kb)
            assert values.get(BATTERY, objects=[RB1]) == number
        values.set(COST, objects=[], value=1)
        between(kb)
        values.set("loc", objects=["rb1"], value=WP2)
        between(kb)
        assert values.get("loc", objects=["rb1"]) == WP2
        values.set("loc", objects=["rb1"], value=WP1)
        kb.functions.delete(COST)
        kb.objects.delete(WP2)
    assert (kb.revision, versions(kb, "function_value")) == (2, before)
    assert texts(kb) == ["(= (battery rb1) 10)", "(= (loc rb1) wp1)"]


@pytest.mark.parametrize("between", BETWEEN, ids=["nothing", "get", "get_all", "failing"])
def test_what_is_set_back_is_no_part_of_a_revision_that_changes_something_else(
    kb: KnowledgeBase, between: Callable[[KnowledgeBase], None]
) -> None:
    kb.function_values.set(BATTERY, objects=[RB2], value=1)
    before = versions(kb, "function_value")
    with kb.transaction():
        for number in (11, 12, 10.0):
            kb.function_values.set(BATTERY, objects=[RB1], value=number)
            between(kb)
        kb.function_values.unset("loc", objects=["rb1"])
        between(kb)
        kb.function_values.set("loc", objects=["rb1"], value=WP1)
        kb.function_values.unset(BATTERY, objects=[RB2])
    assert last_changes(kb) == ["- value (= (battery rb2) 1)"]
    *others, last = before
    assert versions(kb, "function_value") == [*others, (last[0], 3, 4)]


@pytest.mark.parametrize("between", BETWEEN, ids=["nothing", "get", "get_all", "failing"])
def test_many_changes_in_one_transaction_are_one_version(
    kb: KnowledgeBase, between: Callable[[KnowledgeBase], None]
) -> None:
    with kb.transaction():
        for step in range(1, 5):
            assert kb.function_values.increase("battery", objects=["rb1"], by=step) == 10 + sum(
                range(step + 1)
            )
            between(kb)
        kb.function_values.unset("loc", objects=["rb1"])
        between(kb)
        kb.function_values.set("loc", objects=["rb1"], value=WP2)
        between(kb)
    assert last_changes(kb) == [
        "+ object wp2 - wp",
        "+ value (= (battery rb1) 20)",
        "+ value (= (loc rb1) wp2)",
        "- value (= (battery rb1) 10)",
        "- value (= (loc rb1) wp1)",
    ]
    assert versions(kb, "function_value") == [
        ("(= (battery rb1) 10)", 1, 3),
        ("(= (loc rb1) wp1)", 2, 3),
        ("(= (battery rb1) 20)", 3, None),
        ("(= (loc rb1) wp2)", 3, None),
    ]


def test_what_a_failing_call_did_is_undone_alone(kb: KnowledgeBase) -> None:
    for read in (False, True):
        with kb.transaction():
            kb.function_values.increase("battery", objects=["rb1"], by=1)
            before = kb.function_values.get("battery", objects=["rb1"])
            with pytest.raises(InvalidKnowledgeError):
                kb.function_values.save_all([*map(distance, range(3)), Value(BATTERY, [WP1], 1)])
            with undone(kb):
                kb.function_values.increase("battery", objects=["rb1"], by=1)
                if read:
                    read_all(kb)
                kb.function_values.unset("battery", objects=["rb1"])
            assert kb.function_values.get("battery", objects=["rb1"]) == before
        assert len(last_changes(kb)) == 2
    assert texts(kb) == ["(= (battery rb1) 12)", "(= (loc rb1) wp1)"]

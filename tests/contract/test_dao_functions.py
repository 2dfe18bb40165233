"""Functions, named parameters and `either`, on every backend."""

from __future__ import annotations

from typing import Any

import pytest

from kant_sql import (
    ConflictError,
    DependantsError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlEitherTypeDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    ReadOnlyError,
)
from kant_sql.errors import ArityError, InvalidNameError, TypeMismatchError
from tests.support.reading import beside, last_changes, nothing_changes, refuses, undone, versions
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    assigned,
    navigation,
    robot_at,
)

Function = PddlFunctionDto
DISTANCE = Function("distance", [WAYPOINT, WAYPOINT])
LOCATION = Function("loc", [ROBOT], value_types=[WAYPOINT])
HUMAN = PddlTypeDto("human")
ANYBODY = PddlEitherTypeDto([ROBOT, HUMAN])


def texts(kb: KnowledgeBase) -> list[str]:
    return [str(dto) for dto in kb.functions.get_all()]


def test_a_function_is_saved_read_and_deleted(fresh_kb: KnowledgeBase) -> None:
    functions = fresh_kb.functions
    assert functions.get("distance") is None
    assert functions.save(DISTANCE) is True
    assert last_changes(fresh_kb) == ["+ function (distance ?w0 - wp ?w1 - wp)", "+ type wp"]
    functions.save(LOCATION)
    found = functions.get("LOC")
    assert found is not None
    assert (found.name, found.types, found.value_types) == ("loc", [ROBOT], [WAYPOINT])
    assert found.parameter_names is None
    assert texts(fresh_kb) == ["(distance ?w0 - wp ?w1 - wp)", "(loc ?r0 - robot) - wp"]
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
    assert texts(fresh_kb) == wanted
    newcomer = beside(fresh_kb, fresh_kb.store.factory._store.name)  # type: ignore[attr-defined]
    assert texts(newcomer) == wanted
    found = newcomer.functions.get("boss")
    assert found is not None
    assert isinstance(found.types[0], PddlEitherTypeDto)
    assert found.types[0].types == [ROBOT, HUMAN]
    assert found.value_types == [HUMAN, ROBOT]
    with nothing_changes(fresh_kb):
        assert fresh_kb.functions.save_all(newcomer.functions.get_all()) == 0


def test_insert_and_update_of_a_function(fresh_kb: KnowledgeBase) -> None:
    functions = fresh_kb.functions
    assert functions.update(DISTANCE) is False
    assert functions.insert(DISTANCE) is True
    with nothing_changes(fresh_kb):
        assert functions.insert(Function("distance")) is False
        assert functions.update(DISTANCE) is True
    assert functions.update(Function("distance", [WAYPOINT])) is True
    assert texts(fresh_kb) == ["(distance ?w0 - wp)"]
    with pytest.raises(ReadOnlyError):
        fresh_kb.at(1).functions.save(DISTANCE)


def test_another_name_of_a_parameter_is_no_redefinition(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.actions.save(navigation())
    fresh_kb.function_values.set(DISTANCE, objects=[WP1, WP2], value=10)
    named: list[tuple[Any, Any]] = [
        (
            fresh_kb.predicates,
            PddlPredicateDto("robot_at", [ROBOT, WAYPOINT], parameter_names=["r", "at"]),
        ),
        (
            fresh_kb.functions,
            Function("distance", [WAYPOINT, WAYPOINT], parameter_names=["from", "to"]),
        ),
    ]
    for dao, dto in named:
        dao.save(dto)
        assert str(dao.get(dto.name)) == str(dto)
        assert len(last_changes(fresh_kb)) == 2
    with nothing_changes(fresh_kb):
        # Nothing said of the names, or only referred to.
        fresh_kb.predicates.save(ROBOT_AT)
        fresh_kb.functions.save(DISTANCE)
        fresh_kb.propositions.save(robot_at())
        fresh_kb.function_values.set(DISTANCE, objects=[WP1, WP2], value=10)
    wider = Function("distance", [WAYPOINT, WAYPOINT, WAYPOINT])
    fresh_kb.functions.save(wider, cascade=True)
    assert texts(fresh_kb) == ["(distance ?w0 - wp ?w1 - wp ?w2 - wp)"]


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
    assert "argument 1, 'wp2', is of type 'wp', expected '(either robot human)'" in str(
        caught.value
    )
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
    assert texts(fresh_kb) == []


def test_names_and_number_of_parameters_are_checked_of_predicates_too(
    fresh_kb: KnowledgeBase,
) -> None:
    one = PddlPredicateDto("p", [ROBOT], parameter_names=["x", "y"])
    refuses(fresh_kb, ArityError, fresh_kb.predicates.save, one)
    other = PddlPredicateDto("p", [ROBOT], parameter_names=["x)"])
    refuses(fresh_kb, InvalidNameError, fresh_kb.predicates.save, other)


def test_several_types_are_no_type_that_can_be_saved(fresh_kb: KnowledgeBase) -> None:
    with nothing_changes(fresh_kb), pytest.raises(InvalidKnowledgeError):
        fresh_kb.types.save(ANYBODY)


@pytest.mark.parametrize(
    "other",
    [
        Function("distance", [WAYPOINT]),
        Function("distance", [WAYPOINT, ROBOT]),
        Function("distance", [WAYPOINT, WAYPOINT], value_types=[WAYPOINT]),
        Function("distance", [WAYPOINT, PddlTypeDto("wp", parent=ROBOT)]),
    ],
    ids=str,
)
def test_a_value_never_redefines_its_function(
    fresh_kb: KnowledgeBase, other: PddlFunctionDto
) -> None:
    fresh_kb.functions.save(DISTANCE)
    call = fresh_kb.function_values.set
    caught = refuses(fresh_kb, ConflictError, call, other, objects=[WP1, WP2], value=1)
    assert "is stored as" in str(caught.value)


def test_redefining_a_function_with_values_is_refused_with_the_list_or_cascades(
    fresh_kb: KnowledgeBase,
) -> None:
    values = fresh_kb.function_values
    values.set(DISTANCE, objects=[WP1, WP2], value=10)
    values.set(DISTANCE, objects=[WP2, WP1], value=12)
    as_object = Function("distance", [WAYPOINT, WAYPOINT], value_types=[WAYPOINT])
    caught = refuses(fresh_kb, DependantsError, fresh_kb.functions.save, as_object)
    assert isinstance(caught.value, DependantsError)
    assert caught.value.dependants == (
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

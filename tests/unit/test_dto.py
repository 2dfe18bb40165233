"""DTOs are plain data: their fields, getters and setters, equality, and lists of their own."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from collections.abc import Callable
from typing import Any, get_type_hints

import pytest

from kant_sql import (
    Dto,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
)

Literal = PddlConditionEffectDto

SAMPLES: dict[type[Dto], Dto] = {
    PddlTypeDto: PddlTypeDto("robot", parent=PddlTypeDto("vehicle")),
    PddlObjectDto: RB1,
    PddlPredicateDto: ROBOT_AT,
    PddlPropositionDto: robot_at(),
    PddlFunctionDto: PddlFunctionDto("loc", [ROBOT], value_types=[WAYPOINT], parameter_names=["r"]),
    PddlFunctionValueDto: PddlFunctionValueDto(PddlFunctionDto("loc", [ROBOT]), [RB1], WP1),
    PddlConditionEffectDto: Literal(ROBOT_AT, [RB1, WP1], Literal.AT_END, True),
    PddlActionDto: navigation(),
}
# The fields in their positional order, each with another value for it.
FIELDS: dict[type[Dto], dict[str, object]] = {
    PddlTypeDto: {"name": "car", "parent": WAYPOINT},
    PddlObjectDto: {"type": WAYPOINT, "name": "wp9", "is_constant": True},
    PddlPredicateDto: {
        "name": "near",
        "types": [WAYPOINT, WAYPOINT],
        "parameter_names": ["from", "to"],
    },
    PddlFunctionDto: {
        "name": "distance",
        "types": [WAYPOINT, WAYPOINT],
        "value_types": [ROBOT],
        "parameter_names": ["from", "to"],
    },
    PddlFunctionValueDto: {
        "function": PddlFunctionDto("distance", [WAYPOINT]),
        "objects": [WP2],
        "value": 2.5,
    },
    PddlPropositionDto: {
        "predicate": PddlPredicateDto("near", [WAYPOINT]),
        "objects": [WP2],
        "is_goal": True,
    },
    PddlConditionEffectDto: {
        "predicate": PddlPredicateDto("near", [WAYPOINT]),
        "objects": [WP2],
        "time": Literal.OVER_ALL,
        "is_negative": True,
    },
    PddlActionDto: {
        "name": "walk",
        "parameters": [RB1],
        "conditions": [Literal(ROBOT_AT)],
        "effects": [Literal(ROBOT_AT)],
        "durative": False,
        "duration": 2.5,
    },
}
FIELD_CASES = [(dto_class, name) for dto_class, fields in FIELDS.items() for name in fields]
LIST_CASES = [case for case in FIELD_CASES if isinstance(FIELDS[case[0]][case[1]], list)]
NEVER_NONE = [case for case in LIST_CASES if case[1] != "parameter_names"]


@pytest.mark.parametrize("dto_class", FIELDS)
def test_a_dto_is_a_dataclass_with_its_fields_in_the_documented_order(dto_class: type[Any]) -> None:
    assert [field.name for field in dataclasses.fields(dto_class)] == list(FIELDS[dto_class])
    assert list(inspect.signature(dto_class).parameters) == list(FIELDS[dto_class])
    assert issubclass(dto_class, Dto)


@pytest.mark.parametrize(("dto_class", "name"), FIELD_CASES)
def test_each_field_is_public_with_a_getter_and_a_setter(dto_class: type[Dto], name: str) -> None:
    dto: Any = copy.deepcopy(SAMPLES[dto_class])
    value = FIELDS[dto_class][name]
    assert getattr(dto, f"get_{name}")() is getattr(dto, name)
    assert getattr(dto, f"set_{name}")(value) is None
    assert getattr(dto, name) == value
    assert getattr(dto, f"get_{name}")() == value


@pytest.mark.parametrize(("dto_class", "name"), FIELD_CASES)
def test_getters_and_setters_are_written_out_with_types(dto_class: type[Dto], name: str) -> None:
    field = get_type_hints(dto_class)[name]
    getter = get_type_hints(getattr(dto_class, f"get_{name}"))
    setter = get_type_hints(getattr(dto_class, f"set_{name}"))
    assert getter == {"return": field}
    assert set(setter) == {name, "return"}
    assert setter["return"] is type(None)
    if (dto_class, name) not in LIST_CASES:
        assert setter[name] == field


@pytest.mark.parametrize(("dto_class", "name"), LIST_CASES)
def test_a_list_that_is_given_is_never_aliased(dto_class: type[Dto], name: str) -> None:
    constructor: Callable[..., Any] = dto_class
    given: list[object] = [*FIELDS[dto_class][name]]  # type: ignore[misc]
    arguments = {
        field.name: getattr(SAMPLES[dto_class], field.name)
        for field in dataclasses.fields(dto_class)  # type: ignore[arg-type]
    }
    built = constructor(**{**arguments, name: given})
    changed = constructor(**arguments)
    getattr(changed, f"set_{name}")(given)
    for dto in (built, changed):
        assert getattr(dto, name) == given
        given.append("more")
        assert getattr(dto, name) == given[:-1]
        given.pop()


@pytest.mark.parametrize("nothing", [None, (), [], iter(())])
@pytest.mark.parametrize(("dto_class", "name"), NEVER_NONE)
def test_none_means_an_empty_list_of_its_own(
    dto_class: type[Dto], name: str, nothing: object
) -> None:
    first: Any = copy.deepcopy(SAMPLES[dto_class])
    second: Any = copy.deepcopy(SAMPLES[dto_class])
    getattr(first, f"set_{name}")(nothing)
    getattr(second, f"set_{name}")(nothing)
    assert getattr(first, name) == []
    assert getattr(first, name) is not getattr(second, name)


def test_lists_may_be_left_out() -> None:
    assert PddlPredicateDto("p").types == []
    assert PddlFunctionDto("f").types == PddlFunctionDto("f").value_types == []
    assert PddlFunctionValueDto(PddlFunctionDto("f")).objects == []
    assert PddlPropositionDto(ROBOT_AT).objects == []
    assert PddlConditionEffectDto(ROBOT_AT).objects == []
    action = PddlActionDto("a")
    assert (action.parameters, action.conditions, action.effects) == ([], [], [])


def test_what_is_left_out_has_the_documented_default() -> None:
    assert PddlTypeDto("robot").parent is None
    assert PddlPropositionDto(ROBOT_AT).is_goal is False
    assert PddlPredicateDto("p").parameter_names is None
    assert PddlFunctionDto("f").parameter_names is None
    assert PddlFunctionValueDto(PddlFunctionDto("f")).value == 0
    literal = PddlConditionEffectDto(ROBOT_AT)
    assert (literal.time, literal.is_negative) == (None, False)
    assert (PddlActionDto("a").durative, PddlActionDto("a").duration) == (True, 10)


def test_parent_and_duration_are_given_by_keyword_only() -> None:
    make_type: Callable[..., PddlTypeDto] = PddlTypeDto
    make_action: Callable[..., PddlActionDto] = PddlActionDto
    with pytest.raises(TypeError):
        make_type("robot", WAYPOINT)
    with pytest.raises(TypeError):
        make_action("a", [], [], [], True, 5)
    assert make_type("robot", parent=WAYPOINT).parent is WAYPOINT
    assert make_action("a", [], [], [], True, duration=5).duration == 5


@pytest.mark.parametrize("dto", SAMPLES.values(), ids=lambda dto: type(dto).__name__)
def test_a_dto_can_be_copied_and_pickled(dto: Dto) -> None:
    for twin in (copy.copy(dto), copy.deepcopy(dto), pickle.loads(pickle.dumps(dto))):
        assert twin == dto
        assert str(twin) == str(dto)
        assert vars(twin) == vars(dto)
    fields: Any = dto
    assert dataclasses.replace(fields) == dto


@pytest.mark.parametrize("dto", SAMPLES.values(), ids=lambda dto: type(dto).__name__)
def test_repr_names_the_class_and_the_fields(dto: Dto) -> None:
    assert repr(dto).startswith(f"{type(dto).__name__}({next(iter(FIELDS[type(dto)]))}=")

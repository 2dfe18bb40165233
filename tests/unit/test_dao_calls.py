"""Calls of DAOs as JSON: what is written is read again, and nothing else is."""

from __future__ import annotations

import copy
import dataclasses
import json
import random
from contextlib import suppress
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kant_sql
from kant_sql import (
    InvalidKnowledgeError,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEitherTypeDto,
    PddlEventDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.dao_calls import CLASSES, call, document, read
from kant_sql.dto.formulas import And, Atom, Checked, Constant, Not
from kant_sql.errors import InvalidArgumentError, TypeCycleError
from kant_sql.pddl import Domain, Problem
from tests.support.generators.documents import NAMES, domains_and_problems
from tests.support.profile import PROFILE

ROBOT = PddlTypeDto("robot", parent=PddlTypeDto("machine"))
RB1 = PddlObjectDto(ROBOT, "rb1", is_constant=True)
EITHER = PddlEitherTypeDto([ROBOT, PddlTypeDto("human")])
NEAR = PddlPredicateDto("near", [ROBOT, EITHER], parameter_names=["x", "x"])
LEVEL = PddlFunctionDto("level", [ROBOT], value_types=[EITHER], parameter_names=["r"])
LITERAL = PddlConditionEffectDto(NEAR, [RB1, RB1], PddlConditionEffectDto.AT_END, True)
NODE = Not(Atom("near", (Constant("rb1"),)))
PARTS: tuple[Any, Any, Any, Any] = ("go", [RB1], [LITERAL, NODE], [NODE])
EACH = [
    *(ROBOT, EITHER, RB1, NEAR, LEVEL, LITERAL, PddlPropositionDto(NEAR, [RB1, RB1], is_goal=True)),
    *(PddlFunctionValueDto(LEVEL, [RB1], value) for value in (1, 2.5, Decimal("0.10"), RB1)),
    *(PddlActionDto(*PARTS, duration=duration) for duration in (1, Decimal("1.50"), [NODE])),
    *(PddlActionDto(*PARTS, durative=False), PddlProcessDto(*PARTS), PddlEventDto(*PARTS)),
]
VALUES: list[Any] = [None, True, 0, -1.5, 10**60, "", "\ud800\0", [], [[1], []], Decimal("-0.0")]


def again(value: Any) -> Any:
    return read(json.loads(json.dumps(document(value), allow_nan=False)))


def whole(value: Any) -> Any:
    """All fields of a DTO or node, whatever it is equal to."""
    if isinstance(value, list | tuple):
        return [whole(one) for one in value]
    if not dataclasses.is_dataclass(value):
        return type(value), str(value)
    return [type(value), *(whole(getattr(value, one.name)) for one in dataclasses.fields(value))]


@pytest.mark.parametrize("value", [*EACH, *VALUES], ids=repr)
def test_what_is_written_is_read_again(value: Any) -> None:
    assert whole(again(value)) == whole(value)
    assert whole(again({"dto": [value]})["dto"]) == whole([value])


def nodes_of(value: object) -> list[Checked]:
    """The largest nodes and typed names in a document."""
    if type(value).__name__ in CLASSES:
        return [value]  # type: ignore[list-item]
    if isinstance(value, tuple):
        return [node for one in value for node in nodes_of(one)]
    if isinstance(value, Checked):
        names = [field.name for field in dataclasses.fields(value)]  # type: ignore[arg-type]
        return [node for name in names for node in nodes_of(getattr(value, name))]
    return []


@settings(max_examples=PROFILE.texts)
@given(domains_and_problems(), st.lists(NAMES, min_size=1))
def test_nodes_of_whole_documents_and_all_names_are_read_again(
    both: tuple[Domain, Problem], names: list[str]
) -> None:
    assert again(found := [node for part in both for node in nodes_of(part)]) == found
    types = [PddlTypeDto(name, parent=ROBOT) for name in names]
    assert whole(again(types)) == whole(types)


def test_what_is_shared_is_written_once_and_is_one_object_again() -> None:
    facts = [PddlPropositionDto(NEAR, [RB1, RB1]) for _ in range(3)]
    assert len(document(facts)["pool"]) == 6 + 3  # type: ignore[arg-type]
    first, _, last = again(facts)
    assert first is not last
    assert first.objects[0] is last.objects[1]
    assert first.predicate.types[0] is first.objects[0].type


def test_a_hierarchy_of_any_depth_is_read_and_one_that_is_a_circle_is_refused() -> None:
    tall = PddlTypeDto("t")
    for _ in range(5_000):
        tall = PddlTypeDto("t", parent=tall)
    assert len(read(document(tall)).__repr__()) == len(repr(tall))
    loop = PddlTypeDto("loop", parent=ROBOT)
    loop.parent = PddlTypeDto("other", parent=loop)
    with pytest.raises(TypeCycleError, match="'other' would be its own ancestor"):
        document([loop])


def test_a_list_in_itself_and_what_is_no_argument_arrive_as_what_is_refused() -> None:
    endless: list[Any] = []
    endless.append(endless)
    assert again([object])[0].__class__.__name__ == "type"
    assert repr(again(b"x")) == "b'x'"
    assert repr(read({"pool": [], "value": {"other": ["\ud800\0", "x"]}})) == "x"
    assert again(endless)[0][0][0]
    with pytest.raises(InvalidKnowledgeError, match="lacks a field"):
        document(object.__new__(PddlTypeDto))


def doubled(kind: str, first: Any, part: str) -> dict[str, Any]:
    """A document of 60 items that unfolds to 2 ** 60."""
    pairs = [{kind: {part: [{"ref": place}, {"ref": place}]}} for place in range(60)]
    return {"pool": [first, *pairs], "value": {"ref": 60}}


ITEMS: list[Any] = [
    *(5, {}, {"Domain": {}}, {"Dto": {}}, {"os": {}}, {"PddlTypeDto": {}}),
    {"PddlTypeDto": {"name": "a", "__class__": 1}},
    {"PddlTypeDto": {"name": "a", "parent": {"ref": 0}}},
]
WRONG: list[Any] = [
    *({"ref": place} for place in (0, -1, True, "0", 1e9, None)),
    *({"decimal": text} for text in (1, "x", "1e9999999999999999999", "9" * 1001)),
    *({"float": 1}, {"float": "1"}, {"other": 1}, {"other": ["a", 1]}, {"other": ["a"]}),
    *({"list": []}, {"map": 1}, {"ref": 0, "map": {}}, [[[[[[[[[[]]]]]]]]]]),
]
HOSTILE: list[Any] = [
    *(None, 5, [], {}, {"pool": []}, {"pool": {}, "value": 1}),
    *({"pool": [item], "value": 1} for item in ITEMS),
    *({"pool": [], "value": wrong} for wrong in WRONG),
    doubled("And", {"Constant": {"name": "a"}}, "formulas"),
    doubled("PddlEitherTypeDto", {"PddlTypeDto": {"name": "a"}}, "types"),
    doubled("PddlEitherTypeDto", {"PddlTypeDto": {"name": "a" * 10**7}}, "types"),
]


@pytest.mark.parametrize("hostile", HOSTILE, ids=lambda one: str(one)[:60])
def test_what_is_no_document_is_refused(hostile: Any) -> None:
    with pytest.raises((InvalidArgumentError, InvalidKnowledgeError)) as caught:
        read(hostile)
    assert len(str(caught.value)) < 500


@settings(max_examples=PROFILE.texts)
@given(st.randoms(use_true_random=False), st.sampled_from(EACH))
def test_a_document_with_anything_anywhere_is_read_or_refused(
    chance: random.Random, value: Any
) -> None:
    broken: Any = copy.deepcopy(document([value, And((NODE, NODE))]))
    place, key = broken, chance.choice(["pool", "value"])
    while isinstance(place[key], list | dict) and place[key] and chance.random() < 0.8:
        place = place[key]
        key = chance.choice([*place] if isinstance(place, dict) else range(len(place)))
    place[key] = chance.choice([None, 5, "x", [], {}, {"ref": 0}, {"PddlTypeDto": {"name": "x"}}])
    with suppress(InvalidArgumentError, InvalidKnowledgeError):
        read(broken)


@pytest.mark.parametrize(
    ("kind", "do", "given"),
    [
        ("types", "save", {"dto": "robot"}),
        ("types", "__init__", {}),
        ("types", "_store", {}),
        ("revision", "get", {}),
        ("types", "get", {"name": "x", "self": "y"}),
        ("types", "get", ["x"]),
        ("types", "get", {}),
    ],
)
def test_only_methods_that_read_are_called_to_read(kind: str, do: str, given: Any) -> None:
    with kant_sql.connect("sqlite://") as kb:
        with pytest.raises(InvalidArgumentError):
            call(kb, kind, do, document(given), reads=True)
        assert kb.revision == 0

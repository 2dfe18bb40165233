"""Whatever stands where a DTO, a name or a list belongs is refused as bad knowledge.

Each part of each DTO is replaced by things that do not belong there, down to the parent of the
type of a term, and every method of the DAO is called with the result.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

import kant_sql
from kant_sql.errors import InvalidNameError
from tests.support.parts import dao_of
from tests.support.reading import Undone, nothing_changes, refuses
from tests.support.worlds.robots import ROBOT, robot_at

Path = tuple[str | int, ...]

VEHICLE = kant_sql.PddlTypeDto("vehicle")
CAR = kant_sql.PddlTypeDto("car", parent=VEHICLE)
C1 = kant_sql.PddlObjectDto(CAR, "c1")
PARKED = kant_sql.PddlPredicateDto("parked", [CAR])
LITERAL = kant_sql.PddlConditionEffectDto(PARKED, [C1], kant_sql.PddlConditionEffectDto.AT_END)
GOOD: dict[str, kant_sql.Dto] = {
    "types": CAR,
    "objects": C1,
    "predicates": PARKED,
    "propositions": kant_sql.PddlPropositionDto(PARKED, [C1]),
    "actions": kant_sql.PddlActionDto(
        "park", [kant_sql.PddlObjectDto(CAR, "x")], [LITERAL], [LITERAL]
    ),
}
# Anything but a value that belongs somewhere: not even an empty list.
JUNK: list[Any] = [
    *(5, 2.5, "?", b"x", [None], [5], [[]], ["?"], {"x": 1}, object(), object),
    *(robot_at(), [robot_at()]),
]
# What may be left unsaid.
OPTIONAL = {"parent", "parameter_names"}


def paths(dto: Any) -> Iterator[Path]:
    """Where in a DTO something can stand."""
    for field in dataclasses.fields(dto):
        value = getattr(dto, field.name)
        # Whether an object is a constant does not count where it is referred to.
        if field.name != "is_constant":
            yield (field.name,)
        for item, step in _items(value):
            if step is not None:
                yield (field.name, step)
            yield from ((field.name, *_steps(step), *rest) for rest in paths(item))


def _items(value: Any) -> list[tuple[Any, int | None]]:
    if isinstance(value, list):
        return [(item, position) for position, item in enumerate(value)]
    return [(value, None)] if isinstance(value, kant_sql.Dto) else []


def _steps(step: int | None) -> Path:
    return () if step is None else (step,)


def replaced(dto: kant_sql.Dto, path: Path, value: Any) -> kant_sql.Dto:
    """A copy of a DTO with something else at one place."""
    copied: Any = copy.deepcopy(dto)
    place = copied
    for step in path[:-1]:
        place = place[step] if isinstance(step, int) else getattr(place, step)
    last = path[-1]
    if isinstance(last, int):
        place[last] = value
    else:
        setattr(place, last, value)
    return copied  # type: ignore[no-any-return]


def junk_for(path: Path) -> list[Any]:
    """What belongs at a place least of all."""
    junk = JUNK if path[-1] in OPTIONAL else [None, *JUNK]
    fits = {"name": str, "duration": int | float}.get(str(path[-1]), ())
    return [value for value in junk if not isinstance(value, fits)]


def try_methods(kb: kant_sql.KnowledgeBase, kind: str, dto: kant_sql.Dto) -> None:
    dao = dao_of(kb, kind)
    for method in (dao.save, dao.insert, dao.update, lambda dto: dao.save_all([dto])):
        with suppress(Undone, kant_sql.InvalidKnowledgeError), kb.transaction():
            # An element that is there is not inserted, and one that is not is not updated.
            assert method(dto) is False
            raise Undone
    with suppress(Undone, kant_sql.InvalidKnowledgeError), kb.transaction():
        assert dao.delete(dto) in (True, False)
        raise Undone


@pytest.mark.parametrize("populated", [False, True], ids=["empty", "populated"])
@pytest.mark.parametrize("kind", GOOD)
def test_what_does_not_belong_in_a_dto_is_refused_and_nothing_of_it_stored(
    fresh_kb: kant_sql.KnowledgeBase, kind: str, populated: bool
) -> None:
    fresh_kb.propositions.save(robot_at())
    if populated:
        for other, dto in GOOD.items():
            dao_of(fresh_kb, other).save(dto)
    with nothing_changes(fresh_kb):
        for path in paths(GOOD[kind]):
            with fresh_kb.transaction():
                for junk in junk_for(path):
                    try_methods(fresh_kb, kind, replaced(GOOD[kind], path, junk))


@pytest.mark.parametrize("kind", GOOD)
def test_what_is_no_dto_of_the_kind_is_refused(fresh_kb: kant_sql.KnowledgeBase, kind: str) -> None:
    dao = dao_of(fresh_kb, kind)
    others = [dto for other, dto in GOOD.items() if other != kind]
    for wrong in [None, *JUNK[:-2], *others, LITERAL]:
        is_text = isinstance(wrong, str)
        error = kant_sql.PddlError if is_text else kant_sql.InvalidKnowledgeError
        for method in (dao.save, dao.insert, dao.update, dao.delete):
            if method == dao.delete and is_text and kind != "propositions":
                # It deletes by name, too.
                assert method(wrong) is False
                continue
            has_text = method == dao.save and wrong == ["?"]
            caught = refuses(fresh_kb, kant_sql.PddlError if has_text else error, method, wrong)
            if is_text or has_text:
                assert "'?'" in str(caught)
            elif "take lists" in str(caught):
                assert isinstance(wrong, list)
            elif kind == "propositions":
                assert "a fact" in str(caught)
                assert "(robot_at rb1 wp1)" in str(caught)
            else:
                assert type(GOOD[kind]).__name__ in str(caught)
        refuses(fresh_kb, error, dao.save_all, [GOOD[kind], wrong])


@pytest.mark.parametrize("kind", GOOD)
def test_save_all_takes_an_iterable(fresh_kb: kant_sql.KnowledgeBase, kind: str) -> None:
    dao = dao_of(fresh_kb, kind)
    for wrong in (None, 5, object(), GOOD[kind]):
        caught = refuses(fresh_kb, kant_sql.InvalidKnowledgeError, dao.save_all, wrong)
        assert "is an iterable of DTOs, not" in str(caught)


def test_what_is_no_name_cannot_be_asked_for(fresh_kb: kant_sql.KnowledgeBase) -> None:
    reads: list[Any] = [
        fresh_kb.types.get,
        fresh_kb.objects.get,
        fresh_kb.predicates.get,
        fresh_kb.actions.get,
        fresh_kb.propositions.get_by_predicate,
    ]
    for _ in range(2):
        for read in reads:
            for wrong in (None, 5, b"robot", ["robot"], ROBOT):
                refuses(fresh_kb, InvalidNameError, read, wrong)
        fresh_kb.propositions.save(robot_at())


def test_a_subclass_of_a_dto_is_one(fresh_kb: kant_sql.KnowledgeBase) -> None:
    class Place(kant_sql.PddlTypeDto):
        pass

    place = Place("place")
    fresh_kb.types.save(place)
    fresh_kb.objects.save(kant_sql.PddlObjectDto(place, "kitchen"))
    assert fresh_kb.types.get("place") == kant_sql.PddlTypeDto("place")


def test_a_tuple_does_for_a_list(fresh_kb: kant_sql.KnowledgeBase) -> None:
    fact = robot_at()
    fact.objects = tuple(fact.objects)  # type: ignore[assignment]
    fresh_kb.propositions.save(fact)
    assert fresh_kb.propositions.get_all() == [robot_at()]

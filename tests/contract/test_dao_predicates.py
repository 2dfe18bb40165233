"""Predicates and their parameters, on every backend."""

from __future__ import annotations

import pytest

from kant_sql import (
    ConflictError,
    KnowledgeBase,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.errors import ArityError
from tests.support.reading import nothing_changes, refuses, state
from tests.support.worlds.robots import ROBOT, ROBOT_AT, WAYPOINT, robot_at

Predicate = PddlPredicateDto
SWAPPED = Predicate("robot_at", [WAYPOINT, ROBOT])


@pytest.mark.parametrize(
    "predicate",
    [
        Predicate("raining"),
        Predicate("same", [ROBOT, ROBOT]),
        Predicate("anything", [PddlTypeDto("object")]),
        Predicate("wide", [PddlTypeDto(f"t{number % 7}") for number in range(100)]),
    ],
    ids=lambda predicate: predicate.name,
)
def test_any_number_of_parameters_is_kept_in_order(
    fresh_kb: KnowledgeBase, predicate: PddlPredicateDto
) -> None:
    fresh_kb.predicates.save(predicate)
    found = fresh_kb.predicates.get(predicate.name)
    assert found is not None
    assert found.types == predicate.types
    assert str(found) == str(predicate)


def test_a_predicate_has_a_hundred_parameters_at_most(fresh_kb: KnowledgeBase) -> None:
    wide = Predicate("wide", [ROBOT] * 101)
    caught = refuses(fresh_kb, ArityError, lambda: fresh_kb.predicates.save(wide))
    assert "'wide' has 101 parameters, 100 at most" in str(caught.value)


def test_types_that_are_missing_are_saved_along(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.predicates.save(Predicate("free", [PddlTypeDto("car", parent=PddlTypeDto("vehicle"))]))
    assert state(fresh_kb)["types"] == ["vehicle", "car - vehicle"]
    assert fresh_kb.revision == 1


@pytest.mark.parametrize(
    "other",
    [
        SWAPPED,
        Predicate("robot_at", [ROBOT]),
        Predicate("robot_at"),
        Predicate("robot_at", [ROBOT, WAYPOINT, WAYPOINT]),
        Predicate("ROBOT_AT", [ROBOT, PddlTypeDto("place")]),
    ],
    ids=str,
)
def test_what_refers_to_a_predicate_with_other_parameters_is_refused_naming_both(
    fresh_kb: KnowledgeBase, other: PddlPredicateDto
) -> None:
    fresh_kb.propositions.save(robot_at())
    objects = [PddlObjectDto(type_, f"o{n}") for n, type_ in enumerate(other.types)]
    caught = refuses(
        fresh_kb,
        ConflictError,
        lambda: fresh_kb.propositions.save(PddlPropositionDto(other, objects)),
    )
    assert "is stored as (robot_at ?r0 - robot ?w1 - wp)" in str(caught.value)
    assert f"refers to it as {other}" in str(caught.value)


def test_what_refers_to_a_parameter_type_with_another_parent_is_refused_naming_both(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.propositions.save(robot_at())
    rolling = PddlTypeDto("robot", parent=PddlTypeDto("machine"))
    other = Predicate("robot_at", [rolling, WAYPOINT])
    for call in (
        lambda: fresh_kb.predicates.save(other),
        lambda: fresh_kb.propositions.save(PddlPropositionDto(other, robot_at().objects)),
    ):
        caught = refuses(fresh_kb, ConflictError, call)
        assert "type 'robot' is stored as 'robot'" in str(caught.value)
        assert "'robot - machine'" in str(caught.value)


def test_saving_the_same_definition_is_no_redefinition(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    shouted = Predicate("ROBOT_AT", [PddlTypeDto("ROBOT"), PddlTypeDto("WP")])
    with nothing_changes(fresh_kb):
        assert fresh_kb.predicates.save(shouted) is True
        assert fresh_kb.predicates.update(shouted, cascade=True) is True
        assert fresh_kb.predicates.save_all([shouted]) == 0


def test_save_all_counts_what_changed(fresh_kb: KnowledgeBase) -> None:
    given = [ROBOT_AT, Predicate("raining"), ROBOT_AT, SWAPPED]
    assert fresh_kb.predicates.save_all(dto for dto in given) == 3
    assert fresh_kb.revision == 1
    assert state(fresh_kb)["predicates"] == ["(robot_at ?w0 - wp ?r1 - robot)", "(raining)"]

"""Type hierarchies of any depth are read, loaded, listed, saved and deleted in proportion."""

from __future__ import annotations

import copy
import os
import time
from pathlib import Path

import pytest

from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.errors import SourceError, TypeCycleError
from kant_sql.pddl import read_domain
from tests.support.profile import PROFILE

# More than a recursion has room for.
LEVELS = 3_000 if PROFILE.is_whole else 1_200


def chain(levels: int, prefix: str = "t") -> list[PddlTypeDto]:
    types = [PddlTypeDto(f"{prefix}0")]
    for number in range(1, levels):
        types.append(PddlTypeDto(f"{prefix}{number}", parent=types[-1]))
    return types


def domain(levels: int) -> str:
    types = " ".join(f"t{number + 1} - t{number}" for number in range(levels - 1))
    return f"(define (domain d) (:requirements :typing) (:types {types}) (:predicates (p ?x - t0)))"


@pytest.mark.more
def test_a_deep_hierarchy_is_loaded_listed_and_saved(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(domain(LEVELS))
    types = fresh_kb.types.get_all()
    assert len(types) == LEVELS
    assert fresh_kb.types.save_all(types) == 0
    deepest = fresh_kb.types.get(f"t{LEVELS - 1}")
    assert deepest is not None
    assert str(deepest) == f"t{LEVELS - 1} - t{LEVELS - 2}"
    assert fresh_kb.types.insert(deepest) is False
    fresh_kb.objects.save(PddlObjectDto(deepest, "o"))
    assert fresh_kb.store.verify().is_intact
    assert read_domain(fresh_kb.domain_pddl()) == fresh_kb.pddl.domain()
    # What is missing above is saved along.
    fresh_kb.types.save(chain(LEVELS, "u")[-1])
    assert len(fresh_kb.types.get_all()) == 2 * LEVELS
    assert fresh_kb.types.delete_all() == 2 * LEVELS


def test_a_cycle_that_is_deep_is_refused(fresh_kb: KnowledgeBase) -> None:
    types = chain(2_000)
    types[0].parent = types[-1]
    with pytest.raises(TypeCycleError):
        fresh_kb.types.save(types[-1])


def test_dtos_of_a_deep_hierarchy_are_copied_and_shown() -> None:
    deepest = chain(10_000)[-1]
    again = copy.deepcopy(deepest)
    assert again == deepest
    assert again.parent is not deepest.parent
    assert repr(again) == repr(deepest)
    assert repr(chain(2)[1]) == (
        "PddlTypeDto(name='t1', parent=PddlTypeDto(name='t0', parent=None))"
    )


def seconds(kb: KnowledgeBase, levels: int) -> float:
    types = chain(levels, f"n{levels}x")
    start = time.process_time()
    kb.types.save_all(types)
    kb.types.save_all(reversed(types))
    kb.types.get_all()
    return time.process_time() - start


def test_saving_takes_time_in_proportion(fresh_kb: KnowledgeBase) -> None:
    small = seconds(fresh_kb, 200)
    # Squared, that would be 64 times as long.
    assert seconds(fresh_kb, 1_600) < 30 * small


def test_undeclared_types_take_time_in_proportion() -> None:
    def text(count: int) -> str:
        names = " ".join(f"t{number}" for number in range(count))
        return f"(define (domain d) (:predicates (p ?x - (either {names}))))"

    found = read_domain(text(2_000))
    assert len(found.types) == 2_000
    assert sum("did you mean" in each.message for each in found.warnings) <= 20
    times = []
    for count in (1_000, 8_000):
        start = time.process_time()
        read_domain(text(count))
        times.append(time.process_time() - start)
    assert times[1] < 30 * times[0]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pipe.pddl"
    os.mkfifo(path)
    for source in (path, Path("/dev/zero"), tmp_path):
        with pytest.raises(SourceError):
            read_domain(source)

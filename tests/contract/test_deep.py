"""Formulas and types as deep as they may be, and deeper: stored, read and loaded in proportion."""

from __future__ import annotations

import copy
import os
import pickle
from pathlib import Path
from typing import Any

import pytest

from kant_sql import InvalidKnowledgeError, KnowledgeBase, PddlActionDto, PddlObjectDto, PddlTypeDto
from kant_sql.dto import formulas as f
from kant_sql.errors import SourceError, TypeCycleError
from kant_sql.pddl import read_domain, read_problem, write
from tests.contract.test_proportion import ratio
from tests.support.profile import PROFILE
from tests.support.reading import loaded, present

DOMAIN = """
(define (domain deep) (:requirements :adl :fluents :derived-predicates :constraints)
  (:types t) (:constants k - t)
  (:predicates (p) (q ?x - t) (d)) (:functions (f) - number (next ?x - t) - t)
  (:constraints {precondition})
  (:derived (d) {precondition})
  (:action a :parameters () :precondition {precondition} :effect (increase (f) {value})))
"""
PROBLEM = """
(define (problem deeper) (:domain deep) (:init (= (f) 0)) (:goal {goal})
  (:metric minimize {value}))
"""
# With the atom within, and what is around some of these formulas.
LEVELS = f.MAX_NESTING - 2


def load(kb: KnowledgeBase, opening: str, levels: int) -> tuple[Any, Any]:
    """Load documents whose formulas are all deep; a sum that is deep on the left is the metric."""
    formula = f"{opening * levels}(p){')' * levels}"
    terms = f"(q {'(next ' * levels}k{')' * levels})"
    value = f"{'(+ 1 ' * levels}(f){')' * levels}"
    text = DOMAIN.format(precondition=formula, value=value)
    domain = read_domain(text.replace(f"(:constraints {formula})", ""))
    left = f"{'(+ ' * levels}(f){' (f))' * levels}"
    goal = f"(and {formula} {terms})"
    problem = read_problem(PROBLEM.format(goal=goal, value=left), domain=domain)
    loaded(kb, write(domain), write(problem))
    return domain, problem


@pytest.mark.more
@pytest.mark.parametrize("opening", ["(or (p) ", "(exists (?x) "])
def test_what_is_deep_comes_back_equal(fresh_kb: KnowledgeBase, opening: str) -> None:
    domain, problem = load(fresh_kb, opening, LEVELS)
    assert fresh_kb.pddl.domain() == domain
    assert fresh_kb.pddl.problem() == problem
    assert fresh_kb.at(fresh_kb.revision).problem_pddl() == write(problem)
    assert fresh_kb.at(1).domain_pddl() == write(domain)
    assert fresh_kb.store.verify().is_intact
    action = fresh_kb.actions.get("a")
    assert pickle.loads(pickle.dumps(action)).conditions == action.conditions  # type: ignore[union-attr]
    fresh_kb.restore(1)
    fresh_kb.restore(2)
    assert fresh_kb.pddl.problem() == problem
    fresh_kb.load_domain(write(domain), mode="replace")
    assert fresh_kb.pddl.domain() == domain


def nested(leaf: Any, levels: int) -> Any:
    for _ in range(levels):
        leaf = f.Not(leaf)
    return leaf


def test_daos_take_and_give_what_is_deep(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(
        DOMAIN.format(precondition="(always (p))", value="1")
        .replace("(:derived (d) (always (p)))", "(:derived (d) (p))")
        .replace(":precondition (always (p))", ":precondition (p)")
    )
    term: Any = f.Variable("x")
    total: Any = f.Number(1)
    for _ in range(LEVELS // 2):
        term, total = f.Fluent("next", (term,)), f.Arithmetic("-", (total,))
    goal = f.Exists((f.TypedName("x", ("t",)),), nested(f.Atom("q", (term,)), LEVELS // 2))
    fresh_kb.goals.save(goal)
    fresh_kb.goals.save(f.Comparison("<", total, f.Fluent("f")))
    fresh_kb.pddl.metric.set(f.Metric("minimize", total))
    fresh_kb.pddl.derived_predicates.save(f.Derived("d", (), nested(f.Atom("p"), LEVELS)))
    assert fresh_kb.goals.get_all() == [goal, f.Comparison("<", total, f.Fluent("f"))]
    assert fresh_kb.pddl.metric.get() == f.Metric("minimize", total)
    assert fresh_kb.store.verify().is_intact
    assert fresh_kb.goals.insert(goal) is False
    assert fresh_kb.goals.delete(goal) is True
    assert fresh_kb.goals.delete(goal) is False
    # Deleting a type takes all that mentions it along.
    assert fresh_kb.functions.delete(fresh_kb.functions.get("f")) is True  # type: ignore[arg-type]
    assert fresh_kb.goals.get_all() == []


TOO_DEEP = "levels deep, expected at most 50 levels; name a part by a derived predicate"


@pytest.mark.more
def test_what_is_deeper_is_refused_wherever_it_comes_from(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(
        "(define (domain d) (:requirements :adl :fluents) (:predicates (p)) (:functions (f)))"
    )
    for deepest in (nested(f.Atom("p"), f.MAX_NESTING - 1), numbered(f.MAX_NESTING)):
        fresh_kb.goals.save(deepest)
        assert fresh_kb.goals.get_all() == [deepest]
        assert fresh_kb.holds(str(deepest)) in (True, False)
        assert fresh_kb.goals.delete(deepest)
    fresh_kb.goals.save(nested(f.Atom("p"), f.MAX_NESTING - 1))
    before = fresh_kb.revision
    for levels in (f.MAX_NESTING + 1, 50_000):
        for wrong in (nested(f.Atom("p"), levels - 1), numbered(levels)):
            for save in (
                lambda wrong=wrong: fresh_kb.goals.save(wrong),
                lambda wrong=wrong: fresh_kb.goals.save(str(wrong)),
                lambda wrong=wrong: fresh_kb.pddl.derived_predicates.save(
                    f.Derived("p", (), wrong)
                ),
                lambda wrong=wrong: fresh_kb.actions.save(
                    PddlActionDto("a", [], [wrong], [], durative=False)
                ),
                lambda wrong=wrong: fresh_kb.holds(str(wrong)),
                lambda wrong=wrong: fresh_kb.query(str(wrong)),
            ):
                with pytest.raises(InvalidKnowledgeError, match=TOO_DEEP):
                    save()
    assert fresh_kb.revision == before


def numbered(levels: int) -> f.Comparison:
    total: Any = f.Fluent("f")
    for _ in range(levels - 2):
        total = f.Arithmetic("-", (total,))
    return f.Comparison("<", total, f.Number(1))


# Types.


# More than a recursion has room for.
TYPE_LEVELS = 3_000 if PROFILE.is_whole else 1_200


def chain(levels: int, prefix: str = "t") -> list[PddlTypeDto]:
    types = [PddlTypeDto(f"{prefix}0")]
    for number in range(1, levels):
        types.append(PddlTypeDto(f"{prefix}{number}", parent=types[-1]))
    return types


def domain_of_types(levels: int) -> str:
    types = " ".join(f"t{number + 1} - t{number}" for number in range(levels - 1))
    return f"(define (domain d) (:requirements :typing) (:types {types}) (:predicates (p ?x - t0)))"


@pytest.mark.more
def test_a_deep_hierarchy_is_loaded_listed_and_saved(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(domain_of_types(TYPE_LEVELS))
    types = fresh_kb.types.get_all()
    assert len(types) == TYPE_LEVELS
    assert fresh_kb.types.save_all(types) == 0
    deepest = present(fresh_kb.types.get(f"t{TYPE_LEVELS - 1}"))
    assert str(deepest) == f"t{TYPE_LEVELS - 1} - t{TYPE_LEVELS - 2}"
    assert fresh_kb.types.insert(deepest) is False
    fresh_kb.objects.save(PddlObjectDto(deepest, "o"))
    assert fresh_kb.store.verify().is_intact
    assert read_domain(fresh_kb.domain_pddl()) == fresh_kb.pddl.domain()
    # What is missing above is saved along.
    fresh_kb.types.save(chain(TYPE_LEVELS, "u")[-1])
    assert len(fresh_kb.types.get_all()) == 2 * TYPE_LEVELS
    assert fresh_kb.types.delete_all() == 2 * TYPE_LEVELS


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


def test_saving_takes_time_in_proportion(fresh_kb: KnowledgeBase) -> None:
    def save(levels: int) -> None:
        types = chain(levels, f"n{levels}x")
        fresh_kb.types.save_all(types)
        fresh_kb.types.save_all(reversed(types))
        fresh_kb.types.get_all()

    # Squared, that would be 64 times as long.
    assert ratio(lambda: save(200), lambda: save(1_600)) < 30


def test_undeclared_types_take_time_in_proportion() -> None:
    def text(count: int) -> str:
        names = " ".join(f"t{number}" for number in range(count))
        return f"(define (domain d) (:predicates (p ?x - (either {names}))))"

    found = read_domain(text(2_000))
    assert len(found.types) == 2_000
    assert sum("did you mean" in each.message for each in found.warnings) <= 20
    small, large = text(1_000), text(8_000)
    assert ratio(lambda: read_domain(small), lambda: read_domain(large)) < 30


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pipe.pddl"
    os.mkfifo(path)
    for source in (path, Path("/dev/zero"), tmp_path):
        with pytest.raises(SourceError):
            read_domain(source)

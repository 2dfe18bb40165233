"""What unified-planning cannot express is refused by name; all of the competitions' files."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec

import pytest

from kant_sql import UnsupportedConstructError
from kant_sql.errors import PlannerMissingError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.planning import from_unified_planning, to_unified_planning
from tests.planning.normal_form import normal_form, spelled
from tests.planning.yard import convert, durative
from tests.support.corpus import PAIRS, needs_corpus, small_pairs
from tests.support.profile import PROFILE

unified_planning = pytest.importorskip("unified_planning")
from unified_planning.environment import Environment  # noqa: E402


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"domain": "(:derived (move) (not (move)))", "goal": "(move)"},
            r"cannot express \(move\) in the goal: .*depends on itself",
        ),
        (
            {"problem": "(:constraints (within 5 (clean t1)))"},
            r"\(within 5 \(clean t1\)\) in the constraints: within has no counterpart",
        ),
        (
            {
                "effect": "(decrease (fuel ?v) 1)",
                "problem": "(:metric minimize (+ (fuel t1) (total-time)))",
            },
            r"\(fuel t1\) in the metric: it is not a sum of costs: action move makes it better",
        ),
        (
            {
                "effect": "(increase (fuel ?v) (fuel ?v))",
                "goal": "(and (move) (preference p (clean t1)))",
                "problem": "(:metric minimize (+ (fuel t1) (is-violated p)))",
            },
            r"\(fuel t1\) in the metric: .*: the amount in action move depends on the state",
        ),
        (
            {
                "effect": "(when (clean ?v) (increase (fuel ?v) 1))",
                "goal": "(and (move) (preference p (clean t1)))",
                "problem": "(:metric minimize (+ (fuel t1) (is-violated p)))",
            },
            r"\(fuel t1\) in the metric: .*: action move changes it under a condition",
        ),
        (
            {"problem": "(:metric minimize (* (fuel t1) (total-time)))"},
            r"\(\* \(fuel t1\) \(total-time\)\) in the metric: it is not a weighted sum",
        ),
        (
            {
                "problem": """(:constraints (preference p (within 3 (clean t1))))
                (:metric minimize (is-violated p))"""
            },
            r"\(preference p \(within 3 \(clean t1\)\)\) in the constraints: no planner .* within",
        ),
        (
            {"effect": "(assign (fuel ?v) (/ (rate) 0))"},
            r"\(/ \(rate\) 0\) in action move: it divides by zero",
        ),
    ],
)
def test_what_has_no_counterpart_is_named_with_its_place(
    change: dict[str, str], message: str
) -> None:
    with pytest.raises(UnsupportedConstructError, match=message):
        convert(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"duration": "(>= ?duration 2)"}, "durative-action wash: the duration needs an upper"),
        (
            {"effect": "(when (at start (clean ?v)) (at end (not (clean ?v))))"},
            "an effect whose condition has another time",
        ),
        (
            {
                "duration": "(<= ?duration (fuel ?v))",
                "effect": "(at end (decrease (fuel ?v) ?duration))",
            },
            r"\?duration in durative-action wash",
        ),
        (
            {"duration": "(and (= ?duration (rate)) (<= ?duration (fuel ?v)))"},
            "one lower and one upper bound",
        ),
        (
            {"effect": "(forall (?x - van) (increase (fuel ?x) (* #t 2)))"},
            "a continuous effect with a condition or a quantifier",
        ),
    ],
)
def test_what_takes_time_and_has_no_counterpart(change: dict[str, str], message: str) -> None:
    with pytest.raises(UnsupportedConstructError, match=message):
        durative(**change)


def test_several_supertypes_and_objects_of_several_types_are_refused() -> None:
    two = "(define (domain d) (:types a b - object c - (either a b)) (:predicates (p)))"
    read = read_domain(two)
    problem = "(define (problem q) (:domain d) (:init) (:goal (p)))"
    with pytest.raises(UnsupportedConstructError, match="type c: it has the supertypes a and b"):
        to_unified_planning(read, problem=read_problem(problem, domain=read))
    read = read_domain("(define (domain d) (:types a b) (:predicates (p)))")
    either = "(define (problem q) (:domain d) (:objects x - (either a b)) (:init) (:goal (p)))"
    with pytest.raises(UnsupportedConstructError, match=r"object x: an object has one type"):
        to_unified_planning(read, problem=read_problem(either, domain=read))


def test_formulas_as_deep_as_they_may_be() -> None:
    goal = "(not (and (move) " * 24 + "(clean t1)" + "))" * 24
    assert len(convert(goal=goal).goals) == 1


def test_expressions_of_unified_planning_nested_too_deeply() -> None:
    problem = convert()
    manager = problem.environment.expression_manager
    goal = problem.goals[0]
    for _ in range(3_000):
        goal = manager.And(manager.Not(goal), problem.goals[0])
    problem.clear_goals()
    problem.add_goal(goal)
    with pytest.raises(UnsupportedConstructError, match="nested too deeply"):
        from_unified_planning(problem)


def test_derived_predicates_that_are_nested_too_deeply() -> None:
    rules = "".join(f"(:derived (d{n}) (not (d{n + 1})))" for n in range(2000))
    predicates = "".join(f"(d{n})" for n in range(2001))
    domain = read_domain(f"(define (domain d) (:predicates {predicates}) {rules})")
    problem = read_problem("(define (problem q) (:domain d) (:init) (:goal (d0)))", domain=domain)
    with pytest.raises(UnsupportedConstructError, match="nested too deeply"):
        to_unified_planning(domain, problem=problem)


def test_an_environment_of_its_own() -> None:
    environment = Environment()
    assert convert(environment=environment).environment is environment


def test_without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(PlannerMissingError, match=re.escape('pip install "kant-sql[planning]"')):
        convert()


def test_the_package_is_imported_without_unified_planning() -> None:
    code = "import sys; import kant_sql.planning; sys.exit('unified_planning' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert find_spec("unified_planning") is not None


@pytest.mark.more
@needs_corpus
def test_the_competitions_files_are_converted_or_refused_by_name() -> None:
    """All of them in the profile `long`, else the small ones."""
    converted = 0
    given = PAIRS if PROFILE.is_whole else small_pairs(20_000)
    for pair in given:
        read = read_domain(pair.domain)
        try:
            to_unified_planning(read, problem=read_problem(pair.problem, domain=read))
        except UnsupportedConstructError:
            continue
        converted += 1
    assert converted > len(given) * 0.6


@pytest.mark.filterwarnings("ignore")  # its reader warns of what it reads
@needs_corpus
def test_what_unified_planning_reads_itself_is_the_same() -> None:
    """All of the competitions' files in the profile `long`, else a handful."""
    from unified_planning.io import PDDLReader

    environment = unified_planning.environment.get_environment()
    environment.error_used_name = False
    compared = 0
    try:
        for pair in PAIRS if PROFILE.is_whole else small_pairs(6_000)[:12]:
            try:
                theirs = PDDLReader(environment).parse_problem(str(pair.domain), str(pair.problem))
            except Exception:
                continue
            domain, problem = (
                path.read_text(encoding="utf-8", errors="replace").lower()
                for path in (pair.domain, pair.problem)
            )
            read = read_domain(domain)
            ours = to_unified_planning(
                read, problem=read_problem(problem, domain=read), environment=environment
            )
            compared += 1
            if normal_form(ours) != normal_form(theirs):
                assert spelled(normal_form(ours)) == spelled(normal_form(theirs)), pair.name
    finally:
        environment.error_used_name = True
    assert compared >= (60 if PROFILE.is_whole else 4)

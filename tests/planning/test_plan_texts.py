"""Plans are read from the texts of planners; `texts/` has them as these print them."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import Plan, PlanStep
from kant_sql.errors import InvalidArgumentError, PddlError, SourceMissingError
from tests.support.generators.documents import NAMES

TEXTS = Path(__file__).parent / "texts"
FIRST = PlanStep(None, "walk", ("rb1", "wp1", "wp2"))
SECOND = PlanStep(None, "walk", ("rb1", "wp2", "wp3"))


def timed(step: PlanStep, start: str, duration: str | None = None) -> PlanStep:
    until = None if duration is None else Decimal(duration)
    return PlanStep(Decimal(start), step.action, step.arguments, until)


SHORT = (timed(FIRST, "0", "17.733"), timed(SECOND, "17.734", "66.433"))
SHIFTED = (timed(FIRST, "0.001", "17.733"), timed(SECOND, "17.744", "66.433"))
KNOWN: dict[str, tuple[tuple[PlanStep, ...], str, str | None]] = {
    "val.plan": (
        (
            timed(FIRST, "0.001", "5"),
            timed(PlanStep(None, "switch-on", ("lamp",)), "5.002"),
            timed(SECOND, "5.1", "7.5"),
        ),
        "",
        None,
    ),
    "fast-downward.plan": ((FIRST, SECOND), "fast-downward", "5"),
    # The cost of a plan without costs is its length, no value of a metric.
    "fast-downward-unit.plan": ((FIRST, SECOND), "fast-downward", None),
    "fast-downward.log": ((FIRST, SECOND), "fast-downward", "5"),
    "popf.log": (SHORT, "", "84.167"),
    "optic.log": (SHORT, "", "84.167"),
    "temporal-fast-downward.log": (SHIFTED, "", None),
    "temporal-fast-downward.plan": (SHIFTED, "", None),
    "enhsp.log": ((PlanStep(Decimal(0), "walk", ("rb1", "wp1", "wp3")),), "", "9"),
    "unified-planning-sequential.plan": ((FIRST, SECOND), "", None),
    "unified-planning-sequential.txt": ((FIRST, PlanStep(None, "stop")), "", None),
    "unified-planning-timed.plan": ((timed(FIRST, "0", "5"), timed(SECOND, "5.01")), "", None),
    "unified-planning-timed.txt": (
        (
            timed(FIRST, "0", "5"),
            timed(PlanStep(None, "stop"), "0.00000001"),
            timed(SECOND, "5.01"),
        ),
        "",
        None,
    ),
}


def test_each_text_is_known() -> None:
    assert {path.name for path in TEXTS.iterdir()} == set(KNOWN)


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_the_texts_of_planners_are_read(name: str, ends: str, tmp_path: Path) -> None:
    steps, engine, value = KNOWN[name]
    found = Plan.read(TEXTS / name)
    assert found == Plan(steps, engine, "solved_satisficing")
    assert found.value == (None if value is None else Decimal(value))
    assert (found.revision, found.problem_hash, found.ignored) == (None, None, ())
    other = tmp_path / name
    with other.open("w", newline=ends) as file:
        file.write("\ufeff" + (TEXTS / name).read_text())
    for source in (other, str(other), other.read_bytes().decode()):
        assert Plan.read(source) == found


def test_letters_of_any_case() -> None:
    log = (TEXTS / "optic.log").read_text().upper()
    assert [str(step) for step in Plan.read(log).steps] == [
        "0.000: (WALK RB1 WP1 WP2) [17.733]",
        "17.734: (WALK RB1 WP2 WP3) [66.433]",
    ]


def test_what_the_command_prints() -> None:
    text = "; revision 3\n; solved_optimally by fast-downward-opt\n(stop)\n"
    assert Plan.read(text) == Plan(
        (PlanStep(None, "stop"),), "fast-downward-opt", "solved_optimally"
    )
    assert Plan.read("; solved_satisficing\n(stop)\n").engine == ""


def test_goals_that_hold_need_no_step() -> None:
    for text in (
        "",
        "; cost = 0 (unit cost)\n",
        "SequentialPlan:",
        ";;;; Solution Found\n; Cost: 0.000\n",
        "[t=0s, 1 KB] Solution found!\n[t=0s, 1 KB] Plan length: 0 step(s).",
    ):
        assert Plan.read(text).steps == ()


@pytest.mark.parametrize(
    "text",
    [
        "; Plan found with metric -2.5\n0: (stop) [1]\n",
        "Found Plan:\n0.0: (stop)\n\nPlan-Length:1\nMetric (Search):-2.5\n",
        "; Version LPG-td-1.0\n; MetricValue -2.5\n\n0.0000:   (STOP) [1.0000]\n",
    ],
)
def test_the_value_of_a_metric_may_be_negative(text: str) -> None:
    assert Plan.read(text).value == Decimal("-2.5")


def test_what_a_search_by_enhsp_waits_for_is_no_step() -> None:
    text = "Found Plan:\n0.0: (open valve)\n0.0: -----waiting---- [5.0]\n5.0: (close valve)\n"
    assert [step.action for step in Plan.read(text).steps] == ["open", "close"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(walk a b)\nwalk a b", "<string>:2:1: in the plan: found 'walk a b', expected a step as"),
        ("\n  (walk a b", "<string>:2:3: in the plan: found '(walk a b', expected a step as"),
        ("(walk a b) 5]", "<string>:1:12: in the plan: found '5]', expected a duration as '[5]'"),
        ("1: (walk) [x]", "1:11: in the plan: found '[x]', expected a duration as '[5]'"),
        ("1: (walk) [5] [6]", "1:15: in the plan: found '[6]', expected the end of the line"),
        ("\n1: () [5]", "<string>:2:5: in the plan: found an empty step, expected the name of an"),
        ("-1: (walk)\n", "<string>:1:1: in the plan: found '-1: (walk)', expected a step as"),
        ("(walk :a)", "<string>:1:7: in the plan: found ':a', expected the name of an action"),
        ("(walk a\0)", "<string>:1:7: in the plan: found 'a\\x00', expected the name of an action"),
        (f"1e{'9' * 30}: (walk)", "expected a number of at most 400 digits"),
        ("SequentialPlan:\n  walk(a, b", "2:3: in the plan: found 'walk(a, b', expected a step as"),
        ("SequentialPlan:\n  walk(a,, b)", "found '', expected the name of an action or an object"),
        ("Solution found!\nwalk a b\n", "2:1: in the plan: found 'walk a b', expected a step as"),
        ("Solution found!\nwalk a b (1)", "found the end of the text, expected the line"),
        (";;;; Solution Found\n0.0: walk a [5]\n", "2:1: in the plan: found '0.0: walk a [5]'"),
    ],
)
def test_what_is_no_plan_is_refused_with_its_line(text: str, message: str) -> None:
    with pytest.raises(PddlError) as caught:
        Plan.read(text)
    assert message in str(caught.value)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(SourceMissingError, match="cannot read the file"):
        Plan.read(tmp_path / "nowhere")
    with pytest.raises(SourceMissingError):
        Plan.read("plan (2).txt")
    with pytest.raises(
        InvalidArgumentError, match="a plan is a path, or a plan's text, not int: 3"
    ):
        Plan.read(3)  # type: ignore[arg-type]
    latin = tmp_path / "latin"
    latin.write_bytes(b"; f\xfcr\n(walk caf\xe9)\n")
    with pytest.raises(PddlError, match=r"latin:2:7: in the plan"):
        Plan.read(latin)


TIMES = st.none() | st.decimals(0, 10**6, allow_nan=False, allow_infinity=False)
STEPS = st.builds(PlanStep, TIMES, NAMES, st.lists(NAMES, max_size=4).map(tuple), TIMES)


@given(st.lists(STEPS, max_size=5).map(tuple))
def test_the_text_of_a_plan_is_read_as_the_plan(steps: tuple[PlanStep, ...]) -> None:
    plan = Plan(steps, "", "solved_satisficing")
    assert Plan.read(str(plan)) == plan


@pytest.mark.more
@given(st.lists(st.tuples(NAMES, st.lists(NAMES, max_size=3)), max_size=4), st.booleans())
def test_plans_of_unified_planning(calls: list[tuple[str, list[str]]], is_timed: bool) -> None:
    """Its writer and its `str`, on names that both PDDL and its own text can have."""
    model = pytest.importorskip("unified_planning.model")
    plans = pytest.importorskip("unified_planning.plans")
    shortcuts = pytest.importorskip("unified_planning.shortcuts")
    environment = pytest.importorskip("unified_planning.environment").Environment()
    environment.error_used_name = False
    type_ = environment.type_manager.UserType("thing")
    instances = []
    for number, (_, arguments) in enumerate(calls):
        parameters = {f"p{at}": type_ for at in range(len(arguments))}
        action = model.InstantaneousAction(f"act{number}", parameters, environment)
        objects = [model.Object(f"o{at}", type_, environment) for at in range(len(arguments))]
        given_ = map(environment.expression_manager.ObjectExp, objects)
        instances.append(plans.ActionInstance(action, tuple(given_)))
    wanted = [
        (f"act{number}", tuple(f"o{at}" for at in range(len(arguments))))
        for number, (_, arguments) in enumerate(calls)
    ]
    if is_timed:
        starts = [(shortcuts.Fraction(at, 8), one, None) for at, one in enumerate(instances)]
        made = plans.TimeTriggeredPlan(starts, environment)
    else:
        made = plans.SequentialPlan(instances, environment)
    read = Plan.read(str(made))
    assert [(step.action, step.arguments) for step in read.steps] == wanted
    if is_timed:
        assert [step.start for step in read.steps] == [Decimal(at) / 8 for at in range(len(calls))]

"""The canonical text of a plan: all that it says can be read from it, so no two plans share one."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from decimal import Decimal
from hashlib import sha256
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql.errors import InvalidKnowledgeError
from kant_sql.planning import Plan, PlanStep
from kant_sql.sql.executions import ExecutionDefinition, PlanDefinition, read_outcome, status_text
from tests.support.generators.documents import NAMES

TEXTS = st.none() | st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"))
NUMBERS = st.none() | st.decimals(allow_nan=False, allow_infinity=False, places=3).map(
    "{:f}".format
)
MEMBERS = (
    *("revision", "problem-hash", "planner", "planner-version", "objective", "value", "status"),
    *("domain-pddl", "problem-pddl", "steps"),
)
STEPS = st.builds(
    ExecutionDefinition,
    NUMBERS,
    NUMBERS,
    st.just(0),
    st.none(),
    st.just(()),
    st.lists(NAMES, min_size=1, max_size=4).map(lambda names: f"({' '.join(names)})"),
)
PLANS = st.builds(
    PlanDefinition,
    st.integers(1),
    st.integers(1),
    st.text("0123456789abcdef", min_size=64, max_size=64),
    *(TEXTS, TEXTS, TEXTS, NUMBERS, TEXTS, TEXTS, TEXTS),
    st.lists(STEPS, max_size=3).map(tuple),
)


def value_at(text: str, start: int) -> tuple[Any, int]:
    """Read a quoted string, or what stands up to the next space."""
    if text[start] == '"':
        value, length = json.JSONDecoder().raw_decode(text[start:])
        return value, start + length
    end = re.compile(r"[ )]").search(text, start)
    assert end is not None
    word = text[start : end.start()]
    return None if word == "null" else word, end.start()


def steps_at(text: str, start: int) -> list[tuple[str | None, str, str | None]]:
    found = re.findall(r"\((\S+) (\([^()]*\)) ([^\s()]+)\)", text[start + 1 : -2])
    return [tuple(None if part == "null" else part for part in step) for step in found]  # type: ignore[misc]


def read(text: str) -> dict[str, Any]:
    """Read what a text says, member by member."""
    start = len("(:plan ")
    assert text.startswith("(:plan ")
    id_, end = value_at(text, start)
    said: dict[str, Any] = {"id": int(id_)}
    for name in MEMBERS[:-1]:
        assert text.startswith(f" :{name} ", end)
        said[name], end = value_at(text, end + len(f" :{name} "))
    assert text.startswith(" :steps (", end)
    said["steps"] = steps_at(text, end + len(" :steps "))
    return said


def digest(text: str | None) -> str | None:
    return None if text is None else sha256(text.encode()).hexdigest()


@given(PLANS)
def test_the_text_says_all_of_it(plan: PlanDefinition) -> None:
    assert read(plan.text) == {
        "id": plan.id,
        "revision": str(plan.revision),
        "problem-hash": plan.problem_hash,
        "planner": plan.planner,
        "planner-version": plan.planner_version,
        "objective": plan.objective,
        "value": plan.value,
        "status": plan.status,
        "domain-pddl": digest(plan.domain_pddl),
        "problem-pddl": digest(plan.problem_pddl),
        "steps": [(step.start, step.text, step.duration) for step in plan.steps],
    }


def test_a_status_is_one_line() -> None:
    assert status_text((17, 3), "running") == "(:plan 17 :step 3 started)"
    assert read_outcome("(:plan 17 :step 3 started)") == ("17.3", None, "running")


def test_what_is_no_plan_is_refused_where_it_is_made() -> None:
    anything: Any = None
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: PlanStep(None, anything), "the action of a PlanStep is a str, not NoneType"),
        (lambda: PlanStep(cast("Any", "0"), "go"), "the start of a PlanStep is a number, not str"),
        (
            lambda: PlanStep(cast("Any", True), "go"),
            "the start of a PlanStep is a number, not bool",
        ),
        (lambda: PlanStep(Decimal("NaN"), "go"), "the start of a PlanStep is a finite number"),
        (lambda: PlanStep(None, "go", cast("Any", "ab")), "the arguments of a PlanStep is a tuple"),
        (lambda: Plan(cast("Any", ["go"]), "x", "y"), "each item of the steps of a Plan is a Plan"),
        (lambda: Plan((), anything, "y"), "the engine of a Plan is a str, not NoneType: None"),
        (lambda: Plan((), "x", "y", -1), "the revision of a Plan is a whole number from 0 on"),
    ]
    for make, message in wrong:
        with pytest.raises(InvalidKnowledgeError, match=message):
            make()
    step = PlanStep(None, "go")
    assert Plan(cast("Any", [step]), "x", "y").steps == (step,)

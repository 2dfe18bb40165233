"""What `validate` says of a plan, beside what VAL says.

VAL differs in ways that this module knows, each for its reason:

- It accepts a comparison whose sides differ by at most 0.0001, also `<` and `>` of equal sides. So
  a plan that it judges otherwise is validated again with that tolerance, and must then agree.
- It breaks off at a fluent without a value on a right-hand side or in a duration, where `validate`
  names the step. It gives no verdict then.
- It checks the types of all steps before it executes any, and has `object` as a type like others
  where a domain declares it. `validate` executes up to such a step.
- Of several steps that fail at one time, it names the one that stands first in its memory.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from kant_sql import Plan
from kant_sql.knowledge import resolved
from kant_sql.pddl import Domain, Problem
from kant_sql.reasoning.validate import SIMULTANEOUS, Validation, validate_plan
from tests.meaning import val
from tests.meaning.material import Pair

_NOW = re.compile(r"Checking next happening \(time ([^)]*)\)")
_FAILING = re.compile(r"unsatisfied precondition in:\n\(([^)]*)\)")
_DIGITS = 1e-5
TOLERANCE = 1e-4
TOLERANT = {
    "<": lambda left, right: left - right < TOLERANCE,
    "<=": lambda left, right: left - right <= TOLERANCE,
    "=": lambda left, right: abs(left - right) < TOLERANCE,
    ">=": lambda left, right: left - right >= -TOLERANCE,
    ">": lambda left, right: left - right > -TOLERANCE,
}


class Judged(NamedTuple):
    """The outcome of one plan.

    Attributes:
        outcome: `valid`, `goal`, `step`, `constraint`, or `no verdict` of VAL.
        difference: how VAL disagrees; empty if it does not.
        is_tolerant: whether both agree only with VAL's tolerance of comparisons.
    """

    outcome: str
    difference: str
    is_tolerant: bool = False


class Told(NamedTuple):
    """What VAL tells: the outcome, and the time and the step at which it fails."""

    outcome: str
    time: float | None = None
    step: str = ""


def told(verdict: val.Verdict) -> Told:
    """Read what VAL tells."""
    text = verdict.output
    if verdict.refused or "Bad plan description" in text:
        return Told("refused")
    if verdict.valid:
        return Told("valid")
    if "validator failed" in text:
        return Told("no verdict")
    if "Goal not satisfied" in text:
        return Told("goal")
    if "Plan failed to execute" in text:
        times, step = _NOW.findall(text), _FAILING.search(text)
        return Told("step", float(times[-1]) if times else None, step[1].lower() if step else "")
    return Told("no verdict")


def judge(pair: Pair, domain: Domain, problem: Problem, plan: Plan, file: Path) -> Judged:
    """Judge a plan by VAL and by `validate`."""
    file.write_text(str(plan))
    verdict = val.validate(pair, file)
    ours = validate_plan(domain, problem, plan)
    difference = differs(ours, verdict)
    if not difference:
        return Judged(outcome(ours), "")
    if told(verdict).outcome == "no verdict" and not ours.valid:
        return Judged("no verdict", "")
    with tolerant():
        ours = validate_plan(domain, problem, plan)
    again = differs(ours, verdict)
    return Judged(outcome(ours), again and f"{again}\n{plan}{ours}\n{verdict.output[-1500:]}", True)


@contextmanager
def tolerant() -> Iterator[None]:
    """Compare numbers with VAL's tolerance."""
    with pytest.MonkeyPatch.context() as patch:
        for operator, compare in TOLERANT.items():
            patch.setitem(resolved.COMPARE, operator, compare)
        yield


def outcome(ours: Validation) -> str:
    """Return what is wrong first."""
    if ours.failed_step is not None:
        return "step"
    if not ours.is_goal_reached:
        return "goal"
    return "constraint" if ours.violated_constraints else "valid"


def differs(ours: Validation, verdict: val.Verdict) -> str:
    """Return how VAL's verdict differs; empty if it does not."""
    theirs, mine = told(verdict), outcome(ours)
    if ours.valid != (theirs.outcome == "valid") or theirs.outcome == "no verdict":
        return f"VAL says {theirs}, validate says {mine}"
    if ours.valid:
        return _values_differ(ours, verdict)
    if theirs.outcome == "refused":
        return "" if mine == "step" else f"VAL refuses, validate says {mine}"
    if ours.violated_constraints:
        # VAL stops at a violation, or judges the goal first.
        return ""
    if mine != theirs.outcome:
        return f"VAL says {theirs}, validate says {mine}"
    return _steps_differ(ours, theirs) if mine == "step" else ""


def _values_differ(ours: Validation, verdict: val.Verdict) -> str:
    violations = {
        name: int(count) for name, count in (one.rsplit(":", 1) for one in verdict.violations)
    }
    mine = {name.lower(): count for name, count in ours.violated_preferences.items()}
    if violations != mine:
        return f"VAL counts {violations}, validate counts {mine}"
    if ours.metric_value is None:
        return ""
    theirs, own = float(verdict.value), float(ours.metric_value)
    # VAL prints six digits.
    if abs(theirs - own) > _DIGITS * max(1, abs(own)):
        return f"VAL's value is {verdict.value}, that of validate {ours.metric_value}"
    return ""


def _steps_differ(ours: Validation, theirs: Told) -> str:
    failed = ours.failed_step
    assert failed is not None
    text = " ".join((failed.step.action, *failed.step.arguments)).lower()
    if theirs.time is None or abs(theirs.time - float(failed.time)) > _DIGITS * theirs.time + float(
        SIMULTANEOUS
    ):
        return f"VAL fails at {theirs.time}, validate at {failed.time}"
    if theirs.step and theirs.step != text and failed.step.start is None:
        return f"VAL fails at {theirs.step}, validate at {text}"
    return ""

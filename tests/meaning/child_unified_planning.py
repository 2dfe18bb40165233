"""A process that reads pairs twice with unified-planning: the originals, and ours.

Its input is a JSON list of `[name, domain, problem, our domain, our problem]`, one line for each
answer: `[name, "refused" | "equal" | "differs" | "ours refused", message]`.
"""

from __future__ import annotations

import json
import sys
from collections import Counter

from unified_planning.environment import get_environment
from unified_planning.io import PDDLReader
from unified_planning.model import Problem

# How many differences are shown.
MOST = 5


def main() -> None:
    """Answer for each pair."""
    # An action, an object and a predicate may share a name: the language keeps them apart.
    get_environment().error_used_name = False
    for name, *files in json.load(sys.stdin):
        print(json.dumps([name, *judge(*files)]), flush=True)


def judge(domain: str, problem: str, our_domain: str, our_problem: str) -> tuple[str, str]:
    """Compare what unified-planning reads."""
    try:
        original = PDDLReader().parse_problem(domain, problem)
    except Exception as error:  # It raises what comes: syntax errors, KeyError, AssertionError.
        return "refused", repr(error)
    try:
        ours = PDDLReader().parse_problem(our_domain, our_problem)
    except Exception as error:
        return "ours refused", repr(error)
    if original == ours:
        return "equal", ""
    left, right = normal_form(original), normal_form(ours)
    if left == right:
        return "equal", "in the normal form"
    lost, won = sorted(left - right)[:MOST], sorted(right - left)[:MOST]
    return "differs", f"original: {lost}, ours: {won}"


def normal_form(problem: Problem) -> Counter[str]:
    """Write a problem's lines, in spite of two things that mean nothing.

    Where a domain declares `object` itself, like any type, unified-planning has it above those
    types only that it meets after having met `object` as the type of something: no type is written
    as one below it. A conjunction within a conjunction, which our text does not keep, is flattened
    by its simplifier.
    """
    problem = problem.clone()
    simplify = problem.environment.simplifier.simplify
    for action in problem.instantaneous_actions:
        preconditions = [simplify(condition) for condition in action.preconditions]
        action.clear_preconditions()
        for condition in preconditions:
            action.add_precondition(condition)
    lines = str(problem).replace(" - object", "").splitlines()
    objects = [f"{item.name} of {item.type.name}" for item in problem.all_objects]
    return Counter(objects + [line for line in lines if not line.startswith("  object: [")])


if __name__ == "__main__":
    main()

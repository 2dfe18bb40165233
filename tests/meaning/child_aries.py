"""A process that has Aries plan for a pair, and prints the plan as VAL reads it.

Aries knows integers only, and unified-planning takes each number of PDDL for a real: a fluent is
taken for an integer here, which Aries refuses if a value is none.
"""

from __future__ import annotations

import sys

from unified_planning.environment import get_environment
from unified_planning.io import PDDLReader
from unified_planning.plans import TimeTriggeredPlan
from unified_planning.shortcuts import OneshotPlanner

from kant_sql.planning.worker import engine_parameters


def main(domain: str, problem: str, seconds: str) -> None:
    """Print the plan, a line for each action."""
    environment = get_environment()
    environment.credits_stream = None
    environment.error_used_name = False
    integer = environment.type_manager.IntType
    environment.type_manager.RealType = lambda *_, **__: integer()
    task = PDDLReader().parse_problem(domain, problem)
    with OneshotPlanner(name="aries", params=engine_parameters("aries")) as planner:
        planner.skip_checks = True
        result = planner.solve(task, timeout=float(seconds))
    if not isinstance(result.plan, TimeTriggeredPlan):
        sys.exit(f"no plan: {result.status.name} {result.log_messages}")
    for start, step, duration in result.plan.timed_actions:
        action = " ".join([step.action.name, *map(str, step.actual_parameters)])
        lasts = "" if duration is None else f" [{float(duration)}]"
        print(f"{float(start)}: ({action}){lasts}")


if __name__ == "__main__":
    main(*sys.argv[1:])

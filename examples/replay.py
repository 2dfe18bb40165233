"""Replay a failed mission: the planner's input, and the changes that each step made.

python examples/replay.py [URL]

By default, the store is in memory. The rounds are those of `kant-sql demo failed-plan`.
"""

from __future__ import annotations

import sys

import kant_sql
from kant_sql import Execution, KnowledgeBase
from kant_sql.planning import Plan
from kant_sql.plans import RecordedPlan
from kant_sql_plugins.demo.failed_plan import DOMAIN, PROBLEM, STEPS


def execute(kb: KnowledgeBase, step: Execution) -> bool:
    """Execute a step, unless the place is shut; save the observation."""
    if step.arguments[-1] != "lab":
        kb.apply(step)
        return True
    kb.plans.set_status(step, status="running")
    with kb.transaction(reason="the door is shut", execution=step):
        kb.propositions.delete("(open lab)")
        kb.plans.set_status(step, status="failed")
    return False


def carry_out(kb: KnowledgeBase, plan: RecordedPlan) -> None:
    """Execute the steps until one fails."""
    has_failed = False
    for step in plan.steps:
        if has_failed:
            kb.plans.set_status(step, status="aborted")
        else:
            has_failed = not execute(kb, step)


def run(kb: KnowledgeBase) -> int:
    """Plan and act; return the plan's id, from which it can be replayed."""
    with kb.transaction(actor="operator", reason="the night's rounds"):
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
    plan = kb.plans.record(Plan(STEPS, "the night planner", "solved_satisficing"))
    carry_out(kb, plan)
    # The robot is put back, and the night continues.
    with kb.transaction(actor="operator", reason="brought home"):
        kb.propositions.delete("(at rb1 kitchen)")
        kb.propositions.save("(at rb1 hall)")
    return plan.id


def replay(kb: KnowledgeBase, plan_id: int) -> None:
    """Print the planner's input, and the changes of each step."""
    plan = kb.plans.get(plan_id)
    assert plan is not None
    print(f"Plan {plan.id} was made from revision {plan.revision} by {plan.planner}. It was given")
    print(plan.problem_pddl())
    for step in plan.steps:
        print(f"{step.position} {step} {step.outcome or 'was not started'}")
        for number in step.revisions:
            (entry,) = kb.log(since=number, until=number)
            for change in entry.changes:
                if change.kind == "fact":
                    print(f"    {entry.revision.number}: {change.sign} {change.text}")


def main(url: str) -> None:
    """Run a failing mission, and replay it."""
    with kant_sql.connect(url, knowledge_base="rounds", actor="executive") as kb:
        replay(kb, run(kb))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sqlite://")

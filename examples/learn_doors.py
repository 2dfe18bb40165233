"""A robot learns which doors to avoid: it plans with the outcomes of its steps.

python examples/learn_doors.py [URL] [MISSIONS]

The building is that of `kant-sql demo warehouse`. By default, the store is in memory, and there are
200 missions each way. It needs planners: pip install 'kant-sql[planning]'.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from typing import Literal

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql_plugins.demo.warehouse import DOMAIN, LONG, PROBLEM, Building

BEGIN = datetime(2026, 3, 2, 8, tzinfo=UTC)


def missions(
    building: Building, kb: KnowledgeBase, count: int, costs: Literal["history"] | None
) -> float:
    """Plan and execute missions, and print the results; return the share of success."""
    began = building.now
    plan = kb.plan("fast-downward-opt", costs=costs, timeout=120)
    kb.plans.record(plan)
    reached = sum(building.mission(plan) for _ in range(count))
    seconds = (building.now - began).total_seconds() / count
    way = " ".join(step.arguments[0] for step in plan.steps)
    print(f"{count} missions by {way}: {reached / count:.1%} succeeded, {seconds:.1f} s each")
    return reached / count


def main(url: str, count: int) -> None:
    """Execute missions by the shortest way, then with the learned costs."""
    with kant_sql.connect(url, knowledge_base="building", actor="operator") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        building = Building(kb, BEGIN)
        # A new robot is shown each door a few times.
        for _ in range(5):
            building.mission(LONG)
        before = missions(building, kb, count, None)
        after = missions(building, kb, count, "history")
        for door in kb.statistics(by=["arguments"]):
            low, high = door.interval or (0, 1)
            print(f"{door} {door.count} times, {low:.0%} to {high:.0%} succeed, {door.median:g} s")
        print("Learning helped." if after > before else "Learning did not help.")


if __name__ == "__main__":
    words = sys.argv[1:]
    main(words[0] if words else "sqlite://", int(words[1]) if len(words) > 1 else 200)

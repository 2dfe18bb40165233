"""The waypoint walk-through of the KANT paper: where the robot is, and its goal.

python examples/navigation.py [URL]

By default, the store is in memory.
"""

from __future__ import annotations

import sys

from kant_sql import (
    DaoFactory,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    create_dao_factory,
)

AT_START, AT_END = PddlConditionEffectDto.AT_START, PddlConditionEffectDto.AT_END

robot, wp = PddlTypeDto("robot"), PddlTypeDto("wp")
robot_at = PddlPredicateDto("robot_at", [robot, wp])
rb1, wp1, wp2 = PddlObjectDto(robot, "rb1"), PddlObjectDto(wp, "wp1"), PddlObjectDto(wp, "wp2")
r, s, d = PddlObjectDto(robot, "r"), PddlObjectDto(wp, "s"), PddlObjectDto(wp, "d")
navigation = PddlActionDto(
    "navigation",
    parameters=[r, s, d],
    conditions=[PddlConditionEffectDto(robot_at, [r, s], AT_START)],
    effects=[
        PddlConditionEffectDto(robot_at, [r, s], AT_START, is_negative=True),
        PddlConditionEffectDto(robot_at, [r, d], AT_END),
    ],
)


def walk_through(factory: DaoFactory) -> None:
    """Save the robot's knowledge, read it, drive, and look back."""
    propositions, goals = factory.create_pddl_proposition_dao(), factory.create_goal_dao()
    actions = factory.create_pddl_action_dao()
    here, there = (PddlPropositionDto(robot_at, [rb1, place]) for place in (wp1, wp2))

    propositions.delete_all()  # left by an earlier run; the history keeps it
    # The first save also saves the missing types, predicate and objects.
    propositions.save(here)
    goals.save(there)
    actions.save(navigation)
    before = factory.revision

    print("Objects:", *factory.create_pddl_object_dao().get_all(), sep="\n  ")
    print("Facts:", *propositions.get_all(), sep="\n  ")
    print("Goals:", *goals.get_all(), sep="\n  ")
    print(actions.get("navigation"))

    with factory.transaction(actor="executive", reason="navigation to wp2 finished"):
        propositions.delete(here)
        propositions.save(there)

    past = factory.at(before).create_pddl_proposition_dao()
    print("Facts now:", *propositions.get_all(), sep="\n  ")
    print(f"Facts at revision {before}:", *past.get_all(), sep="\n  ")
    print("All that happened:")
    for entry in KnowledgeBase(factory).log():
        print(f"  {entry.revision.number} {entry.revision.actor}: {entry.revision.reason or '-'}")
        for change in entry.changes:
            print(f"    {change.sign} {change.kind} {change.text.splitlines()[0]}")


if __name__ == "__main__":
    url = sys.argv[1] if len(sys.argv) > 1 else "sqlite://"
    # The URL selects the DAO family; its factory creates one DAO per element.
    waypoints = create_dao_factory(url, knowledge_base="waypoints", actor="operator")
    try:
        walk_through(waypoints)
    finally:
        waypoints.close()

"""Several robots patrol at once in one event loop, while a monitor follows the changes."""

from __future__ import annotations

import asyncio
import sys
from itertools import pairwise

from kant_sql import PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto, aio
from kant_sql.aio import AsyncKnowledgeBase

ROBOT, PLACE = PddlTypeDto("robot"), PddlTypeDto("place")
AT = PddlPredicateDto("at", [ROBOT, PLACE])
ROBOTS = ("rb1", "rb2", "rb3")
TOUR = [PddlObjectDto(PLACE, name) for name in ("dock", "hall", "kitchen", "dock")]


def at(robot: str, place: PddlObjectDto) -> PddlPropositionDto:
    """Return the fact that a robot is at a place."""
    return PddlPropositionDto(AT, [PddlObjectDto(ROBOT, robot), place])


async def patrol(kb: AsyncKnowledgeBase, robot: str) -> None:
    """Go from place to place; each arrival is one revision of that robot."""
    await kb.propositions.save(at(robot, TOUR[0]))
    for before, after in pairwise(TOUR):
        await asyncio.sleep(0.01)  # The robot drives.
        async with kb.transaction(actor=robot, reason=f"arrived at {after.name}"):
            await kb.propositions.delete(at(robot, before))
            await kb.propositions.save(at(robot, after))


async def monitor(kb: AsyncKnowledgeBase, robots: int) -> None:
    """Print changes as they are committed, until each robot is back at the dock."""
    seen = 0
    while robots:
        await kb.watch(seen)
        async for entry in kb.changes(seen):
            seen = entry.revision.number
            if entry.revision.reason is not None:
                print(f"{entry.revision.actor} {entry.revision.reason}")
                robots -= entry.revision.reason == f"arrived at {TOUR[-1].name}"


async def main(url: str) -> None:
    """Run three patrols, and print where the robots are."""
    async with aio.connect(url, knowledge_base="patrol", actor="setup") as kb:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(monitor(kb, len(ROBOTS)))
            for name in ROBOTS:
                tasks.create_task(patrol(kb, name))
        for fact in await kb.propositions.get_all():
            print(fact)
        print(f"revision {await kb.revision()}")


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1] if len(sys.argv) > 1 else "sqlite://"))

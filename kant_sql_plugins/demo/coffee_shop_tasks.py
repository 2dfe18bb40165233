"""What the robot does in the coffee shop: five tasks, each by calls of its components.

After the timed tasks of the KANT paper (Gonzalez-Santamarta et al., 2022).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields

from kant_sql import KnowledgeBase, PddlObjectDto, PddlPropositionDto

from . import coffee_shop_world as world
from .coffee_shop_world import fact, goal

SEEN = {  # in the order of the round
    "table1": world.FREE,
    "table2": world.OCCUPIED,
    "table3": world.DIRTY,
    "table6": world.FREE,
    "table5": world.FREE,
    "table4": world.OCCUPIED,
}
TAKEN = {
    "order1": ("table2", ("espresso", "croissant")),
    "order2": ("table4", ("latte", "soup")),
    "order3": ("table2", ("tea", "muffin")),
}
BY_NAME = {object_.name: object_ for object_ in world.OBJECTS}


Ways = list[tuple[PddlObjectDto, PddlObjectDto]]


@dataclass(frozen=True)
class Robot:
    """The robot's components: each has its own connection and is the actor of its writes."""

    mission: KnowledgeBase
    planner: KnowledgeBase
    executive: KnowledgeBase
    perception: KnowledgeBase
    guidance: KnowledgeBase
    waiter_ui: KnowledgeBase
    kitchen_ui: KnowledgeBase

    def close(self) -> None:
        """Close all connections."""
        for field in fields(self):
            getattr(self, field.name).close()


def connect_robot(connect: Callable[[str], KnowledgeBase]) -> Robot:
    """Connect each component by its name."""
    return Robot(*(connect(field.name) for field in fields(Robot)))


# Operations shared by the tasks.


def replace(
    component: KnowledgeBase,
    reason: str,
    old: Iterable[PddlPropositionDto],
    new: Iterable[PddlPropositionDto],
) -> None:
    """Replace facts by others, atomically."""
    with component.transaction(reason=reason):
        for proposition in old:
            component.propositions.delete(proposition)
        for proposition in new:
            component.propositions.save(proposition)


def plan(robot: Robot, *actions: str) -> Ways:
    """Read the goals, the actions and the connections, as a planner does."""
    planner = robot.planner
    planner.goals.get_propositions()
    for name in actions:
        planner.actions.get(name)
    return [
        (way.objects[0], way.objects[1])
        for way in planner.propositions.get_by_predicate("connected")
    ]


def reach(robot: Robot, wanted: PddlPropositionDto) -> None:
    """Delete a reached goal."""
    if wanted in robot.mission.goals.get_propositions():
        robot.mission.goals.delete(wanted)


def navigate(robot: Robot, ways: Ways, destination: PddlObjectDto) -> None:
    """Drive somewhere, from one connected place to the next."""
    (position,) = robot.executive.propositions.get_by_predicate("robot_at")
    here = position.objects[1]
    for there in route(ways, here, destination):
        replace(
            robot.executive,
            f"navigation to {there.name} finished",
            [fact(world.ROBOT_AT, world.RB1, here)],
            [fact(world.ROBOT_AT, world.RB1, there)],
        )
        here = there


def route(ways: Ways, start: PddlObjectDto, end: PddlObjectDto) -> list[PddlObjectDto]:
    """Return the shortest path over connected places."""
    paths, known = deque([[start]]), {start}
    while paths[0][-1] != end:
        path = paths.popleft()
        for here, there in ways:
            if here == path[-1] and there not in known:
                known.add(there)
                paths.append([*path, there])
    return paths[0][1:]


# The five tasks.


def reset(robot: Robot) -> None:
    """Delete everything; the history stays."""
    mission = robot.mission
    mission.propositions.delete_all()
    mission.goals.delete_all()
    for dao in (mission.actions, mission.predicates, mission.objects, mission.types):
        dao.delete_all()


def load(robot: Robot) -> None:
    """Save the initial PDDL, element by element."""
    mission = robot.mission
    for type_ in world.TYPES:
        mission.types.save(type_)
    for object_ in world.OBJECTS:
        mission.objects.save(object_)
    for predicate in world.PREDICATES:
        mission.predicates.save(predicate)
    for action in world.ACTIONS:
        mission.actions.save(action)
    for proposition in world.FACTS:
        mission.propositions.save(proposition)


def check_tables(robot: Robot) -> None:
    """Look at each table once."""
    for name, status in SEEN.items():
        table = BY_NAME[name]
        wanted = goal(world.CHECKED, table)
        robot.mission.goals.save(wanted)
        ways = plan(robot, "navigation", "check_table")
        navigate(robot, ways, table)
        replace(
            robot.perception,
            f"the camera sees that {name} is {status.name}",
            [fact(world.TABLE_IS, table, world.UNKNOWN)],
            [fact(world.TABLE_IS, table, status)],
        )
        robot.executive.propositions.save(fact(world.CHECKED, table))
        reach(robot, wanted)


def serve_orders(robot: Robot) -> None:
    """Take each order, bring its items one by one, and close it."""
    for order_name, (table_name, item_names) in TAKEN.items():
        order, table = BY_NAME[order_name], BY_NAME[table_name]
        items = [BY_NAME[name] for name in item_names]
        taken = [fact(world.ORDER_OF, order, table)]
        taken += [fact(world.ORDERED, order, item) for item in items]
        replace(robot.waiter_ui, f"a guest at {table_name} has ordered", [], taken)
        for item in items:
            robot.mission.goals.save(goal(world.DELIVERED, order, item))
        ways = plan(robot, "navigation", "pick_item", "deliver_item")
        makers = robot.planner.propositions.get_by_predicate("made_at")
        for item in items:
            place = next(made.objects[1] for made in makers if made.objects[0] == item)
            robot.kitchen_ui.propositions.save(fact(world.READY, item, place))
            navigate(robot, ways, place)
            pick_up(robot, item, place)
            navigate(robot, ways, table)
            hand_over(robot, item, order)
        replace(robot.waiter_ui, f"{order_name} is paid", taken, [])


def pick_up(robot: Robot, item: PddlObjectDto, place: PddlObjectDto) -> None:
    """Take a ready item."""
    replace(
        robot.executive,
        f"{item.name} picked up",
        [fact(world.READY, item, place), fact(world.HANDS_FREE, world.RB1)],
        [fact(world.HOLDING, world.RB1, item)],
    )


def hand_over(robot: Robot, item: PddlObjectDto, order: PddlObjectDto) -> None:
    """Give an item to the guests who ordered it."""
    replace(
        robot.executive,
        f"{item.name} handed over",
        [fact(world.HOLDING, world.RB1, item)],
        [fact(world.HANDS_FREE, world.RB1), fact(world.DELIVERED, order, item)],
    )
    reach(robot, goal(world.DELIVERED, order, item))


def guide_persons(robot: Robot) -> None:
    """Fetch each guest at the entrance, and bring them to a free table."""
    door, rb1 = world.ENTRANCE, world.RB1
    for guest in world.GUESTS:
        robot.perception.propositions.save(fact(world.PERSON_AT, guest, door))
        robot.perception.propositions.save(fact(world.WAITING, guest))
        tables = robot.planner.propositions.get_by_predicate("table_is")
        table = next(seen.objects[0] for seen in tables if seen.objects[1] == world.FREE)
        wanted = goal(world.SEATED, guest, table)
        robot.mission.goals.save(wanted)
        ways = plan(robot, "navigation", "greet_person", "guide_person")
        navigate(robot, ways, door)
        robot.guidance.propositions.save(fact(world.GREETED, guest))
        replace(
            robot.guidance,
            f"{guest.name} followed to {table.name}",
            [fact(world.ROBOT_AT, rb1, door), fact(world.PERSON_AT, guest, door)],
            [fact(world.ROBOT_AT, rb1, table), fact(world.PERSON_AT, guest, table)],
        )
        replace(
            robot.perception,
            f"the camera sees {guest.name} sit down",
            [fact(world.WAITING, guest), fact(world.TABLE_IS, table, world.FREE)],
            [fact(world.SEATED, guest, table), fact(world.TABLE_IS, table, world.OCCUPIED)],
        )
        reach(robot, wanted)


TASKS: dict[str, Callable[[Robot], None]] = {
    "TtR": reset,
    "TtL": load,
    "TtC": check_tables,
    "TtS": serve_orders,
    "TtG": guide_persons,
}

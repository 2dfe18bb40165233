"""A coffee shop that a robot serves: several components share what it knows."""

from __future__ import annotations

from collections.abc import Sequence

from kant_sql import KnowledgeBase

from .coffee_shop_tasks import TASKS, connect_robot
from .stories import Connect, Step, World

CARLA, TAKEN = "(waiting carla)", "(table_is ?table occupied)"


def fill(connect: Connect) -> None:
    """Write the story of a morning: each component is the actor of its writes."""
    robot = connect_robot(connect)
    for task in TASKS.values():
        task(robot)


def steps(kb: KnowledgeBase) -> Sequence[Step]:
    """Make the steps of the page."""
    paid = next(one.until for one in kb.history("(ordered order1 espresso)") if one.until)
    then = paid.number - 1
    left = next(one.until for one in kb.history("(robot_at rb1 charger)") if one.until)
    ((place,),) = kb.query("(robot_at rb1 ?place)")
    here = f"(robot_at rb1 {place})"
    return (
        Step(
            "Who works here?",
            "Every write is a revision, with its time, its actor and its reason. Here are the "
            "kitchen's: it says what is ready.",
            *("/log", {"actor": "kitchen_ui"}, "log --actor kitchen_ui"),
            '[entry.changes[0].text for entry in kb.log(actor="kitchen_ui")]',
        ),
        Step(
            "Where was the robot all morning?",
            "The timeline draws facts in the colour of who asserted them. Point at a bar to "
            "see its reason; click the axis to zoom in.",
            *("/timeline", {"object": "rb1", "since": left.number}),
            *("when '(robot_at rb1 ?place)'", 'len(kb.when("(robot_at rb1 ?place)"))'),
        ),
        Step(
            "Who says that it is there now?",
            "The page of a fact has everybody who ever asserted or retracted it.",
            *("/fact", {"text": here}, f"blame '{here}'"),
            f'kb.blame("{here}").since.reason',
        ),
        Step(
            "Which tables are taken?",
            "Ask any condition in PDDL; the page has the SQL that found the answer, too.",
            *("/ask", {"condition": TAKEN}, f"query '{TAKEN}'"),
            f'kb.query("{TAKEN}").to_dicts()',
        ),
        Step(
            "What did it know before the first guest paid?",
            f"The state after revision {then} is as complete as the one of now: move the slider "
            "to any other.",
            *("/state", {"at": then, "predicate": "ordered"}, f"show --at {then}"),
            f'kb.at({then}).query("(ordered order1 ?item)").to_dicts()',
        ),
        Step(
            "What changed since then?",
            "Two states side by side, and the revisions between them.",
            *("/difference", {"a": then}, f"diff {then} now"),
            f"[change.text for change in kb.diff({then}, kb.revision)]",
        ),
        Step(
            "How long did carla wait?",
            "Conditions can be asked of the past, too: each period, with who began and ended it.",
            *("/ask", {"condition": CARLA, "mode": "when"}, f"when '{CARLA}'"),
            f'[str(held) for held in kb.when("{CARLA}")]',
        ),
    )


WORLD = World(
    "coffee-shop",
    "a robot serves guests: where it was, what it knew, and who said so",
    "A robot checks tables, serves orders and guides guests. Its components, from the camera to "
    "the kitchen, share one knowledge base, which forgets nothing.",
    fill,
    steps,
)

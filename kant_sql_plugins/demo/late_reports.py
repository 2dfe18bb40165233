"""A week with late reports: what was true, and what was known, are two questions."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, time, timedelta

from kant_sql import KnowledgeBase

from .stories import Connect, Step, World

DOMAIN = """
(define (domain museum)
  (:requirements :typing :fluents :object-fluents)
  (:types painting room)
  (:predicates (open ?r - room))
  (:functions (place ?x - painting) - room (humidity ?r - room) - number))
"""
ROOMS = ("hall", "workshop", "depot")
PLACE, RISK = "(= (place iris) ?room)", "(and (= (place iris) depot) (open depot))"
# What the sensor of the depot measured on the third night, hour by hour from 20:00.
HUMIDITY = (45, 45, 46, 52, 60, 66, 70, 72, 73, 73, 71, 58, 49, 46)


def beginning(kb: KnowledgeBase) -> datetime:
    """Return the midnight at which the story begins, a week before it was written."""
    (first,) = kb.store.revisions(after=0, limit=1)
    return datetime.combine(first.committed_at.date() - timedelta(days=7), time(), UTC)


def fill(connect: Connect) -> None:
    """Write the story of a week, in the order in which its reports came."""
    curator = connect("curator")
    curator.load_domain(DOMAIN)
    curator.objects.save_all(["iris - painting", *(f"{room} - room" for room in ROOMS)])
    begin = beginning(curator)

    def at(hours: float | None) -> datetime | None:
        return None if hours is None else begin + timedelta(hours=hours)

    def say(actor: str, reason: str, room: str, since: float, until: float | None = None) -> None:
        kb = connect(actor)
        with kb.transaction(reason=reason, valid_from=at(since), valid_until=at(until)):
            kb.function_values.set("(place iris)", value=room)

    say("curator", "the inventory", "hall", 8)
    say("camera", "carried to the workshop", "workshop", 33)
    say("guard", "back on its wall", "hall", 81)
    door = connect("door")
    with door.transaction(reason="the log of the week", valid_from=at(70), valid_until=at(78)):
        door.propositions.save("(open depot)")
    sensor = connect("sensor")
    for hour, value in enumerate(HUMIDITY, start=68):
        file = {"file": "depot.csv"}
        with sensor.transaction(source=file, valid_from=at(hour), valid_until=at(hour + 1)):
            sensor.function_values.set("(humidity depot)", value=value)
    say("restorer", "I had put it into the depot, and told nobody", "depot", 58, 81)


def steps(kb: KnowledgeBase) -> Sequence[Step]:
    """Make the steps of the page."""
    begin, last = beginning(kb), kb.revision
    night = begin + timedelta(hours=71)
    day, hour = f"{night:%A}", f"{night:%Y-%m-%d %H:%M}"
    before = f"{night - timedelta(days=1):%Y-%m-%d %H:%M}"
    return (
        Step(
            "Where was the painting in the week?",
            "By the clock of the world, the timeline has a bar for each room: hall, workshop, "
            "depot, hall. No report came in time, and none came in order.",
            *("/timeline", {"object": "iris", "clock": "valid", "since": begin.isoformat()}),
            f"when '{PLACE}' --clock valid",
            f'[str(held) for held in kb.when("{PLACE}", clock="valid")]',
        ),
        Step(
            f"Where was it on {day} at 23:00?",
            "In the depot, as is known now.",
            *("/ask", {"condition": PLACE, "valid": hour}),
            f"query '{PLACE}' --valid '{hour}'",
            f'kb.at(valid="{hour}").query("{PLACE}").to_dicts()',
        ),
        Step(
            "And what did everybody believe before the last report?",
            f"Before revision {last}, the same question had another answer: in the workshop. The "
            "record keeps both clocks.",
            *("/ask", {"condition": PLACE, "valid": hour, "at": last - 1}),
            f"query '{PLACE}' --valid '{hour}' --at {last - 1}",
            f'kb.at(known={last - 1}, valid="{hour}").query("{PLACE}").to_dicts()',
        ),
        Step(
            "Who said something else, and when?",
            "The restorer, in the last revision, which is about a past time.",
            *("/corrections", {"since": last}, f"corrections --since {last}"),
            "[(one.believed.content, one.said.content) for one in kb.corrections(limit=1)]",
        ),
        Step(
            "Did it lie in a room with an open door?",
            "Yes, for eight hours. The door log and the restorer's report came on their own; the "
            "question joins them.",
            *("/ask", {"condition": RISK, "mode": "when", "clock": "valid"}),
            f"when '{RISK}' --clock valid",
            f'[str(held) for held in kb.when("{RISK}", clock="valid")]',
        ),
        Step(
            "How humid was it meanwhile?",
            "The sensor's file came as a whole, too; the timeline draws its values at the hours of "
            "which they speak.",
            "/timeline",
            {
                "predicate": "humidity",
                "clock": "valid",
                "since": (begin + timedelta(hours=66)).isoformat(),
                "until": (begin + timedelta(hours=84)).isoformat(),
            },
            f"show --valid '{hour}'",
            f'kb.at(valid="{hour}").function_values.get("(humidity depot)")',
        ),
        Step(
            "What differed from the day before?",
            "Two times can be compared like two revisions.",
            *("/difference", {"a": before, "b": hour, "clock": "valid"}),
            f"diff '{before}' '{hour}' --clock valid",
            f'[change.text for change in kb.diff("{before}", "{hour}", clock="valid")]',
        ),
    )


WORLD = World(
    "late-reports",
    "a week with late reports: what was true, and who knew it when",
    "A museum lost sight of a painting for a week. The reports of cameras, doors and people came "
    "late and out of order. Find where it was, and whether it was in danger.",
    fill,
    steps,
)

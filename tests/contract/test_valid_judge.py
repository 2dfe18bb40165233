"""What was true at any time, as known at any revision, judged by a replay of all that was said.

KANT_SQL_TEST_EXAMPLES=400 hunts for longer: 20,000 reads on each backend.
"""

from __future__ import annotations

from datetime import datetime
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from kant_sql import KnowledgeBase
from tests.support.profile import hunting
from tests.support.two_clocks import FACTS, FLUENTS, OBJECTS, Content, Model, Writer

READS = 10


def test_every_read_says_what_was_said_last(fresh_kb: KnowledgeBase) -> None:
    writer = Writer(fresh_kb, seed=7)
    writer.run(30)

    @hunting(10)
    @given(st.integers(0, 2**32 - 1))
    def same(seed: int) -> None:
        random = Random(seed)
        if random.random() < 0.2:
            writer.random = random
            writer.step()
        for _ in range(READS):
            judge(fresh_kb, writer.model, random)

    same()


def test_corrections_are_all_that_was_believed_otherwise(fresh_kb: KnowledgeBase) -> None:
    writer = Writer(fresh_kb, seed=11)
    model = writer.run(40)
    found = fresh_kb.corrections()
    assert [one.said.revision.number for one in found if one.said.revision] == sorted(
        (one.said.revision.number for one in found if one.said.revision), reverse=True
    )
    moments = model.moments()
    for said in model.sayings:
        own = [
            one
            for one in found
            if one.text == said.element
            and one.said.revision
            and one.said.revision.number == said.since
        ]
        for moment in moments:
            if not said.valid_from <= moment < said.valid_until:
                continue
            before = model.truth(said.element, moment, said.since - 1)
            covering = [one for one in own if one.valid_from <= moment < one.valid_until]
            assert len(covering) == (before != said.content), (said, moment)
            for one in covering:
                assert (one.believed.content, one.said.content) == (shown(before), shown(said[1]))
    numbers = [said.since for said in model.sayings]
    some = fresh_kb.corrections(since=numbers[len(numbers) // 2], limit=3)
    assert some == found[:3]


def shown(content: Content) -> str:
    """How a correction says it."""
    names = {True: "held", False: "not held", None: "no value"}
    return names[content] if content in (True, False, None) else str(content)


def judge(kb: KnowledgeBase, model: Model, random: Random) -> None:
    """Compare seven reads of one state."""
    last = max(model.times)
    moment = random.choice([one for one in model.moments() if one <= model.times[last]])
    known = random.randint(2, last)  # From then on there are objects.
    then = kb.at(known=known, valid=moment)
    truth = {one: model.truth(one, moment, known) for one in (*FACTS, *FLUENTS)}
    facts = {str(dto) for dto in then.propositions.get_all()}
    assert facts == {fact for fact in FACTS if truth[fact]}, where(moment, known)
    values = {f"({v.function.name} {v.objects[0].name})": v for v in then.function_values.get_all()}
    found = {name: said(value.value) for name, value in values.items()}
    assert found == {one: truth[one] for one in FLUENTS if truth[one] is not None}
    at = {f"(at {robot} {room})" for robot, room in then.query("(at ?r ?p)")}
    assert at == {fact for fact in FACTS if fact.startswith("(at") and truth[fact]}
    unclean = {room for room in OBJECTS["room"] if not truth[f"(clean {room})"]}
    assert {room for (room,) in then.query("(not (clean ?p))")} == unclean, where(moment, known)
    asked = random.choice(FACTS)
    assert then.holds(asked) is truth[asked], (asked, where(moment, known))
    charged = {r for r in OBJECTS["robot"] if int(str(truth[f"(battery {r})"] or -1)) >= 5}
    assert {robot for (robot,) in then.query("(>= (battery ?r) 5)")} == charged
    home = {f"(home {robot})": room for robot, room in then.query("(= (home ?r) ?p)")}
    assert home == {one: truth[one] for one in FLUENTS if one.startswith("(home") and truth[one]}


def said(value: object) -> Content:
    return str(getattr(value, "name", value))


def where(moment: datetime, known: int) -> str:
    return f"valid {moment.isoformat()}, known {known}"

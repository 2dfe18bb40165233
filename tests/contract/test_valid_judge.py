"""What was true at any time, as known at any revision, judged by a replay of all that was said.

KANT_SQL_TEST_EXAMPLES=400 hunts for longer: 20,000 reads on each backend.
"""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import pairwise
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.sql import valid_time
from kant_sql.store import valid_store
from tests.support.profile import hunting
from tests.support.reading import loaded
from tests.support.two_clocks import FACTS, FLUENTS, OBJECTS, Content, Model, Plain, Writer

READS = 10
AFTER = datetime.max.replace(tzinfo=UTC)


@pytest.mark.parametrize("few", [valid_time.FEW, 0], ids=["listed", "looked up"])
def test_every_read_says_what_was_said_last(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, few: int
) -> None:
    monkeypatch.setattr(valid_time, "FEW", few)
    monkeypatch.setattr(valid_store, "FIRST_USES", 0)
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
    model = Writer(fresh_kb).run(60)
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


# What is defined otherwise, as it is then, and what fits no more.
REDEFINED: dict[str, tuple[str, str, str]] = {
    "predicates of another type": ("(clean ?p - room)", "(clean ?p - robot)", "(clean"),
    "predicates with fewer arguments": ("(at ?r - robot ?p - room)", "(at ?r - robot)", "(at"),
    "predicates with more arguments": ("(open)", "(open ?p - room)", "(open"),
    "functions with numbers": ("(home ?r - robot) - room", "(home ?r - robot) - number", "(home"),
    "functions of objects": ("(battery ?r - robot) - number", "(battery ?p - room)", "(battery"),
    "objects of another type": ("r2 - robot", "r2 - room", "r2"),
}


@pytest.mark.parametrize("name", REDEFINED)
def test_what_does_not_fit_its_definition_is_not_true(fresh_kb: KnowledgeBase, name: str) -> None:
    writer, known = Writer(fresh_kb, seed=3), 0
    *forms, lost = REDEFINED[name]
    dao: Any = getattr(fresh_kb, name.split(maxsplit=1)[0])
    # What fits, by the last revision of a definition.
    fitting: dict[int, list[str]] = {}
    for number in range(3):
        every = [*FACTS, *FLUENTS]
        if number:
            dao.save(forms[number % 2], cascade=True)
            writer.note()
            known = max(writer.model.times)
            gone = [one for one in every if lost in one]
            content = {one: False if one in FACTS else None for one in gone}
            writer.model.plain += [Plain(one, said, known) for one, said in content.items()]
        writer.elements = [one for one in every if not (number % 2 and lost in one)]
        writer.run(5)
        fitting[max(writer.model.times)] = writer.elements
    moments = writer.model.moments()
    for known, elements in fitting.items():
        judge_fitting(fresh_kb, writer.model, known, elements, moments[:: 1 + len(moments) // 5])


def judge_fitting(
    kb: KnowledgeBase, model: Model, known: int, elements: list[str], moments: list[datetime]
) -> None:
    """Compare reads of states, and of the times between them, with what fits of what is true."""
    asked = [one for one in elements if one in FACTS][::3]
    periods = {one: kb.at(known).when(one, clock="valid").to_dicts() for one in asked}
    before: set[str] = set()
    moments = [one for one in moments if one <= model.times[known]]
    for earlier, moment in pairwise([moments[0], *moments]):
        then = kb.at(known=known, valid=moment)
        truth = {one: model.truth(one, moment, known) for one in elements}
        facts = {one for one in elements if truth[one] is True}
        values = {one for one in elements if truth[one] not in (None, True, False)}
        assert {str(dto) for dto in then.propositions.get_all()} == facts, where(moment, known)
        now = {f"(= {one} {truth[one]})" for one in values}
        assert {str(dto) for dto in then.function_values.get_all()} == now, where(moment, known)
        now |= facts
        changes = kb.at(known).diff(earlier, moment, clock="valid")
        said = {(one.sign, one.text) for one in changes if one.kind in ("fact", "value")}
        if moment != moments[0]:
            wanted = {("-", one) for one in before - now} | {("+", one) for one in now - before}
            assert said == wanted, where(moment, known)
        before = now
        for one in asked:
            assert then.holds(one) is truth[one], (one, where(moment, known))
            covers = [
                (held["since_time"] or moment) <= moment < (held["until_time"] or AFTER)
                for held in periods[one]
            ]
            assert any(covers) is truth[one], (one, where(moment, known))
    with kant_sql.connect("sqlite://") as copy:
        loaded(copy, then.domain_pddl(), then.problem_pddl())
        assert {str(dto) for dto in copy.propositions.get_all()} == facts


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

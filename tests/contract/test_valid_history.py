"""Questions about a range of valid times, judged by the model of all sayings."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from fractions import Fraction
from random import Random
from typing import Any

import pytest

from kant_sql import HeldPeriods, KnowledgeBase
from kant_sql.dto.lexical import fold
from kant_sql.errors import InvalidArgumentError, UnknownRevisionError
from kant_sql.knowledge.symbols import symbols_of
from kant_sql.knowledge_base import state_of
from kant_sql.pddl.given import ReadCondition, read_condition, read_rules
from kant_sql.reasoning.trajectory import Trajectory
from tests.support.evaluator import Evaluator, State, Theory
from tests.support.profile import PROFILE
from tests.support.reading import present
from tests.support.two_clocks import FACTS, FLUENTS, OBJECTS, Model, Writer

BEFORE, AFTER = datetime.min.replace(tzinfo=UTC), datetime.max.replace(tzinfo=UTC)
MICROSECOND = timedelta(microseconds=1)
CONDITIONS = (
    *("(at r1 hall)", "(open)", "(at ?r ?p)", "(at r1 ?p)", "(and (at ?r ?p) (clean ?p))"),
    *("(and (at r1 ?p) (at r2 ?p) (open))", "(and (at ?r ?p) (not (clean ?p)))"),
    *("(not (at r1 hall))", "(or (at r1 hall) (open))", "(forall (?r - robot) (at ?r hall))"),
    *("(exists (?p - room) (and (at r1 ?p) (clean ?p)))", "(>= (battery ?r) 4)"),
    *("(= (home r1) ?p)", "(and (= (home ?r) ?p) (at ?r ?p))"),
)
RULES = (
    "(always (not (and (at r1 hall) (open))))",
    "(sometime (at r1 lab))",
    "(forall (?p - room) (at-most-once (at r2 ?p)))",
    "(sometime-after (at r1 hall) (clean hall))",
    "(sometime-before (open) (clean lab))",
    "(within 1 (at r1 lab))",
    "(always-within 1 (at r1 hall) (open))",
    "(hold-during 1 2 (not (open)))",
    "(hold-after 2 (not (at r2 hall)))",
    "(at end (open))",
    "(preference few (always (>= (battery r1) 3)))",
)


class Judge:
    """What the model says of each time, evaluated one by one."""

    def __init__(self, kb: KnowledgeBase, model: Model, known: int) -> None:
        self.kb, self.model, self.known = kb, model, known
        self.view = kb if known == kb.revision else kb.at(known)
        self.symbols = symbols_of(state_of(kb).store.read_definitions(lambda own: own))
        self.objects = {name: (kind,) for kind, names in OBJECTS.items() for name in names}
        self.moments = model.moments()
        self.states = {moment: self.state(moment) for moment in self.moments}

    def state(self, moment: datetime) -> Evaluator:
        facts, values = set(), dict[tuple[str, ...], Fraction | str]()
        for element in (*FACTS, *FLUENTS):
            content = self.model.truth(element, moment, self.known)
            words = tuple(element.strip("()").split())
            if content is True:
                facts.add(words)
            elif isinstance(content, str):
                values[words] = Fraction(content) if content.isdecimal() else content
        return Evaluator(Theory({}), State(self.objects, frozenset(facts), values))

    def read(self, condition: str) -> ReadCondition:
        return read_condition(condition, symbols=self.symbols)

    def check_when(
        self, condition: str, since: datetime | None = None, until: datetime | None = None
    ) -> int:
        """Compare periods with all times of a range; return how many times."""
        found = self.view.when(condition, since=since, until=until, clock="valid")
        read = self.read(condition)
        moments = [one for one in self.moments if (since or BEFORE) <= one <= (until or AFTER)]
        for moment in moments:
            wanted = {*self.states[moment].answers(read.formula, read.free)}
            said = f"{condition} at {moment} known at {self.known}: {found}"
            assert answers_at(found, moment) == wanted, said
        self.check_ends(found)
        return len(moments)

    def check_ends(self, found: HeldPeriods) -> None:
        """Check that the revision at an end says something of that time, and is known."""
        for held in found:
            for revision, time in ((held.since, held.since_time), (held.until, held.until_time)):
                assert (revision is None) == (time is None)
                if revision is not None and time is not None:
                    own = [one for one in self.model.sayings if one.since == revision.number]
                    said = {end for one in own for end in one[2:4]}
                    assert time in said | {self.model.times[revision.number]}
                    assert revision.number <= self.known

    def check_rules(self, since: datetime, until: datetime | None) -> None:
        """Compare verdicts with those of a trajectory that has a state at every time."""
        for rule in RULES:
            found = self.view.pddl.check_rules(rule, since=since, until=until, clock="valid")
            end = until or self.model.times[self.known]
            states = [one for one in self.moments if since < one < end]
            trajectory = Trajectory(
                read_rules(rule, symbols=self.symbols),
                lambda variable: [o for o, own in self.objects.items() if own == variable.types],
            )
            for moment in (since, *states, end):
                time = Decimal((moment - since) // MICROSECOND) / 1_000_000
                trajectory.observe(time, self.state(moment).holds)
            trajectory.conclude()
            wanted = [(str(one), one.violation is None) for one in trajectory.rules]
            assert [(one.rule, one.is_satisfied) for one in found] == wanted, (rule, since, until)
            for own, one in zip(found, trajectory.rules, strict=True):
                if one.violation is not None and "within" not in rule and "hold" not in rule:
                    assert own.time == one.violation.time, rule

    def check_diff(self, a: datetime, b: datetime) -> None:
        """Compare a difference with the contents at both times."""
        wanted = set()
        for element in (*FACTS, *FLUENTS):
            contents = [self.model.truth(element, moment, self.known) for moment in (a, b)]
            for sign, content in zip("-+", contents, strict=True):
                if content not in (None, False) and contents[0] != contents[1]:
                    is_fact = content is True
                    text = element if is_fact else f"(= {element} {content})"
                    wanted.add((sign, "fact" if is_fact else "value", text))
        found = self.view.diff(a, b, clock="valid")
        assert {*found} == wanted, (a, b, self.known)
        assert found == sorted(found)

    def check_timeline(self, since: datetime | None, until: datetime) -> int:
        """Compare the bars of lanes with the contents at all times; return how many bars."""
        given: Any = {"until": until, "clock": "valid", "unchanged": True, "lanes": 100}
        shown = self.view.timeline(since, **given, kinds=("fact", "value"))
        lanes = {lane.text: lane.bars for lane in shown.lanes}
        for moment in [one for one in self.moments if shown.since <= one <= until]:
            for element in (*FACTS, *FLUENTS):
                held = [
                    bar.value or True
                    for bar in lanes.get(element, ())
                    if bar.since_at <= moment < (bar.until_at or AFTER)
                ]
                content = self.model.truth(element, moment, self.known)
                assert held == ([content] if content else []), (element, moment, self.known)
        counted = self.view.timeline(since, **given, kinds=("fact", "value"), slices=3)
        for lane in counted.lanes:
            count = len(lane.bars) + sum(one.count for one in lane.densities)
            assert count == len(lanes[lane.text]), lane
            assert len(lane.bars) <= 3 or not lane.densities
        return sum(map(len, lanes.values()))


def answers_at(found: HeldPeriods, moment: datetime) -> set[tuple[str, ...]]:
    """The objects for which a period covers a time, each once."""
    rows = [
        tuple(map(fold, held.binding.values()))
        for held in found
        if (held.since_time or BEFORE) <= moment < (held.until_time or AFTER)
    ]
    assert len({*rows}) == len(rows)
    return {*rows}


def judges(kb: KnowledgeBase, seed: int, revisions: int) -> Iterator[tuple[Judge, Random]]:
    """Write a history; judge what is known now, and what was known at two earlier revisions."""
    model = Writer(kb, seed).run(revisions)
    random = Random(seed)
    last = max(model.times)
    for known in sorted({last, *random.sample(range(2, last), 2)}):
        yield Judge(kb, model, known), random


def pair(judge: Judge, random: Random) -> tuple[datetime, datetime]:
    first, last = sorted(random.sample(judge.moments, 2))
    now = judge.model.times[max(judge.model.times)]
    return min(first, now), min(last, now)


SEEDS = range(max(2, PROFILE.episodes))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.more
def test_periods_are_those_of_the_model(fresh_kb: KnowledgeBase, seed: int) -> None:
    for judge, random in judges(fresh_kb, seed, 25):
        for condition in CONDITIONS:
            judge.check_when(condition)
            judge.check_when(condition, *pair(judge, random))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.more
def test_verdicts_are_those_of_the_model(fresh_kb: KnowledgeBase, seed: int) -> None:
    for judge, random in judges(fresh_kb, seed, 25):
        judge.check_rules(*pair(judge, random))
        judge.check_rules(judge.model.times[1] - timedelta(seconds=5), None)


@pytest.mark.parametrize("seed", SEEDS)
def test_differences_are_those_of_the_model(fresh_kb: KnowledgeBase, seed: int) -> None:
    for judge, random in judges(fresh_kb, seed, 25):
        for _ in range(10):
            a, b = pair(judge, random)
            judge.check_diff(a, b)
            judge.check_diff(b, a)


@pytest.mark.parametrize("seed", SEEDS)
def test_lanes_are_those_of_the_model(fresh_kb: KnowledgeBase, seed: int) -> None:
    for judge, random in judges(fresh_kb, seed, 40):
        now = judge.model.times[judge.known]
        assert judge.check_timeline(None, now)
        for _ in range(3):
            begin, end = pair(judge, random)
            judge.check_timeline(begin, end)


@pytest.fixture
def cup(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    fresh_kb.load_domain(
        "(define (domain cafe) (:requirements :typing) (:types cup room)"
        " (:predicates (in ?c - cup ?r - room)))"
    )
    fresh_kb.objects.save(["cup1 - cup", "cup2 - cup", "kitchen - room", "hall - room"])
    return fresh_kb


def test_a_cup_was_in_the_kitchen_for_half_an_hour(cup: KnowledgeBase) -> None:
    now = datetime.now(UTC)
    begin, end = now - timedelta(minutes=60), now - timedelta(minutes=30)
    with cup.transaction(actor="camera", reason="late", valid_from=begin, valid_until=end):
        cup.propositions.save("(in cup1 kitchen)")
    said = cup.revision
    assert list(cup.when("(in cup1 kitchen)")) == []
    (held,) = cup.when("(in cup1 kitchen)", clock="valid")
    assert (held.since_time, held.until_time) == (begin, end)
    assert held.since is not None
    assert (held.since.number, held.since.actor, held.until) == (said, "camera", held.since)
    (line,) = cup.when("(in ?c ?r)", clock="valid").to_dicts()
    assert (line["?r"], line["since"], line["since_time"]) == ("kitchen", said, begin)
    # As it was known before, and for a part of the time.
    assert list(cup.at(said - 1).when("(in cup1 kitchen)", clock="valid")) == []
    middle = begin + timedelta(minutes=10)
    (part,) = cup.when("(in cup1 kitchen)", since=middle, clock="valid")
    assert (part.since, part.until_time) == (None, end)
    assert list(cup.when("(in cup1 kitchen)", since=end, clock="valid")) == []
    (verdict,) = cup.pddl.check_rules("(always (not (in cup1 kitchen)))", clock="valid")
    assert (verdict.verdict, verdict.valid_at) == ("violated", begin)
    assert verdict.revision == held.since
    assert f"at {begin.isoformat(timespec='seconds')}" in str(verdict)
    assert [*cup.diff(begin - timedelta(1), middle, clock="valid")] == [
        ("+", "fact", "(in cup1 kitchen)")
    ]
    assert "as of" in str(held)
    (lane,) = cup.timeline(clock="valid", predicate="in").lanes
    (bar,) = lane.bars
    assert (bar.since_at, bar.until_at, bar.actor) == (begin, end, "camera")
    (lane,) = cup.timeline(clock="valid", until=middle).lanes
    assert [(bar.since_at, bar.until_at) for bar in lane.bars] == [(begin, None)]
    drawn = [cup.timeline(clock=clock, predicate="in").svg() for clock in ("valid", "committed")]
    assert ["(in cup1 kitchen)" in each for each in drawn] == [True, False]


def test_a_timeline_begins_with_the_facts_of_the_first_revision(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction():
        fresh_kb.predicates.save("(clean ?p - room)")
        fresh_kb.objects.save("hall - room")
        fresh_kb.propositions.save("(clean hall)")
    fresh_kb.objects.save("lab - room")
    first, second = (one.committed_at for one in fresh_kb.store.revisions())
    begin, end = first + timedelta(microseconds=1), second
    with fresh_kb.transaction(valid_from=begin, valid_until=end):
        fresh_kb.propositions.delete("(clean hall)")
    (lane,) = fresh_kb.timeline(clock="valid").lanes
    assert [(bar.since_at, bar.until_at) for bar in lane.bars] == [(first, begin), (end, None)]


def test_what_is_gone_has_a_past(cup: KnowledgeBase) -> None:
    cup.propositions.save("(in cup1 kitchen)")
    there = cup.revision
    cup.objects.delete("cup1 - cup")
    gone = cup.revision
    (held,) = cup.when("(in ?c kitchen)", clock="valid")
    assert (held.since and held.since.number, held.until and held.until.number) == (there, gone)
    # It can be no object of a quantifier after its end.
    (never,) = cup.when("(forall (?c - cup) (not (in ?c ?r)))", r="kitchen", clock="valid")[1:]
    assert present(never.since).number == gone
    with cup.transaction(valid_from="9 minutes ago", valid_until="7 minutes ago"):
        cup.propositions.save("(in cup2 hall)")
    moments = [one.committed_at for one in cup.store.revisions()]
    moments += [datetime.now(UTC) - timedelta(minutes=minutes) for minutes in (20, 8, 1)]
    for condition in ("(in ?c ?r)", "(not (in ?c hall))", "(forall (?c - cup) (in ?c kitchen))"):
        found = cup.when(condition, clock="valid")
        for moment in [one + by for one in moments for by in (-MICROSECOND, 0 * MICROSECOND)]:
            then = cup.at(valid=moment).query(condition)
            assert answers_at(found, moment) == {*map(tuple, then)}, (condition, moment)
    changes = cup.diff(there, gone, clock="valid")
    assert [*changes] == [("-", "fact", "(in cup1 kitchen)"), ("-", "object", "cup1 - cup")]


def test_a_question_of_another_clock_is_refused(cup: KnowledgeBase) -> None:
    for ask in (
        lambda: cup.when("(in cup1 hall)", clock="observed"),
        lambda: cup.diff(1, 2, clock="wall"),
        lambda: cup.pddl.check_rules("(always (in cup1 hall))", clock="wall"),
        lambda: cup.diff(cup, 2, clock="valid"),
    ):
        with pytest.raises(InvalidArgumentError, match="clock"):
            ask()
    with pytest.raises(UnknownRevisionError, match="future"):
        cup.when("(in cup1 hall)", until=datetime.now(UTC) + timedelta(1), clock="valid")


def test_a_lane_is_there_until_the_last_microsecond_of_its_period(cup: KnowledgeBase) -> None:
    end = datetime.now(UTC) - timedelta(minutes=30)
    with cup.transaction(valid_from=end - timedelta(minutes=30), valid_until=end):
        cup.propositions.save("(in cup1 kitchen)")
    tick = timedelta(microseconds=1)
    for since, count in ((end - tick, 1), (end, 0), (end + tick, 0)):
        for until in (since, since + tick, since + 2 * tick):
            lanes = cup.timeline(since, until=until, clock="valid", unchanged=True).lanes
            assert len(lanes) == count

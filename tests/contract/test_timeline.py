"""Timelines: each version that a window meets is a bar or is counted, and nothing else is there."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import psycopg
import pytest

from kant_sql import (
    Bar,
    Density,
    InvalidArgumentError,
    KnowledgeBase,
    Lane,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    Revision,
    Timeline,
    UnknownNameError,
    UnknownRevisionError,
    Version,
)
from kant_sql.history import gantt, timeline
from kant_sql.sql import lanes
from tests.support.archives import target_url
from tests.support.atoms import Atoms
from tests.support.profile import PROFILE
from tests.support.servers import Server
from tests.support.statements import Statement, count, explain, seen
from tests.support.stores import Connect
from tests.support.worlds.missions import TOUR, begin
from tests.support.worlds.robots import BATTERY, LOCATION, RB1, ROBOT, WP1, robot_at, waypoint

OTHER = PddlObjectDto(ROBOT, "Rb2")
MOMENT = timedelta(microseconds=1)
ALL = ("fact", "goal", "value")


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    return fresh_kb


def live(kb: KnowledgeBase, revisions: int, seed: int) -> None:
    """Let robots come and go for some revisions."""
    chance = random.Random(seed)
    for number in range(revisions):
        with kb.transaction(actor=f"actor{chance.randrange(4)}", reason=f"step {number}"):
            for _ in range(chance.randrange(1, 4)):
                robot = chance.choice([RB1, OTHER])
                fact = robot_at(robot, waypoint(chance.randrange(4)), chance.random() < 0.2)
                if chance.random() < 0.6:
                    Atoms(kb).save(fact)
                else:
                    Atoms(kb).delete(fact)
            if chance.random() < 0.7:
                kb.function_values.set(BATTERY, objects=[RB1], value=chance.randrange(100))
            if chance.random() < 0.2:
                kb.function_values.set(LOCATION, objects=[OTHER], value=WP1)


# The oracle: what a timeline is to say, from `kb.history` alone.


class Wanted(NamedTuple):
    """The versions of a lane, and what it is."""

    kind: str
    text: str
    versions: list[Version]


def histories(kb: KnowledgeBase) -> list[Wanted]:
    """All that ever was of each fact, goal and fluent."""
    seen_ = {
        (change.kind, fluent(change.text) if change.kind == "value" else change.text)
        for entry in kb.log()
        for change in entry.changes
        if change.kind in ALL
    }
    return [
        Wanted(kind, text, [one for one in kb.history(text) if one.kind == kind])
        for kind, text in sorted(seen_)
    ]


def fluent(text: str) -> str:
    """The fluent of `(= (battery rb1) 7)`."""
    return text.removeprefix("(= ").rpartition(" ")[0]


def meets(version: Version, first: int, last: int) -> bool:
    return version.since.number <= last and (version.until is None or version.until.number > first)


def slice_ends(kb: KnowledgeBase, made: Timeline) -> list[int]:
    """The last revision up to each end of a slice."""
    length = made.until - made.since
    revisions = kb.store.revisions()
    ends = []
    for n in range(made.slices + 1):
        moment = made.since + length * n / made.slices
        number = sum(revision.committed_at <= moment for revision in revisions)
        ends.append(min(max(number, made.first), made.last))
    return [made.first, *ends[1:-1], made.last]


def lasts(version: Version, ends: Sequence[int]) -> bool:
    """Whether a version holds for a whole slice."""
    return any(
        version.since.number <= a and (version.until is None or version.until.number > b)
        for a, b in pairwise(ends)
    )


def slice_of(version: Version, ends: Sequence[int]) -> int:
    """The slice that a version begins in, or the first one."""
    return next((n for n, (a, b) in enumerate(pairwise(ends)) if a < version.since.number <= b), 0)


def bar_of(version: Version) -> Bar:
    """A version as a bar, without its value."""
    since, until = version.since, version.until
    began = since.number, since.committed_at, since.actor, since.reason
    if until is None:
        return Bar(began[0], None, began[1], None, *began[2:])
    ended = until.actor, until.reason
    return Bar(began[0], until.number, began[1], until.committed_at, *began[2:], *ended)


def without_value(bar: Bar) -> Bar:
    return replace(bar, value=None, number=None)


def counted(made: Timeline, densities: Sequence[Density]) -> Counter[int]:
    """How many versions are counted in each slice."""
    step = (made.until - made.since) / made.slices
    found: Counter[int] = Counter()
    for density in densities:
        assert not density.is_capped
        first = round((density.begin - made.since) / step)
        width = round((density.end - density.begin) / step)
        for n in range(width):
            assert first + n not in found
            found[first + n] = density.count // width
        assert density.count % width == 0
    return found


def check_lane(kb: KnowledgeBase, made: Timeline, lane: Lane, wanted: Wanted) -> None:
    versions = [one for one in wanted.versions if meets(one, made.first, made.last)]
    began = [one for one in versions if one.since.number > made.first]
    if lane.densities or len(began) > made.slices:
        ends = slice_ends(kb, made)
        short = [one for one in versions if not lasts(one, ends)]
        versions = [one for one in versions if lasts(one, ends)]
        assert counted(made, lane.densities) == Counter(slice_of(one, ends) for one in short)
    assert [without_value(bar) for bar in lane.bars] == [bar_of(one) for one in versions]
    if lane.kind == "value":
        assert [f"(= {lane.text} {bar.value})" for bar in lane.bars] == [
            one.text for one in versions
        ]


def check(kb: KnowledgeBase, made: Timeline, histories: Sequence[Wanted]) -> None:
    """Compare a timeline with the histories."""
    wanted = {(one.kind, one.text): one for one in histories}
    expected = {
        (one.kind, one.text)
        for one in histories
        if any(meets(version, made.first, made.last) for version in one.versions)
    }
    assert {(lane.kind, lane.text) for lane in made.lanes} == expected
    assert len(made.lanes) == len(expected)
    assert [lane.kind for lane in made.lanes] == sorted(lane.kind for lane in made.lanes)
    for lane in made.lanes:
        check_lane(kb, made, lane, wanted[lane.kind, lane.text])


@pytest.mark.parametrize("seed", range(3))
def test_each_version_is_a_bar_or_is_counted(kb: KnowledgeBase, seed: int) -> None:
    live(kb, 40, seed)
    known, revisions = histories(kb), kb.store.revisions()
    chance = random.Random(seed)
    for _ in range(max(6, PROFILE.names // 20)):
        low, high = sorted(chance.choices(revisions, k=2), key=lambda one: one.number)
        for since, until in (
            (low.number, high.number),
            (low.committed_at, high.committed_at),
            (low.committed_at - MOMENT, high.committed_at + MOMENT),
            (None, high.number),
            (low.committed_at, None),
        ):
            for slices in (1, chance.randrange(2, 9), 600):
                made = kb.timeline(since, until=until, slices=slices, unchanged=True)
                assert made.slices <= slices
                check(kb, made, known)


def test_a_window_is_the_state_at_its_beginning_and_what_changed(kb: KnowledgeBase) -> None:
    for number in range(6):
        kb.propositions.save(robot_at(RB1, waypoint(number)))
        kb.propositions.delete(robot_at(RB1, waypoint(number)))
    revisions = kb.store.revisions()
    made = kb.timeline(3, until=5)
    assert (made.first, made.last) == (3, 5)
    assert (made.since, made.until) == (revisions[2].committed_at, revisions[4].committed_at)
    # Bars are whole: those of a zoomed window tell when it really began and ended.
    assert [(bar.since, bar.until) for lane in made.lanes for bar in lane.bars] == [(3, 4), (5, 6)]


def test_a_time_in_the_future_counts_as_now(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    made = kb.timeline(until=datetime.now(UTC) + timedelta(days=9))
    assert abs(made.until - datetime.now(UTC)) < timedelta(minutes=5)
    late = kb.timeline(datetime.max.replace(tzinfo=UTC))
    assert late.since == late.until
    assert [lane.text for lane in late.lanes] == ["(robot_at rb1 wp1)"]


def lanes_by_pages(kb: KnowledgeBase, size: int, *since: int, **wanted: Any) -> tuple[Lane, ...]:
    """The lanes of a window, read page by page."""
    pages = [kb.timeline(*since, lanes=size, **wanted)]
    while pages[-1].next is not None:
        assert len(pages[-1].lanes) == size
        pages.append(kb.timeline(*since, lanes=size, after=pages[-1].next, **wanted))
    return tuple(lane for page in pages for lane in page.lanes)


@pytest.mark.parametrize("clock", ["committed", "valid"])
def test_a_revision_may_be_given_as_text(kb: KnowledgeBase, clock: str) -> None:
    kb.propositions.save(robot_at())
    with kb.transaction(valid_from="2026-01-01", valid_until="2026-01-02"):
        kb.propositions.save(robot_at(OTHER))
    assert kb.timeline("0", clock=clock) == kb.timeline(0, clock=clock)
    assert kb.timeline(until="0", clock=clock) == kb.timeline(until=0, clock=clock)


def test_lanes_come_in_pages(kb: KnowledgeBase) -> None:
    live(kb, 30, 5)
    whole = kb.timeline(4, until=22)
    assert whole.next is None
    for size in (1, 2, 3, 7):
        assert lanes_by_pages(kb, size, 4, until=22) == whole.lanes
    only = kb.timeline(4, until=22, kinds=["value", "goal"])
    assert only.lanes == tuple(lane for lane in whole.lanes if lane.kind != "fact")
    assert kb.timeline(kinds=[]).lanes == ()


def test_lanes_are_chosen_by_predicate_object_and_text(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    kb.propositions.save(robot_at(OTHER, waypoint(12)))
    kb.goals.save(robot_at(is_goal=True))
    kb.function_values.set(BATTERY, objects=[RB1], value=9)
    kb.function_values.set(BATTERY, objects=[OTHER], value=9)
    named = PddlPredicateDto("größe", [PddlTypeDto("maß_%!")])
    kb.propositions.save(PddlPropositionDto(named, [PddlObjectDto(named.types[0], "Straße_1")]))

    def shown(**wanted: Any) -> list[str]:
        return [lane.text for lane in kb.timeline(unchanged=True, **wanted).lanes]

    assert shown(predicate="ROBOT_AT") == [
        "(robot_at rb1 wp1)",
        "(robot_at Rb2 wp12)",
        "(robot_at rb1 wp1)",
    ]
    assert shown(predicate="battery") == ["(battery rb1)", "(battery Rb2)"]
    assert shown(object="rB2") == ["(robot_at Rb2 wp12)", "(battery Rb2)"]
    assert shown(object="wp12", predicate="robot_at") == ["(robot_at Rb2 wp12)"]
    assert shown(object="wp1", predicate="battery") == []
    assert shown(text="RB2 w") == ["(robot_at Rb2 wp12)"]
    assert shown(text="AT rb", object="rb2") == ["(robot_at Rb2 wp12)"]
    assert shown(text="%") == shown(text="!") == []
    assert shown(text="_1") == shown(text="GRÖ") == shown(text="STRAß") == ["(größe Straße_1)"]
    assert len(shown(text="")) == 6


def test_a_goal_may_be_any_formula(kb: KnowledgeBase) -> None:
    begin(kb)
    goal = "(or (at rb1 Home) (not (at rb1 Wp1)))"
    kb.goals.save(goal)
    kb.goals.delete(goal)
    kb.goals.save(goal)

    def shown(**wanted: Any) -> list[tuple[str, list[tuple[int, int | None]]]]:
        lanes = kb.timeline(kinds=["goal"], **wanted).lanes
        return [
            (lane.text, [(bar.since, bar.until) for bar in lane.bars])
            for lane in lanes
            if lane.text.startswith("(or")
        ]

    last = kb.revision
    (only,) = kb.history(goal)[:1]
    expected = [(only.text, [(last - 2, last - 1), (last, None)])]
    assert shown() == shown(predicate="AT") == shown(object="home") == shown(text="(OR") == expected
    assert shown(until=last - 3) == shown(object="wp2") == []
    assert [len(lane.densities) for lane in kb.timeline(slices=1).lanes if "(or" in lane.text] == [
        1
    ]
    assert lanes_by_pages(kb, 1) == kb.timeline().lanes


def test_lanes_are_the_same_however_they_are_found(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    live(kb, 30, 3)
    shown = [partial(kb.timeline, 5, until=20), partial(kb.timeline, object="rb1")]
    in_window = [one() for one in shown]
    monkeypatch.setattr(lanes, "FEW_REVISIONS", 0)
    assert [one() for one in shown] == in_window
    monkeypatch.setattr(lanes, "MOST_LISTED", 0)
    for made in (lanes._few, lanes._in_window):
        made.cache_clear()
    assert [one() for one in shown] == in_window
    monkeypatch.undo()
    for made in (lanes._few, lanes._in_window):
        made.cache_clear()


@pytest.mark.parametrize("is_listed", [True, False])
def test_what_never_changed_is_folded_away(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, is_listed: bool
) -> None:
    if not is_listed:
        monkeypatch.setattr(lanes, "FEW_REVISIONS", 0)
    kb.propositions.save_all(robot_at(OTHER, waypoint(n)) for n in range(20, 26))
    kb.function_values.set(LOCATION, objects=[OTHER], value=WP1)
    live(kb, 30, 7)
    revisions, last = kb.store.revisions(), kb.revision
    began = {
        (one.kind, one.text): min(version.since.number for version in one.versions)
        for one in histories(kb)
    }
    for low, high in ((0, last), (2, last - 1), (9, 12), (20, 20)):
        whole = kb.timeline(low, until=high, unchanged=True)
        made = kb.timeline(low, until=high)
        assert (whole.folded, made.has_more_folded) == (None, False)
        begin = whole.since + (whole.until - whole.since) / timeline.FIRST
        settled = max(low, sum(revision.committed_at <= begin for revision in revisions))

        def is_changed(lane: Lane, low: int = low, high: int = high, to: int = settled) -> bool:
            last = lane.bars[-1]
            is_new = last.since == began[lane.kind, lane.text]
            return last.since > (to if is_new else low) or (last.until or high + 1) <= high

        expected = tuple(lane for lane in whole.lanes if is_changed(lane))
        assert made.lanes == (expected or whole.lanes)
        assert made.folded == (len(whole.lanes) - len(expected) if expected else 0)
        assert lanes_by_pages(kb, 1, low, until=high) == made.lanes


def test_folded_lanes_are_counted_as_they_are_chosen(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb.propositions.save_all(robot_at(OTHER, waypoint(n)) for n in range(20, 26))
    kb.function_values.set(LOCATION, objects=[OTHER], value=WP1)
    kb.propositions.save(robot_at(OTHER, waypoint(1)))
    kb.function_values.set(BATTERY, objects=[OTHER], value=1)

    def folded(**wanted: Any) -> tuple[int | None, bool]:
        made = kb.timeline(2, **wanted)
        return made.folded, made.has_more_folded

    assert folded() == (7, False)
    assert folded(kinds=["value"]) == (1, False)
    assert folded(predicate="ROBOT_AT") == folded(object="rb2", text="AT r") == (6, False)
    assert folded(object="wp1") == (0, False)
    monkeypatch.setattr(timeline, "MOST_FOLDED", 3)
    count_, has_more = folded()
    assert has_more
    assert 3 <= count_ < 7  # type: ignore[operator]
    # Among those of an object, only the wanted ones count.
    kb.propositions.save(robot_at(OTHER, waypoint(35)))
    assert folded(object="rb2", text="5") == (1, False)
    # Where nothing changed, what held is shown.
    assert len(kb.timeline(2, until=2).lanes) == 7
    assert len(kb.timeline(2, until=2, lanes=2).lanes) == 2


def test_it_is_drawn_as_it_was_asked_for(kb: KnowledgeBase) -> None:
    for number in range(3):
        kb.propositions.save(robot_at(RB1, waypoint(number)))
        kb.propositions.delete(robot_at(RB1, waypoint(number)))
        kb.propositions.save(robot_at(OTHER, waypoint(number)))
    made = kb.timeline().svg()
    assert "robot_at rb1: wp0, wp1, wp2" in made
    assert "robot_at Rb2:" not in made
    assert "(robot_at Rb2 wp1)" in made
    assert "(robot_at Rb2 wp1)" not in kb.timeline(object="rb1").svg()


def test_what_never_was_is_refused(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    kb.executions.report("dock", outcome="succeeded")
    with pytest.raises(UnknownNameError, match="robot_at"):
        kb.timeline(predicate="robot_ta")
    with pytest.raises(UnknownNameError, match="rb1"):
        kb.timeline(object="rb")
    kb.objects.save(OTHER)
    assert kb.timeline(object="rb2").lanes == ()
    with pytest.raises(UnknownRevisionError, match="revision 9"):
        kb.timeline(9)
    with pytest.raises(UnknownRevisionError, match="zone"):
        kb.timeline(until=datetime(2026, 1, 1))
    with pytest.raises(InvalidArgumentError, match="before it begins"):
        kb.timeline(1, until=0)
    with pytest.raises(InvalidArgumentError, match="before it begins"):
        kb.timeline(until=datetime.min.replace(tzinfo=UTC))


@pytest.mark.parametrize(
    "wrong",
    [
        *({"kinds": ["facts"]}, {"kinds": "fact"}, {"lanes": 0}, {"lanes": 1_001}),
        *({"unchanged": 1}, {"slices": 0}, {"slices": 10_001}, {"after": "fact:1"}),
        *({"after": "plan:1:2"}, {"predicate": 3}, {"text": "a\0b"}, {"object": "\ud800"}),
    ],
    ids=str,
)
def test_wrong_arguments_are_refused(kb: KnowledgeBase, wrong: Any) -> None:
    kb.propositions.save(robot_at())
    with pytest.raises((InvalidArgumentError, UnknownNameError)):
        kb.timeline(**wrong)


def test_before_the_first_revision_nothing_is_shown(kb: KnowledgeBase) -> None:
    made = kb.timeline()
    assert (made.lanes, made.plans, made.first, made.last) == ((), (), 0, 0)
    assert made.since == made.until
    live(kb, 2, 1)
    assert kb.at(0).timeline().lanes == kb.timeline(0, until=0).lanes == ()


def test_a_view_of_the_past_knows_nothing_later(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    kb.propositions.delete(robot_at())
    kb.propositions.save(robot_at())
    (lane,) = kb.at(1).timeline().lanes
    assert [(bar.since, bar.until, bar.ended_by) for bar in lane.bars] == [(1, None, None)]
    with pytest.raises(UnknownRevisionError):
        kb.at(1).timeline(until=2)


def test_a_transaction_shows_what_is_committed(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    before = kb.timeline().lanes
    with kb.transaction():
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(OTHER))
        kb.propositions.get_all()
        assert kb.timeline().lanes == before


def test_numbers_that_are_counted_have_their_range(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    for value in (5, 9, 2, 7):
        kb.function_values.set(BATTERY, objects=[RB1], value=value)
    (lane,) = kb.timeline(slices=1).lanes
    assert lane.bars == ()
    (density,) = lane.densities
    assert (density.count, density.is_capped) == (4, False)
    assert (density.least, density.largest, density.last) == (2, 9, 7)
    assert [bar.number for bar in kb.timeline().lanes[0].bars] == [5, 9, 2, 7]
    # Where more happened than is counted, it says so.
    monkeypatch.setattr(timeline, "COUNTED", 12)
    ((capped,),) = (lane.densities for lane in kb.timeline(slices=1).lanes)
    assert (capped.count, capped.is_capped, capped.last) == (3, True, 7)


def test_an_answer_is_bounded(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(12):
        for number in range(4):
            kb.propositions.save(robot_at(RB1, waypoint(number)))
        kb.propositions.delete_all()
    monkeypatch.setattr(timeline, "BARS", 14)
    monkeypatch.setattr(timeline, "CELLS", 9)
    made = kb.timeline()
    # One lane has room for its bars, the others share the slices.
    assert made.slices == 3
    assert [bool(lane.densities) for lane in made.lanes].count(False) == 1
    for lane in made.lanes:
        assert len(lane.bars) + sum(density.count for density in lane.densities) == 12


def test_equal_densities_side_by_side_are_one(kb: KnowledgeBase) -> None:
    for _ in range(40):
        kb.propositions.save(robot_at())
        kb.propositions.delete(robot_at())
    (lane,) = kb.timeline(slices=2).lanes
    assert sum(density.count for density in lane.densities) == 40
    assert len(lane.densities) <= 2


# Plans.


def test_plans_have_their_steps_and_outcomes(kb: KnowledgeBase) -> None:
    begin(kb)  # 1
    plan = kb.plans.record(TOUR)  # 2
    with kb.transaction(actor="executive", reason="off"):
        kb.plans.set_status(plan.steps[0], status="running")  # 3
    with kb.transaction(actor="arm", reason="slipped"):
        kb.plans.set_status(plan.steps[0], status="failed")  # 4
    kb.plans.set_status(plan.steps[1], status="running")  # 5
    kb.plans.set_status(plan.steps[2], status="aborted")  # 6
    times = {one.number: one.committed_at for one in kb.store.revisions()}
    (bar,) = kb.timeline().plans
    assert (bar.id, bar.recorded_in, bar.recorded_at) == (plan.id, 2, times[2])
    assert [step.text for step in bar.steps] == [str(step) for step in plan.steps]
    assert [(step.status, step.since, step.until) for step in bar.steps] == [
        *(("failed", 3, 4), ("running", 5, None), ("aborted", None, 6), (None, None, None))
    ]
    failed = bar.steps[0]
    assert (failed.since_at, failed.until_at) == (times[3], times[4])
    assert (failed.actor, failed.reason) == ("executive", "off")
    assert (failed.ended_by, failed.ended_reason) == ("arm", "slipped")
    assert bar.steps[2].since_at is None
    assert bar.steps[2].until_at == times[6]


def test_a_window_has_the_plans_that_were_made_or_ran_in_it(kb: KnowledgeBase) -> None:
    begin(kb)  # 1
    one = kb.plans.record(TOUR)  # 2
    kb.plans.set_status(one.steps[0], status="running")  # 3
    other = kb.plans.record(TOUR)  # 4
    kb.plans.set_status(one.steps[0], status="succeeded")  # 5
    kb.plans.set_status(other.steps[1], status="running")  # 6
    kb.plans.set_status(other.steps[1], status="succeeded")  # 7

    def shown(kb: KnowledgeBase, since: int, until: int) -> list[int | None]:
        return [plan.id for plan in kb.timeline(since, until=until).plans]

    assert shown(kb, 1, 1) == []
    assert shown(kb, 1, 2) == shown(kb, 2, 2) == shown(kb, 3, 3) == [one.id]
    assert shown(kb, 4, 4) == shown(kb, 4, 5) == [one.id, other.id]
    assert shown(kb, 6, 6) == shown(kb, 6, 7) == [other.id]
    assert shown(kb.at(4), 4, 4) == [one.id, other.id]
    (past,) = kb.at(3).timeline().plans
    assert (past.steps[0].status, past.steps[0].until) == ("running", None)
    assert kb.timeline(kinds=ALL).plans == ()
    assert kb.timeline(lanes=1, after="fact:0:").plans == ()


def test_executions_without_a_plan_come_last(kb: KnowledgeBase) -> None:
    begin(kb)  # 1
    plan = kb.plans.record(TOUR)  # 2
    report = kb.executions.report
    running = report("dock", arguments=["rb1"], outcome="running")  # 3
    done = report("greet", arguments=["a guest"], outcome="succeeded")  # 4
    kb.fail(running, code="E4")  # 5
    last = report("wait", outcome="running")  # 6

    def shown(since: int, until: int, **wanted: Any) -> list[int]:
        bars = kb.timeline(since, until=until, **wanted).plans
        return [step.position for bar in bars if bar.id is None for step in bar.steps]

    acts = [int(each.id) for each in (running, done, last)]
    assert [bar.id for bar in kb.timeline().plans] == [plan.id, None]
    assert shown(1, 6) == acts
    assert shown(2, 2) == []
    assert shown(3, 3) == acts[:1]
    assert shown(4, 4) == shown(3, 5) == acts[:2]
    assert shown(6, 6) == acts[2:]
    assert shown(1, 6, object="rb1") == acts[:1]
    assert shown(1, 6, text="guest") == acts[1:2]
    (bar,) = kb.timeline(3, until=6).plans
    steps = [(step.text, step.status, step.since, step.until) for step in bar.steps]
    assert steps == [
        ('("dock" rb1)', "failed", 3, 5),
        ('("greet" "a guest")', "succeeded", None, 4),
        ('("wait")', "running", 6, None),
    ]
    drawn = kb.timeline()._repr_html_()
    assert "3 executions" in drawn
    assert f"execution {running.id}" in drawn


def test_plans_are_chosen_by_object_and_text(kb: KnowledgeBase) -> None:
    begin(kb)
    kb.plans.record(TOUR)

    def shown(**wanted: Any) -> list[str]:
        return [step.text for plan in kb.timeline(**wanted).plans for step in plan.steps]

    assert shown(object="HOME") == ["(Move rb1 wp2 Home)", "(charge rb1 Home)"]
    assert shown(text="charge RB1") == ["(charge rb1 Home)"]
    assert shown(text="nothing of it") == []


def test_plans_are_bounded(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    begin(kb)
    made = [kb.plans.record(TOUR).id for _ in range(4)]
    assert [plan.id for plan in kb.timeline().plans] == made
    assert not kb.timeline().has_more_plans
    monkeypatch.setattr(gantt, "MOST_PLANS", 2)
    cut = kb.timeline()
    assert [plan.id for plan in cut.plans] == made[2:]
    assert cut.has_more_plans
    monkeypatch.setattr(gantt, "MOST_STEPS", 5)
    assert sum(len(plan.steps) for plan in kb.timeline().plans) == 5


def test_an_archived_part_is_missing_and_said(url: str, connect: Connect, tmp_path: Path) -> None:
    kb = connect(url, knowledge_base="tiago", actor="test")
    for _ in range(3):
        kb.propositions.save(robot_at())
        kb.propositions.delete(robot_at())
    kb.propositions.save(robot_at())
    assert kb.timeline().archived_until is None
    kb.store.archive(4, to=target_url(tmp_path))
    times: dict[int, Revision] = {one.number: one for one in kb.store.revisions()}
    made = kb.timeline()
    assert made.archived_until == times[3].committed_at
    assert [(bar.since, bar.until) for bar in made.lanes[0].bars] == [(3, 4), (5, 6), (7, None)]
    assert kb.timeline(4).archived_until is None


# What it costs.

MOST_STATEMENTS = 23


@pytest.mark.parametrize("size", [1, 20, 200])
def test_statements_do_not_grow_with_what_happened(kb: KnowledgeBase, size: int) -> None:
    begin(kb)
    for number in range(size):
        with kb.transaction():
            kb.propositions.save_all(robot_at(RB1, waypoint(9 + n)) for n in range(size // 10 + 1))
            kb.function_values.set(BATTERY, objects=[RB1], value=number)
            kb.goals.save(robot_at(RB1, waypoint(9 + number % 3), True))
        kb.propositions.delete_all()
    kb.plans.record(TOUR)
    calls = (partial(kb.timeline, slices=2), partial(kb.timeline, object="rb1", text="w", lanes=3))
    for call in calls:
        assert count(call) <= MOST_STATEMENTS


def test_no_statement_reads_all_versions(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    live(kb, 60, 1)
    with seen() as statements:
        kb.timeline(slices=2)
        kb.timeline(20, until=40, slices=2, object="rb1", text="rb")
    # PostgreSQL prefers to read the whole of a table as small as these, and is told not to.
    for statement in statements:
        if "_version" in statement.sql:
            plan = "\n".join(without_scans(shared_url, statement))
            assert "Seq Scan on proposition_version" not in plan
            assert "Seq Scan on function_value_version" not in plan
            assert "SCAN v" not in plan
            assert "SCAN l" not in plan


def test_a_lane_is_read_by_its_own_key_also_where_one_fact_has_nearly_all_versions(
    server: Server, connect: Connect
) -> None:
    url = server.new_store()
    kb = connect(url, knowledge_base="tiago", actor="test")
    kb.propositions.save(robot_at(OTHER))
    for _ in range(150):
        kb.propositions.save(robot_at())
        kb.propositions.delete(robot_at())
    with psycopg.connect(url, autocommit=True) as connection:
        # As of a sample that has only the one fact.
        connection.execute(
            "ALTER TABLE proposition_version ALTER COLUMN proposition_id SET (n_distinct = 1)"
        )
        connection.execute("ANALYZE")
    with seen() as statements:
        kb.timeline(slices=20)
    lines = [
        line
        for statement in statements
        if "proposition_version AS v" in statement.sql
        for line in without_scans(url, statement)
    ]
    assert any("pk_proposition_version" in line for line in lines)
    assert not any("ix_proposition_version_since" in line for line in lines)
    kb.close()
    server.drop_database(url)


def without_scans(url: str, statement: Statement) -> list[str]:
    if url.startswith("sqlite"):
        return explain(url, statement)
    option = "options=-c%20enable_seqscan%3Doff"
    return explain(f"{url}{'&' if '?' in url else '?'}{option}", statement)

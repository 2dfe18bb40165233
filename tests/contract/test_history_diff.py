"""The difference of two states: what holds at one and not at the other."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest

from kant_sql import KnowledgeBase
from kant_sql.dto.formulas import Comparison, Metric
from tests.support.worlds.depot import fuel, load, number
from tests.support.worlds.robots import RB1, ROBOT, STORY, WP2, robot_at


def lines(kb: KnowledgeBase, a: Any, b: Any) -> list[str]:
    return [" ".join(change) for change in kb.diff(a, b)]


def state(kb: KnowledgeBase) -> set[tuple[str, str]]:
    """Kind and text of all that holds, from what each revision changed."""
    held: set[tuple[str, str]] = set()
    for entry in reversed(list(kb.log())):
        held -= {(kind, text) for sign, kind, text in entry.changes if sign == "-"}
        held |= {(kind, text) for sign, kind, text in entry.changes if sign == "+"}
    return held


@pytest.fixture
def told(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    for step in STORY:
        step(fresh_kb)
    assert fresh_kb.revision == len(STORY)
    return fresh_kb


def test_it_is_the_difference_of_any_two_states(told: KnowledgeBase) -> None:
    states = [state(told.at(revision)) for revision in range(len(STORY) + 1)]
    for a, here in enumerate(states):
        for b, there in enumerate(states):
            expected = [("+", *each) for each in there - here]
            expected += [("-", *each) for each in here - there]
            assert [tuple(change) for change in told.diff(a, b)] == sorted(expected)


def test_what_came_and_went_in_between_is_no_difference(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    for _ in range(3):
        fresh_kb.propositions.save(robot_at(RB1, WP2))
        fresh_kb.propositions.delete(robot_at(RB1, WP2))
        fresh_kb.propositions.delete(robot_at())
        fresh_kb.propositions.save(robot_at())
    assert lines(fresh_kb, 1, fresh_kb.revision) == ["+ object wp2 - wp"]
    assert lines(fresh_kb, fresh_kb.revision, 1) == ["- object wp2 - wp"]


def test_a_value_is_a_difference_by_what_is_written(told: KnowledgeBase) -> None:
    assert lines(told, 4, 6) == [
        "+ value (= (battery rb1) 5)",
        "- fact (robot_at rb1 wp1)",
        "- value (= (battery rb1) 10.0)",
    ]


def test_formulas_have_the_kind_of_their_section(fresh_kb: KnowledgeBase) -> None:
    start = load(fresh_kb)
    fresh_kb.goals.save(Comparison(">", fuel(), number("2")))
    fresh_kb.pddl.metric.set(Metric("minimize", fuel()))
    assert lines(fresh_kb, start, fresh_kb.revision) == [
        "+ goal (> (fuel t1) 2)",
        "+ metric (:metric minimize (fuel t1))",
    ]


def test_times_name_states(told: KnowledgeBase) -> None:
    moments = [revision.committed_at for revision in told.store.revisions()]
    before = moments[0] - timedelta(microseconds=1)
    assert told.diff(before, moments[-1]) == told.diff(0, len(STORY))
    assert told.diff(moments[-1], before) == told.diff(len(STORY), 0)


def test_of_nothing_there_is_no_difference(fresh_kb: KnowledgeBase) -> None:
    assert fresh_kb.diff(0, 0) == []
    fresh_kb.types.save(ROBOT)
    assert fresh_kb.diff(1, 1) == []
    assert lines(fresh_kb, 0, 1) == ["+ type robot"]

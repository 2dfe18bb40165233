"""Every past state stays readable through the same DAOs, and nothing can change it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest

from kant_sql import (
    InvalidArgumentError,
    KnowledgeBase,
    PddlFunctionValueDto,
    PddlTypeDto,
    ReadOnlyError,
    UnknownRevisionError,
)
from tests.support.parts import dao_of
from tests.support.reading import State, facts, nothing_changes, state, undone
from tests.support.stores import Connect
from tests.support.worlds.robots import (
    BATTERY,
    ELEMENTS,
    LOCATION,
    RB1,
    ROBOT,
    ROBOT_AT,
    STORY,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
    waypoint,
)

# What can be asked of a state and its history, besides what the DAOs read.
QUESTIONS: dict[str, Callable[[KnowledgeBase], Any]] = {
    "revisions": lambda kb: kb.store.revisions(),
    "log": lambda kb: list(kb.log()),
    "log of a page": lambda kb: list(kb.log(limit=2)),
    "log of an actor": lambda kb: list(kb.log(actor="test")),
    "log of a fact": lambda kb: list(kb.log(element=robot_at())),
    "log of an object": lambda kb: list(kb.log(element=WP1)),
    "changes": lambda kb: list(kb.changes()),
    "later changes": lambda kb: list(kb.changes(min(kb.revision, 2))),
    "difference": lambda kb: kb.diff(0, kb.revision),
    "last difference": lambda kb: kb.diff(max(kb.revision, 1) - 1, kb.revision),
    "blame": lambda kb: [kb.blame(each) for each in (robot_at(), robot_at(is_goal=True), WP1)],
    "history of a fact": lambda kb: kb.history(robot_at()),
    "history of a goal": lambda kb: kb.history(robot_at(is_goal=True)),
    "history of a value": lambda kb: kb.history(PddlFunctionValueDto(BATTERY, [RB1])),
    "history of an object": lambda kb: kb.history(WP1),
    "history of definitions": lambda kb: [kb.history(each) for each in (WAYPOINT, ROBOT_AT)],
}


def answers(kb: KnowledgeBase) -> dict[str, Any]:
    return {name: ask(kb) for name, ask in QUESTIONS.items()}


def values(kb: KnowledgeBase) -> list[Any]:
    read = kb.function_values
    return [read.get_all(), *(read.get(each, objects=[RB1]) for each in (BATTERY, LOCATION))]


@pytest.fixture
def states(fresh_kb: KnowledgeBase) -> list[State]:
    """What held at each revision, recorded when that was the head."""
    recorded = [state(fresh_kb)]
    for step in STORY:
        step(fresh_kb)
        recorded.append(state(fresh_kb))
        assert fresh_kb.revision == len(recorded) - 1
    return recorded


def test_each_revision_reads_as_it_did_when_it_was_the_head(
    fresh_kb: KnowledgeBase, states: list[State]
) -> None:
    for _ in range(2):
        for number, recorded in reversed([*enumerate(states)]):
            assert state(fresh_kb.at(number)) == recorded
            assert fresh_kb.at(number).revision == number


def test_each_question_is_answered_as_when_that_was_the_head(fresh_kb: KnowledgeBase) -> None:
    recorded = []
    for step in STORY:
        step(fresh_kb)
        recorded.append((answers(fresh_kb), values(fresh_kb)))
    for number, expected in enumerate(recorded, start=1):
        for past in (fresh_kb.at(number), fresh_kb.at(len(STORY)).at(number)):
            assert (answers(past), values(past)) == expected


def test_what_is_not_committed_is_not_told(fresh_kb: KnowledgeBase, states: list[State]) -> None:
    before = answers(fresh_kb)
    with undone(fresh_kb):
        fresh_kb.types.delete_all()
        fresh_kb.propositions.save(robot_at(RB1, waypoint(9)))
        assert len(fresh_kb.propositions.get_all()) == 1
        assert answers(fresh_kb) == before
        assert fresh_kb.history("wp9") == []
        assert list(fresh_kb.log(element="wp9")) == []


def test_another_process_reads_the_same_past(
    fresh_kb: KnowledgeBase, states: list[State], common_url: str, connect: Connect
) -> None:
    if common_url == "sqlite://":
        pytest.skip("a store in memory has one process")
    name = fresh_kb.store.factory._store.name  # type: ignore[attr-defined]
    other = connect(common_url, knowledge_base=name)
    for number, recorded in enumerate(states):
        assert state(other.at(number)) == recorded


def test_the_past_does_not_move_with_the_present(
    fresh_kb: KnowledgeBase, states: list[State]
) -> None:
    past = fresh_kb.at(3)
    assert state(past) == states[3]
    fresh_kb.types.delete_all()
    assert state(past) == states[3]
    with undone(fresh_kb):
        fresh_kb.types.save(ROBOT)
        assert state(past) == states[3]


def test_each_dao_reads_the_past(fresh_kb: KnowledgeBase, states: list[State]) -> None:
    past = fresh_kb.at(3)
    assert past.types.get("ROBOT") == ROBOT
    assert past.objects.get("wp2") == WP2
    assert past.predicates.get("robot_at") == ROBOT_AT
    assert past.actions.get("navigation") == navigation()
    assert past.propositions.get_by_predicate("robot_at") == [robot_at(), robot_at(RB1, WP2)]
    assert past.goals.get_propositions() == [robot_at(is_goal=True)]
    assert past.propositions.get_all() == [robot_at(), robot_at(RB1, WP2)]
    assert fresh_kb.at(1).actions.get("navigation") is None
    assert fresh_kb.at(0).propositions.get_by_predicate("robot_at") == []


def test_the_past_is_looked_at_from_the_past(fresh_kb: KnowledgeBase, states: list[State]) -> None:
    assert state(fresh_kb.at(3).at(1)) == states[1]
    assert fresh_kb.at(3).at(fresh_kb.store.revisions()[-1].committed_at).revision == 3


def test_nothing_can_be_written_to_the_past(fresh_kb: KnowledgeBase, states: list[State]) -> None:
    past = fresh_kb.at(3)
    with nothing_changes(fresh_kb):
        for kind, element in ELEMENTS.items():
            dao = dao_of(past, kind)
            for method in (dao.save, dao.insert, dao.update, dao.delete):
                # Read-only is said first, whatever is given.
                for given in (element, None):
                    with pytest.raises(ReadOnlyError, match=r"as it was at revision 3: the past"):
                        method(given)
            with pytest.raises(ReadOnlyError):
                dao.save_all([element])
            with pytest.raises(ReadOnlyError):
                dao.save_all(iter([]))
            with pytest.raises(ReadOnlyError):
                dao.delete_all()
        with pytest.raises(ReadOnlyError):
            past.transaction().__enter__()
        with fresh_kb.transaction(), pytest.raises(ReadOnlyError):
            past.types.save(PddlTypeDto("new"))
    assert state(past) == states[3]


def test_the_message_says_where_the_knowledge_base_is(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(ROBOT)
    with pytest.raises(UnknownRevisionError, match=r"has no revision 2: it is at 1$"):
        fresh_kb.at(2)


def test_a_revision_in_the_making_is_not_there_yet(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction():
        fresh_kb.types.save(ROBOT)
        with pytest.raises(UnknownRevisionError):
            fresh_kb.at(1)
    assert fresh_kb.at(1).types.get_all() == [ROBOT]


def test_a_time_reads_the_last_revision_up_to_it(
    fresh_kb: KnowledgeBase, states: list[State]
) -> None:
    revisions = fresh_kb.store.revisions()
    for revision in revisions:
        same_time = [r.number for r in revisions if r.committed_at == revision.committed_at]
        moment = revision.committed_at
        assert fresh_kb.at(moment).revision == same_time[-1]
        assert state(fresh_kb.at(moment)) == states[same_time[-1]]
        east = moment.astimezone(timezone(timedelta(hours=13, minutes=45)))
        assert fresh_kb.at(east).revision == same_time[-1]
        assert fresh_kb.at(moment - timedelta(microseconds=1)).revision == same_time[0] - 1
    assert fresh_kb.at(datetime.now(UTC) - timedelta(days=1)).revision == 0


@pytest.mark.parametrize(
    "moment",
    [
        datetime.min.replace(tzinfo=UTC),
        datetime.min.replace(tzinfo=timezone(timedelta(hours=14))),
        datetime.min.replace(tzinfo=timezone(timedelta(hours=-12))),
    ],
)
def test_before_the_first_revision_there_was_nothing(
    fresh_kb: KnowledgeBase, moment: datetime
) -> None:
    assert fresh_kb.at(moment).revision == 0
    fresh_kb.types.save(ROBOT)
    assert fresh_kb.at(moment).revision == 0
    assert fresh_kb.at(moment).types.get_all() == []
    assert fresh_kb.at(valid=moment).propositions.get_all() == []


@pytest.mark.parametrize(
    "moment",
    [
        datetime.max.replace(tzinfo=UTC),
        datetime.max.replace(tzinfo=timezone(timedelta(hours=-12))),
        datetime.max.replace(tzinfo=timezone(timedelta(hours=14))),
        datetime.now(UTC) + timedelta(days=1),
    ],
)
def test_a_time_in_the_future_is_refused(fresh_kb: KnowledgeBase, moment: datetime) -> None:
    for _ in range(2):
        with pytest.raises(UnknownRevisionError, match="is in the future: the store's clock says"):
            fresh_kb.at(moment)
        with pytest.raises(UnknownRevisionError, match="is in the future: the store's clock says"):
            fresh_kb.diff(moment, moment, clock="valid")
        fresh_kb.types.save(ROBOT)


def test_a_range_that_begins_in_the_future_is_refused_by_its_own_time(
    fresh_kb: KnowledgeBase,
) -> None:
    for _ in range(2):
        for call in (fresh_kb.log, fresh_kb.contradicted):
            with pytest.raises(
                UnknownRevisionError, match=r"the time 2999-01-01T00:00:00\+00:00 is"
            ):
                list(call(since="2999-01-01T00:00:00Z"))
        fresh_kb.types.save(ROBOT)


def test_a_time_without_a_zone_is_refused(fresh_kb: KnowledgeBase) -> None:
    with pytest.raises(UnknownRevisionError, match=r"has no zone; give one, as UTC$"):
        fresh_kb.at(NAIVE)


# What takes a revision or a time.
TAKERS: dict[str, Callable[[KnowledgeBase, Any], Iterable[Any]]] = {
    "at": lambda kb, when: [kb.at(when).revision],
    "diff from": lambda kb, when: kb.diff(when, 3),
    "diff to": lambda kb, when: kb.diff(3, when),
    "changes": lambda kb, when: kb.changes(when),
    "log until": lambda kb, when: kb.log(until=when),
    "log since": lambda kb, when: kb.log(when),
    "timeline": lambda kb, when: kb.timeline(until=when).lanes,
    "when": lambda kb, when: kb.when("(robot_at ?r ?w)", until=when),
    "rules": lambda kb, when: kb.pddl.check_rules("(always (robot_at rb1 wp2))", since=when),
}
NAIVE, LAST = datetime(2026, 1, 31), datetime.max.replace(tzinfo=UTC)
# Of a knowledge base at revision 4.
UNKNOWN = [5, 2**63, 10**30, -1, True, False, "99", 3.0, b"3", [3], timedelta(1), NAIVE, LAST]


# A timeline ends at the present then.
@pytest.mark.parametrize("taker", [taker for taker in TAKERS if taker != "timeline"])
def test_a_state_that_is_not_there_is_refused_at_once(fresh_kb: KnowledgeBase, taker: str) -> None:
    for step in STORY[:4]:
        step(fresh_kb)
    can_be_none = taker in ("log until", "log since", "when", "rules")
    for when in UNKNOWN if can_be_none else [*UNKNOWN, None]:
        with pytest.raises(UnknownRevisionError):
            TAKERS[taker](fresh_kb, when)
    with pytest.raises(UnknownRevisionError, match="has no revision 4: it is at 3"):
        TAKERS[taker](fresh_kb.at(3), 4)


@pytest.mark.parametrize("taker", TAKERS)
def test_a_revision_or_a_time_is_given_as_text(fresh_kb: KnowledgeBase, taker: str) -> None:
    for step in STORY[:4]:
        step(fresh_kb)
    moment = fresh_kb.store.revisions()[1].committed_at

    def taken(when: Any) -> list[Any]:
        return [*TAKERS[taker](fresh_kb, when)]

    assert taken("2") == taken(2)
    assert taken(moment.isoformat()) == taken(moment)
    assert taken(moment.replace(tzinfo=None).isoformat()) == taken(moment)
    with pytest.raises(InvalidArgumentError, match="neither a revision's number nor a time"):
        taken("the day it broke")


def test_yesterday_and_now_are_read(fresh_kb: KnowledgeBase) -> None:
    for step in STORY[:4]:
        step(fresh_kb)
    for text, revision in (("yesterday", 0), ("2 hours ago", 0), ("Now", 4), (" 3", 3)):
        assert fresh_kb.at(text).revision == revision
    assert fresh_kb.at(3).at("now").revision == 3
    assert [each.revision.number for each in fresh_kb.log(until="now")] == [4, 3, 2, 1]
    assert [each.revision.number for each in fresh_kb.log("yesterday", until="2")] == [2, 1]


def test_now_is_the_present(fresh_kb: KnowledgeBase) -> None:
    for number in range(5):
        fresh_kb.objects.save(waypoint(number))
        last = fresh_kb.store.revisions()[-1]
        assert fresh_kb.at(last.committed_at).revision == number + 1
    assert facts(fresh_kb.at(5)) == []

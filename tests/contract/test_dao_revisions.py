"""Revisions say who wrote, when, why and from what; a call that changes nothing makes none.

When something was sensed is kept beside the time at which it was written.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest

from kant_sql import KnowledgeBase, PddlTypeDto, UnknownRevisionError
from kant_sql.errors import InvalidMetadataError
from kant_sql.sql.dialects.base import Session
from tests.support.chain import check_chain
from tests.support.reading import last_changes, nothing_changes, present, undone
from tests.support.stores import Connect
from tests.support.worlds.depot import again
from tests.support.worlds.robots import RB1, ROBOT, WAYPOINT, WP2, robot_at, waypoint

SOURCES: list[Any] = [
    *("camera", "5", '"quoted"', "null", "", "x" * 100_000, "\x7f\x85'\"\\%s"),
    *(5, -1, 2**53 - 1, 0.5, 1e16, 6.473672162563846e16, -1e300, 5e-324, True, False),
    *([], {}, [None]),
    {"a": None, "ü": ["x\0y", "\u2028", "🤖"], "": {"nested": [1, 2.5, {"deep": []}]}},
]


def test_revisions_have_no_gaps_and_time_does_not_go_back(fresh_kb: KnowledgeBase) -> None:
    before = datetime.now(UTC) - timedelta(seconds=5)
    for number in range(6):
        fresh_kb.objects.save(waypoint(number))
        fresh_kb.objects.save(waypoint(number))
        assert fresh_kb.objects.delete(waypoint(99)) is False
    revisions = fresh_kb.store.revisions()
    assert [revision.number for revision in revisions] == [1, 2, 3, 4, 5, 6]
    times = [revision.committed_at for revision in revisions]
    assert times == sorted(times)
    assert before < times[0]
    assert times[-1] < datetime.now(UTC) + timedelta(seconds=5)
    assert {time.utcoffset() for time in times} == {timedelta(0)}


def test_time_does_not_go_back_even_if_the_clock_does(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    fresh_kb.types.save(ROBOT)
    true_now = Session.now
    monkeypatch.setattr(Session, "now", lambda self, raw: true_now(self, raw) - timedelta(days=1))
    fresh_kb.types.save(WAYPOINT)
    one, other = fresh_kb.store.revisions()
    assert one.committed_at == other.committed_at
    # What was the present then is the past, whatever the clock says.
    assert fresh_kb.at(other.committed_at).revision == 2
    monkeypatch.undo()
    fresh_kb.types.save(PddlTypeDto("later"))
    assert fresh_kb.store.revisions()[-1].committed_at > other.committed_at


def test_actor_and_reason_are_recorded(fresh_kb: KnowledgeBase) -> None:
    strange = "O'Brien; DROP TABLE revision -- % \\ $$ 🤖\n\t\x7f"
    fresh_kb.types.save(ROBOT)
    with fresh_kb.transaction(actor="executive", reason=strange):
        fresh_kb.types.save(WAYPOINT)
    with fresh_kb.transaction(actor="", reason=""):
        fresh_kb.types.delete(WAYPOINT)
    with fresh_kb.transaction(reason="x" * 100_000):
        fresh_kb.types.save(WAYPOINT)
    said = [(revision.actor, revision.reason) for revision in fresh_kb.store.revisions()]
    assert said == [("test", None), ("executive", strange), ("", ""), ("test", "x" * 100_000)]


def test_without_an_actor_there_is_none(common_url: str, connect: Connect) -> None:
    kb = connect(common_url, knowledge_base=f"nobody {datetime.now(UTC).isoformat()}")
    kb.types.save(ROBOT)
    assert kb.store.revisions()[0].actor is None


def test_a_source_is_any_json_and_is_read_as_it_was_given(fresh_kb: KnowledgeBase) -> None:
    for number, source in enumerate(SOURCES):
        with fresh_kb.transaction(source=source):
            fresh_kb.objects.save(waypoint(number))
    read = [revision.source for revision in fresh_kb.store.revisions()]
    assert read == SOURCES
    for got, given in zip(read, SOURCES, strict=True):
        # JSON has one kind of number: one without a fraction is read as an integer, if that is
        # exact.
        if not isinstance(given, float):
            assert type(got) is type(given)
    assert [entry.revision.source for entry in fresh_kb.log()] == SOURCES[::-1]


def test_a_tuple_is_read_back_as_the_list_that_it_is_in_json(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction(source=("camera", 3)):
        fresh_kb.types.save(ROBOT)
    assert fresh_kb.store.revisions()[0].source == ["camera", 3]


@pytest.mark.parametrize(
    "options",
    # `tests/unit/test_canonical.py` has all that a source, an actor and a reason cannot be.
    [{"source": {1, 2}}, {"source": float("nan")}, {"actor": 5}, {"reason": "\ud800"}],
    ids=str,
)
def test_what_cannot_be_kept_is_refused_before_anything_is_done(
    fresh_kb: KnowledgeBase, options: dict[str, Any]
) -> None:
    with nothing_changes(fresh_kb), pytest.raises(InvalidMetadataError):
        fresh_kb.transaction(**options).__enter__()
    with fresh_kb.transaction():
        fresh_kb.types.save(ROBOT)
        with pytest.raises(InvalidMetadataError):
            fresh_kb.transaction(**options).__enter__()
    assert fresh_kb.types.get_all() == [ROBOT]
    assert fresh_kb.revision == 1


def test_revisions_are_read_from_where_and_as_many_as_asked_for(fresh_kb: KnowledgeBase) -> None:
    for number in range(5):
        fresh_kb.objects.save(waypoint(number))

    def numbers(after: int = 0, limit: int | None = None) -> list[int]:
        return [revision.number for revision in fresh_kb.store.revisions(after, limit=limit)]

    assert numbers() == [1, 2, 3, 4, 5]
    assert numbers(3) == [4, 5]
    assert numbers(5) == numbers(6) == numbers(2**62) == []
    assert numbers(0, 2) == [1, 2]
    assert numbers(1, 2) == [2, 3]
    assert numbers(4, 2) == [5]
    assert numbers(0, 0) == []
    with pytest.raises(UnknownRevisionError, match="after is a revision's number, or 0"):
        numbers(-3)
    assert numbers(0, None) == numbers(0, 100) == [1, 2, 3, 4, 5]


def test_the_log_is_newest_first_and_in_the_order_of_the_hash(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    with fresh_kb.transaction():
        fresh_kb.propositions.delete(robot_at())
        fresh_kb.goals.save(robot_at(is_goal=True))
        fresh_kb.types.save(PddlTypeDto("ärger"))
        fresh_kb.types.save(PddlTypeDto("zebra"))
        fresh_kb.types.save(PddlTypeDto("Zebra2"))
    assert last_changes(fresh_kb) == [
        *("+ goal (robot_at rb1 wp1)", "+ type Zebra2", "+ type zebra", "+ type ärger"),
        "- fact (robot_at rb1 wp1)",
    ]
    entries = list(fresh_kb.log())
    assert [entry.revision.number for entry in entries] == [2, 1]
    assert [entry.revision for entry in entries] == fresh_kb.store.revisions()[::-1]
    for entry in entries:
        assert list(entry.changes) == sorted(entry.changes)
    assert [len(list(fresh_kb.log(limit=limit))) for limit in (0, 1, 2, 3)] == [0, 1, 2, 2]


SEEN = datetime(2026, 1, 31, 9, 30, 15, 123456, tzinfo=UTC)


def observed(kb: KnowledgeBase) -> list[datetime | None]:
    return [revision.observed_at for revision in kb.store.revisions()]


@pytest.mark.parametrize(
    "moment",
    [
        SEEN,
        SEEN.astimezone(timezone(timedelta(hours=13, minutes=45))),
        datetime.now(UTC) + timedelta(days=365),
        datetime.min.replace(tzinfo=UTC),
        datetime.max.replace(tzinfo=UTC),
    ],
    ids=["utc", "another zone", "later than now", "first moment", "last moment"],
)
def test_it_is_kept_to_the_microsecond_in_utc(fresh_kb: KnowledgeBase, moment: datetime) -> None:
    with fresh_kb.transaction(observed_at=moment):
        fresh_kb.propositions.save(robot_at())
    (revision,) = again(fresh_kb).store.revisions()
    assert revision.observed_at == moment
    assert present(revision.observed_at).utcoffset() == timedelta(0)
    # The store's own clock goes on.
    assert abs(revision.committed_at - datetime.now(UTC)) < timedelta(minutes=5)


def test_late_data_is_visible_as_late(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction(observed_at=SEEN):
        fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.save(robot_at(RB1, WP2))
    assert observed(fresh_kb) == [SEEN, None]
    assert [entry.revision.observed_at for entry in fresh_kb.log()] == [None, SEEN]
    assert present(fresh_kb.blame(robot_at())).since.observed_at == SEEN
    # It is not a time of the store's: states are found by when they were written.
    assert fresh_kb.at(SEEN).revision == 0


def test_a_nested_transaction_has_the_outer_one_s(fresh_kb: KnowledgeBase) -> None:
    other = SEEN + timedelta(hours=1)
    with fresh_kb.transaction(observed_at=SEEN), fresh_kb.transaction(observed_at=other):
        fresh_kb.propositions.save(robot_at())
    with fresh_kb.transaction():
        fresh_kb.propositions.save(robot_at(RB1, WP2))
        with fresh_kb.transaction(observed_at=other):
            fresh_kb.propositions.delete(robot_at())
        with undone(fresh_kb):
            fresh_kb.types.delete_all()
    assert observed(fresh_kb) == [SEEN, None]


@pytest.mark.parametrize(
    "moment",
    [
        datetime(2026, 1, 31),
        1_769_851_800,
        SEEN.date(),
        datetime.min.replace(tzinfo=timezone(timedelta(hours=14))),
        datetime.max.replace(tzinfo=timezone(timedelta(hours=-12))),
    ],
    ids=str,
)
def test_what_is_no_moment_is_refused(fresh_kb: KnowledgeBase, moment: Any) -> None:
    fresh_kb.propositions.save(robot_at())
    with nothing_changes(fresh_kb):
        with pytest.raises(InvalidMetadataError, match="observed_at"):
            fresh_kb.transaction(observed_at=moment).__enter__()
        with (
            fresh_kb.transaction(),
            pytest.raises(InvalidMetadataError),
            fresh_kb.transaction(observed_at=moment),
        ):
            fresh_kb.types.delete_all()


def test_the_hash_covers_it(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    with kb.transaction(observed_at=SEEN):
        kb.propositions.save(robot_at())
    kb.propositions.delete(robot_at())
    assert check_chain(shared_url)

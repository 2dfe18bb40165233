"""Times, and what is reckoned from them, are exact and the same on both databases."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, timezone

import pytest
from sqlalchemy import make_url

from kant_sql import KnowledgeBase, PddlPredicateDto, PddlPropositionDto
from tests.audit.story import Clock
from tests.support.pages import ask, rows_of
from tests.support.stores import Connect

pytestmark = pytest.mark.every_backend

LIT = PddlPropositionDto(PddlPredicateDto("lit", []), [])
# Rounded to milliseconds, as SQLite would, it is a second later.
ALMOST = datetime(2026, 3, 29, 0, 59, 59, 999999, UTC)


@pytest.fixture
def clock() -> Iterator[Clock]:
    with Clock().ruling() as ruling:
        yield ruling


def tell(kb: KnowledgeBase, clock: Clock, moment: datetime, observed: datetime | None) -> None:
    """Let the one fact come, or go, at a time."""
    clock.moment = moment
    with kb.transaction(observed_at=observed):
        if not kb.propositions.delete(LIT):
            kb.propositions.save(LIT)


@pytest.mark.parametrize(
    ("moment", "epoch", "hour"),
    [
        (ALMOST, 1774745999.999999, "2026-03-29T00"),
        (datetime(2026, 3, 29, 1, 0, 0, 1, UTC), 1774746000.000001, "2026-03-29T01"),
        (datetime(2026, 12, 31, 23, 59, 59, 123456, UTC), 1798761599.123456, "2026-12-31T23"),
    ],
)
def test_seconds_since_1970_are_the_nearest_double(
    scratch_url: str, connect: Connect, clock: Clock, moment: datetime, epoch: float, hour: str
) -> None:
    name = f"epoch {epoch}"
    tell(connect(scratch_url, knowledge_base=name), clock, moment, None)
    ((found, text),) = rows_of(
        scratch_url,
        "SELECT committed_epoch, committed_hour FROM audit_revision "
        f"WHERE knowledge_base = '{name}'",
    )
    assert (repr(found), text) == (repr(epoch), hour)
    assert epoch == moment.timestamp()


@pytest.mark.parametrize(
    ("length", "seconds"),
    [
        (timedelta(microseconds=1), "1e-06"),
        (timedelta(microseconds=100_000), "0.1"),
        (timedelta(seconds=3599, microseconds=999_999), "3599.999999"),
        (timedelta(days=400), "34560000.0"),
        (timedelta(0), "0.0"),
    ],
)
def test_durations_and_delays_are_exact(
    scratch_url: str, connect: Connect, clock: Clock, length: timedelta, seconds: str
) -> None:
    name = f"duration {seconds}"
    kb = connect(scratch_url, knowledge_base=name)
    tell(kb, clock, ALMOST, ALMOST - length)
    tell(kb, clock, ALMOST + length, ALMOST + 2 * length)
    where = f"WHERE knowledge_base = '{name}'"
    assert ask(scratch_url, f"SELECT duration FROM audit_fact {where}") == [seconds]
    delays = ask(scratch_url, f"SELECT delay FROM audit_revision {where} ORDER BY revision")
    # What was sensed by a clock that is ahead comes before its time.
    assert delays == [seconds, seconds if length == timedelta(0) else f"-{seconds}"]


def test_what_was_sensed_long_ago_has_its_time(
    scratch_url: str, connect: Connect, clock: Clock
) -> None:
    kb = connect(scratch_url, knowledge_base="long ago")
    before_1970 = datetime(1969, 12, 31, 23, 59, 59, 500_000, UTC)
    in_another_zone = datetime(2026, 3, 1, tzinfo=timezone(timedelta(hours=5, minutes=30)))
    tell(kb, clock, ALMOST, before_1970)
    tell(kb, clock, ALMOST, in_another_zone)
    lines = ask(
        scratch_url,
        "SELECT observed_at, observed_epoch FROM audit_revision "
        "WHERE knowledge_base = 'long ago' ORDER BY revision",
    )
    assert lines == [
        "1969-12-31T23:59:59.500000Z | -0.5",
        "2026-02-28T18:30:00.000000Z | 1772303400.0",
    ]
    lines = ask(
        scratch_url,
        "SELECT since_observed_at, until_observed_at, duration FROM audit_fact "
        "WHERE knowledge_base = 'long ago'",
    )
    assert lines == ["1969-12-31T23:59:59.500000Z | 2026-02-28T18:30:00.000000Z | 0.0"]


def test_the_zone_of_the_session_changes_no_answer(postgresql_story: str) -> None:
    there = make_url(postgresql_story).update_query_dict({"options": "-ctimezone=Asia/Kolkata"})
    query = (
        "SELECT committed_at, committed_epoch, committed_hour FROM audit_revision "
        "WHERE knowledge_base = 'courier' AND committed_at <= '2026-03-02T09:00:00.000000Z' "
        "ORDER BY revision"
    )
    lines = ask(there.render_as_string(hide_password=False), query)
    assert lines == ask(postgresql_story, query)
    assert lines[-1] == "2026-03-02T09:00:00.000000Z | 1772442000.0 | 2026-03-02T09"
    assert len(lines) == 4

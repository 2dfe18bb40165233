"""Moments as people type them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone, tzinfo

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import moment_text as times
from kant_sql.cli.common import parse_optional, parse_state, parse_when

AGO = {
    "2 hours ago": timedelta(hours=2),
    "1 hour ago": timedelta(hours=1),
    "an hour ago": timedelta(hours=1),
    "A Week Ago": timedelta(weeks=1),
    "90 s ago": timedelta(seconds=90),
    "90s ago": timedelta(seconds=90),
    "1.5 days ago": timedelta(days=1.5),
    "5 min ago": timedelta(minutes=5),
    " 30 minutes  ago ": timedelta(minutes=30),
    "90 days ago": timedelta(days=90),
}
WRONG = [
    *("", "ago", "two hours ago", "2 hours", "-2 hours ago", "2 months ago"),
    *("tuesday", "last", "last day", "yesterday 25:00", "today 9", "now 9:00", "last week"),
    *("2026-02-30", "2026-01-31T25:00", "9" * 5000, "999999999 weeks ago", "1e3 days ago"),
]


@pytest.mark.parametrize("text", AGO)
def test_how_long_ago_is_a_time_in_utc(text: str) -> None:
    before = datetime.now(UTC)
    moment = parse_when(text)
    after = datetime.now(UTC)
    assert isinstance(moment, datetime)
    assert before - AGO[text] <= moment <= after - AGO[text]
    assert moment.utcoffset() == timedelta(0)


@pytest.mark.parametrize("text", WRONG)
def test_what_is_no_moment_is_refused_with_the_option_and_the_text(text: str) -> None:
    with pytest.raises(typer.BadParameter) as caught:
        parse_when(text, "--since")
    assert caught.value.param_hint == "--since"
    assert "neither a revision's number nor a time" in str(caught.value)


@pytest.mark.parametrize("text", ["now", " NOW "])
def test_now_is_the_present_whatever_a_clock_says(text: str) -> None:
    before = datetime.now(UTC)
    moment = parse_when(text)
    assert isinstance(moment, datetime)
    assert before <= moment <= datetime.now(UTC)
    assert parse_state(text) is None
    assert parse_state(None) is None
    assert parse_state("3") == 3


# A Wednesday, late in the evening.
NOW = datetime(2026, 7, 15, 23, 30, 5, tzinfo=UTC)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("today", "2026-07-15T00:00Z"),
        ("Yesterday", "2026-07-14T00:00Z"),
        ("yesterday 9:05", "2026-07-14T09:05Z"),
        ("yesterday at 14:30:01.5", "2026-07-14T14:30:01.5Z"),
        ("today 01:00+02:00", "2026-07-14T23:00Z"),
        ("today 01:00Z", "2026-07-15T01:00Z"),
        ("last tuesday", "2026-07-14T00:00Z"),
        ("last Wednesday", "2026-07-08T00:00Z"),
        ("last thursday 12:00", "2026-07-09T12:00Z"),
        ("last  SUNDAY", "2026-07-12T00:00Z"),
    ],
)
def test_a_day_is_its_beginning_in_utc_or_a_time_of_it(
    text: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Clock(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> Clock:
            return cls.fromtimestamp(NOW.timestamp(), tz)

    monkeypatch.setattr(times, "datetime", Clock)
    assert parse_when(text) == datetime.fromisoformat(expected)


@given(st.integers(-(10**12), 10**12))
def test_digits_are_a_number(number: int) -> None:
    assert parse_when(str(number)) == number


@given(
    st.datetimes(datetime(1, 1, 2), datetime(9999, 12, 30)),
    st.integers(-14 * 60, 14 * 60).map(lambda minutes: timezone(timedelta(minutes=minutes))),
)
def test_a_time_in_iso_8601_keeps_its_moment(moment: datetime, zone: timezone) -> None:
    assert parse_when(moment.replace(tzinfo=zone).isoformat()) == moment.replace(tzinfo=zone)
    # Without a zone, it is in UTC.
    assert parse_when(moment.isoformat()) == moment.replace(tzinfo=UTC)


def test_an_option_that_was_not_given_has_no_moment() -> None:
    assert parse_optional(None, "--since") is None
    assert parse_optional("3", "--since") == 3

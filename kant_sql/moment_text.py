"""Moments as people type them: revisions, times in ISO 8601, '2 hours ago', 'yesterday 14:03'."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import overload

from .arguments import shown
from .errors import InvalidArgumentError

_UNITS = {"s": "seconds", "m": "minutes", "h": "hours", "d": "days", "w": "weeks"}
_AGO = re.compile(
    r"(?P<count>\d+(?:\.\d+)?|an?)\s*"
    r"(?P<unit>s|secs?|seconds?|m|mins?|minutes?|h|hours?|d|days?|w|weeks?)\s+ago",
    re.IGNORECASE,
)
_DAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
_DAY = re.compile(
    rf"(?P<day>today|yesterday|last\s+(?P<weekday>{'|'.join(_DAYS)}))"
    r"(?:\s+(?:at\s+)?(?P<time>\d{1,2}:\d{2}(?::\d{2}(?:\.\d+)?)?(?:Z|[+-]\d{2}:?\d{2})?))?",
    re.IGNORECASE,
)


# A revision's number, a time, or a text for `parse_moment`.
When = int | datetime | str
Moment = int | datetime


@overload
def read_when(when: When) -> Moment: ...


@overload
def read_when(when: When | None) -> Moment | None: ...


def read_when(when: When | None) -> Moment | None:
    """Return a revision's number or a time, also from text."""
    return parse_moment(when) if isinstance(when, str) else when


def parse_moment(text: str) -> int | datetime:
    """Parse a revision's number or a time.

    Args:
        text: a number, a time in ISO 8601 (UTC unless it has a zone), `now`, `2 hours ago`,
            `yesterday` or `last tuesday 14:30`.

    Returns:
        The number, or the aware time in UTC.

    Raises:
        InvalidArgumentError: the text is none of these.
    """
    given = text.strip()
    try:
        if given.removeprefix("-").isdecimal():
            return int(given)
        return _time(given, datetime.now(UTC))
    except (ValueError, OverflowError):
        raise InvalidArgumentError(
            f"{shown(text)} is neither a revision's number nor a time as 2026-01-31T09:30:00Z, "
            "'now', '2 hours ago', 'yesterday' or 'last tuesday 14:30'"
        ) from None


def is_now(when: object) -> bool:
    """Return whether a text means the present."""
    return isinstance(when, str) and when.strip().lower() == "now"


def _time(text: str, now: datetime) -> datetime:
    if is_now(text):
        return now
    if ago := _AGO.fullmatch(text):
        return now - _duration(ago["count"], ago["unit"])
    if day := _DAY.fullmatch(text):
        return _on_day(day, now)
    return _in_utc(datetime.fromisoformat(text))


def _on_day(match: re.Match[str], now: datetime) -> datetime:
    """Return the beginning of a day, or the given time of that day."""
    days = int(match["day"].lower() == "yesterday")
    if match["weekday"]:
        # Seven days back if today is that weekday.
        days = (now.weekday() - _DAYS.index(match["weekday"].lower()) - 1) % 7 + 1
    date = (now - timedelta(days=days)).date()
    clock = match["time"] or "00:00"
    return _in_utc(datetime.fromisoformat(f"{date}T{clock if clock[2] == ':' else f'0{clock}'}"))


def _in_utc(moment: datetime) -> datetime:
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC)


def _duration(count: str, unit: str) -> timedelta:
    number = 1.0 if count.lower().startswith("a") else float(count)
    return timedelta(**{_UNITS[unit[0].lower()]: number})

"""Moments as people type them: a revision's number, a time, or how long ago."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import Annotated

import typer

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
_HELP = (
    "number, a time in ISO 8601, 'now', '2 hours ago', 'yesterday' or 'last tuesday 14:30'; in UTC "
    "without a zone."
)

At = Annotated[
    str | None,
    typer.Option(metavar="REV|TIME", show_default=False, help=f"The revision's {_HELP}"),
]
Since = Annotated[
    str | None,
    typer.Option(metavar="REV|TIME", show_default=False, help=f"From this one on: its {_HELP}"),
]
Until = Annotated[
    str | None,
    typer.Option(metavar="REV|TIME", show_default=False, help=f"Up to this one: its {_HELP}"),
]


def parse_when(text: str, hint: str = "--at") -> int | datetime:
    """Read a revision's number or a time.

    Args:
        text: digits are a number. All else is a time: one in ISO 8601; `now`; how long ago, as `2
            hours ago`, `90 s ago`, `a week ago`; or a day, `today`, `yesterday` or as `last
            tuesday`, which never is today, from its beginning or with a time of day, as `yesterday
            14:30`. What has no zone is in UTC, days are those of UTC, and the clock is this
            machine's.
        hint: the option that it was given to, for the message.

    Returns:
        The number, or the time in UTC.

    Raises:
        typer.BadParameter: it is none of these.
    """
    try:
        if text.removeprefix("-").isdecimal():
            return int(text)
        return _time(text.strip(), datetime.now(UTC))
    except (ValueError, OverflowError):
        raise typer.BadParameter(
            f"{text!r} is neither a revision's number nor a time as 2026-01-31T09:30:00Z, 'now', "
            "'2 hours ago', 'yesterday' or 'last tuesday 14:30'",
            param_hint=hint,
        ) from None


def parse_state(text: str | None, hint: str = "--at") -> int | datetime | None:
    """Read which state is meant.

    Args:
        text: as for `parse_when`; None when the option was not given.
        hint: the option, for the message.

    Returns:
        The number or the time in UTC; None for the present state, which `now` is whatever the
        clocks of this machine and of a server say.

    Raises:
        typer.BadParameter: the text is no moment.
    """
    return None if text is None or _is_now(text) else parse_when(text, hint)


def _is_now(text: str) -> bool:
    return text.strip().lower() == "now"


def _time(text: str, now: datetime) -> datetime:
    if _is_now(text):
        return now
    if ago := _AGO.fullmatch(text):
        return now - _duration(ago["count"], ago["unit"])
    if day := _DAY.fullmatch(text):
        return _on_day(day, now)
    return _in_utc(datetime.fromisoformat(text))


def _on_day(said: re.Match[str], now: datetime) -> datetime:
    """Give the beginning of a day, or its time of day that was said."""
    days = int(said["day"].lower() == "yesterday")
    if said["weekday"]:
        # Seven days back when it is that day of the week today.
        days = (now.weekday() - _DAYS.index(said["weekday"].lower()) - 1) % 7 + 1
    date = (now - timedelta(days=days)).date()
    clock = said["time"] or "00:00"
    return _in_utc(datetime.fromisoformat(f"{date}T{clock if clock[2] == ':' else f'0{clock}'}"))


def _in_utc(moment: datetime) -> datetime:
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC)


def parse_optional(text: str | None, hint: str) -> int | datetime | None:
    """Read what an option was given, if it was.

    Args:
        text: the text; None when the option was not given.
        hint: the option, for the message.

    Returns:
        The number, the time in UTC, or None.
    """
    return None if text is None else parse_when(text, hint)


def _duration(count: str, unit: str) -> timedelta:
    number = 1.0 if count.lower().startswith("a") else float(count)
    return timedelta(**{_UNITS[unit[0].lower()]: number})

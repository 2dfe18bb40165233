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
_HELP = "number, a time in ISO 8601 (UTC without a zone), or as '2 hours ago'."

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
        text: digits are a number; else it is a time in ISO 8601, one without a zone being in UTC,
            or how long ago by this machine's clock: `2 hours ago`, `90 s ago`, `a week ago`.
        hint: the option that it was given to, for the message.

    Returns:
        The number, or the time in UTC.

    Raises:
        typer.BadParameter: it is none of these.
    """
    try:
        if text.removeprefix("-").isdecimal():
            return int(text)
        ago = _AGO.fullmatch(text.strip())
        if ago is not None:
            return datetime.now(UTC) - _duration(ago["count"], ago["unit"])
        moment = datetime.fromisoformat(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC)
    except (ValueError, OverflowError):
        raise typer.BadParameter(
            f"{text!r} is neither a revision's number nor a time as 2026-01-31T09:30:00Z or "
            "'2 hours ago'",
            param_hint=hint,
        ) from None


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

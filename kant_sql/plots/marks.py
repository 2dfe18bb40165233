"""Colours, patterns and words of figures."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from datetime import datetime
from html import escape
from typing import NamedTuple
from urllib.parse import urlencode
from zlib import crc32

from ..html import cut, visible

# Each has a contrast of 3:1 or more with white and with the dark page, and they stay apart for
# readers who do not see red, green or blue (Machado et al., 2009).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#7a5fd0", "#c45a94", "#3a9bdc")
PATTERNS = ("", "/", "x", ".", "\\", "+", "-", "|")
NOBODY = "#7b848c"
LABEL, HOVER = 32, 200


class Fill(NamedTuple):
    """How bars are filled."""

    colour: str
    pattern: str = ""


def marks(actors: Iterable[str | None]) -> dict[str | None, Fill]:
    """Give each actor a mark; where the actors are few, a colour without a pattern.

    An actor has the same mark in the next window, unless another one there takes it first.
    """
    found: dict[str | None, Fill] = {None: Fill(NOBODY)}
    names = sorted({actor for actor in actors if actor is not None})
    rounds = len(names) // len(COLOURS) + 1
    free = [Fill(colour, pattern) for pattern in _patterns(rounds) for colour in COLOURS]
    taken: set[int] = set()
    for name in names:
        place = crc32(name.encode("utf-8", "replace")) % len(free)
        while place in taken:
            place = (place + 1) % len(free)
        taken.add(place)
        found[name] = free[place]
    return found


def _patterns(rounds: int) -> Sequence[str]:
    return [PATTERNS[n % len(PATTERNS)] for n in range(rounds)]


class Outcome(NamedTuple):
    """How a step of a plan is drawn."""

    name: str
    sign: str
    mark: Fill


# By the status of a step: a colour on which white text is read, a sign and, unless it succeeded, a
# pattern.
OUTCOMES = {
    "succeeded": Outcome("succeeded", "✓", Fill("#007a59")),
    "failed": Outcome("failed", "✗", Fill("#b84f00", "x")),
    "aborted": Outcome("aborted", "■", Fill("#68717a", "/")),
    "started": Outcome("running", "▶", Fill("#0072b2", ".")),
}


class Theme(NamedTuple):
    """The colours of a figure beside its marks."""

    ink: str
    quiet: str
    line: str
    band: str


LIGHT = Theme("#1b2126", "#56616b", "#c9d0d6", "rgba(110,120,130,0.08)")
DARK = Theme("#e6eaed", "#a5b0b9", "#3d4750", "rgba(150,160,170,0.10)")


def said(text: str | None, length: int = HOVER) -> str:
    """Return a text as a figure shows it: in its own words, which are not markup."""
    return "" if text is None else escape(cut(visible(" ".join(text.split())), length), quote=False)


def label(text: str) -> str:
    """Return the name of a lane."""
    shown = visible(text)
    return escape(shown if len(shown) <= LABEL else f"{shown[: LABEL - 1]}…", quote=False)


def shown_time(moment: datetime) -> str:
    """Return a time as people read it."""
    text = moment.strftime("%Y-%m-%d %H:%M:%S.%f")
    return text.rstrip("0").rstrip(".")


def axis_time(moment: datetime) -> str:
    """Return a time as the axis reads it, which has no zone: it is UTC."""
    return moment.replace(tzinfo=None).isoformat(timespec="microseconds")


def address(path: str, **query: object) -> str:
    """Return the address of a page of the web application."""
    return f"{path}?{urlencode(query, errors='replace')}"


def who(actor: str | None, reason: str | None, source: object = None) -> str:
    """Say who did something and why, and from what."""
    # Without markup: Plotly makes inline styles of it, which a strict policy of a page forbids.
    by = f" by {said(actor)}" if actor is not None else ""
    why = f"<br>   because: {said(reason)}" if reason is not None else ""
    given = None if source is None else json.dumps(source, ensure_ascii=False)
    return by + why + (f"<br>   source: {said(given)}" if given is not None else "")

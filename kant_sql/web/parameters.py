"""Parameters that several pages have, as they are documented, and how they are read."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from fastapi import Query

from ..moment_text import is_now, parse_moment

_MOMENT = "a revision's number, a time as 2026-03-02T14:03:00Z (UTC unless it has a zone), `now`, "
_MOMENT += "`2 hours ago` or `yesterday 14:03`"
At = Annotated[str | None, Query(description=f"Which state: {_MOMENT}; by default the present.")]
SinceMoment = Annotated[str | None, Query(description=f"Only from then on, inclusive: {_MOMENT}.")]
UntilMoment = Annotated[str | None, Query(description=f"Only up to then, inclusive: {_MOMENT}.")]
Before = Annotated[
    int | None, Query(ge=0, description="Only revisions before this one: the next page.")
]
ElementText = Annotated[
    str | None, Query(description="Only elements whose text contains this, in any case.")
]
ObjectName = Annotated[str | None, Query(description="Only elements that name this object.")]
After = Annotated[str | None, Query(description="Where the page begins: `next` of the last one.")]
Offset = Annotated[
    int, Query(ge=0, le=2**53, description="How many come before the page: `next` of the last one.")
]


def moment(text: str | None) -> int | datetime | None:
    """Read a revision or a time; None for the present."""
    stripped = (text or "").strip()
    return None if not stripped or is_now(stripped) else parse_moment(stripped)

"""What a question is asked of."""

from __future__ import annotations

from typing import NamedTuple

from .store import Store


class State(NamedTuple):
    """A knowledge base as it is now, or as it was at one revision."""

    store: Store  # the knowledge base, on its connections
    at: int | None  # the revision that is read; None for the present

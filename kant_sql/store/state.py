"""What a question is asked of."""

from __future__ import annotations

from typing import NamedTuple

from .store import Store


class State(NamedTuple):
    """A knowledge base as it is now, or as it was at one revision.

    Attributes:
        store: the knowledge base, on its connections.
        at: the revision that is read; None for the present.
    """

    store: Store
    at: int | None

"""A service of the node: what it is called, and what answers it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class Service(NamedTuple):
    """A service.

    Attributes:
        name: its name, relative to the node's namespace.
        kind: the class of its interface.
        answer: fills a response for a request; an error that it raises is the response's.
    """

    name: str
    kind: Any
    answer: Callable[[Any, Any], None]

    @property
    def is_question(self) -> bool:
        """Whether it changes nothing."""
        verbs = "get_", "exist_", "is_", "query", "validate_"
        return self.name.rpartition("/")[2].startswith(verbs)

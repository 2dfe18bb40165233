"""A service of the node: its name, its interface and its function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class Service(NamedTuple):
    """A service.

    Attributes:
        name: its name, relative to the node's namespace.
        kind: the class of its interface.
        answer: fills the response to a request; its error becomes the error of the response.
    """

    name: str
    kind: Any
    answer: Callable[[Any, Any], None]

    @property
    def is_question(self) -> bool:
        """Whether it only reads."""
        verbs = "get_", "exist_", "is_", "query", "validate_"
        return self.name.rpartition("/")[2].startswith(verbs)

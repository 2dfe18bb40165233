"""Plugins: external modules, found by entry points and loaded on first use."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Generic, TypeVar, cast

from .errors import ExtraMissingError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

P_co = TypeVar("P_co", covariant=True)


class Plugins(Generic[P_co]):
    """The plugins of one group of entry points; each is a `P_co`.

    Args:
        group: the name of the group.
    """

    def __init__(self, group: str) -> None:
        self.group = group

    def names(self) -> tuple[str, ...]:
        """Return the names of the installed plugins, sorted."""
        return tuple(sorted(self._entries()))

    def get(self, name: str) -> P_co | None:
        """Load a plugin; None if no such plugin is installed.

        Raises:
            ExtraMissingError: it cannot be imported.
        """
        entry = self._entries().get(name)
        if entry is None:
            return None
        try:
            return cast(P_co, entry.load())
        except (ImportError, AttributeError) as error:
            raise ExtraMissingError(
                f"the plugin {name!r} of the group {self.group} cannot be imported from "
                f"{entry.value}: {error}; install its package again"
            ) from error

    def _entries(self) -> Mapping[str, EntryPoint]:
        return _entries(self.group, tuple(sys.path))


@cache
def _entries(group: str, path: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    """Find the entry points of a group on a path; the first one of a name counts."""
    # Imported on first need: it takes a tenth of the time of `import kant_sql`.
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in reversed([*entry_points(group=group)])}

"""SQLite connections that report when nobody closed them, as on Python 3.13, and their opener."""

from __future__ import annotations

import os
import sqlite3
import warnings
from contextlib import suppress
from typing import Any


class WatchedConnection(sqlite3.Connection):
    """A connection that fails the test in which it is freed, unless it was closed."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.opener = os.environ.get("PYTEST_CURRENT_TEST")

    def __del__(self) -> None:
        # A closed connection refuses this.
        with suppress(sqlite3.ProgrammingError):
            _ = self.total_changes
            warnings.warn(f"left open by {self.opener}", ResourceWarning, stacklevel=1)

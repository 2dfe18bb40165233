"""What a session needs of a driver's cursor, and the cursor that it may use no more."""

from __future__ import annotations

from typing import Any, Protocol

from ..errors import ForkedError

Row = tuple[Any, ...]


class Cursor(Protocol):
    """What a session needs of a driver's cursor (PEP 249)."""

    rowcount: int

    def execute(self, sql: str, parameters: Any = ..., /) -> Any:
        """Run a statement."""

    def executemany(self, sql: str, parameters: Any, /) -> Any:
        """Run a statement for each set of parameters."""

    def fetchall(self) -> list[Row]:
        """Give all rows that are left."""

    def fetchmany(self, size: int = ..., /) -> list[Row]:
        """Give the next rows."""


class AbandonedCursor:
    """The cursor of a session whose connection is another process's."""

    def __getattr__(self, name: str) -> Any:
        raise ForkedError(
            "this process was forked within a transaction, which is its parent's: nothing of it is "
            "written from here; begin another one"
        )

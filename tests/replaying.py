"""Migrations of empty databases, done again by the very statements that did them before.

To make them out takes Alembic longer than the database to run them. A store in memory is a copy.
"""

from __future__ import annotations

from typing import Any

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, event, inspect

from kant_sql import schema
from kant_sql.backends import Backend
from kant_sql.backends.sqlite import SqliteBackend

LOOKS = ("SELECT", "PRAGMA", "WITH")
Statement = tuple[str, Any, bool]


class Migrations:
    """What takes the place of `schema._upgrade`."""

    def __init__(self) -> None:
        self._done: dict[tuple[str, str], list[Statement]] = {}
        self._image: bytes | None = None

    def upgrade(self, backend: Backend, revision: str) -> None:
        """Bring the tables to a version: by Alembic, unless there are none and it is known how."""
        if revision == "head" and isinstance(backend, SqliteBackend) and backend.in_memory:
            self._copy(backend)
        else:
            schema._migrate(backend, lambda config: self._run(config, revision))

    def _copy(self, backend: Backend) -> None:
        pooled = backend.engine.raw_connection()
        driver: Any = pooled.driver_connection
        if self._image is None:
            schema._migrate(backend, lambda config: self._run(config, "head"))
            self._image = driver.serialize()
        else:
            driver.deserialize(self._image)
        pooled.close()

    def _run(self, config: Config, revision: str) -> None:
        connection: Connection = config.attributes["connection"]
        key = (connection.dialect.name, revision)
        if inspect(connection).has_table(schema.VERSION_TABLE):
            command.upgrade(config, revision)
        elif key in self._done:
            cursor = connection.connection.cursor()
            for statement, parameters, is_many in self._done[key]:
                (cursor.executemany if is_many else cursor.execute)(statement, parameters)
            cursor.close()
        else:
            self._done[key] = self._record(connection, config, revision)

    def _record(self, connection: Connection, config: Config, revision: str) -> list[Statement]:
        statements: list[Statement] = []

        def record(_: object, __: object, sql: str, parameters: Any, *more: Any) -> None:
            if not sql.lstrip().upper().startswith(LOOKS):
                statements.append((sql, parameters, more[-1]))

        event.listen(connection, "before_cursor_execute", record)
        try:
            command.upgrade(config, revision)
        finally:
            event.remove(connection, "before_cursor_execute", record)
        return statements

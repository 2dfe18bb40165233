"""Fresh stores on each backend, and migrations that are as fast as the database."""

from __future__ import annotations

import functools
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, event, inspect

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.sql import schema
from kant_sql.sql.dialects.base import Backend
from kant_sql.sql.dialects.sqlite import SqliteBackend
from kant_sql.sql.tables.base import VERSION_TABLE
from tests.support.citus import Cluster, citus_url
from tests.support.servers import Server
from tests.support.statistics import add_statistics

BACKENDS = ("sqlite-file", "sqlite-memory", "postgresql")
# A distributed store, if there is a cluster for tests.
CITUS = ("citus",) if citus_url() else ()
LOOKS = ("SELECT", "PRAGMA", "WITH")
Statement = tuple[str, Any, bool]
Connect = Callable[..., KnowledgeBase]
Everywhere = Callable[[Callable[[KnowledgeBase], None]], None]


def extra_urls() -> list[str]:
    return os.environ.get("KANT_SQL_TEST_URLS", "").split()


@functools.cache
def _migrated_file() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "store.db")
        kant_sql.connect(f"sqlite:///{path}").close()
        add_statistics(path)
        return path.read_bytes()


def new_file_store(path: Path) -> str:
    """Make a file with tables and statistics, as a copy of a migrated one; return its URL."""
    path.write_bytes(_migrated_file())
    return f"sqlite:///{path}"


def make_store_url(request: pytest.FixtureRequest, backend: str, tmp_path: Path) -> str:
    """Make an empty store with its tables on one backend."""
    if backend == "sqlite-file":
        return new_file_store(tmp_path / "store.db")
    if backend == "sqlite-memory":
        return "sqlite://"
    if backend == "postgresql":
        server: Server = request.getfixturevalue("server")
        new = server.new_store()
        # A store of the session may end after the server, which discards it anyway.
        if request.scope != "session":
            request.addfinalizer(lambda: server.drop_database(new))
        return new
    if backend == "citus":
        cluster: Cluster = request.getfixturevalue("cluster")
        distributed = cluster.new_store()
        request.addfinalizer(lambda: cluster.drop_database(distributed))
        return distributed
    extra = extra_urls()[int(backend.removeprefix("extra-"))]
    kant_sql.operations.downgrade(extra, revision="base")
    kant_sql.upgrade(extra)
    return extra


class Migrations:
    """Replaces `schema._upgrade`.

    An empty database is migrated with the statements that migrated an earlier one: Alembic takes
    longer to generate them than the database to run them. A store in memory is a copy.
    """

    def __init__(self) -> None:
        self._done: dict[tuple[str, str], list[Statement]] = {}
        self._image: bytes | None = None

    def upgrade(self, backend: Backend, revision: str) -> None:
        """Upgrade the tables: by Alembic, unless there are none and the statements are known."""
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
        if inspect(connection).has_table(VERSION_TABLE):
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

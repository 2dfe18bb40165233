"""Fixtures of the migration tests: empty databases, and Alembic on them as the library runs it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest
import pytest_alembic.tests.experimental.downgrade_leaves_no_trace as no_trace
from alembic.config import Config
from sqlalchemy import Connection, make_url

from kant_sql.sql import schema
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.schema import alembic_config as library_config
from tests.migrations.stores import Fill, Make
from tests.support.servers import Server

UPGRADE = schema._upgrade


@pytest.fixture(params=["sqlite", "postgresql"])
def dialect(request: pytest.FixtureRequest) -> str:
    """Each dialect in turn."""
    name: str = request.param
    return name


def new_database(request: pytest.FixtureRequest, dialect: str, folder: Path) -> str:
    """Give the URL of a database without any table."""
    if dialect == "sqlite":
        return f"sqlite:///{folder / 'store.db'}"
    url: str = request.getfixturevalue("server").new_database()
    return url


@pytest.fixture
def empty_url(request: pytest.FixtureRequest, dialect: str, tmp_path: Path) -> str:
    """The URL of a database without any table, on each dialect in turn."""
    return new_database(request, dialect, tmp_path)


@pytest.fixture
def second_empty_url(request: pytest.FixtureRequest, dialect: str, tmp_path: Path) -> str:
    """The URL of another such database, of the same dialect."""
    (tmp_path / "second").mkdir()
    return new_database(request, dialect, tmp_path / "second")


class Originals:
    """Stores that are made once each: a copy takes a fraction of what Alembic does."""

    def __init__(self, request: pytest.FixtureRequest, folder: Path) -> None:
        self._request = request
        self._folder = folder
        self._made: dict[tuple[str, Fill], str] = {}

    def copy(self, dialect: str, fill: Fill, folder: Path) -> str:
        """Give the URL of a copy of the store that `fill` makes of an empty database."""
        key = dialect, fill
        if key not in self._made:
            own = self._folder / str(len(self._made))
            own.mkdir()
            self._made[key] = new_database(self._request, dialect, own)
            with mock.patch.object(schema, "_upgrade", UPGRADE):
                fill(self._made[key])
        original = self._made[key]
        if dialect == "postgresql":
            server: Server = self._request.getfixturevalue("server")
            return server.copy(original)
        shutil.copy(str(make_url(original).database), folder / "store.db")
        return f"sqlite:///{folder / 'store.db'}"


@pytest.fixture(scope="session")
def originals(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Originals:
    """What tests have copies of."""
    return Originals(request, tmp_path_factory.mktemp("originals"))


@pytest.fixture
def make(originals: Originals, dialect: str, tmp_path: Path) -> Make:
    """Make a store from an empty database, on each dialect in turn."""
    return lambda fill: originals.copy(dialect, fill, tmp_path)


@pytest.fixture
def alembic_config() -> Config:
    """What pytest-alembic runs: the migrations of the library."""
    return library_config()


@pytest.fixture
def alembic_engine(empty_url: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Connection]:
    """Where pytest-alembic runs them: in the library's own kind of transaction."""
    # One of its checks would wrap the connection for an env.py that expects an engine.
    monkeypatch.setattr(no_trace, "WrappingConnection", lambda connection: connection)
    backend = create_backend(empty_url)
    with backend.migration_connection() as connection:
        yield connection
    backend.close()

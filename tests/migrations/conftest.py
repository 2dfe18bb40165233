"""Fixtures of the migration tests: empty databases, and Alembic on them as the library runs it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import pytest_alembic.tests.experimental.downgrade_leaves_no_trace as no_trace
from alembic.config import Config
from sqlalchemy import Connection

from kant_sql.sql.dialects import create_backend
from kant_sql.sql.schema import alembic_config as library_config


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

"""A store with a story in it, on each dialect, recorded once for all tests that only read it."""

from __future__ import annotations

import pytest

import kant_sql
from tests.audit.story import record_store
from tests.support.citus import Cluster
from tests.support.pages import Ask, ask
from tests.support.servers import Server
from tests.support.stores import CITUS


@pytest.fixture(scope="session")
def sqlite_story(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of the store on SQLite."""
    return record_store(f"sqlite:///{tmp_path_factory.mktemp('audit') / 'store.db'}")


@pytest.fixture(scope="session")
def postgresql_story(server: Server) -> str:
    """The URL of the store on PostgreSQL."""
    url = server.new_store()
    return record_store(url)


@pytest.fixture(params=["sqlite", "postgresql", *CITUS])
def story_url(request: pytest.FixtureRequest) -> str:
    """The URL of the store, on each dialect in turn."""
    url: str = request.getfixturevalue(f"{request.param}_story")
    return url


@pytest.fixture
def asked(story_url: str) -> Ask:
    """Ask that store in SQL."""
    return lambda sql: ask(story_url, sql)


@pytest.fixture(scope="session")
def sqlite_scratch(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a store that tests share, each with knowledge bases of its own, on SQLite."""
    url = f"sqlite:///{tmp_path_factory.mktemp('audit') / 'store.db'}"
    kant_sql.upgrade(url)
    return url


@pytest.fixture(scope="session")
def postgresql_scratch(server: Server) -> str:
    """The URL of such a store on PostgreSQL."""
    return server.new_store()


@pytest.fixture(scope="session")
def citus_scratch(cluster: Cluster) -> str:
    """The URL of such a store, distributed."""
    return cluster.new_store()


@pytest.fixture(params=["sqlite", "postgresql", *CITUS])
def scratch_url(request: pytest.FixtureRequest) -> str:
    """The URL of such a store, on each dialect in turn."""
    url: str = request.getfixturevalue(f"{request.param}_scratch")
    return url

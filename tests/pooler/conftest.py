"""PgBouncer before the tests' server, and stores on it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from kant_sql import KnowledgeBase
from tests.support.poolers import Pooler
from tests.support.servers import Server
from tests.support.stores import Connect


@pytest.fixture(scope="session")
def narrow_pooler(server: Server) -> Iterator[Pooler]:
    """A pooler whose clients take turns on one connection of the server."""
    running = Pooler(server)
    yield running
    running.stop()


@pytest.fixture(scope="session")
def wide_pooler(server: Server) -> Iterator[Pooler]:
    """A pooler with connections enough for those who wait for each other."""
    running = Pooler(server, default_pool_size="8")
    yield running
    running.stop()


@pytest.fixture
def direct(server: Server) -> Iterator[str]:
    """The URL of an empty store on the server itself."""
    url = server.new_store()
    yield url
    server.drop_database(url)


@pytest.fixture
def narrow(narrow_pooler: Pooler, direct: str) -> str:
    """The URL of that store through one connection."""
    return narrow_pooler.url(direct)


@pytest.fixture
def wide(wide_pooler: Pooler, direct: str) -> str:
    """The URL of that store through some connections."""
    return wide_pooler.url(direct)


@pytest.fixture
def url(wide: str) -> str:
    """The URL of an empty store: here, there is one backend."""
    return wide


@pytest.fixture
def fresh_kb(wide: str, connect: Connect) -> KnowledgeBase:
    return connect(wide, knowledge_base="tiago", actor="test")

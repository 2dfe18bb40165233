"""A store with a story in it, on each dialect, recorded once for all tests that only read it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from tests.audit.story import record_store
from tests.support.pages import Ask, ask
from tests.support.stores import CITUS, make_store_url


@pytest.fixture(scope="session")
def sqlite_story(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of the store on SQLite."""
    return record_store(f"sqlite:///{tmp_path_factory.mktemp('audit') / 'store.db'}")


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
def scratch(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], str]:
    """The URL of a store of a dialect that tests share, each with knowledge bases of its own."""

    @cache
    def url_on(dialect: str) -> str:
        backend = "sqlite-file" if dialect == "sqlite" else dialect
        return make_store_url(request, backend, tmp_path_factory.mktemp("scratch"))

    return url_on


@pytest.fixture(params=["sqlite", "postgresql", *CITUS])
def scratch_url(request: pytest.FixtureRequest, scratch: Callable[[str], str]) -> str:
    """The URL of such a store, on each dialect in turn."""
    return scratch(request.param)

"""A browser, and servers of the stories on each dialect.

Playwright keeps an event loop running in its thread, in which no test could start another: so it
runs for the tests of one module.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, expect, sync_playwright
from sqlalchemy import make_url

from tests.support.browsing import ARGUMENTS, Serving, Visitor, chromium

REQUIRED = "KANT_SQL_TEST_REQUIRE_BROWSER"
# The machine may have other things to do, too.
expect.set_options(timeout=30_000)
Visit = Callable[..., Visitor]
Serve = Callable[..., Serving]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Debian's chromium; without it, the tests skip, or fail where they are required."""
    path = chromium()
    if path is None:
        missing = "no chromium: install Debian's, or name one in KANT_SQL_TEST_BROWSER"
        if os.environ.get(REQUIRED):
            pytest.fail(missing)
        pytest.skip(missing)
    with sync_playwright() as driver:
        launched = driver.chromium.launch(executable_path=path, args=ARGUMENTS, timeout=120_000)
        yield launched
        launched.close()


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Serve a store until nobody visits it any more."""
    with ExitStack() as stack:

        def serve_(url: str, *words: str, **options: Any) -> Serving:
            serving = Serving(url, tmp_path, *words, **options)
            stack.callback(serving.stop)
            return serving

        yield serve_


@pytest.fixture
def own_story(sqlite_story: str, tmp_path: Path) -> str:
    """The URL of a store of the story on SQLite that a test may write to."""
    return f"sqlite:///{shutil.copy(str(make_url(sqlite_story).database), tmp_path / 'own.db')}"


@pytest.fixture
def visit(browser: Browser, serve: Serve) -> Iterator[Visit]:
    """Let somebody visit a server; at the end of the test nothing has gone wrong for anybody."""
    # Servers stop after the visitors have left: a browser complains of one that is gone.
    del serve
    visitors: list[Visitor] = []

    def visit_(address: str, **options: Any) -> Visitor:
        visitors.append(Visitor(browser, address, **options))
        return visitors[-1]

    yield visit_
    for visitor in visitors:
        visitor.close()
    assert [fault for visitor in visitors for fault in visitor.faults] == []


@pytest.fixture(scope="session")
def sqlite_served(sqlite_story: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A server of the story on SQLite."""
    serving = Serving(sqlite_story, tmp_path_factory.mktemp("served"))
    yield serving
    serving.stop()


@pytest.fixture(scope="session")
def postgresql_served(
    postgresql_story: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Serving]:
    """A server of the story on PostgreSQL."""
    serving = Serving(postgresql_story, tmp_path_factory.mktemp("served"))
    yield serving
    serving.stop()


@pytest.fixture(params=["sqlite", "postgresql"])
def served(request: pytest.FixtureRequest) -> Iterator[Serving]:
    """A server of the story, on each dialect in turn, which has nothing to complain of."""
    serving: Serving = request.getfixturevalue(f"{request.param}_served")
    before = serving.log()
    yield serving
    assert serving.log() == before

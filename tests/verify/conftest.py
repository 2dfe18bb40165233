"""Fixtures of the tests of verification."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import kant_sql
from tests.support.servers import Server
from tests.support.worlds.story import NAME, write_story
from tests.verify.bare import Bare, bare_store

BOTH = ["sqlite", "postgresql"]


def write_on(request: pytest.FixtureRequest, folder: Path) -> str:
    """Write the story on a dialect, and give its URL."""
    url = f"sqlite:///{folder / 'story.db'}"
    if request.param == "postgresql":
        server: Server = request.getfixturevalue("server")
        url = server.new_store()
    write_story(url, f"sqlite:///{folder / 'archive.db'}")
    return url


@pytest.fixture(scope="session", params=BOTH)
def bare(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bare]:
    """The story without constraints, on each dialect."""
    with bare_store(write_on(request, tmp_path_factory.mktemp("story"))) as store:
        yield store


@pytest.fixture(scope="session", params=BOTH)
def full(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bare]:
    """The same with a row in each table: it was a replica, was promoted, and was verified."""
    folder = tmp_path_factory.mktemp("full")
    url = write_on(request, folder)
    replica = f"sqlite:///{folder / 'replica.db'}"
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        kb.store.push(replica, archive=f"sqlite:///{folder / 'archive.db'}")
    with kant_sql.connect(replica, knowledge_base=NAME) as kb:
        kb.store.promote()
        kb.store.push(url, adopt=True)
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        kb.store.promote()
    with bare_store(url) as store:
        yield store

"""Fixtures of the tests of verification."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.servers import Server
from tests.support.worlds.story import write_story
from tests.verify.bare import Bare, bare_store


@pytest.fixture(scope="session", params=["sqlite", "postgresql"])
def bare(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bare]:
    """The story without constraints, on each dialect."""
    folder = tmp_path_factory.mktemp("story")
    url = f"sqlite:///{folder / 'story.db'}"
    if request.param == "postgresql":
        server: Server = request.getfixturevalue("server")
        url = server.new_store()
    write_story(url, f"sqlite:///{folder / 'archive.db'}")
    with bare_store(url) as store:
        yield store

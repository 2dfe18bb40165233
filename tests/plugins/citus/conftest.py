"""Fixtures of the tests that need a Citus cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.support.citus import Cluster
from tests.support.worlds.story import write_story

NewDatabase = Callable[[], str]


@pytest.fixture
def new_database(cluster: Cluster) -> Iterator[NewDatabase]:
    """Create databases with the extension and without tables, for one test."""
    made: list[str] = []

    def create() -> str:
        made.append(cluster.new_database())
        return made[-1]

    yield create
    for url in made:
        cluster.drop_database(url)


@pytest.fixture
def local_url(cluster: Cluster) -> Iterator[str]:
    """The URL of an empty store on the coordinator, not distributed yet."""
    url = cluster.new_store(shards=0)
    yield url
    cluster.drop_database(url)


@pytest.fixture(scope="session")
def common_story(cluster: Cluster, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of the store that tests have copies of."""
    url = cluster.new_store(shards=0)
    write_story(url, f"sqlite:///{tmp_path_factory.mktemp('story') / 'archive.db'}")
    return url


@pytest.fixture
def story_url(cluster: Cluster, common_story: str) -> Iterator[str]:
    """The URL of a store with rows in each table, not distributed yet."""
    url = cluster.copy(common_story)
    yield url
    cluster.drop_database(url)


@pytest.fixture
def distributed_url(cluster: Cluster) -> Iterator[str]:
    """The URL of an empty distributed store."""
    url = cluster.new_store()
    yield url
    cluster.drop_database(url)

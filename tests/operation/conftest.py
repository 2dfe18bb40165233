"""Clusters of PostgreSQL servers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import kant_sql
from tests.support.clusters import Cluster, Node


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    """A place for servers, which are stopped in the end."""
    made = Cluster()
    yield made
    made.stop()


@pytest.fixture
def primary(cluster: Cluster) -> Node:
    """A server with an empty store."""
    made = cluster.primary()
    kant_sql.upgrade(made.url)
    return made


@pytest.fixture
def standby(cluster: Cluster, primary: Node) -> Node:
    """A standby that streams from it."""
    return cluster.standby(primary, 5433)

"""Two stores: one that is pushed from, and one that is pushed to."""

from __future__ import annotations

from pathlib import Path

import pytest

from kant_sql import KnowledgeBase
from tests.support.archives import target_url
from tests.support.stores import CITUS, Connect, make_store_url, new_file_store


@pytest.fixture(params=["sqlite-file", "postgresql", *CITUS])
def target(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty store to push to, on each backend in turn."""
    folder = tmp_path / "target"
    folder.mkdir()
    return make_store_url(request, request.param, folder)


@pytest.fixture
def file_url(tmp_path: Path) -> str:
    """The URL of an empty file to push from, for what does not depend on the backend."""
    return new_file_store(tmp_path / "store.db")


@pytest.fixture
def file_kb(file_url: str, connect: Connect) -> KnowledgeBase:
    """An empty knowledge base in that file."""
    return connect(file_url, knowledge_base="tiago", actor="robot")


@pytest.fixture
def replica_url(tmp_path: Path) -> str:
    """The URL of a file that can become a replica."""
    return target_url(tmp_path, "replica.db")

"""Stores, and what can become an archive of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from kant_sql import KnowledgeBase
from tests.support.archives import count, target_url
from tests.support.stores import Connect


@pytest.fixture(params=["sqlite-file", "postgresql"])
def any_archive_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a store that can become an archive, on each backend in turn."""
    if request.param == "sqlite-file":
        return target_url(tmp_path)
    new: str = request.getfixturevalue("server").new_store()
    return new


@pytest.fixture
def archive_url(tmp_path: Path) -> str:
    """The URL of a file that can become an archive."""
    return target_url(tmp_path)


@pytest.fixture
def file_kb(file_url: str, connect: Connect) -> KnowledgeBase:
    """An empty knowledge base in a file: what does not depend on the backend is tested there."""
    return connect(file_url, knowledge_base="tiago")


@pytest.fixture
def counted(file_kb: KnowledgeBase) -> KnowledgeBase:
    """The same with six revisions."""
    count(file_kb, 6)
    return file_kb

"""The application on a store with a story in it, on each dialect, without a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.web.application import create_app
from tests.support.statements import count, fill

BASE = "http://127.0.0.1"
# A knowledge base to fill, and a reader of it.
Filled = tuple[KnowledgeBase, TestClient]


def archive_some(kb: KnowledgeBase, folder: Path) -> None:
    """Give a knowledge base seven revisions or more, and move the first five to old.db."""
    fill(kb, 5)
    for _ in range(3):
        kb.propositions.delete("(robot_at rb1 wp1)")
        kb.propositions.save("(robot_at rb1 wp1)")
    kb.store.archive(6, to=f"sqlite:///{folder / 'old.db'}")


def statements_of(client: TestClient, path: str) -> int:
    """How many statements a page takes that was shown before."""
    client.get(path)
    return count(lambda: client.get(path))


@pytest.fixture(params=["sqlite", "postgresql"])
def story_url(request: pytest.FixtureRequest) -> str:
    """The URL of the store, on each dialect in turn."""
    url: str = request.getfixturevalue(f"{request.param}_story")
    return url


@pytest.fixture
def client(story_url: str) -> Iterator[TestClient]:
    """A client of the application."""
    with TestClient(create_app(story_url), base_url=BASE) as made:
        yield made


@pytest.fixture(params=["sqlite", "postgresql"])
def filled(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Filled]:
    """A knowledge base to fill, and a reader of it."""
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path / 'store.db'}"
    else:
        url = request.getfixturevalue("server").new_store()
    with (
        kant_sql.connect(url, knowledge_base="courier", actor="filler") as kb,
        TestClient(create_app(url), base_url=BASE) as client,
    ):
        yield kb, client

"""The application on a store with a story in it, on each dialect, without a network."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient

from kant_sql.web.application import create_app

BASE = "http://127.0.0.1"


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

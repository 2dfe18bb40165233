"""A server of these tests' own, which they kill."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import kant_sql
from tests.conftest import Server


@pytest.fixture(scope="session")
def mortal_server() -> Iterator[Server]:
    """A server of these tests' own, which keeps its promises as in earnest."""
    folder = Path(tempfile.mkdtemp(prefix="kantpg"))
    running = Server(folder, fsync=True)
    yield running
    running._server.cleanup()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def mortal_url(mortal_server: Server) -> str:
    """The URL of an empty store on it."""
    url = mortal_server.new_database()
    kant_sql.upgrade(url)
    return url

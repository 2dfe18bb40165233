"""A server of these tests' own, which they kill."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import kant_sql
from tests.support.servers import MortalServer


@pytest.fixture(scope="session")
def mortal_server() -> Iterator[MortalServer]:
    """A server of these tests' own."""
    folder = Path(tempfile.mkdtemp(prefix="kantpg"))
    running = MortalServer(folder)
    yield running
    running.stop()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def mortal_url(mortal_server: MortalServer) -> str:
    """The URL of an empty store on it."""
    url = mortal_server.new_database()
    kant_sql.upgrade(url)
    return url

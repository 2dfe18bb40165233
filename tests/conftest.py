"""Fixtures for all tests: a real PostgreSQL, and a fresh store on every backend."""

from __future__ import annotations

import asyncio
import gc
import inspect
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.sql import schema
from kant_sql.sql.dialects.base import _BACKENDS
from tests import selection
from tests.audit.story import record_store
from tests.support import citus, profile
from tests.support.citus import Cluster
from tests.support.processes.workers import STOPPING
from tests.support.servers import IN_MEMORY, MortalServer, Server
from tests.support.stores import (
    BACKENDS,
    CITUS,
    Connect,
    Migrations,
    extra_urls,
    make_store_url,
    new_file_store,
)

profile.load()
UPGRADE = schema._upgrade

if IN_MEMORY is not None:
    # Where pytest makes `tmp_path`.
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(IN_MEMORY))


# With tests of five seconds and more.
LONGEST = {
    *("test_site.py", "test_mutations.py", "test_store.py", "test_document_properties.py"),
    *("test_val.py", "test_other_parsers.py", "test_properties.py", "test_documents.py"),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the targets of `make`."""
    parser.addoption("--most", action="store_true", help="what `make test` runs")
    parser.addoption("--rest", action="store_true", help="what `make test` leaves out")
    parser.addoption("--note-slow", action="store_true", help="write which of these are slow")
    parser.addoption("--on-server", action="store_true", help="only tests that use PostgreSQL")


def pytest_configure(config: pytest.Config) -> None:
    """Note what takes long, in the process that has all reports."""
    if config.option.note_slow and not hasattr(config, "workerinput"):
        config.pluginmanager.register(selection.SlowTests())


def pytest_report_header() -> str | None:
    """Say what is left out."""
    return None if CITUS else citus.MISSING


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what is left out as a whole."""
    return True if config.option.most and selection.has_none(collection_path) else None


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect what an option leaves out; begin with the longest tests."""
    option = config.option
    # First: of what is chosen, each test that has a server runs there.
    if option.on_server:
        keep(config, items, selection.is_on_server)
    if option.most or option.rest:
        most = selection.in_make_test(items, option.note_slow or option.on_server)
        keep(config, items, lambda item: (item in most) == option.most)
    for item in items if option.note_slow else ():
        item.user_properties.append(("name", selection.without_backend(item)))
    # A long test that begins last keeps one worker busy while the other has nothing to do.
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine in an event loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


def keep(
    config: pytest.Config, items: list[pytest.Item], is_wanted: Callable[[pytest.Item], bool]
) -> None:
    """Deselect the others."""
    config.hook.pytest_deselected(items=[item for item in items if not is_wanted(item)])
    items[:] = filter(is_wanted, items)


def pytest_collection_finish() -> None:
    """Exempt modules and items from garbage collection: they live to the end."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    # A short path: a socket's path ends at about 100 characters.
    folder = Path(tempfile.mkdtemp(prefix="kantpg", dir=IN_MEMORY))
    running = Server(folder)
    yield running
    running.drop()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def cluster() -> Iterator[Cluster]:
    """A Citus cluster; tests that need it are skipped where there is none."""
    url = citus.citus_url()
    if url is None:
        pytest.skip(citus.MISSING)
    running = Cluster(url)
    yield running
    running.drop()


@pytest.fixture(scope="session")
def mortal_server() -> Iterator[MortalServer]:
    """A PostgreSQL server that tests kill and start again."""
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


@pytest.fixture(params=[*BACKENDS, *CITUS, *(f"extra-{n}" for n, _ in enumerate(extra_urls()))])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty store that is ready to be opened, on each backend in turn."""
    return make_store_url(request, request.param, tmp_path)


@pytest.fixture(params=["sqlite-file", "postgresql", *CITUS])
def shared_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a store that processes can share."""
    return make_store_url(request, request.param, tmp_path)


@pytest.fixture
def file_url(tmp_path: Path) -> str:
    """The URL of a file that is not there yet."""
    return f"sqlite:///{tmp_path / 'file.db'}"


@pytest.fixture(scope="session")
def sqlite_story(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a store with a robot's day in it, on SQLite; it is only read."""
    return record_store(new_file_store(tmp_path_factory.mktemp("story") / "store.db"))


@pytest.fixture(scope="session")
def postgresql_story(server: Server) -> str:
    """The URL of a store with a robot's day in it, on PostgreSQL; it is only read."""
    return record_store(server.new_store())


@pytest.fixture(scope="session")
def citus_story(cluster: Cluster) -> str:
    """The URL of a store with a robot's day in it, distributed; it is only read."""
    return record_store(cluster.new_store())


@pytest.fixture(scope="session", autouse=True)
def default_signals_for_children() -> Iterator[None]:
    """Give all child processes the default signals, however the tests themselves are started.

    A child inherits that a signal is ignored, but no handler: a handler that does nothing keeps
    the signal away from the tests, and no child inherits it.
    """
    ignored = [number for number in STOPPING if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, lambda *_: None)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture(scope="session", autouse=True)
def replayed_migrations() -> Iterator[None]:
    """Let what makes a store take as long as the database needs."""
    with mock.patch.object(schema, "_upgrade", Migrations().upgrade):
        yield


@pytest.fixture
def real_migrations() -> Iterator[None]:
    """Let Alembic make stores."""
    with mock.patch.object(schema, "_upgrade", UPGRADE):
        yield


@pytest.fixture
def connect() -> Iterator[Connect]:
    """Open knowledge bases that are closed after the test."""
    opened: list[KnowledgeBase] = []

    def connect_(url: str, **options: Any) -> KnowledgeBase:
        kb = kant_sql.connect(url, **options)
        opened.append(kb)
        return kb

    yield connect_
    for kb in opened:
        kb.close()


@pytest.fixture
def closed_stores() -> Iterator[None]:
    """Close what a test opens with an API that closes nothing, such as the original's."""
    before = {*_BACKENDS}
    yield
    for backend in {*_BACKENDS} - before:
        backend.close()


@pytest.fixture
def kb(url: str, connect: Connect) -> KnowledgeBase:
    """An empty knowledge base on each backend in turn."""
    return connect(url, knowledge_base="tiago", actor="test")

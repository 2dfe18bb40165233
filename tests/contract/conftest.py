"""Knowledge bases of their own in a database that tests share: a new name is a fresh start."""

from __future__ import annotations

import itertools
import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import cache

import pytest
from sqlalchemy.sql.expression import Executable

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.history import follow
from kant_sql.sql.query import Query
from tests.support import async_facade, remote
from tests.support.chain import check_chain
from tests.support.citus import Cluster
from tests.support.faults import be_impatient
from tests.support.processes.workers import PATIENCE
from tests.support.profile import PROFILE
from tests.support.reading import beside, findings
from tests.support.remote import Served
from tests.support.roles import MINE, Members, fill_store, members
from tests.support.servers import Server
from tests.support.sharding import DIALECT, unbound
from tests.support.statistics import loses_bound
from tests.support.stores import BACKENDS, CITUS, Everywhere, extra_urls, new_file_store
from tests.support.worlds import depot

COMMON = {"sqlite-file": "one_file", "postgresql": "one_database", "citus": "one_distributed"}
_numbers = itertools.count(1)


@pytest.fixture(scope="session")
def one_database(server: Server) -> str:
    """The URL of one PostgreSQL database for many tests: to make one takes longer than a test."""
    return server.new_store()


@pytest.fixture(scope="session")
def one_distributed(cluster: Cluster) -> str:
    """The URL of one distributed store for many tests."""
    return cluster.new_store()


@pytest.fixture(scope="session")
def one_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of one SQLite file for many tests."""
    return new_file_store(tmp_path_factory.mktemp("common") / "store.db")


# What tests have the database refuse is not a statement of the library.
OWN_SQL = "test_the_database_itself_refuses"
INDEX_CHECK = ("hash_record_extended(", " AS looked_up")


@pytest.fixture(scope="session")
def made_queries() -> Iterator[list[Query]]:
    """The statements that are made while the tests run, besides the constants of modules."""
    made: list[Query] = []
    make = Query.__init__

    def spy(self: Query, statement: Executable) -> None:
        make(self, statement)
        made.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Query, "__init__", spy)
        yield made


@pytest.fixture(scope="session")
def analyzed(one_file: str) -> Iterator[sqlite3.Connection]:
    """A connection to a store with statistics."""
    with closing(sqlite3.connect(one_file.removeprefix("sqlite:///"))) as connection:
        yield connection


@pytest.fixture(autouse=True)
def sound_statements(
    request: pytest.FixtureRequest, made_queries: list[Query], analyzed: sqlite3.Connection
) -> Iterator[None]:
    """Whatever a test makes a statement of, it loses no bound on any SQLite with statistics.

    And each query in it names its knowledge base.
    """
    made_queries.clear()
    yield
    if request.node.name.startswith(OWN_SQL):
        return
    run = {query.texts.get("sqlite", "") for query in made_queries}
    assert not [text for text in run if loses_bound(analyzed, text)]
    texts = {query.text(DIALECT) for query in made_queries}
    faults = {text: tables for text in texts if (tables := unbound(text))}
    # Indexes are compared with tables for all knowledge bases at once.
    assert not [text for text in faults if not any(part in text for part in INDEX_CHECK)]


# Backends as the asynchronous front door sees them, and the tests that go through it by default.
AIO = {
    "aio-sqlite-file": ("test_dao_",),
    "aio-postgresql": ("test_dao_propositions", "test_dao_functions"),
    "aio-sqlite-memory": ("test_dao_propositions",),
}
# Backends as the DAO family over HTTP sees them, which the tests of the DAOs go through.
HTTP = ("http-sqlite-file", "http-postgresql")
# A test of another actor than the token's; of questions in a transaction; of fields of DTOs that
# were overwritten, which the constructor refuses there or corrects; and of one that writes while a
# request is made of what it yields.
NOT_HTTP = re.compile(
    "test_the_outer_transaction_says_who|test_actor_and_reason_are|test_what_is_not_committed_is"
    "|test_what_does_not_belong_in_a_dto.*-(predicates|propositions|actions)"
    "|no_number_of_0|a_literal_of_a.*http.*-(5|time5|0)]"
    "|names in a DTO|wrong8|test_a_generator_may_read_and_write_the_same"
)
# What is given to a call is used in its thread, where nothing can be awaited.
NOT_AIO = "test_a_generator_may_read_and_write_the_same_knowledge_base"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out what goes through asyncio or HTTP only when it is asked for."""
    items[:] = [item for item in items if _is_wanted(item)]


def _is_wanted(item: pytest.Item) -> bool:
    backend = getattr(item, "callspec", None) and item.callspec.params.get("common_url")  # type: ignore[attr-defined]
    if backend in HTTP:
        is_dao = item.path.name.startswith("test_dao_")
        return is_dao and not NOT_HTTP.search(f"{item.path.name} {item.name}")
    if backend not in AIO:
        return True
    if item.name.startswith(NOT_AIO):
        return False
    is_slow = item.path.name.startswith("test_dao_wrong_types")
    return PROFILE.is_whole or (item.path.name.startswith(AIO[backend]) and not is_slow)


@pytest.fixture(
    params=[*BACKENDS, *CITUS, *AIO, *HTTP, *(f"extra-{n}" for n, _ in enumerate(extra_urls()))]
)
def common_url(request: pytest.FixtureRequest) -> str:
    """The URL of a store that other tests may have used, on each backend in turn."""
    backend = str(request.param).removeprefix("aio-").removeprefix("http-")
    if backend == "sqlite-memory":
        return "sqlite://"
    if backend in COMMON:
        url: str = request.getfixturevalue(COMMON[backend])
        return url
    extra = extra_urls()[int(request.param.removeprefix("extra-"))]
    kant_sql.upgrade(extra)
    return extra


@pytest.fixture(scope="session")
def first_kbs() -> Iterator[dict[str, KnowledgeBase]]:
    """A knowledge base of each common store: to connect takes longer than most tests."""
    opened: dict[str, KnowledgeBase] = {}
    yield opened
    for kb in opened.values():
        kb.close()


@pytest.fixture(scope="session")
def event_loop_thread() -> Iterator[async_facade.Loop]:
    """An event loop for all tests of the asynchronous front door."""
    loop = async_facade.Loop()
    yield loop
    loop.close()


@pytest.fixture(scope="session")
def http_servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Served]]:
    """Servers of the stores that tests share."""
    with ExitStack() as running:

        @cache
        def serve(url: str) -> Served:
            return running.enter_context(remote.served(url, tmp_path_factory.mktemp("tokens")))

        yield serve


@pytest.fixture
def fresh_kb(
    request: pytest.FixtureRequest, common_url: str, first_kbs: dict[str, KnowledgeBase]
) -> Iterator[KnowledgeBase]:
    """An empty knowledge base in a store that others may live in, on each backend in turn."""
    name = f"robot {next(_numbers)}"
    if common_url not in first_kbs:
        first_kbs[common_url] = kant_sql.connect(common_url)
    if request.node.callspec.params["common_url"] in AIO:
        loop = request.getfixturevalue("event_loop_thread")
        kb = async_facade.beside(loop, first_kbs[common_url], name)
        yield kb
        kb.close()
    elif request.node.callspec.params["common_url"] in HTTP:
        server = request.getfixturevalue("http_servers")(common_url)
        with remote.beside(server, first_kbs[common_url], name) as over_http:
            yield over_http
    else:
        yield beside(first_kbs[common_url], name)


@pytest.fixture(scope="module")
def everywhere(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Everywhere]:
    """Do something with a new knowledge base in a database of each kind; all are sound then."""
    urls = [f"sqlite:///{tmp_path_factory.mktemp('each') / 'store.db'}", server.new_store()]
    firsts = [kant_sql.connect(url) for url in ("sqlite://", *urls)]

    def do(work: Callable[[KnowledgeBase], None]) -> None:
        name = f"example {next(_numbers)}"
        for first in firsts:
            work(beside(first, name))

    yield do
    for kb in firsts:
        kb.close()
    for url in urls:
        assert check_chain(url)
        assert findings(url) == []


@pytest.fixture
def only_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who waits for news does not look by itself: it has to be told."""
    monkeypatch.setattr(follow, "LOOK_EVERY", 10 * PATIENCE)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    be_impatient(monkeypatch)


@pytest.fixture
def depot_kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with the world of a depot."""
    depot.load(fresh_kb)
    return fresh_kb


@pytest.fixture(scope="session")
def role_store(server: Server) -> str:
    """The URL of a store with two knowledge bases, with something in each table, and with roles."""
    url = server.new_database()
    fill_store(url)
    kant_sql.operations.create_roles(url)
    return url


@pytest.fixture(scope="session")
def role_users(role_store: str) -> Iterator[Members]:
    """Users, each a member of a role of that store."""
    with members(role_store, kant_sql.operations.create_roles(role_store)) as urls:
        yield urls


@pytest.fixture(scope="session")
def limited_users(role_store: str) -> Iterator[Members]:
    """Users who may see only one of the two knowledge bases."""
    with members(
        role_store, kant_sql.operations.create_roles(role_store, knowledge_base=MINE)
    ) as urls:
        yield urls

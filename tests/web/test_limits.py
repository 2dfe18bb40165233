"""Readers that leave, and questions that take too long, on a real server."""

from __future__ import annotations

import http.client
import socket
import threading
from collections.abc import Callable
from urllib.parse import urlsplit

import httpx2
import psycopg
import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import QuestionCancelledError
from kant_sql.factory import SqlDaoFactory
from kant_sql.sql.query import raw
from kant_sql.web import stores
from kant_sql.web.application import create_app
from kant_sql.web.registry import Pages
from tests.support.processes.workers import PATIENCE, wait_for
from tests.support.serving import running

SLOW = raw(
    "WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 2000000000) "
    "SELECT count(*) FROM n"
)
SOON = PATIENCE / 2


class SlowPage:
    """A page whose question takes minutes, and how it ended."""

    def __init__(self) -> None:
        self.began = threading.Event()
        self.ended = threading.Event()
        self.error: BaseException | None = None
        self.pages = Pages("tests")

        @self.pages.page("/slow", "none.html")
        def slow(kb: KnowledgeBase) -> dict[str, int]:
            """Ask what takes minutes."""
            return self.ask(kb)

    def ask(self, kb: KnowledgeBase) -> dict[str, int]:
        factory = kb.store.factory
        assert isinstance(factory, SqlDaoFactory)
        self.began.set()
        try:
            return {"rows": len(factory._store.query(lambda session, _: session.rows(SLOW)))}
        except BaseException as error:
            self.error = error
            raise
        finally:
            self.ended.set()


def leave_during(address: str, path: str, is_time: Callable[[], object]) -> None:
    """Ask for a page, and close the connection while the server works on it."""
    parts = urlsplit(address)
    assert parts.hostname is not None
    client = http.client.HTTPConnection(parts.hostname, parts.port, timeout=SOON)
    client.request("GET", path)
    is_time()
    assert isinstance(client.sock, socket.socket)
    client.sock.shutdown(socket.SHUT_RDWR)
    client.close()


def test_the_question_of_a_reader_who_leaves_is_cancelled(story_url: str) -> None:
    slow = SlowPage()
    with running(story_url, pages=slow.pages) as address:
        leave_during(address, "/api/slow?kb=courier", lambda: slow.began.wait(SOON))
        assert slow.ended.wait(SOON)
        assert isinstance(slow.error, QuestionCancelledError)
        assert (
            httpx2.get(f"{address}/api/revision?kb=courier&number=5", timeout=60).status_code == 200
        )


def test_the_database_server_ends_it_too(postgresql_story: str) -> None:
    slow = SlowPage()
    running_now = (
        "SELECT count(*) FROM pg_stat_activity WHERE state = 'active' AND query LIKE '%RECURSIVE%' "
        "AND pid <> pg_backend_pid()"
    )
    with (
        psycopg.connect(postgresql_story, autocommit=True) as observer,
        running(postgresql_story, pages=slow.pages) as address,
    ):

        def is_asked(count: int) -> bool:
            return observer.execute(running_now).fetchone() == (count,)

        leave_during(address, "/api/slow?kb=courier", lambda: wait_for(lambda: is_asked(1)))
        wait_for(lambda: is_asked(0))


def test_a_server_that_stops_waits_for_no_question(story_url: str) -> None:
    slow = SlowPage()
    failed: list[Exception] = []

    def ask(address: str) -> None:
        try:
            httpx2.get(f"{address}/api/slow?kb=courier", timeout=60)
        except httpx2.HTTPError as error:
            failed.append(error)

    with running(story_url, pages=slow.pages) as address:
        reader = threading.Thread(target=ask, args=(address,))
        reader.start()
        assert slow.began.wait(SOON)
    assert slow.ended.wait(SOON)
    assert isinstance(slow.error, QuestionCancelledError)
    reader.join(SOON)


def test_a_statement_that_takes_too_long_is_an_error_of_one_sentence(
    story_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = SlowPage()
    app = create_app(story_url)
    app.include_router(slow.pages.api)
    with TestClient(app, base_url="http://127.0.0.1") as client:
        with monkeypatch.context() as patch:
            patch.setattr(stores, "STATEMENT_SECONDS", 0.1)
            answer = client.get("/api/slow?kb=courier")
        assert answer.status_code == 504
        assert answer.json()["type"] == "StatementTimeoutError"
        assert "0.1 s" in answer.json()["error"]
        assert client.get("/api/revision?kb=courier&number=5").status_code == 200


def test_the_pages_open_the_store_only_to_read(story_url: str) -> None:
    app = create_app(story_url)
    with (
        TestClient(app, base_url="http://127.0.0.1"),
        app.state.store.knowledge_base("courier") as kb,
        pytest.raises(kant_sql.ReadOnlyError),
    ):
        kb.propositions.delete_all()


def test_a_reader_who_would_wait_too_long_is_told_so(
    story_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stores, "MOST_WAITING", 0)
    with TestClient(create_app(story_url), base_url="http://127.0.0.1") as client:
        answer = client.get("/api/")
    assert (answer.status_code, answer.json()["type"]) == (503, "StoreBusyError")

"""Live events, on a real server: told, resumed, shared, and surviving restarts."""

from __future__ import annotations

import json
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import httpx2
import pytest

from kant_sql import KnowledgeBase
from kant_sql.web import live
from kant_sql.web.stores import OpenStore
from kant_sql.web.tokens import TokenFile
from tests.support.clusters import free_port
from tests.support.faults import terminate
from tests.support.processes.workers import wait_for
from tests.support.servers import MortalServer
from tests.support.serving import running
from tests.support.stores import Connect, new_file_store
from tests.support.worlds.robots import RB1, waypoint
from tests.support.worlds.robots import robot_at as at

SOON = 20.0


class Event(NamedTuple):
    id: str
    data: dict[str, Any]


class Listening:
    """The events of a stream as they come."""

    def __init__(self, answer: httpx2.Response) -> None:
        self.headers = answer.headers
        self._lines = answer.iter_lines()

    def next(self) -> Event:
        fields: dict[str, str] = {}
        for line in self._lines:
            if line and not line.startswith(":"):
                name, _, value = line.partition(": ")
                fields[name] = value
            elif not line and "data" in fields:
                assert fields["event"] == "revision"
                return Event(fields["id"], json.loads(fields["data"]))
        raise AssertionError("the stream has ended")

    def comment(self) -> None:
        assert any(line.startswith(":") for line in self._lines)

    def rest(self) -> Iterator[str]:
        return self._lines


@contextmanager
def listening(address: str, query: str = "kb=tiago", **headers: str) -> Iterator[Listening]:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    with httpx2.stream("GET", f"{address}/live?{query}", headers=named, timeout=SOON) as answer:
        assert answer.status_code == 200
        yield Listening(answer)


@pytest.fixture
def kb(shared_url: str, connect: Connect) -> KnowledgeBase:
    kb = connect(shared_url, knowledge_base="tiago", actor="perception")
    kb.propositions.save(at())
    return kb


def test_a_stream_ends_when_its_token_is_revoked(
    kb: KnowledgeBase, shared_url: str, tmp_path: Path
) -> None:
    tokens = TokenFile(tmp_path / "tokens.json")
    secret = tokens.add("screen", ["tiago"], ["read"])
    with (
        running(shared_url, tokens=tokens) as address,
        listening(address, authorization=f"Bearer {secret}") as stream,
    ):
        assert stream.next().id == "1"
        tokens.revoke(secret.partition(".")[0])
        write(kb, 2, "nobody hears this")
        assert not any("nobody" in line for line in stream.rest())


def write(kb: KnowledgeBase, number: int, reason: str | None = None) -> None:
    with kb.transaction(reason=reason):
        kb.propositions.save(at(RB1, waypoint(number)))


def test_a_new_revision_is_told_with_who_and_why(shared_url: str, kb: KnowledgeBase) -> None:
    with running(shared_url) as address, listening(address, "kb=tiago&after=1") as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        write(kb, 7, "saw it")
        event = stream.next()
        assert event.id == "2"
        assert event.data["knowledge_base"] == "tiago"
        assert (event.data["revision"], event.data["actor"]) == (2, "perception")
        assert event.data["message"] == "Revision 2 by perception: saw it"
        write(kb, 8)
        assert stream.next().data["message"] == "Revision 3 by perception"


@pytest.mark.more
def test_who_connects_again_misses_nothing(shared_url: str, kb: KnowledgeBase) -> None:
    write(kb, 7)
    with running(shared_url) as address:
        with listening(address, "kb=tiago") as stream:
            assert stream.next().id == "2"
        with listening(address, "kb=tiago&after=1") as stream:
            assert stream.next().id == "2"
        write(kb, 8)
        with listening(address, "kb=tiago&after=1", last_event_id="2") as stream:
            assert stream.next().id == "3"
        with listening(address, "kb=tiago&after=3", last_event_id="junk") as stream:
            write(kb, 9)
            assert stream.next().id == "4"


def test_the_home_page_follows_all_knowledge_bases(
    shared_url: str, kb: KnowledgeBase, connect: Connect
) -> None:
    with running(shared_url) as address, listening(address, "after=1") as stream:
        connect(shared_url, knowledge_base="other").propositions.save(at())
        event = stream.next()
        assert (event.id, event.data["knowledge_base"]) == ("2", None)
        assert event.data["message"] == "2 knowledge bases, 2 revisions"


def test_an_unknown_knowledge_base_is_refused(shared_url: str, kb: KnowledgeBase) -> None:
    with running(shared_url) as address:
        for path in ("/live", "/api/live"):
            assert httpx2.get(f"{address}{path}?kb=nobody", timeout=SOON).status_code == 404
        assert httpx2.get(f"{address}/live?kb=tiago&after=-1", timeout=SOON).status_code == 422


def watchers() -> int:
    return sum(thread.name == live.THREAD for thread in threading.enumerate())


@pytest.mark.more
def test_all_readers_share_one_thread_which_ends_after_the_last(
    shared_url: str, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "LINGER", 0.1)
    monkeypatch.setattr(live, "WATCH_FOR", 0.2)
    # The thread of an earlier test may just end.
    wait_for(lambda: not watchers())
    with running(shared_url) as address:
        with ExitStack() as stack:
            streams = [
                stack.enter_context(listening(address, "kb=tiago&after=1")) for _ in range(20)
            ]
            write(kb, 7)
            assert {stream.next().id for stream in streams} == {"2"}
            assert watchers() == 1
        # The next heartbeat or revision shows that they are gone.
        write(kb, 8)
        wait_for(lambda: not watchers())
        with listening(address, "kb=tiago&after=2") as stream:
            assert stream.next().id == "3"


def test_too_many_readers_are_refused(
    shared_url: str, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "MOST_READERS", 1)
    with running(shared_url) as address, listening(address):
        assert httpx2.get(f"{address}/live?kb=tiago", timeout=SOON).status_code == 503


def test_readers_who_leave_at_once_are_no_readers(
    shared_url: str, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "MOST_READERS", 2)
    with running(shared_url) as address:
        parts = urlsplit(address)
        request = f"GET /live?kb=tiago HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode()
        for _ in range(20):
            with socket.create_connection((parts.hostname or "", parts.port or 0)) as leaving:
                leaving.sendall(request)

        def is_admitted() -> bool:
            with httpx2.stream("GET", f"{address}/live?kb=tiago", timeout=SOON) as answer:
                return answer.status_code == 200

        wait_for(is_admitted)


def test_quiet_streams_are_kept_alive(
    shared_url: str, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "HEARTBEAT", 0.05)
    with running(shared_url) as address, listening(address, "kb=tiago&after=1") as stream:
        stream.comment()
        stream.comment()
        write(kb, 7)
        assert stream.next().id == "2"


def test_a_server_that_stops_ends_its_streams(shared_url: str, kb: KnowledgeBase) -> None:
    with ExitStack() as stack:
        with running(shared_url) as address:
            stream = stack.enter_context(listening(address, "kb=tiago&after=1"))
            started = time.monotonic()
        assert list(stream.rest()) is not None
        assert time.monotonic() - started < SOON
    wait_for(lambda: not watchers())


async def test_a_stream_that_begins_while_the_server_stops_starts_no_thread() -> None:
    with closing(OpenStore("sqlite://", read_only=False)) as store:
        hub = live.LiveHub(store)
        hub.close()
        assert [part async for part in live._stream(hub, "tiago", None, lambda: True)] == []
        assert "tiago" not in hub._feeds


def test_readers_go_on_after_a_restart_of_the_server(shared_url: str, kb: KnowledgeBase) -> None:
    port = free_port()
    with running(shared_url, port=port) as address, listening(address) as stream:
        last = stream.next().id
    write(kb, 7)
    with (
        running(shared_url, port=port) as address,
        listening(address, last_event_id=last) as stream,
    ):
        assert stream.next().id == "2"


@pytest.mark.more
@pytest.mark.parametrize("shared_url", ["sqlite-file"], indirect=True)
def test_a_file_that_takes_the_place_of_the_store_is_opened(
    shared_url: str, kb: KnowledgeBase, connect: Connect, tmp_path: Path
) -> None:
    other = new_file_store(tmp_path / "other.db")
    with connect(other, knowledge_base="tiago", actor="somebody else") as theirs:
        for number in range(3):
            write(theirs, number)
    with running(shared_url) as address, listening(address, "kb=tiago&after=1") as stream:
        assert (
            httpx2.get(f"{address}/api/revision?kb=tiago&number=1", timeout=SOON).status_code == 200
        )
        kb.close()
        place = Path(shared_url.removeprefix("sqlite:///"))
        for name in (f"{place}-wal", f"{place}-shm"):
            Path(name).unlink(missing_ok=True)
        (tmp_path / "other.db").replace(place)
        event = stream.next()
        assert (event.id, event.data["actor"]) == ("3", "somebody else")
        answer = httpx2.get(f"{address}/api/revision?kb=tiago&number=3", timeout=SOON)
        assert answer.json()["revision"]["actor"] == "somebody else"
        assert (
            httpx2.get(f"{address}/api/", timeout=SOON).json()["knowledge_bases"][0]["revision"]
            == 3
        )


@pytest.mark.parametrize("shared_url", ["postgresql"], indirect=True)
def test_lost_connections_are_made_again(shared_url: str, kb: KnowledgeBase) -> None:
    with running(shared_url) as address, listening(address, "kb=tiago&after=1") as stream:
        write(kb, 7)
        assert stream.next().id == "2"
        assert terminate(shared_url)
        write(kb, 8)
        assert stream.next().id == "3"


@pytest.mark.more
def test_readers_go_on_after_a_restart_of_the_database(connect: Connect) -> None:
    folder = Path(tempfile.mkdtemp(prefix="kantpg"))
    database = MortalServer(folder)
    try:
        url = database.new_store()
        kb = connect(url, knowledge_base="tiago", actor="perception")
        kb.propositions.save(at())
        with running(url) as address, listening(address, "kb=tiago&after=1") as stream:
            database.kill()
            time.sleep(1)
            database.restart()
            write(kb, 7)
            assert stream.next().id == "2"
    finally:
        database.stop()
        shutil.rmtree(folder, ignore_errors=True)


def test_pages_follow_what_they_show(shared_url: str, kb: KnowledgeBase) -> None:
    with running(shared_url) as address:
        page = httpx2.get(f"{address}/revision?kb=tiago&number=1", timeout=SOON).text
        assert 'data-feed="/live?kb=tiago" data-head="1"' in page
        assert "data-live" in page
        assert 'role="status" aria-live="polite"' in page
        assert "/static/live.js?v=" in page
        assert 'data-feed="/live" data-head="1"' in httpx2.get(address, timeout=SOON).text
        assert (
            "data-feed"
            not in httpx2.get(f"{address}/revision?kb=tiago&number=9", timeout=SOON).text
        )

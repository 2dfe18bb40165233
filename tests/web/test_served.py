"""`kant-sql serve` as a process: where it listens, how large answers get, and what errors say."""

from __future__ import annotations

import http.client
import itertools
import json
import shutil
import socket
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import psutil
import pytest
from sqlalchemy import make_url

from kant_sql.errors import ClosedError
from kant_sql.web.stores import OpenStore, persistent
from tests.audit.story import record_store
from tests.benchmarks.support import alternate
from tests.browser.addresses import ALL, FIRST
from tests.support.browsing import Serving
from tests.support.crawling import Markup
from tests.support.processes.commands import PROGRAM
from tests.support.processes.workers import PATIENCE
from tests.support.servers import MortalServer
from tests.support.stores import Connect
from tests.support.worlds.robots import ROBOT

PASSWORD = "the-password-of-the-robot"
# Of an answer, whatever is asked for: the story is a small store.
LARGEST = 500_000
HUGE = ("9" * 30, "-1", "x" * 10_000, "(" * 5000, "(not " * 2000 + ")" * 2000)


def ask(
    served: Serving, path: str, method: str = "GET", **headers: str
) -> tuple[int, dict[str, str], str]:
    """Ask a server, which may say no before it has read everything."""
    connection = http.client.HTTPConnection(urlsplit(served.address).netloc, timeout=PATIENCE)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, dict(answer.getheaders()), text


def everything(pages: Sequence[str] = ALL) -> Iterator[str]:
    """Give the addresses of pages, and of their JSON."""
    for each in pages:
        yield each
        if each != "/api":
            yield f"/api{each}"


@contextmanager
def serving(url: str, folder: Path, *words: str, **options: Any) -> Iterator[Serving]:
    served = Serving(url, folder, *words, **options)
    try:
        yield served
    finally:
        served.stop()


@pytest.fixture(scope="module")
def served(sqlite_story: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    with serving(sqlite_story, tmp_path_factory.mktemp("served")) as running:
        yield running


pytestmark = pytest.mark.more


@pytest.mark.smoke
def test_it_listens_where_only_this_machine_reaches_it(served: Serving) -> None:
    address = urlsplit(served.address)
    assert address.hostname == "127.0.0.1"
    assert ask(served, "/", Host="evil.example")[0] == 400
    # The machine's other addresses: another one of the loopback's stands for them.
    with (
        pytest.raises(ConnectionRefusedError),
        socket.create_connection(("127.0.0.2", address.port)),
    ):
        pass


@pytest.mark.smoke
def test_another_address_needs_a_token(sqlite_story: str, tmp_path: Path) -> None:
    with serving(sqlite_story, tmp_path, "--host", "0.0.0.0") as running:
        assert running.token is not None
        assert len(running.token) >= 32
        running.address = running.address.replace("0.0.0.0", "127.0.0.1")
        for path in everything():
            status, _, text = ask(running, path)
            assert (status, "(robot_at" in text.split("<form")[0]) == (401, False), path
        bearer = f"Bearer {running.token}"
        assert ask(running, "/api/", Authorization=bearer)[0] == 200
        assert ask(running, "/api/", Authorization=bearer[:-1])[0] == 401
        # It is not part of an address, which would be kept in histories and logs.
        assert ask(running, f"/api/?token={running.token}")[0] == 401


def test_every_answer_is_bounded(served: Serving) -> None:
    described = json.loads(ask(served, "/api/openapi.json")[2])["paths"]
    for path in everything():
        status, _, text = ask(served, path)
        assert status == 200, (path, text[:500])
        assert len(text) < LARGEST, path
    for each in FIRST:
        page, _, query = each.partition("?")
        declared = described.get(f"/api{page}", {}).get("get", {}).get("parameters", ())
        for name, huge in itertools.product((one["name"] for one in declared), HUGE):
            kept = [part for part in query.split("&") if not part.startswith(f"{name}=")]
            asked = f"{page}?{'&'.join((*kept, urlencode({name: huge})))}"
            status, _, text = ask(served, asked)
            assert status in (200, 400, 404, 422), (asked[:200], status, text[:300])
            assert len(text) < LARGEST, asked[:200]


def test_a_query_of_200_kb_is_answered_and_a_longer_one_is_refused(served: Serving) -> None:
    for path in everything(FIRST):
        long = f"{path}{'&' if '?' in path else '?'}unknown={'x' * 200_000}"
        status, _, text = ask(served, long)
        # JSON refuses what no path reads; a page ignores it.
        expected = 400 if path.startswith("/api/") else 200
        assert (status, len(text) < LARGEST) == (expected, True), path
    try:
        status = ask(served, f"/?unknown={'x' * 1_000_000}")[0]
    except (BrokenPipeError, ConnectionResetError):
        # It need not read what it does not answer.
        status = 400
    assert status == 400
    assert ask(served, "/")[0] == 200


def test_a_stopped_database_is_told_without_password_and_traceback(
    mortal_server: MortalServer, mortal_url: str, tmp_path: Path
) -> None:
    record_store(mortal_url)
    url = make_url(mortal_url).set(password=PASSWORD).render_as_string(hide_password=False)
    assert PASSWORD in url
    with serving(url, tmp_path) as running:
        assert {ask(running, path)[0] for path in everything(FIRST)} == {200}
        mortal_server.kill()
        # Each waits for a while whether the server comes back, and eight may ask at a time.
        paths = FIRST[::4]
        assert len(paths) <= 8
        with ThreadPoolExecutor(8) as threads:
            answers = list(threads.map(partial(ask, running), paths))
        for path, (status, headers, text) in zip(paths, answers, strict=True):
            assert status == (200 if path == "/api" else 503), (path, text)
            assert PASSWORD not in text
            assert "Traceback" not in text
            assert list(Markup(text).faults()) == []
            assert PASSWORD not in str(headers)
        mortal_server.restart()
        assert {ask(running, path)[0] for path in everything(FIRST)} == {200}
        assert PASSWORD not in running.log()


@pytest.mark.smoke
def test_a_broken_file_is_told_without_traceback(sqlite_story: str, tmp_path: Path) -> None:
    path = tmp_path / "store.db"
    shutil.copy(str(make_url(sqlite_story).database), path)
    with serving(f"sqlite:///{path}", tmp_path) as running:
        # The pages after the first few: what is in them is read when it is asked for.
        size = path.stat().st_size
        with path.open("r+b") as file:
            file.seek(8192)
            file.write(b"\xff" * (size - 8192))
        for asked in everything():
            status, _, text = ask(running, asked)
            assert status in (200, 500, 503), asked
            assert "Traceback" not in text


def test_a_question_is_asked_again_of_a_file_that_another_reader_has_opened_anew(
    file_url: str, connect: Connect, tmp_path: Path
) -> None:
    with connect(file_url) as kb:
        kb.types.save(ROBOT)
    path, copy = Path(str(make_url(file_url).database)), tmp_path / "copy.db"
    shutil.copy(path, copy)
    store, times = OpenStore(file_url), iter([copy])

    def revision() -> int:
        with store.knowledge_base("default") as kb:
            for each in times:
                assert kb.revision
                each.replace(path)
                with ThreadPoolExecutor(1) as other:
                    assert other.submit(persistent, revision).result(60)
            return kb.revision

    def names() -> list[str]:
        return store.read_catalog(lambda catalog: catalog.first_names(2))

    with closing(store):
        assert persistent(revision) == 1
        assert names() == ["default"]
    with pytest.raises(ClosedError):
        persistent(revision)
    with pytest.raises(ClosedError):
        names()


def test_a_kept_connection_is_no_slower_than_new_ones(served: Serving) -> None:
    kept = http.client.HTTPConnection(urlsplit(served.address).netloc, timeout=PATIENCE)

    def ask_again() -> None:
        for _ in range(10):
            kept.request("GET", "/static/icon.svg")
            kept.getresponse().read()

    def ask_anew() -> None:
        for _ in range(10):
            ask(served, "/static/icon.svg")

    again, anew = alternate(5, lambda _: ask_again, lambda _: ask_anew)
    kept.close()
    # With Nagle's algorithm, each answer would wait for an acknowledgement: ten times as long.
    assert again[0] < 3 * anew[0]


def test_its_memory_does_not_grow_with_requests(sqlite_story: str, tmp_path: Path) -> None:
    with serving(sqlite_story, tmp_path, program=PROGRAM) as running:
        process, paths = psutil.Process(running.process.pid), list(everything(FIRST))
        # Caches fill, and the allocator keeps what the largest answers took.
        for path in paths * 24:
            ask(running, path)
        before = process.memory_info().rss
        for path in paths * 16:
            ask(running, path)
        grown = process.memory_info().rss - before
    # An answer that is kept has more than this.
    assert grown < 8_000 * 16 * len(paths)


def test_it_ends_with_ctrl_c(sqlite_story: str, tmp_path: Path) -> None:
    running = Serving(sqlite_story, tmp_path, program=PROGRAM)
    ask(running, "/")
    running.stop()
    assert running.process.returncode in (0, -2, -15, 130, 143)
    assert running.log() == ""

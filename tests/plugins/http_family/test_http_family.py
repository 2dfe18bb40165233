"""The DAO family over HTTP: a server and its clients, and what is refused."""

from __future__ import annotations

import asyncio
import contextvars
import logging
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto, aio, errors
from kant_sql.errors import (
    AuthenticationError,
    ClosedError,
    ConnectionLostError,
    DependantsError,
    InvalidArgumentError,
    InvalidUrlError,
    OutcomeUnknownError,
    PddlError,
    ReadOnlyError,
    ReadOnlyStoreError,
    StaleRevisionError,
    StoreBusyError,
    StoreError,
    StoreUnreachableError,
    TransactionOpenError,
    UnknownNameError,
)
from kant_sql.web import transactions
from kant_sql_plugins import http_family
from tests.support.cutting import cutting
from tests.support.generators.junk import looped_type
from tests.support.processes.workers import wait_for
from tests.support.remote import Served, served
from tests.support.serving import running
from tests.support.stores import Connect, new_file_store
from tests.unit.test_factory import chain

WP = PddlTypeDto("wp")
BATTERY = "(= (battery) 0)"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Served]:
    with served(new_file_store(tmp_path / "store.db"), tmp_path) as running_server:
        yield running_server


@pytest.mark.smoke
def test_a_url_opens_the_daos_of_a_server(server: Served, connect: Connect) -> None:
    kb = connect(server.at("tiago"), actor="test")
    assert repr(kb) == f"<KnowledgeBase 'tiago' of {server.address}>"
    assert (kb.objects.get_all(), kb.revision) == ([], 0)
    assert kb.objects.save_all(PddlObjectDto(WP, f"wp{number}") for number in range(3)) == 3
    assert kb.functions.save("(battery) - number")
    assert kb.function_values.save(BATTERY)
    assert kb.function_values.increase("battery", by=Decimal("0.10")) == Decimal("0.10")
    assert kb.function_values.get(function="battery") == Decimal("0.10")
    assert kb.pddl.metric.set("(:metric minimize (battery))")
    assert str(kb.pddl.metric.get()) == "(:metric minimize (battery))"
    direct = connect(server.url, knowledge_base="tiago")
    assert (direct.revision, direct.store.revisions()[0].actor) == (5, "test")
    assert direct.objects.get_all() == kb.objects.get_all()
    with pytest.raises(DependantsError) as refused:
        kb.functions.save("(battery ?w - wp) - number")
    assert "value (= (battery) 0.10)" in refused.value.dependants
    with pytest.raises(PddlError) as unread:
        kb.propositions.save("(at")
    assert (unread.value.line, unread.value.column) == (1, 4)
    with pytest.raises(PddlError, match=r"\\ud800"):
        kb.types.save("\ud800")
    with pytest.raises(TypeError, match="unexpected keyword argument 'by'"):
        kb.types.save("x", by=5)  # type: ignore[call-arg]
    kb.close()
    for call in (kb.objects.get_all, lambda: kb.types.save("robot"), lambda: kb.revision):
        with pytest.raises(ClosedError, match="was closed; connect again"):
            call()
    assert repr(kb).endswith(", closed>")


async def test_tasks_and_threads_share_one(server: Served, connect: Connect) -> None:
    async with aio.connect(server.at("tiago")) as front:
        await asyncio.gather(*(front.types.save(f"t{number}") for number in range(20)))
        assert await front.revision() == 20
    kb = connect(server.at("tiago"))
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda number: kb.types.save(f"u{number}"), range(20)))
    assert (len(kb.types.get_all()), kb.revision) == (40, 40)


def test_the_token_decides_who_writes_what(server: Served, connect: Connect) -> None:
    add, at = server.tokens.add, server.at
    reader = connect(at("tiago", add("reader", ["tiago"], ["read"])))
    with pytest.raises(AuthenticationError, match="the token has not the scope write"):
        reader.types.save("robot")
    writer = connect(at("tiago", add("writer", ["tiago", "other"], ["write", "read"])))
    assert writer.types.save("robot")
    assert [str(one) for one in reader.types.get_all()] == ["robot"]
    with pytest.raises(InvalidArgumentError, match="the token writes as 'reader', not as 'me'"):
        connect(at("tiago", add("reader", ["*"], ["read"])), actor="me")
    with pytest.raises(AuthenticationError, match="not for the knowledge base 'secret'"):
        connect(at("secret", add("reader", ["tiago"], ["read"])))
    for wrong in ("wrong-and-unknown", f"{server.secret}x"):
        with pytest.raises(AuthenticationError, match="unknown, or was revoked"):
            connect(at("tiago", wrong)).types.save("x")
    kb = connect(at("tiago"))
    server.tokens.revoke(server.secret.partition(".")[0])
    with pytest.raises(AuthenticationError, match="revoked"):
        kb.types.save("wp")
    assert reader.revision == 1


def test_what_only_reads_refuses_to_write(
    server: Served, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert connect(server.at("tiago")).types.save("robot")
    monkeypatch.setenv("KANT_SQL_TOKEN", server.secret)
    reader = connect(f"{server.address}/tiago", read_only=True)
    with pytest.raises(ReadOnlyError, match="was opened for reading only"):
        reader.types.save("wp")
    monkeypatch.delenv("KANT_SQL_TOKEN")
    with running(server.url) as address:
        kb = connect(address, knowledge_base="tiago")
        assert [str(one) for one in kb.types.get_all()] == ["robot"]
        with pytest.raises(ReadOnlyStoreError, match="start it with: kant-sql serve --write"):
            kb.types.save("wp")
        with pytest.raises(UnknownNameError, match="no knowledge base 'other'"):
            connect(f"{address}/other")
    with pytest.raises(InvalidUrlError, match="lacks plans"):
        _ = kb.plans
    direct = connect(server.url, knowledge_base="tiago")
    act = direct.executions.report("go", outcome="running")
    with pytest.raises(InvalidUrlError, match="lacks executions"), kb.transaction(execution=act):
        pass


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("http://:SECRET@robot.example/kb", "would carry the token in the clear; use https://"),
        ("https://SECRET@host/kb", "write https://:TOKEN@HOST:PORT/KNOWLEDGE_BASE"),
        ("https://me:SECRET@host/kb", "not the URL of a server"),
        ("https:///kb", "not the URL of a server"),
        ("https://:SECRET@a..b/kb", "not the URL of a server"),
        ("https://:SECRET@my host/kb", "not the URL of a server"),
        ("https://:SECRET@host:99999/kb", "not the URL of a server"),
        (f"https://:SECRET@host/kb?timeout={'9' * 20}", "timeout is a number of seconds"),
        ("https://:SECRET@host/kb?frobnicate=1", "the options timeout and insecure only"),
        ("https://:SECRET@host/kb?timeout=0", "timeout is a number of seconds"),
        ("https://:SECRET@host/kb?timeout=soon", "timeout is a number of seconds"),
        ("https://:SECRET@host/kb#part", "the options timeout and insecure only"),
        ("https://:SECRET%0d@host/kb", "characters that HTTP headers cannot carry"),
        ("https://:SECRET@host/other", "names the knowledge base 'other', and knowledge_base is"),
    ],
)
def test_a_url_that_is_wrong_is_refused_without_the_token(url: str, message: str) -> None:
    with pytest.raises(InvalidUrlError) as caught:
        kant_sql.connect(url, knowledge_base="kb")
    assert message in str(caught.value)
    assert not [one for one in chain(caught.value) if "SECRET" in f"{one}{one!r}"]


def test_no_message_and_no_log_has_the_token(
    server: Served, connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    kb = connect(server.at("tiago"))
    shown = [repr(kb), kb.store.factory.address, kb.store.factory.label]
    with pytest.raises(errors.KantSqlError) as refused:
        kb.types.save(looped_type())
    with pytest.raises(StoreUnreachableError) as unreachable:
        connect("http://:SECRET@127.0.0.1:1/tiago")
    assert str(unreachable.value).startswith("http://127.0.0.1:1: no connection (")
    for error in (*chain(refused.value), *chain(unreachable.value)):
        shown += [str(error), repr(error)]
    shown += [record.getMessage() for record in caplog.records]
    assert not [text for text in shown if server.secret in text or "SECRET" in text]


@contextmanager
def answering(answer: Callable[[socket.socket], None]) -> Iterator[str]:
    """A server that reads each request, and answers as it is told to; give its address."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            with client:
                client.recv(1 << 16)
                answer(client)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join()


@pytest.mark.parametrize(
    ("answer", "error", "message"),
    [
        (b"", ConnectionLostError, "no answer"),
        (b"HTTP/1.1 200 OK\r\n\r\n", ConnectionLostError, "the answer has no length"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n{}", ConnectionLostError, "no answer"),
        (b"SSH-2.0-OpenSSH_9.6\r\n", ConnectionLostError, "no answer"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi", StoreError, "answers 200"),
        (b"HTTP/1.1 302 x\r\nContent-Length: 0\r\nLocation: /\r\n\r\n", StoreError, "answers 302"),
        (b"HTTP/1.1 404 x\r\nContent-Length: 3\r\n\r\n\x1b[1", StoreError, r"answers 404.*\\u001b"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}", StoreError, "of this version"),
    ],
)
def test_what_is_no_server_of_ours_is_named(
    answer: bytes, error: type[StoreError], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_family, "PAUSES", (0.0,))
    with (
        answering(lambda client: client.sendall(answer)) as address,
        pytest.raises(error, match=message) as caught,
        kant_sql.connect(f"{address}/kb") as kb,
    ):
        kb.types.get_all()
    assert type(caught.value) is error


@pytest.fixture
def certificate(tmp_path: Path) -> Path:
    """A certificate of this machine that nobody else knows, with its key."""
    program = shutil.which("openssl")
    if program is None:
        pytest.skip("needs the program openssl")
    path = tmp_path / "own.pem"
    words = [program, "req", "-x509", "-nodes", "-newkey", "rsa:2048", "-subj", "/CN=localhost"]
    words += ["-addext", "subjectAltName=IP:127.0.0.1", "-out", path.name, "-keyout", path.name]
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    return path


def test_over_tls_a_certificate_of_ones_own_is_trusted_by_name(
    tmp_path: Path, certificate: Path, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = new_file_store(tmp_path / "store.db")
    with served(store, tmp_path, certificate) as server:
        url = server.at("tiago")
        assert url.startswith("https://")
        with pytest.raises(StoreUnreachableError, match="certificate"):
            connect(url).types.get_all()
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        kb = connect(url)
        assert kb.types.save("robot") is True
        assert kb.types.get("robot") == PddlTypeDto("robot")
        kb.close()


def change(kb: KnowledgeBase, **place: Any) -> None:
    """Let the next requests go elsewhere, or wait for another time."""
    link: Any = kb.store.factory._link  # type: ignore[attr-defined]
    link.place = link.place._replace(**place)
    link._drop()


def test_a_write_without_an_answer_may_have_happened(
    server: Served, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_family, "PAUSES", (0.0,))
    kb = connect(server.at("tiago"))
    change(kb, timeout=0.2)
    direct = connect(server.url, knowledge_base="tiago", actor="other")
    with direct.transaction():
        direct.types.save("first")
        with pytest.raises(OutcomeUnknownError, match=r"no answer to a write \(timed out\)"):
            kb.types.save("robot")


@contextmanager
def cut_at_random(
    kb: KnowledgeBase, server: Served, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Cut the connections of a block at random places."""
    monkeypatch.setattr(http_family, "PAUSES", (0.0,) * 60)
    send = http_family._Link._send

    def send_alone(self: Any, method: str, target: str, body: bytes, headers: Any) -> Any:
        # The proxy leads one request on each connection.
        return send(self, method, target, body, {**headers, "Connection": "close"})

    monkeypatch.setattr(http_family._Link, "_send", send_alone)
    with cutting(int(server.address.rpartition(":")[2])) as proxy:
        change(kb, port=proxy.port)
        yield
    assert min(proxy.cuts.values()) > 30


@pytest.fixture
def direct(server: Served, connect: Connect) -> KnowledgeBase:
    """A knowledge base of the server's store with a value to count by."""
    kb = connect(server.url, knowledge_base="tiago", actor="setup")
    assert kb.functions.save("(battery) - number")
    assert kb.function_values.save(BATTERY)
    return kb


@pytest.mark.more
def test_writes_whose_connections_are_cut_are_written_once(
    server: Served, direct: KnowledgeBase, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(server.at("tiago"))
    with cut_at_random(kb, server, monkeypatch):
        done = [kb.function_values.increase("battery", by=1) for _ in range(100)]
    assert done == [*range(1, 101)]
    assert direct.function_values.get("battery") == 100
    assert direct.revision == 102


def test_a_transaction_is_one_revision_nobody_else_sees(server: Served, connect: Connect) -> None:
    kb, other = connect(server.at("tiago")), connect(server.at("tiago"))
    with kb.transaction(reason="moved in", source={"from": [1, 2.5]}):
        assert kb.types.save("robot")
        assert kb.objects.save_all(["rb1 - robot", "rb2 - robot"]) == 2
        assert [one.name for one in kb.objects.get_all()] == ["rb1", "rb2"]
        assert kb.revision == 0
        assert other.objects.get_all() == []
        with ThreadPoolExecutor(1) as threads:
            assert threads.submit(kb.types.get_all).result() == []
        with pytest.raises(TransactionOpenError, match="has a transaction of actor 'test' open"):
            contextvars.copy_context().run(kb.types.save, "wp")
        with suppress(ZeroDivisionError), kb.transaction():
            kb.objects.save("rb3 - robot")
            raise ZeroDivisionError
    with suppress(ZeroDivisionError), kb.transaction():
        kb.objects.save("rb4 - robot")
        raise ZeroDivisionError
    (revision,) = connect(server.url, knowledge_base="tiago").store.revisions()
    assert (revision.actor, revision.reason) == ("test", "moved in")
    assert revision.source == {"from": [1, 2.5]}
    assert [one.name for one in other.objects.get_all()] == ["rb1", "rb2"]
    assert kb.at(0).objects.get_all() == []
    assert repr(kb.at(1)).endswith(" at revision 1>")
    with pytest.raises(InvalidArgumentError, match="the token writes as 'test', not as 'me'"):
        kb.transaction(actor="me").__enter__()
    with pytest.raises(InvalidArgumentError, match="unexpected keyword argument 'why'"):
        kb.transaction(why="so").__enter__()  # type: ignore[call-arg]
    with pytest.raises(StaleRevisionError) as stale:
        kb.transaction(expected_revision=0).__enter__()
    assert (stale.value.expected, stale.value.actual) == (0, 1)


async def test_tasks_have_transactions(server: Served) -> None:
    async with aio.connect(server.at("tiago")) as kb:

        async def write(number: int) -> None:
            async with kb.transaction():
                await kb.types.save(f"a{number}")
                await kb.types.save(f"b{number}")

        await asyncio.gather(*(write(number) for number in range(5)))
        assert await kb.revision() == 5


def test_who_leaves_a_transaction_alone_loses_it(
    server: Served, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, direct = connect(server.at("tiago")), connect(server.url, knowledge_base="tiago")
    transaction = kb.transaction()
    transaction.__enter__()
    # The server looks at it after its next request.
    monkeypatch.setattr(transactions, "IDLE", 0.01)
    assert kb.types.save("wp")
    # Another writer waits for the end of this one.
    assert direct.types.save("other")
    with pytest.raises(ConnectionLostError, match="nothing of it was written"):
        kb.types.save("late")
    with pytest.raises(ConnectionLostError, match="nothing of it was written"):
        transaction.__exit__(None, None, None)
    assert [one.name for one in kb.types.get_all()] == ["other"]
    monkeypatch.setattr(transactions, "IDLE", 10.0)
    with kb.transaction():
        kb.types.save("robot")
    assert kb.revision == 2


def test_who_closes_within_a_transaction_ends_it(
    server: Served, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transactions, "IDLE", 60.0)
    kb, direct = connect(server.at("tiago")), connect(server.url, knowledge_base="tiago")
    with suppress(ClosedError), kb.transaction():
        kb.types.save("wp")
        kb.close()
        assert direct.types.save("other")
    assert [one.name for one in direct.types.get_all()] == ["other"]


def test_a_server_has_so_many_transactions_open(
    server: Served, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transactions, "MOST_OPEN", 1)
    kb = connect(server.at("tiago"))
    with kb.transaction():
        kb.types.save("robot")
        with pytest.raises(StoreBusyError, match="1 transactions are open"):
            connect(server.at("other")).transaction().__enter__()
    assert kb.revision == 1


def test_a_commit_that_is_repeated_is_written_once(
    server: Served, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(server.at("tiago"))
    opened: Any = None
    with kb.transaction():
        kb.types.save("robot")
        opened = kb.store.factory._opened()  # type: ignore[attr-defined]

    def again(step: str) -> Any:
        opened._number -= 1
        return opened.ask(step)

    assert again("commit") == {}
    wait_for(lambda: "kant_sql client" not in [thread.name for thread in threading.enumerate()])
    # The server forgets it, as one that is restarted.
    monkeypatch.setattr(transactions, "KEPT", -1.0)
    with kb.transaction():
        kb.types.save("wp")
    assert (again("commit"), again("rollback")) == ({}, {})
    with pytest.raises(ConnectionLostError, match="begin it again"):
        again("call")
    opened._id = "0" * 32
    with pytest.raises(ConnectionLostError, match="begin it again"):
        again("commit")
    assert kb.revision == 2


def test_a_token_that_may_not_read_reads_in_no_transaction(
    server: Served, connect: Connect
) -> None:
    kb = connect(server.at("tiago"))
    change(kb, token=server.tokens.add("blind", ["*"], ["write"]))
    with kb.transaction():
        kb.types.save("robot")
        with pytest.raises(AuthenticationError, match="the token has not the scope read"):
            kb.types.get_all()
    change(kb, token=server.secret)
    assert [one.name for one in kb.types.get_all()] == ["robot"]


@pytest.mark.more
def test_transactions_whose_connections_are_cut_are_written_once(
    server: Served, direct: KnowledgeBase, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(server.at("tiago"))
    with cut_at_random(kb, server, monkeypatch):
        for number in range(30):
            with kb.transaction():
                assert kb.function_values.increase("battery", by=1) == 2 * number + 1
                assert kb.function_values.get("battery") == 2 * number + 1
                assert kb.function_values.increase("battery", by=1) == 2 * number + 2
    assert direct.function_values.get("battery") == 60
    assert direct.revision == 32


def test_too_much_for_one_request_is_refused_here(
    server: Served, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    def endless() -> Iterator[str]:
        while True:
            yield "robot"

    kb = connect(server.at("tiago"))
    with pytest.raises(InvalidArgumentError, match="takes up to 100,000 elements over HTTP"):
        kb.types.save_all(endless())
    with pytest.raises(InvalidArgumentError, match="write it in several"):
        kb.types.save_all("x" * 2**20 for _ in range(17))
    with pytest.raises(InvalidArgumentError, match="ask in several"):
        kb.types.get("x" * 261_000)
    assert kb.types.get("x" * 250_000) is None
    assert kb.revision == 0


@pytest.mark.usefixtures("connect")
def test_a_server_that_lies_raises_errors_of_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[Any] = [{"revision": 0, "actor": None}]
    monkeypatch.setattr(http_family._Link, "_send", lambda *_: (said[0], said[1]))
    for status, body in (
        (409, b'{"error": "no", "type": "SourceError", "details": {"a": [1]}}'),
        (409, b'{"error": "no", "type": "printable"}'),
        (409, b'{"error": "no", "type": ["KantSqlError"]}'),
        (500, b'{"error": "no", "type": "InternalServerError"}'),
        (200, b"[" * sys.getrecursionlimit() * 2),
        (200, b'{"pool": [{"Domain": {}}], "value": 1}'),
    ):
        said[:] = 200, b'{"revision": 0, "actor": null}'
        with kant_sql.connect("http://127.0.0.1/kb") as kb:
            said[:] = status, body
            for call in (kb.types.get_all, kb.types.delete_all):
                with pytest.raises(errors.KantSqlError) as caught:
                    call()
                assert str(caught.value)

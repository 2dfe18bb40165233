"""A client repeats a request whose answer was lost: it is written once."""

from __future__ import annotations

import http.client
import json
import random
import subprocess
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql.knowledge_base import state_of
from kant_sql.store.requests import forget_requests
from kant_sql.web.tokens import TokenFile
from tests.support.cutting import cutting
from tests.support.processes.commands import command
from tests.support.processes.workers import wait_for
from tests.support.profile import NAME
from tests.web.test_writing import DOMAIN, PROBLEM, Post, client, loaded, post, tokens, url

__all__ = ["client", "loaded", "post", "tokens", "url"]

WRITERS = 4
# 10,000 requests take a quarter of an hour.
REQUESTS = 10_000 if NAME == "long" else 400
KILLS = 2
ADD = {"kind": "function_values", "do": "increase", "element": "(battery rb1)", "by": 1}


def keyed(key: str) -> dict[str, str]:
    return {"idempotency-key": key}


def test_a_repetition_gets_the_same_answer_and_writes_nothing(loaded: Post, url: str) -> None:
    first = loaded("transaction", 200, keyed("one"), changes=[ADD])
    other = loaded("transaction", 200, keyed("two"), changes=[ADD])
    # Its own revision came since, which makes no stale writer of it.
    for headers in (keyed("one"), {**keyed("one"), "if-match": "1"}):
        again = loaded("transaction", 200, headers, changes=[ADD])
        assert again == {**first, "is_repeated": True}
    assert (first["results"], other["results"]) == (["21"], ["22"])
    refused = loaded("transaction", 422, keyed("one"), changes=[ADD, ADD])
    assert "another request" in refused["error"]
    assert "another request" in loaded("facts", 422, keyed("one"), save=[])["error"]
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        assert kb.revision == 3
        assert kb.store.verify().is_intact


def test_what_wrote_nothing_is_tried_again(loaded: Post) -> None:
    step = "(move rb1 wp2 wp1)"
    loaded("apply", 409, keyed("one"), step=step)
    assert loaded("facts", 200, keyed("two"), save=[])["revision"] is None
    loaded("facts", save=["(robot_at rb1 wp2)"])
    assert loaded("apply", 200, keyed("one"), step=step)["revision"] == 3


def test_no_name_is_kept_and_old_requests_are_forgotten(loaded: Post, url: str) -> None:
    loaded("facts", 200, keyed("Mrs Smith"), save=["(robot_at rb1 wp2)"])
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        store = state_of(kb).store
        read = "SELECT number, key, digest, results FROM request"
        rows = store.query(lambda session, _: session.rows_of(read))
        assert [(row[0], len(row[1]), len(row[2]), row[3]) for row in rows] == [
            (2, 64, 64, "[0, 1]")
        ]
        forget_requests(store, timedelta(hours=1))
        assert len(store.query(lambda session, _: session.rows_of(read))) == 1
        forget_requests(store, timedelta(seconds=-60))
        assert store.query(lambda session, _: session.rows_of(read)) == []
        assert kb.revision == 2


@contextmanager
def served(url: str, tokens: Path) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """Serve a store in a process that can be killed; give its port."""
    words = [*command(), "serve", url, "--port", "0", "--write", "--tokens", str(tokens)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield int(process.stdout.readline().rpartition(":")[2].strip(" /\n")), process
        finally:
            process.kill()


class Client:
    """Writes through a proxy, and repeats what it had no whole answer to."""

    def __init__(self, port: int, secret: str, seed: int) -> None:
        self._port = port
        self._headers = {"Authorization": f"Bearer {secret}", "Connection": "close"}
        self._headers["Content-Type"] = "application/json"
        self._random = random.Random(seed)
        self.done: list[int] = []
        self.tries = 0

    def write(self, path: str, **body: Any) -> None:
        key = str(uuid.UUID(int=self._random.getrandbits(128)))
        while True:
            self.tries += 1
            connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=60)
            try:
                headers = {**self._headers, "Idempotency-Key": key}
                connection.request("POST", f"/api/{path}", json.dumps(body), headers)
                answer = connection.getresponse()
                text = answer.read()
                # Cut within its head, an answer may seem to be whole, and empty.
                document = json.loads(text)
            except (OSError, http.client.HTTPException, ValueError):
                continue
            finally:
                connection.close()
            if answer.status in (429, 503):
                continue
            assert answer.status == 200, text
            self.done.append(document["revision"])
            return

    def count(self, times: int) -> None:
        """Add one so many times."""
        for _ in range(times):
            self.write("transaction", changes=[ADD])


def _went_on(clients: list[Client], before: int) -> bool:
    return sum(one.tries for one in clients) > before


def wait_for_many(clients: list[Client], goal: int) -> None:
    """Wait until so many requests are written, however long that takes."""
    while sum(len(one.done) for one in clients) < goal:
        before = sum(one.tries for one in clients)
        wait_for(partial(_went_on, clients, before))


@pytest.mark.more
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("is_killed", [False, True], ids=["cut", "killed"])
def test_requests_whose_connections_are_cut_are_written_once(
    url: str, tokens: TokenFile, is_killed: bool
) -> None:
    secret = tokens.add("counter", ["tiago"], ["write"])
    with kant_sql.connect(url, knowledge_base="tiago", actor="setup") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
    with ExitStack() as stack:
        port, process = stack.enter_context(served(url, tokens._path))
        proxy = stack.enter_context(cutting(port))
        clients = [Client(proxy.port, secret, seed) for seed in range(WRITERS)]
        with ThreadPoolExecutor(WRITERS) as threads:
            counting = [threads.submit(one.count, REQUESTS // WRITERS) for one in clients]
            for kill in range(1, 1 + KILLS * is_killed):
                goal = REQUESTS * kill // (KILLS + 1)
                wait_for_many(clients, goal)
                process.kill()
                process.wait()
                proxy.target, process = stack.enter_context(served(url, tokens._path))
            for one in counting:
                one.result()
    revisions = sorted(number for one in clients for number in one.done)
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        assert revisions == [*range(3, REQUESTS + 3)]
        assert kb.revision == REQUESTS + 2
        assert kb.function_values.get("(battery rb1)") == 20 + REQUESTS
        assert kb.store.verify().is_intact
    assert min(proxy.cuts.values()) > REQUESTS // 8
    assert sum(one.tries for one in clients) > 2 * REQUESTS

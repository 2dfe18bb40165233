"""`kant-sql watch`: the revisions, as they come."""

from __future__ import annotations

import json
import signal
import subprocess
from typing import Any

import kant_sql
from tests.cli.conftest import in_background
from tests.support.processes.commands import CHILD_TIMEOUT, documents, run
from tests.support.worlds.robots import waypoint


def watched(*words: str) -> list[dict[str, Any]]:
    """What `watch --json` writes until its time is over: a document on each line."""
    return documents("watch", *words, "--timeout", "0")


def next_document(process: subprocess.Popen[bytes]) -> dict[str, Any]:
    """Wait for the next line."""
    assert process.stdout is not None
    document: dict[str, Any] = json.loads(process.stdout.readline())
    return document


def save(url: str, number: int) -> None:
    with kant_sql.connect(url, knowledge_base="tiago", actor="elsewhere") as kb:
        kb.objects.save(waypoint(number))


def test_it_begins_after_a_revision_and_is_the_log_turned_round(store: str) -> None:
    log = run("log", store, "--json").stdout.splitlines()
    assert watched(store, "--after", "0") == [json.loads(line) for line in log[::-1]]
    assert [entry["number"] for entry in watched(store, "--after", "2")] == [3]
    assert watched(store, "--after", "3") == watched(store) == []
    texts = run("log", store).stdout.rstrip("\n").split("\n\n")
    written = run("watch", store, "--after", "0", "--timeout", "0").stdout
    assert written.rstrip("\n").split("\n\n") == texts[::-1]


def test_a_pipe_gets_each_revision_at_once(own_store: str) -> None:
    with in_background("watch", own_store, "--json", "--after", "2") as process:
        assert next_document(process)["number"] == 3
        for number in (4, 5):
            save(own_store, number)
            entry = next_document(process)
            assert (entry["number"], entry["actor"]) == (number, "elsewhere")
            assert entry["changes"] == [{"sign": "+", "kind": "object", "text": f"wp{number} - wp"}]
        assert process.poll() is None


def test_it_ends_by_itself_when_time_is_over(own_store: str) -> None:
    with in_background("watch", own_store, "--timeout", "0.1") as process:
        assert process.wait(CHILD_TIMEOUT) == 0
        assert process.communicate() == (b"", b"")


def test_ctrl_c_ends_it_without_a_word(own_store: str) -> None:
    with in_background("watch", own_store, "--json", "--after", "2") as process:
        assert next_document(process)["number"] == 3
        process.send_signal(signal.SIGINT)
        assert process.wait(CHILD_TIMEOUT) == 130
        assert process.stderr is not None
        assert process.stderr.read() == b""


def test_it_ends_when_nobody_reads_any_more(own_store: str) -> None:
    with in_background("watch", own_store, "--after", "2") as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith(b"revision 3  ")
        process.stdout.close()
        process.stdout = None
        assert process.wait(CHILD_TIMEOUT) == 0
        assert process.stderr is not None
        assert process.stderr.read() == b""

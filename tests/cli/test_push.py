"""`kant-sql push` and `promote`: replicas, once or by a service."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql.history.replication import service
from tests.cli.conftest import write_history
from tests.support.archives import target_url
from tests.support.processes.commands import CHILD_TIMEOUT, PROGRAM, one_line, run, start
from tests.support.replicas import equal_histories
from tests.support.servers import MortalServer
from tests.support.stores import new_file_store
from tests.support.worlds.robots import waypoint

Document = dict[str, Any]


@pytest.fixture
def source(tmp_path: Path) -> str:
    """The URL of a store with one knowledge base, tiago, of three revisions."""
    url = new_file_store(tmp_path / "source.db")
    write_history(url)
    return url


@pytest.fixture
def replica(tmp_path: Path) -> str:
    """The URL of a file that is not there yet."""
    return target_url(tmp_path, "replica.db")


def save(url: str, number: int, name: str = "tiago") -> None:
    with kant_sql.connect(url, knowledge_base=name, actor="elsewhere") as kb:
        kb.objects.save(waypoint(number))


def documents(*words: str) -> list[Document]:
    result = run("push", *words, "--json")
    assert result.exit_code == 0, result.stderr
    return [json.loads(line) for line in result.stdout.splitlines()]


def test_it_says_what_it_sent(source: str, replica: str) -> None:
    first = run("push", source, replica)
    assert first.exit_code == 0
    assert re.fullmatch(
        rf"tiago: revisions 1 to 3 sent to {replica} \(\d+ versions\)\n", first.stdout
    )
    assert run("push", source, replica).stdout == "tiago: nothing new, at revision 3\n"
    save(source, 7)
    assert run("push", source, replica).stdout.startswith("tiago: revision 4 sent to ")
    equal_histories(source, replica)


def test_json_says_the_same(source: str, replica: str) -> None:
    (document,) = documents(source, replica)
    took, moment = document.pop("seconds"), document.pop("time")
    assert took >= 0
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", moment)
    assert document.pop("versions") > 5
    assert document == {
        "event": "pushed",
        "knowledge_base": "tiago",
        "target": replica,
        "before": 0,
        "revision": 3,
        "source_revision": 3,
        "revisions": 3,
    }
    (document,) = documents(source, replica)
    assert (document["event"], document["revisions"]) == ("current", 0)


def test_all_knowledge_bases_are_sent_or_the_named_one(source: str, replica: str) -> None:
    for name in ("a", "b"):
        save(source, 1, name)
    assert [each["knowledge_base"] for each in documents(source, replica, "--kb", "b")] == ["b"]
    sent = documents(source, replica)
    assert [each["knowledge_base"] for each in sent] == ["tiago", "a", "b"]
    assert [each["revisions"] for each in sent] == [3, 1, 0]
    for name in ("tiago", "a", "b"):
        equal_histories(source, replica, name)


def test_the_urls_may_be_in_the_environment(
    source: str, replica: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KANT_SQL_TARGET", replica)
    assert run("push", url=source).exit_code == 0
    equal_histories(source, replica)


def test_one_that_is_refused_does_not_keep_the_others(source: str, replica: str) -> None:
    for name in ("a", "b"):
        save(source, 1, name)
    documents(source, replica)
    with kant_sql.connect(replica, knowledge_base="a") as kb:
        kb.promote()
    for name in ("tiago", "a", "b"):
        save(source, 12, name)
    result = run("push", source, replica, "--json")
    assert result.exit_code == 65
    events = [json.loads(line) for line in result.stdout.splitlines()]
    assert [each["event"] for each in events] == ["pushed", "refused", "pushed"]
    assert events[1]["type"] == "DivergedError"
    error = json.loads(result.stderr)
    assert error == {"error": events[1]["error"], "type": "DivergedError", "exit_code": 65}
    equal_histories(source, replica, "b")


def test_exit_codes_say_whether_to_try_again(source: str, replica: str, tmp_path: Path) -> None:
    expected = {
        ("postgresql://localhost:1/x",): 75,
        ("mysql://localhost/x",): 78,
        ("sqlite://",): 65,
        (source,): 65,
        (replica, "--kb", "nobody"): 1,
        (f"sqlite:///{tmp_path}/there/is/no/folder.db",): 75,
    }
    for words, code in expected.items():
        result = run("push", source, *words)
        assert (words, result.exit_code) == (words, code), result.stderr
        assert one_line(result.stderr)
    missing = run("push", target_url(tmp_path, "missing.db"), replica)
    assert missing.exit_code == 78
    assert not (tmp_path / "missing.db").exists()
    assert run("push", source).exit_code == 2


def test_nothing_is_left_of_a_target_that_nothing_was_sent_to(tmp_path: Path, source: str) -> None:
    url = target_url(tmp_path, "nothing.db")
    assert run("push", source, url, "--kb", "nobody").exit_code == 1
    assert not (tmp_path / "nothing.db").exists()


def test_promote(source: str, replica: str) -> None:
    run("push", source, replica)
    refused = run("restore", replica, "1")
    assert refused.exit_code == 1
    assert "kant-sql promote" in one_line(refused.stderr)
    done = run("promote", replica, "--reason", "lost", "--actor", "operator")
    assert done.stdout == "knowledge base tiago, revision 4: no longer a replica\n"
    shown = run("log", replica, "-n", "1").stdout
    assert "actor: operator" in shown
    assert "+ promotion (promotion " in shown
    again = run("promote", replica, "--json")
    assert json.loads(again.stdout) == {"knowledge_base": "tiago", "revision": None}
    assert run("promote", replica).stdout == (
        "knowledge base tiago is no replica; nothing was changed\n"
    )
    assert run("restore", replica, "1").exit_code == 0
    assert run("verify", replica).exit_code == 0


@contextmanager
def following(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Follow in a process of its own, which is gone at the end."""
    process = start("push", *words, "--follow", "--json", program=PROGRAM)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def next_event(process: subprocess.Popen[bytes], *wanted: str) -> Document:
    """Wait for an event of one of some kinds."""
    assert process.stdout is not None
    while True:
        line = process.stdout.readline()
        assert line, process.communicate()
        document: Document = json.loads(line)
        if document["event"] in wanted:
            return document


def test_it_follows_knowledge_bases_and_those_to_come(source: str, replica: str) -> None:
    with following(source, replica) as process:
        assert next_event(process, "following")
        assert next_event(process, "pushed")["revision"] == 3
        save(source, 8)
        assert next_event(process, "pushed")["before"] == 3
        save(source, 1, "new")
        assert next_event(process, "pushed")["knowledge_base"] == "new"
        process.send_signal(signal.SIGTERM)
        assert next_event(process, "stopped")
        assert process.wait(CHILD_TIMEOUT) == 0
    for name in ("tiago", "new"):
        equal_histories(source, replica, name)


def test_what_is_written_within_an_interval_is_sent_at_once(source: str, replica: str) -> None:
    with following(source, replica, "--interval", "2") as process:
        next_event(process, "pushed")
        for number in range(8):
            save(source, number + 20)
        sent = 0
        pushes = 0
        while sent < 11:
            sent = next_event(process, "pushed")["revision"]
            pushes += 1
        assert pushes <= 3
        process.send_signal(signal.SIGINT)
        assert process.wait(CHILD_TIMEOUT) == 130


def test_what_is_refused_is_set_aside_and_the_others_go_on(source: str, replica: str) -> None:
    save(source, 1, "other")
    run("push", source, replica)
    run("promote", replica, "--kb", "other")
    with following(source, replica) as process:
        assert next_event(process, "refused")["knowledge_base"] == "other"
        save(source, 21)
        assert next_event(process, "pushed", "refused")["knowledge_base"] == "tiago"
        save(source, 22, "other")
        save(source, 22)
        assert next_event(process, "pushed", "refused")["knowledge_base"] == "tiago"
        process.send_signal(signal.SIGTERM)
        assert process.wait(CHILD_TIMEOUT) == 0


def test_it_ends_when_nothing_is_left_that_may_be_sent(source: str, replica: str) -> None:
    run("push", source, replica)
    run("promote", replica)
    with following(source, replica) as process:
        assert next_event(process, "refused")["type"] == "ReplicaError"
        assert process.wait(CHILD_TIMEOUT) == 65
        assert process.stderr is not None
        assert json.loads(process.stderr.read())["exit_code"] == 65


@pytest.mark.slow
def test_it_waits_for_a_server(source: str, mortal_server: MortalServer, mortal_url: str) -> None:
    with following(source, mortal_url) as process:
        next_event(process, "pushed")
        mortal_server.kill()
        save(source, 8)
        delays = [next_event(process, "waiting")["retry_in"] for _ in range(3)]
        assert all(0 < delay <= 4 for delay in delays)
        mortal_server.restart()
        assert next_event(process, "pushed")["revision"] == 4
        assert process.poll() is None
    equal_histories(source, mortal_url)


def test_delays_grow_at_random_up_to_a_bound() -> None:
    backoff = service.Backoff()
    delays = [backoff.delay() for _ in range(12)]
    for number, delay in enumerate(delays):
        most = min(service.FIRST_DELAY * 2**number, service.LONGEST_DELAY)
        assert most / 2 <= delay <= most
    assert len({*delays}) == len(delays)
    backoff.reset()
    assert backoff.delay() <= service.FIRST_DELAY


def test_log_lines_are_pairs(source: str, replica: str) -> None:
    process = start("push", source, replica, "--follow", program=PROGRAM)
    try:
        assert process.stdout is not None
        lines = [process.stdout.readline().decode() for _ in range(2)]
    finally:
        process.kill()
        process.communicate()
    pair = r'[a-z_]+=(?:[^\s"=]+|"(?:[^"\\]|\\.)*")'
    for line in lines:
        assert re.fullmatch(rf"{pair}(?: {pair})*\n", line), line
    assert "event=following" in lines[0]
    assert " knowledge_base=tiago " in lines[1]


def test_it_can_be_started_before_its_knowledge_base(tmp_path: Path, replica: str) -> None:
    source = new_file_store(tmp_path / "empty.db")
    with following(source, replica, "--kb", "tiago") as process:
        next_event(process, "following")
        time.sleep(0.5)
        save(source, 1)
        assert next_event(process, "pushed")["revision"] == 1


def test_the_source_is_not_written_to(source: str, replica: str, tmp_path: Path) -> None:
    path = tmp_path / "source.db"
    before = path.read_bytes()
    path.chmod(0o444)
    assert run("push", f"{source}?mode=ro", replica).exit_code == 0
    assert path.read_bytes() == before

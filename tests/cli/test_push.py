"""`kant-sql push` and `promote`: replicas, once or by a service."""

from __future__ import annotations

import json
import os
import re
import signal
import sqlite3
import subprocess
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import Any

import psycopg
import pytest

import kant_sql
from kant_sql.cli.common import Stop
from kant_sql.history.replication import service, target
from kant_sql.history.replication.push import Terms, send
from kant_sql.sql import schema
from kant_sql.sql.dialects import create_backend, postgresql
from kant_sql.sql.dialects.base import Backend
from kant_sql.sql.dialects.sqlite import FileListener, SqliteBackend
from tests.cli.conftest import in_background, write_history
from tests.support.archives import damage, equal_histories, target_url
from tests.support.processes.commands import (
    CHILD_TIMEOUT,
    PROGRAM,
    complaint,
    documents,
    one_line,
    run,
    start,
)
from tests.support.servers import MortalServer, Server
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


def pushed(*words: str) -> list[Document]:
    return documents("push", *words)


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
    (document,) = pushed(source, replica)
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
        "remaining": [],
        "revisions": 3,
    }
    (document,) = pushed(source, replica)
    assert (document["event"], document["revisions"]) == ("current", 0)


def test_bytes_that_may_remain_are_a_failure(source: str, replica: str) -> None:
    kb = kant_sql.connect(source, knowledge_base="tiago")
    with kb.transaction(reason="the camera saw her"):
        kb.types.save("patient")
    pushed(source, replica)
    kb.erase(revisions=[kb.revision], parts=["reason"], reason="asked")
    kb.close()
    with closing(sqlite3.connect(replica.removeprefix("sqlite:///"))) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM object").fetchall()
        sent = run("push", source, f"{replica}?timeout=0.2", "--json")
    assert sent.exit_code == 1
    document = json.loads(sent.stdout)
    assert "wal_checkpoint" in document["remaining"][0]
    assert run("push", source, replica).exit_code == 0


def test_all_knowledge_bases_are_sent_or_the_named_one(source: str, replica: str) -> None:
    for name in ("a", "b"):
        save(source, 1, name)
    assert [each["knowledge_base"] for each in pushed(source, replica, "--kb", "b")] == ["b"]
    sent = pushed(source, replica)
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
    pushed(source, replica)
    with kant_sql.connect(replica, knowledge_base="a") as kb:
        kb.store.promote()
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


def test_each_that_is_refused_is_named_once(source: str, replica: str) -> None:
    for name in ("a", "b"):
        save(source, 1, name)
    run("push", source, replica)
    for name in ("tiago", "b"):
        run("promote", replica, "--kb", name)
    save(source, 12, "a")
    result = run("push", source, replica)
    assert result.exit_code == 65
    assert result.stdout.startswith("a: revision 2 sent to ")
    refused = result.stderr.splitlines()
    assert [line.count("knowledge base") for line in refused] == [1, 1]
    for line, name in zip(refused, ("tiago", "b"), strict=True):
        assert f"knowledge base {name!r} is not a replica" in one_line(line)


@pytest.mark.more
def test_a_damaged_one_does_not_keep_the_others(source: str, replica: str) -> None:
    save(source, 1, "other")
    damage(source, "UPDATE revision SET reason = CAST(x'ff41' AS TEXT) WHERE kb_id = 1")
    result = run("push", source, replica)
    assert result.exit_code == 65
    assert result.stdout.startswith("other: revision 1 sent to ")
    line = one_line(result.stderr)
    assert "'tiago'" in line
    assert f"'kant-sql verify' shows what is damaged in {source}" in line
    with following(source, replica) as process:
        assert next_event(process, "refused")["knowledge_base"] == "tiago"
        save(source, 2, "other")
        assert next_event(process, "pushed")["knowledge_base"] == "other"


@pytest.fixture
def archived(source: str, tmp_path: Path) -> str:
    """A source whose first knowledge base needs an archive, and whose second one does not."""
    with kant_sql.connect(source, knowledge_base="tiago") as kb:
        kb.store.archive(3, to=target_url(tmp_path))
    save(source, 1, "other")
    return source


@pytest.mark.more
def test_an_archive_that_is_away_does_not_keep_the_others(
    archived: str, replica: str, tmp_path: Path
) -> None:
    words = (archived, replica, "--archive", "postgresql://localhost:1/x")
    result = run("push", *words)
    assert result.exit_code == 75, result.stderr
    assert result.stdout.startswith("other: revision 1 sent to ")
    assert one_line(result.stderr).startswith("kant-sql: tiago: postgresql://localhost:1/x: ")
    events = [json.loads(line) for line in run("push", *words, "--json").stdout.splitlines()]
    assert [(each["knowledge_base"], each["event"]) for each in events] == [
        ("tiago", "waiting"),
        ("other", "current"),
    ]
    with following(*words) as process:
        waiting = next_event(process, "waiting")
        assert (waiting["knowledge_base"], waiting["type"]) == ("tiago", "StoreUnreachableError")
        assert 0.5 <= waiting["retry_in"] <= 1
        save(archived, 2, "other")
        assert next_event(process, "pushed")["knowledge_base"] == "other"
        assert next_event(process, "waiting")["knowledge_base"] == "tiago"
    assert run("push", archived, replica).exit_code == 0
    equal_histories(archived, replica, "other")


@pytest.mark.more
def test_a_store_that_is_locked_as_a_whole_ends_it(source: str, replica: str) -> None:
    save(source, 1, "other")
    kant_sql.upgrade(replica)
    with closing(sqlite3.connect(replica.removeprefix("sqlite:///"))) as holder:
        holder.execute("BEGIN IMMEDIATE")
        with following(source, f"{replica}?timeout=0.1") as process:
            waiting = next_event(process, "waiting")
            assert waiting["type"] == "StoreBusyError"
            assert "knowledge_base" not in waiting
            holder.rollback()
            assert next_event(process, "pushed")["revision"] == 3


@pytest.mark.more
@pytest.mark.parametrize("command", ["push", "verify", "promote"])
def test_work_is_finished_when_nobody_reads(source: str, replica: str, command: str) -> None:
    for name in ("a", "b"):
        save(source, 1, name)
    words, code = {
        "push": ((source, replica, "--kb", "tiago"), 0),
        "verify": (("--all", source), 1),
        "promote": ((replica, "--kb", "a"), 0),
    }[command]
    run("push", source, replica, *(("--kb", "a") if command == "push" else ()))
    if command == "verify":
        damage(source, "UPDATE revision SET actor = 'x' WHERE kb_id = 1 AND number = 2")
    reads, writes = os.pipe()
    os.close(reads)
    with os.fdopen(writes, "wb") as unread:
        process = start(command, *words, program=PROGRAM, stdout=unread, stderr=unread)
    assert process.wait(CHILD_TIMEOUT) == code
    if command == "push":
        equal_histories(source, replica)
    if command == "promote":
        assert run("promote", replica, "--kb", "a").stdout.endswith("nothing was changed\n")


@pytest.mark.parametrize("interval", ["inf", "nan", "-1", "86401"])
def test_an_interval_has_bounds(source: str, replica: str, interval: str) -> None:
    assert "0 to 86400 seconds" in complaint(
        "push", source, replica, "--follow", f"--interval={interval}", code=2
    )


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


def test_a_busy_target_is_waited_for_once(
    source: str, replica: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(source, 1, "other")
    waits = []

    def meet_a_lock(_: object, __: object, terms: Terms, *more: object) -> None:
        waits.append(terms.is_patient)
        raise kant_sql.StoreBusyError("locked")

    monkeypatch.setattr(service, "send", meet_a_lock)
    assert run("push", source, replica).exit_code == 75
    assert waits == [True, False]


def test_nothing_is_left_of_a_target_that_nothing_was_sent_to(tmp_path: Path, source: str) -> None:
    url = target_url(tmp_path, "nothing.db")
    assert run("push", source, url, "--kb", "nobody").exit_code == 1
    assert not (tmp_path / "nothing.db").exists()
    damage(source, "UPDATE revision SET actor = 'x' WHERE number = 2")
    assert run("push", source, url).exit_code == 65
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
        "knowledge base tiago is not a replica; nothing was changed\n"
    )
    assert run("restore", replica, "1").exit_code == 0
    assert run("verify", replica).exit_code == 0


def following(*words: str) -> AbstractContextManager[subprocess.Popen[bytes]]:
    return in_background("push", *words, "--follow", "--json", program=PROGRAM)


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


@pytest.mark.more
def test_what_is_written_within_an_interval_is_sent_at_once(source: str, replica: str) -> None:
    with following(source, replica, "--interval", "2") as process:
        next_event(process, "pushed")
        with kant_sql.connect(source, knowledge_base="tiago") as kb:
            for number in range(8):
                kb.objects.save(waypoint(number + 20))
        sent = 0
        pushes = 0
        while sent < 11:
            sent = next_event(process, "pushed")["revision"]
            pushes += 1
        assert pushes <= 3
        process.send_signal(signal.SIGINT)
        assert process.wait(CHILD_TIMEOUT) == 130


@pytest.mark.more
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


@pytest.mark.more
def test_it_ends_when_nothing_is_left_that_may_be_sent(source: str, replica: str) -> None:
    run("push", source, replica)
    run("promote", replica)
    with following(source, replica) as process:
        assert next_event(process, "refused")["type"] == "ReplicaError"
        assert process.wait(CHILD_TIMEOUT) == 65
        assert process.stderr is not None
        assert json.loads(process.stderr.read())["exit_code"] == 65


@pytest.mark.more
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


Report = list[service.PushEvent]


def followed(source: str, target: str, act: Callable[[Report], bool]) -> Report:
    """Follow in this process; `act` is asked after each event whether that was all."""
    events: Report = []
    over: list[bool] = []

    def report(event: service.PushEvent) -> None:
        events.append(event)
        if act(events):
            over.append(True)

    pushes = service.PushService(
        source,
        target,
        name=None,
        terms=Terms(is_patient=False),
        report=report,
        is_stopped=lambda: bool(over),
    )
    pushes.follow(0)
    return events


def names_of(events: Report) -> list[str]:
    return [each.event for each in events if each.event not in ("following", "stopped")]


@pytest.fixture
def short_delays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a service try again at once."""
    monkeypatch.setattr(service, "FIRST_DELAY", 0.02)
    monkeypatch.setattr(service, "LONGEST_DELAY", 0.1)


@pytest.mark.more
@pytest.mark.usefixtures("short_delays")
def test_one_that_is_locked_does_not_keep_the_others(
    source: str, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(postgresql, "LOCK_TIMEOUT", "200ms")
    url = server.new_store()
    save(source, 1, "other")
    run("push", source, url)
    for name in ("tiago", "other"):
        save(source, 12, name)
    lock = "SELECT 1 FROM head JOIN knowledge_base ON id = kb_id WHERE name = 'tiago' FOR UPDATE"
    with psycopg.connect(url) as holder:
        holder.execute(lock)
        result = run("push", source, url)
        assert result.exit_code == 75
        assert result.stdout.startswith("other: revision 2 sent to ")
        assert one_line(result.stderr).startswith("kant-sql: tiago: ")
        save(source, 13, "other")

        def act(events: Report) -> bool:
            if len(names_of(events)) == 2:
                holder.rollback()
            return events[-1].event == "pushed" and events[-1].knowledge_base == "tiago"

        events = followed(source, url, act)
    assert [(each.event, each.knowledge_base) for each in events[1:3]] == [
        ("waiting", "tiago"),
        ("pushed", "other"),
    ]
    assert isinstance(events[1].error, kant_sql.StoreBusyError)


@pytest.mark.usefixtures("short_delays")
@pytest.mark.parametrize("is_source", [True, False])
@pytest.mark.parametrize("version", ["0005", "9999"])
def test_it_waits_for_upgrades(source: str, replica: str, is_source: bool, version: str) -> None:
    url = source if is_source else replica
    kant_sql.upgrade(replica)
    damage(url, f"UPDATE kant_sql_version SET version_num = '{version}'")

    def act(events: Report) -> bool:
        if len(names_of(events)) == 2:
            damage(url, f"UPDATE kant_sql_version SET version_num = '{schema.VERSIONS[-1]}'")
        return events[-1].event == "pushed"

    events = followed(source, replica, act)
    assert names_of(events) == ["waiting", "waiting", "pushed"]
    assert isinstance(events[1].error, kant_sql.SchemaError)
    # Somebody has to do something first.
    assert events[1].retry_in is not None
    assert events[1].retry_in >= 0.05


@pytest.mark.usefixtures("short_delays")
@pytest.mark.parametrize("is_there", [True, False])
def test_it_waits_for_a_file_that_was_there(
    source: str, replica: str, tmp_path: Path, is_there: bool
) -> None:
    path, aside = tmp_path / "source.db", tmp_path / "aside.db"
    if not is_there:
        path.rename(aside)
        with pytest.raises(kant_sql.errors.SchemaMissingError):
            followed(source, replica, lambda events: False)
        return

    def act(events: Report) -> bool:
        kind = names_of(events)[-1:]
        if kind == ["pushed"]:
            path.rename(aside)
        if kind == ["waiting"] and isinstance(events[-1].error, kant_sql.errors.SchemaMissingError):
            aside.rename(path)
        return kind == ["current"]

    assert names_of(followed(source, replica, act)) == ["pushed", "waiting", "waiting", "current"]


@pytest.mark.usefixtures("short_delays")
def test_a_replica_that_is_behind_its_own_replica_waits_for_its_origin(
    source: str, replica: str, tmp_path: Path
) -> None:
    between = target_url(tmp_path, "between.db")
    run("push", source, between)
    with kant_sql.connect(source, knowledge_base="tiago") as kb:
        kb.objects.save("jane - robot")
        kb.erase("jane", reason="she asked")
    run("push", source, replica)

    def act(events: Report) -> bool:
        if events[-1].event == "waiting" and len(events) == 2:
            run("push", source, between)
        return events[-1].event in ("current", "refused")

    events = followed(between, replica, act)
    assert names_of(events) == ["waiting", "current"]
    assert isinstance(events[1].error, kant_sql.errors.DivergedError)


@pytest.mark.usefixtures("short_delays")
def test_it_waits_for_space(source: str, replica: str, monkeypatch: pytest.MonkeyPatch) -> None:
    failures = iter([kant_sql.errors.StoreFullError("full")])

    def full(*arguments: Any) -> Any:
        for failure in failures:
            raise failure
        return send(*arguments)

    monkeypatch.setattr(service, "send", full)
    events = followed(source, replica, lambda events: events[-1].event == "pushed")
    assert names_of(events) == ["waiting", "pushed"]
    assert events[1].knowledge_base == "tiago"


def test_it_listens_for_one_that_is_not_refused(
    source: str, replica: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(source, 1, "other")
    run("push", source, replica)
    run("promote", replica, "--kb", "tiago")
    heard: list[int | None] = []
    wait = FileListener.wait

    def listen(listener: FileListener, kb_id: int | None, seconds: float) -> None:
        heard.append(kb_id)
        wait(listener, kb_id, 0)

    monkeypatch.setattr(FileListener, "wait", listen)
    save(source, 2, "other")

    def act(events: Report) -> bool:
        if names_of(events) == ["refused", "pushed"]:
            save(source, 3, "other")
        return names_of(events) == ["refused", "pushed", "pushed"]

    followed(source, replica, act)
    assert {*heard} == {2}


def test_nothing_stays_open_where_nobody_can_listen(
    source: str, replica: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Backend] = []

    def no_listener(backend: Backend) -> None:
        opened.append(backend)
        raise kant_sql.StoreUnreachableError("nobody listens")

    def create(*arguments: Any, **settings: Any) -> Backend:
        opened.append(create_backend(*arguments, **settings))
        return opened[-1]

    monkeypatch.setattr(target, "create_backend", create)
    monkeypatch.setattr(service, "create_backend", create)
    monkeypatch.setattr(SqliteBackend, "listener", no_listener)
    with pytest.raises(kant_sql.StoreUnreachableError):
        service._Connection(source, replica)
    assert len(opened) == 3
    assert all(backend.is_closed for backend in opened)


def test_ignored_signals_stay_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    stop = Stop()
    try:
        with stop.on_signals():
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGTERM)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert stop.number == signal.SIGTERM
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_handler_that_is_not_python_s_does_no_harm(monkeypatch: pytest.MonkeyPatch) -> None:
    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(signal, "getsignal", lambda number: None)
    stop = Stop()
    try:
        with stop.on_signals():
            os.kill(os.getpid(), signal.SIGTERM)
        assert stop.number == signal.SIGTERM
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.more
def test_log_lines_are_pairs(source: str, replica: str) -> None:
    with in_background("push", source, replica, "--follow", program=PROGRAM) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline().decode() for _ in range(2)]
    pair = r'[a-z_]+=(?:[^\s"=]+|"(?:[^"\\]|\\.)*")'
    for line in lines:
        assert re.fullmatch(rf"{pair}(?: {pair})*\n", line), line
    assert "event=following" in lines[0]
    assert " knowledge_base=tiago " in lines[1]


@pytest.mark.more
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

"""What is logged: by which logger, at which level, and never a password or a forged line."""

from __future__ import annotations

import logging
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path

import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KantSqlError, KnowledgeBase, PddlTypeDto
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.schema import VERSIONS
from kant_sql.store import store
from tests.audit.story import Clock
from tests.docs.test_docs import ROOT, parse
from tests.support.faults import lose_answer, terminate
from tests.support.reading import loaded, present, undone
from tests.support.servers import Server
from tests.support.statements import fact, fill
from tests.support.stores import Connect

DOMAIN = """(define (domain shop) (:requirements :strips :typing)
  (:types robot) (:predicates (free ?r - robot)))"""
# The object is declared twice.
PROBLEM = """(define (problem day) (:domain shop) (:objects r1 r1 - robot)
  (:init (free r1)) (:goal (free r1)))"""


@pytest.fixture
def log(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.DEBUG, "kant_sql")
    caplog.set_level(logging.DEBUG, "kant_sql.sql")
    return caplog


def said(log: pytest.LogCaptureFixture, name: str, level: int) -> list[str]:
    return [
        record.getMessage()
        for record in log.records
        if (record.name, record.levelno) == (f"kant_sql.{name}", level)
    ]


def test_opening_is_told(url: str, connect: Connect, log: pytest.LogCaptureFixture) -> None:
    connect(url, knowledge_base="tiago", actor="boss")
    label = make_url(url).render_as_string(hide_password=True)
    (line,) = said(log, "store", logging.INFO)
    assert line == f"{label}: connected, knowledge base 'tiago', actor 'boss'"


@pytest.mark.more
@pytest.mark.usefixtures("real_migrations")
def test_migrations_are_told(file_url: str, log: pytest.LogCaptureFixture) -> None:
    kant_sql.upgrade(file_url)
    kant_sql.operations.downgrade(file_url, revision="0001")
    way = ["no tables", *VERSIONS, *VERSIONS[-2::-1]]
    assert said(log, "schema", logging.INFO) == [
        f"{file_url}: migrating from {old} to {new}" for old, new in pairwise(way)
    ]


def test_a_load_is_told_with_its_warnings(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture
) -> None:
    fresh_kb.load_domain(DOMAIN)
    loaded = fresh_kb.load_problem(PROBLEM)
    assert loaded.warnings
    name = fresh_kb.store.factory._store.name  # type: ignore[attr-defined]
    number = len(loaded.warnings)
    assert said(log, "documents", logging.INFO) == [
        f"knowledge base {name!r}: loaded domain 'shop', revision 1, 0 warnings",
        f"knowledge base {name!r}: loaded problem 'day', revision 2, {number} warnings",
        *map(str, loaded.warnings),
    ]


def test_restore_and_archive_are_told(
    shared_url: str, connect: Connect, file_url: str, log: pytest.LogCaptureFixture
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    fill(kb, 3)
    kb.restore(1)
    moved = kb.store.archive(kb.revision, to=file_url)
    restored, archived = said(log, "history", logging.INFO)
    assert restored == "knowledge base 'tiago': revision 1 restored, by revision 3"
    assert archived == (
        f"knowledge base 'tiago': {sum(moved.versions.values())} versions that ended up to "
        f"revision {moved.upto} were moved to {moved.target}"
    )


def test_each_revision_is_told(fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture) -> None:
    fill(fresh_kb, 3)
    log.clear()
    with fresh_kb.transaction(actor="executive", reason="done"):
        fresh_kb.propositions.delete(fact(1))
        fresh_kb.propositions.save(fact(7))
    (record,) = [
        record
        for record in log.records
        if record.name == "kant_sql.store" and record.levelno == logging.DEBUG
    ]
    attributes = vars(record)
    assert attributes["revision"] == fresh_kb.revision
    assert (attributes["actor"], attributes["reason"]) == ("executive", "done")
    # The fact that went, the one that came, and its object.
    assert attributes["changes"] == 3
    assert 0 < attributes["milliseconds"] < 60_000
    told = rf"revision {fresh_kb.revision} by 'executive' because 'done': 3 changes, [\d.]+ ms$"
    assert re.search(told, record.getMessage())


def test_the_changes_of_a_large_revision_are_counted(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(fresh_kb, 3)
    monkeypatch.setattr("kant_sql.store.transaction.SPILL_AT", 10)
    log.clear()
    fresh_kb.propositions.save_all(fact(number) for number in range(100, 150))
    (counted,) = [vars(each)["changes"] for each in log.records if hasattr(each, "changes")]
    # Each fact, and its object.
    assert counted == 100


def test_a_revision_that_is_not_made_is_not_told(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture
) -> None:
    fill(fresh_kb, 3)
    log.clear()
    fresh_kb.propositions.save(fact(1))
    with undone(fresh_kb):
        fresh_kb.propositions.save(fact(9))
    assert said(log, "store", logging.DEBUG) == []


def test_statements_are_told_shortened_with_their_time(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture
) -> None:
    fill(fresh_kb, 3)
    log.clear()
    fresh_kb.propositions.get_all()
    (record,) = [record for record in log.records if record.name == "kant_sql.sql"]
    attributes = vars(record)
    assert len(attributes["sql"]) > 200
    assert attributes["milliseconds"] > 0
    text = " ".join(attributes["sql"].split())
    assert record.getMessage().startswith(f"{text[:200]}... (")
    assert re.search(r"\([\d.]+ ms\)$", record.getMessage())


def test_a_statement_that_fails_is_told_too(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture
) -> None:
    with fresh_kb.store.factory._store.backend.open_session() as session:  # type: ignore[attr-defined]
        with pytest.raises(KantSqlError):
            session.define("SELECT nothing FROM nowhere")
        session.rollback()
    assert any(line.startswith("SELECT nothing") for line in said(log, "sql", logging.DEBUG))


def test_parameters_are_not_told(fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture) -> None:
    fresh_kb.types.save(PddlTypeDto("xyzzy"))
    fresh_kb.types.get("xyzzy")
    assert not any("xyzzy" in line for line in said(log, "sql", logging.DEBUG))


def test_what_writers_say_makes_no_line_of_its_own(
    fresh_kb: KnowledgeBase, log: pytest.LogCaptureFixture
) -> None:
    forged = "x\nCRITICAL kant_sql.store: all is lost\r\x1b[2J\u2028\x85"
    with suppress(KantSqlError), fresh_kb.transaction(actor=forged, reason=forged):
        fresh_kb.types.save(PddlTypeDto("robot"))
    with fresh_kb.transaction(actor="boss", reason=forged):
        fresh_kb.types.save(PddlTypeDto("door"))
    fresh_kb.load_domain(DOMAIN.replace("shop)", 'shop) ; "\x1b[2J"'))
    assert any("all is lost" in record.getMessage() for record in log.records)
    assert all(record.getMessage().isprintable() for record in log.records)


def test_the_name_of_a_file_makes_no_line_of_its_own(
    tmp_path: Path, connect: Connect, log: pytest.LogCaptureFixture
) -> None:
    kb = connect(f"sqlite:///{tmp_path}/a\nCRITICAL b.db")
    kb.types.save(PddlTypeDto("robot"))
    assert any("CRITICAL" in record.getMessage() for record in log.records)
    assert all(record.getMessage().isprintable() for record in log.records)


@pytest.fixture
def on_server(server: Server, connect: Connect) -> tuple[str, KnowledgeBase]:
    """A store of a server, and a knowledge base with some facts."""
    url = server.new_store()
    kb = connect(url, knowledge_base="tiago")
    fill(kb, 3)
    return url, kb


def test_retries_and_lost_connections_are_told(
    on_server: tuple[str, KnowledgeBase], log: pytest.LogCaptureFixture
) -> None:
    url, kb = on_server
    terminate(url)
    kb.propositions.get_all()
    (retried,) = said(log, "retry", logging.WARNING)
    assert retried.startswith("attempt 1 failed, trying again: ")
    (lost,) = said(log, "postgresql", logging.WARNING)
    assert lost.endswith(": a connection was lost")


def test_a_lost_connection_within_a_transaction_is_told(
    on_server: tuple[str, KnowledgeBase], log: pytest.LogCaptureFixture
) -> None:
    url, kb = on_server

    def work() -> None:
        with kb.transaction():
            terminate(url)
            kb.propositions.get_all()

    with pytest.raises(kant_sql.errors.ConnectionLostError):
        work()
    assert len(said(log, "postgresql", logging.WARNING)) == 1


def test_a_commit_whose_answer_was_lost_is_told(
    on_server: tuple[str, KnowledgeBase],
    monkeypatch: pytest.MonkeyPatch,
    log: pytest.LogCaptureFixture,
) -> None:
    url, kb = on_server
    last = kb.revision
    lose_answer(monkeypatch, True, lambda: terminate(url))
    kb.propositions.save(fact(4))
    label = make_url(url).render_as_string(hide_password=True)
    assert said(log, "store", logging.WARNING) == [
        f"{label}: the answer to the COMMIT of revision {last + 1} of 'tiago' was lost; it is in "
        "the store"
    ]
    assert kb.revision == last + 1


PIPELINE = """
import sys
import kant_sql
from tests.support.faults import terminate
from tests.support.statements import fact
from tests.support.statements import fill
url, many = sys.argv[1], int(sys.argv[2])
kb = kant_sql.connect(url)
fill(kb, 3)
try:
    with kb.transaction():
        kb.propositions.save_all(fact(number) for number in range(10, 10 + many))
        terminate(url)
        kb.propositions.get_all()
except kant_sql.errors.ConnectionLostError:
    print("lost")
"""


# The first sends many statements in a pipeline, the second by COPY.
@pytest.mark.more
@pytest.mark.parametrize("many", [20, 200])
def test_psycopg_says_nothing_on_standard_error(server: Server, many: int) -> None:
    """Without a handler, Python writes warnings of whatever logger to standard error."""
    done = subprocess.run(
        [sys.executable, "-c", PIPELINE, server.new_store(), str(many)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("lost\n", "")


def test_what_others_do_with_psycopg_is_told_as_ever(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "psycopg"):
        logging.getLogger("psycopg").warning("error ignored terminating %r: %s", 1, 2)
    assert len(caplog.records) == 1


@pytest.fixture
def everything() -> Iterator[list[str]]:
    """Give all that any logger says, arguments and attributes included."""
    texts: list[str] = []

    class Recorder(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            texts.append(f"{logging.Formatter().format(record)} {vars(record)!r}")

    root, recorder = logging.getLogger(), Recorder()
    levels = {
        name: logging.getLogger(name).level
        for name in ("", "kant_sql", "kant_sql.sql", "psycopg", "sqlalchemy", "alembic")
    }
    root.addHandler(recorder)
    for name in levels:
        logging.getLogger(name).setLevel(logging.DEBUG)
    yield texts
    for name, level in levels.items():
        logging.getLogger(name).setLevel(level)
    root.removeHandler(recorder)


def with_password(url: str, where: str) -> str:
    """Give a URL of a server that trusts all, with a password."""
    parsed = make_url(url)
    if where == "user":
        parsed = parsed.set(username="postgres", password="s3cret")
    elif where == "percent":
        parsed = parsed.set(username="postgres", password="s3cret/@%:")
    else:
        parsed = parsed.update_query_dict({where: "s3cret/@"})
    return parsed.render_as_string(hide_password=False)


@pytest.mark.more
@pytest.mark.parametrize("where", ["user", "percent", "password", "sslpassword"])
def test_no_password_is_told(
    server: Server,
    everything: list[str],
    where: str,
    tmp_path: Path,
) -> None:
    url = with_password(server.new_store(), where)
    assert "s3cret" in url
    with kant_sql.connect(url, knowledge_base="tiago", actor="boss") as kb:
        fill(kb, 60)
        loaded(kb, DOMAIN, PROBLEM)
        kb.restore(1)
        kb.store.verify()
        list(kb.log())
        kb.store.archive(kb.revision, to=with_password(server.new_store(), where))
        with suppress(KantSqlError), kb.transaction():
            kb.propositions.save_all(fact(number) for number in range(100, 120))
            terminate(url)
            kb.propositions.get_all()
        terminate(url)
        kb.propositions.get_all()
        kant_sql.operations.update_views(url)
        kant_sql.upgrade(url)
        kant_sql.operations.downgrade(url, revision="base")
        with pytest.raises(KantSqlError):
            kb.propositions.get_all()
    with pytest.raises(KantSqlError):
        kant_sql.connect(url)
    parsed = make_url(url)
    for other in (parsed.set(database="none"), parsed.set(host="127.0.0.1", port=1, query={})):
        with suppress(KantSqlError):
            kant_sql.connect(other.render_as_string(hide_password=False))
    assert len(everything) > 100
    assert any("kant_sql.sql" in text for text in everything)
    assert not [text for text in everything if "s3cret" in text]


def test_the_guide_names_the_loggers() -> None:
    guide = (ROOT / "docs/logging.md").read_text()
    sources = "".join(path.read_text() for path in (ROOT / "kant_sql").rglob("*.py"))
    named = re.findall(r"^\| `(kant_sql\.[\w.]+)` \|", guide, re.MULTILINE)
    made = re.findall(r'getLogger\("(kant_sql\.[\w.]+)"\)', sources)
    assert {*named} == {*made, "kant_sql.compat"}


@pytest.mark.more
def test_nothing_is_written_without_a_word() -> None:
    program = (
        "import logging, kant_sql\n"
        "kb = kant_sql.connect('sqlite://')\n"
        "kb.types.save(kant_sql.PddlTypeDto('robot'))\n"
        "logging.getLogger('kant_sql.retry').warning('a warning')\n"
        "assert not logging.getLogger().handlers\n"
        "log = logging.getLogger('kant_sql')\n"
        "assert [type(each) for each in log.handlers] == [logging.NullHandler]\n"
        "assert log.level == logging.NOTSET\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("level", [logging.NOTSET, logging.DEBUG])
def test_a_level_of_the_root_logger_brings_one_record_a_call(
    fresh_kb: KnowledgeBase, caplog: pytest.LogCaptureFixture, level: int
) -> None:
    fill(fresh_kb, 3)
    caplog.set_level(level)
    calls: tuple[tuple[Callable[[], object], int], ...] = (
        (lambda: fresh_kb.propositions.save(fact(7)), 1),
        (fresh_kb.propositions.get_all, 0),
        (lambda: list(fresh_kb.at(1).types.get_all()), 0),
        (lambda: list(fresh_kb.query("(robot_at ?r ?w)")), 0),
    )
    for call, expected in calls:
        caplog.clear()
        call()
        assert [each.name for each in caplog.records] == ["kant_sql.store"] * expected


def test_nothing_is_formatted_while_it_is_off(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError

    logging.getLogger("kant_sql").setLevel(logging.INFO)
    monkeypatch.setattr("kant_sql.sql.dialects.base.printable", refuse)
    monkeypatch.setattr("kant_sql.store.store.Store._log_revision", refuse)
    try:
        fill(fresh_kb, 3)
        fresh_kb.propositions.get_all()
    finally:
        logging.getLogger("kant_sql").setLevel(logging.NOTSET)
    assert Session._execute.__module__ == "kant_sql.sql.dialects.base"


def test_spans_of_opentelemetry_are_made_of_the_records() -> None:
    pytest.importorskip("opentelemetry.sdk")
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import SimpleSpanProcessor
    from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter

    (block,) = [
        example.parsed
        for example in parse(ROOT / "docs" / "logging.md").examples()
        if "class Spans" in str(example.parsed)
    ]
    names: dict[str, object] = {"logging": logging}
    exec(str(block), names)
    exporter, provider = InMemorySpanExporter(), TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(exporter))
    tracer = provider.get_tracer("test")
    handler = names["Spans"](tracer)  # type: ignore[operator]
    logger, statement_log = logging.getLogger("kant_sql"), logging.getLogger("kant_sql.sql")
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    statement_log.setLevel(logging.DEBUG)
    try:
        with (
            kant_sql.connect("sqlite://") as kb,
            tracer.start_as_current_span("errand"),
            kb.transaction(actor="boss", reason="why"),
        ):
            kb.types.save(PddlTypeDto("robot"))
    finally:
        logger.removeHandler(handler)
        logger.setLevel(logging.NOTSET)
        statement_log.setLevel(logging.INFO)
    spans = exporter.get_finished_spans()
    (errand,) = [span for span in spans if span.name == "errand"]
    (revision,) = [span for span in spans if span.name == "kant_sql.store"]
    assert revision.attributes == {
        "kant_sql.knowledge_base": "default",
        "kant_sql.revision": 1,
        "kant_sql.actor": "boss",
        "kant_sql.reason": "why",
        "kant_sql.changes": 1,
    }
    assert present(revision.parent).span_id == errand.context.span_id
    assert (revision.start_time or 0) < (revision.end_time or 0)
    statements = [span for span in spans if span.name == "kant_sql.sql"]
    assert any("INSERT" in str((span.attributes or {})["db.query.text"]) for span in statements)


# A clock that is behind.


NOON = datetime(2026, 3, 2, 12, tzinfo=UTC)


@pytest.fixture
def warnings(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.WARNING, "kant_sql.store")
    return caplog


@pytest.mark.parametrize(("behind", "warned"), [(59, False), (60, False), (61, True)])
def test_a_clock_more_than_a_minute_behind_is_warned_of(
    fresh_kb: KnowledgeBase, warnings: pytest.LogCaptureFixture, behind: int, warned: bool
) -> None:
    with Clock().ruling() as clock:
        clock.moment = NOON
        fill(fresh_kb, 3)
        last = fresh_kb.revision
        clock.moment = NOON - timedelta(seconds=behind)
        fresh_kb.propositions.delete(fact(1))
    assert [record.levelno for record in warnings.records] == [logging.WARNING] * warned
    if warned:
        message = warnings.records[0].getMessage()
        assert "the clock says 2026-03-02T11:58:59+00:00" in message
        assert f"revision {last} is of 2026-03-02T12:00:00+00:00" in message
    assert fresh_kb.store.revisions()[-1].committed_at == NOON


def test_the_warning_comes_once_an_hour(
    fresh_kb: KnowledgeBase, warnings: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Clock().ruling() as clock:
        clock.moment = NOON
        fill(fresh_kb, 3)
        clock.moment = NOON - timedelta(days=1)
        for number in (1, 2):
            fresh_kb.propositions.delete(fact(number))
        assert len(warnings.records) == 1
        monkeypatch.setattr(store, "CLOCK_PATIENCE", 0.0)
        fresh_kb.propositions.save(fact(1))
    assert len(warnings.records) == 2

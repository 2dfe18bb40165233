"""Through a pooler in transaction mode, no client leaves anything to the next one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psycopg
import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, StoreBusyError, limited
from kant_sql.errors import QuestionCancelledError, ReadOnlyStoreError, StatementTimeoutError
from kant_sql.sql.dialects import base, postgresql
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.dialects.postgresql import PooledSession
from kant_sql.sql.predicate_views import update_views
from kant_sql.sql.query import raw
from tests.support.processes.workers import PATIENCE
from tests.support.reading import store_of
from tests.support.stores import Connect
from tests.support.worlds.robots import WAYPOINT, WP1, WP2, robot_at

# What PgBouncer itself sets for each client.
TRACKED = {
    *("application_name", "client_encoding", "DateStyle", "TimeZone"),
    "standard_conforming_strings",
}
LEFT = {
    "settings": "SELECT name, setting FROM pg_settings WHERE source = 'session' ORDER BY 1",
    "statements": "SELECT name, statement FROM pg_prepared_statements",
    "channels": "SELECT pg_listening_channels()",
    "cursors": "SELECT name FROM pg_cursors WHERE name <> ''",
    "locks": "SELECT objid FROM pg_locks WHERE locktype = 'advisory' AND pid = pg_backend_pid()",
    "tables": "SELECT relname FROM pg_class WHERE relpersistence = 't'",
}
# Enough that the driver would prepare a statement.
OFTEN = 8


def left(url: str) -> dict[str, Any]:
    """Ask the one session of the server what is left in it."""
    with psycopg.connect(url, autocommit=True, prepare_threshold=None) as client:
        found: dict[str, Any] = {
            what: [row for row in client.execute(sql.encode()) if row[0] not in TRACKED]
            for what, sql in LEFT.items()
        }
        found["process"] = client.execute("SELECT pg_backend_pid()").fetchone()
    return found


def save_often(kb: KnowledgeBase) -> None:
    for _ in range(OFTEN):
        kb.propositions.save(robot_at())
        kb.propositions.delete(robot_at())


def read_often(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    for _ in range(OFTEN):
        assert kb.propositions.get_all() == [robot_at()]
        assert kb.at(1).objects.get("rb1") is not None


def read_with_limits(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    for seconds in (1, 2, 3) * 3:
        with limited(seconds=seconds):
            assert kb.propositions.get_all() == [robot_at()]
    with limited(seconds=0.1), pytest.raises(StatementTimeoutError):
        sleep(kb, 5)


def only_read(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    with kant_sql.connect(address_of(kb), knowledge_base="tiago", read_only=True) as reader:
        read = [reader.propositions.get_all() for _ in range(OFTEN)]
    assert read == [[robot_at()]] * OFTEN


def load_many(kb: KnowledgeBase) -> None:
    places = [PddlObjectDto(WAYPOINT, f"w{number}") for number in range(3_000)]
    kb.objects.save_all(places)
    kb.propositions.save_all(robot_at(place=place) for place in places)


def verify(kb: KnowledgeBase) -> None:
    load_many(kb)
    assert kb.store.verify().findings == ()


def watch(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    for seconds in (0, 0.3):
        assert kb.watch(1, timeout=seconds) is None
    assert kb.watch(0) == 1


def archive_into(kb: KnowledgeBase) -> None:
    """Make this store the target, whose commits are durable."""
    with kant_sql.connect("sqlite:///robot.db", knowledge_base="tiago") as robot:
        save_often(robot)
        robot.store.archive(robot.revision, to=address_of(kb))


def replicate(kb: KnowledgeBase) -> None:
    """Push into this store, from it, and verify what arrived."""
    url = address_of(kb)
    with kant_sql.connect("sqlite:///pushing.db", knowledge_base="pushing") as robot:
        load_many(robot)
        robot.store.push(url)
        save_often(robot)
        assert robot.store.push(url).revisions == 2 * OFTEN
        with kant_sql.connect(url, knowledge_base="pushing") as replica:
            assert replica.store.verify(robot.store.anchor(), keep=True).is_intact
            replica.store.push("sqlite:///back.db")
            replica.store.promote()
            assert replica.store.verify(resume=True).is_intact
    assert [one.name for one in kant_sql.operations.knowledge_bases(url)] == ["pushing"]


def administrate(kb: KnowledgeBase) -> None:
    url = address_of(kb)
    kb.propositions.save(robot_at())
    update_views(url)
    kant_sql.operations.create_roles(url)
    kant_sql.operations.downgrade(url, revision="-1")
    kant_sql.upgrade(url)
    with kant_sql.connect(url, knowledge_base="tiago") as again:
        assert again.store.verify().findings == ()


def cancel(kb: KnowledgeBase) -> None:
    with limited() as limit:
        timer = threading.Timer(0.2, limit.cancel)
        timer.start()
        with pytest.raises(QuestionCancelledError):
            sleep(kb, 30)
        timer.join()


def fail(kb: KnowledgeBase) -> None:
    """Leave blocks and streams before their end."""
    load_many(kb)
    with suppress(ZeroDivisionError), kb.transaction():
        kb.propositions.delete_all()
        raise ZeroDivisionError
    with store_of(kb).backend.open_session() as session:
        session.begin(write=False)
        stream = session.stream(raw("SELECT generate_series(1, 100000)"))
        assert next(stream) == (1,)
        session.rollback()
        del stream


@pytest.mark.parametrize(
    "work",
    [
        *(save_often, read_often, read_with_limits, only_read, load_many, verify, watch),
        *(archive_into, replicate, administrate, cancel, fail),
    ],
)
@pytest.mark.parametrize("options", [{}, {"pooler": "transaction"}], ids=["found", "said"])
def test_nothing_is_left_in_the_session_of_the_server(
    narrow: str,
    narrow_pooler: Any,
    direct: str,
    options: dict[str, str],
    work: Callable[[KnowledgeBase], None],
    connect: Connect,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    before = left(narrow)
    kb = connect(narrow_pooler.url(direct, **options), knowledge_base="tiago", actor="test")
    work(kb)
    assert left(narrow) == before
    kb.close()
    assert left(narrow) == before


def test_a_session_that_sets_is_found_out_by_this_test(narrow: str) -> None:
    before = left(narrow)
    with psycopg.connect(narrow, autocommit=True) as rude:
        rude.execute("SET lock_timeout = '1s'")
        rude.execute("LISTEN kant_sql_1")
        rude.execute("PREPARE mine AS SELECT 1")
        after = left(narrow)
        rude.execute("DISCARD ALL")
    changed = {what for what in before if before[what] != after[what]}
    assert changed == {"settings", "channels", "statements"}
    assert left(narrow) == before


def address_of(kb: KnowledgeBase) -> str:
    return store_of(kb).backend.address


def sleep(kb: KnowledgeBase, seconds: float) -> None:
    """Ask what takes some time."""
    query = raw(f"SELECT pg_sleep({seconds})")
    store_of(kb).query(lambda session, _: session.rows(query))


@contextmanager
def session_of(kb: KnowledgeBase) -> Iterator[Session]:
    with store_of(kb).backend.open_session() as session:
        assert isinstance(session, PooledSession)
        yield session


def test_who_only_reads_writes_nothing_and_hinders_no_writer(narrow: str, connect: Connect) -> None:
    writer = connect(narrow, knowledge_base="tiago")
    reader = connect(narrow, knowledge_base="tiago", read_only=True)
    for place in (WP1, WP2) * OFTEN:
        writer.propositions.save(robot_at(place=place))
        assert robot_at(place=place) in reader.propositions.get_all()
        with session_of(reader) as session, pytest.raises(ReadOnlyStoreError, match="read-only"):
            session.run(raw("UPDATE head SET revision = 0"))
        with session_of(reader) as session:
            session.begin(write=True)
            with pytest.raises(ReadOnlyStoreError, match="read-only"):
                session.run(raw("DELETE FROM proposition_version"))
            session.rollback()
        writer.propositions.delete(robot_at(place=place))
    assert writer.revision == reader.revision == 4 * OFTEN
    assert reader.store.verify().findings == ()


def test_an_error_outside_of_a_transaction_ends_no_later_statement(
    narrow: str, connect: Connect
) -> None:
    connect(narrow, knowledge_base="tiago").propositions.save(robot_at())
    reader = connect(narrow, knowledge_base="tiago", read_only=True)
    with session_of(reader) as session:
        for _ in range(3):
            with pytest.raises(ReadOnlyStoreError):
                session.run(raw("DELETE FROM revision"))
            assert session.rows(raw("SELECT count(*) FROM revision")) == [(1,)]
        # Each statement sees what is committed until then.
        session.begin(write=False)
        assert session.rows(raw("SELECT count(*) FROM revision")) == [(1,)]
        session.rollback()


def test_each_client_has_the_time_that_it_asked_for(narrow: str, connect: Connect) -> None:
    hasty, patient = (connect(narrow, knowledge_base="tiago") for _ in range(2))
    hasty.propositions.save(robot_at())
    for _ in range(3):
        with limited(seconds=0.15), pytest.raises(StatementTimeoutError, match=r"than 0\.15 s"):
            sleep(hasty, 5)
        with limited(seconds=5):
            assert hasty.propositions.get_all() == [robot_at()]
        with limited(seconds=30):
            sleep(patient, 0.4)
        sleep(patient, 0.4)


def test_a_limit_holds_for_each_statement_of_a_transaction(narrow: str, connect: Connect) -> None:
    kb = connect(narrow, knowledge_base="tiago")
    nap, long = raw("SELECT pg_sleep(0.2)"), raw("SELECT pg_sleep(9)")

    def work(session: Session, _: object) -> None:
        for _ in range(2):
            session.rows(nap)
        session.rows(long)

    with limited(seconds=0.5), pytest.raises(StatementTimeoutError):
        store_of(kb).query_in_snapshot(work)


def test_a_writer_does_not_wait_for_ever(
    narrow: str, direct: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(base, "RETRY_FOR", 0.5)
    monkeypatch.setattr(postgresql, "LOCK_TIMEOUT", "200ms")
    kb = connect(narrow, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    before = left(narrow)
    holder = connect(direct, knowledge_base="tiago")
    with holder.transaction():
        holder.propositions.delete_all()
        began = time.monotonic()
        with pytest.raises(StoreBusyError, match="lock timeout"):
            kb.propositions.save(robot_at(place=WP2))
        assert time.monotonic() - began < PATIENCE
    assert left(narrow) == before


def test_a_durable_session_stays_so_and_makes_no_other_one_durable(
    narrow: str, direct: str, connect: Connect
) -> None:
    with psycopg.connect(direct, autocommit=True) as owner:
        owner.execute(f"ALTER DATABASE {owner.info.dbname} SET synchronous_commit = off".encode())
    durable, other = (connect(narrow, knowledge_base="tiago") for _ in range(2))
    asked = raw("SHOW synchronous_commit")
    with session_of(durable) as session:
        session.make_durable()
        for _ in range(2):
            session.begin(write=True)
            assert session.rows(asked) == [("on",)]
            session.commit()
        with session_of(other) as another:
            another.begin(write=True)
            assert another.rows(asked) == [("off",)]
            another.rollback()


def test_what_is_cancelled_is_no_other_clients_statement(narrow: str, connect: Connect) -> None:
    asked, other = (connect(narrow, knowledge_base="tiago") for _ in range(2))
    other.propositions.save(robot_at())
    done = threading.Event()
    errors: list[BaseException] = []

    def go_on() -> None:
        try:
            while not done.is_set():
                sleep(other, 0.01)
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        for number in range(25):
            with limited() as limit:
                timer = threading.Timer(0.02 + number * 0.001, limit.cancel)
                timer.start()
                with pytest.raises(QuestionCancelledError):
                    sleep(asked, 30)
                timer.join()
    finally:
        done.set()
        thread.join()
    assert errors == []

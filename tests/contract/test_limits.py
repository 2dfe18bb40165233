"""Limits of questions: statements that take too long, and questions that are cancelled."""

from __future__ import annotations

import asyncio
import random
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import psycopg
import pytest

from kant_sql import KnowledgeBase, Limit, aio, limited, limits
from kant_sql.errors import InvalidTimeoutError, QuestionCancelledError, StatementTimeoutError
from kant_sql.limits import GuardedCursor, StatementGuard
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.query import raw
from tests.support.processes.workers import PATIENCE, wait_for
from tests.support.reading import store_of
from tests.support.statements import recorded
from tests.support.stores import Connect
from tests.support.worlds.robots import WP2, robot_at

# It ends by itself after minutes.
COUNTING = (
    "WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {}) SELECT {} FROM n"
)
SLOW, SLOW_ROWS = (raw(COUNTING.format(2_000_000_000, what)) for what in ("count(*)", "i"))
SOON = PATIENCE / 2
# Seconds that a statement may take: the next ones are tried if the machine stalls.
LONGEST = 16
TRIED = (1, 4, LONGEST)


def ask_slowly(kb: KnowledgeBase) -> object:
    """Ask what takes minutes."""
    return store_of(kb).query(lambda session, _: session.rows(SLOW))


def ask_in_snapshot(kb: KnowledgeBase) -> object:
    """Ask what takes minutes, in a transaction."""
    return store_of(kb).query_in_snapshot(lambda session, _: session.rows(SLOW))


def stream_slowly(kb: KnowledgeBase) -> object:
    """Read what takes minutes row by row."""
    return store_of(kb).query_in_snapshot(
        lambda session, _: sum(1 for _ in session.stream(SLOW_ROWS))
    )


each_question = pytest.mark.parametrize("ask", [ask_slowly, ask_in_snapshot, stream_slowly])


@contextmanager
def cancelled_after(limit: Limit, seconds: float) -> Iterator[None]:
    """Cancel a limit in another thread after some time."""
    timer = threading.Timer(seconds, limit.cancel)
    timer.start()
    try:
        yield
    finally:
        timer.join()


class Clock:
    """The clock of the limits; only the test moves it, however long the machine stalls."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(limits, "time", clock)
    return clock


@contextmanager
def retried(seconds: float) -> Iterator[None]:
    """Let statements take longer than a limit on a machine that stalls, unless it is long."""
    try:
        yield
    except StatementTimeoutError:
        if seconds >= LONGEST:
            raise


@pytest.fixture
def filled(kb: KnowledgeBase) -> KnowledgeBase:
    kb.propositions.save(robot_at())
    return kb


def works(kb: KnowledgeBase) -> bool:
    """Whether a knowledge base answers and can be written to."""
    before = kb.revision
    kb.propositions.save(robot_at(place=WP2))
    kb.propositions.delete(robot_at(place=WP2))
    return kb.propositions.get_all() == [robot_at()] and kb.revision == before + 2


@pytest.mark.parametrize("ask", [ask_slowly, ask_in_snapshot])
def test_a_statement_that_takes_too_long_is_ended(
    filled: KnowledgeBase, ask: Callable[[KnowledgeBase], object]
) -> None:
    started = time.monotonic()
    with (
        limited(seconds=0.2),
        pytest.raises(StatementTimeoutError, match=r"longer than 0\.2 s .* allow more time"),
    ):
        ask(filled)
    assert 0.2 <= time.monotonic() - started < SOON
    assert works(filled)


def test_each_statement_has_that_time(filled: KnowledgeBase, clock: Clock) -> None:
    # So long that SQLite looks at the clock.
    long = raw(COUNTING.format(20_000, "count(*)"))
    with limited(seconds=PATIENCE):
        for _ in range(2):
            clock.now += 0.6 * PATIENCE
            assert store_of(filled).query(lambda session, _: session.rows(long)) == [(20_000,)]


@each_question
def test_a_question_is_cancelled_by_another_thread(
    filled: KnowledgeBase, ask: Callable[[KnowledgeBase], object]
) -> None:
    started = time.monotonic()
    with limited() as limit, cancelled_after(limit, 0.2):
        with pytest.raises(QuestionCancelledError, match="cancelled"):
            ask(filled)
        assert limit.is_cancelled
    assert time.monotonic() - started < SOON
    assert works(filled)


def test_a_session_that_was_stopped_leaves_no_dead_connection_behind(filled: KnowledgeBase) -> None:
    backend = store_of(filled).backend
    with limited() as limit:
        session = backend.reader()
        with cancelled_after(limit, 0.2), pytest.raises(QuestionCancelledError):
            session.rows(SLOW)
        # Without a rollback, as of one statement outside of a transaction.
        session.close()
    with backend.open_session() as another:
        assert another.rows(raw("SELECT 1")) == [(1,)]
    assert works(filled)


def test_a_cancelled_question_asks_nothing_more(filled: KnowledgeBase) -> None:
    with limited(seconds=PATIENCE) as limit:
        assert filled.propositions.get_all() == [robot_at()]
        limit.cancel()
        limit.cancel()
        with recorded() as statements, pytest.raises(QuestionCancelledError):
            filled.propositions.get_all()
        with pytest.raises(QuestionCancelledError):
            limit.check()
    assert statements == []
    assert works(filled)


def test_work_that_reads_in_several_statements_ends_between_them(filled: KnowledgeBase) -> None:
    def ask(limit: Limit) -> object:
        def work(session: Session, _: int | None) -> object:
            session.rows(raw("SELECT 1"))
            limit.cancel()
            return session.rows(SLOW)

        return store_of(filled).query_in_snapshot(work)

    with limited() as limit, pytest.raises(QuestionCancelledError):
        ask(limit)
    assert works(filled)


def test_an_inner_block_obeys_the_outer_one_too(filled: KnowledgeBase) -> None:
    with (
        limited(seconds=0.2),
        limited(seconds=60),
        pytest.raises(StatementTimeoutError, match=r"0\.2 s"),
    ):
        ask_slowly(filled)
    with limited(seconds=60) as outer:
        with limited() as inner, cancelled_after(inner, 0.05):
            with pytest.raises(QuestionCancelledError):
                ask_slowly(filled)
            assert inner.is_cancelled
            assert not outer.is_cancelled
        assert filled.propositions.get_all() == [robot_at()]
    with (
        limited() as outer,
        limited(),
        cancelled_after(outer, 0.05),
        pytest.raises(QuestionCancelledError),
    ):
        ask_slowly(filled)
    assert works(filled)


def test_a_read_within_a_read_leaves_the_outer_one_limited(filled: KnowledgeBase) -> None:
    def work(session: Session, _: int | None) -> object:
        assert filled.propositions.get_all() == [robot_at()]
        return session.rows(SLOW)

    with limited(seconds=0.2), pytest.raises(StatementTimeoutError):
        store_of(filled).query_in_snapshot(work)
    assert works(filled)


def test_what_was_limited_is_not_limited_for_the_next(filled: KnowledgeBase) -> None:
    long = raw(COUNTING.format(200_000, "count(*)"))
    with limited(seconds=0.001), pytest.raises(StatementTimeoutError):
        ask_slowly(filled)
    assert store_of(filled).query(lambda session, _: session.rows(long)) == [(200_000,)]


def test_a_connection_that_is_kept_forgets_the_limit(filled: KnowledgeBase) -> None:
    backend = store_of(filled).backend
    cursors = set()
    for _ in range(3):
        with limited() as limit:
            # As the catalog of a store does: without a transaction to roll back.
            session = backend.reader()
            assert session.rows(raw("SELECT 1")) == [(1,)]
            session.close()
            limit.cancel()
        with backend.open_session() as session:
            assert session.rows(raw("SELECT 1")) == [(1,)]
            cursors.add(type(session._cursor))
    assert GuardedCursor not in cursors


def test_writes_and_open_transactions_are_not_limited(filled: KnowledgeBase) -> None:
    with limited() as limit:
        limit.cancel()
        with filled.transaction(reason="goes on"):
            filled.propositions.save(robot_at(place=WP2))
            assert len(filled.propositions.get_all()) == 2
        assert filled.propositions.delete(robot_at(place=WP2))
    assert works(filled)


def test_a_late_cancellation_does_not_reach_the_next_question(filled: KnowledgeBase) -> None:
    generator, tries, most = random.Random(7), 0, 0.004
    outcomes = set[str]()
    with ThreadPoolExecutor(1) as pool:
        while tries < 60 or len(outcomes) < 2:
            tries += 1
            # A slow machine needs longer to be asked in time, and a fast one less.
            most *= 1.0 if len(outcomes) == 2 else 1.1 if "cancelled" in outcomes else 0.95
            with limited() as limit:
                cancelling = pool.submit(_cancel_after, limit, generator.uniform(0, most))
                until = time.monotonic() + 0.002
                try:
                    while time.monotonic() < until:
                        filled.propositions.get_all()
                    outcomes.add("answered")
                except QuestionCancelledError:
                    outcomes.add("cancelled")
            # At once, while the request to cancel may be on its way.
            assert filled.propositions.get_all() == [robot_at()]
            assert filled.revision == 1
            cancelling.result()
    assert works(filled)


def _cancel_after(limit: Limit, seconds: float) -> None:
    time.sleep(seconds)
    limit.cancel()


def test_a_cancellation_in_the_moment_of_the_statement_is_not_lost(filled: KnowledgeBase) -> None:
    generator = random.Random(7)
    with ThreadPoolExecutor(1) as pool:
        for _ in range(30):
            with limited(seconds=60) as limit:
                cancelling = pool.submit(_cancel_after, limit, generator.uniform(0, 0.002))
                started = time.monotonic()
                with pytest.raises(QuestionCancelledError):
                    ask_slowly(filled)
                cancelling.result()
                assert time.monotonic() - started < SOON
    assert works(filled)


def test_waiting_is_not_limited_and_can_be_cancelled(filled: KnowledgeBase) -> None:
    for seconds in TRIED:
        with retried(seconds), limited(seconds=seconds):
            assert filled.watch(1, timeout=1.2 * seconds) is None
            break
    started = time.monotonic()
    with limited() as limit, cancelled_after(limit, 0.1), pytest.raises(QuestionCancelledError):
        filled.watch(1, timeout=60)
    assert time.monotonic() - started < SOON
    assert works(filled)


async def test_limits_reach_the_threads_of_asyncio(shared_url: str, connect: Connect) -> None:
    connect(shared_url).propositions.save(robot_at())

    async with aio.connect(shared_url) as kb:
        with limited() as limit:
            limit.cancel()
            with pytest.raises(QuestionCancelledError):
                await kb.propositions.get_all()
            with pytest.raises(QuestionCancelledError):
                await asyncio.to_thread(connect(shared_url).propositions.get_all)
        assert await kb.propositions.get_all() == [robot_at()]


@pytest.mark.parametrize("shared_url", ["postgresql"], indirect=True)
def test_the_server_ends_what_is_cancelled(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    running = (
        "SELECT count(*) FROM pg_stat_activity WHERE state = 'active' AND query LIKE '%RECURSIVE%' "
        "AND pid <> pg_backend_pid()"
    )
    with psycopg.connect(shared_url, autocommit=True) as observer, ThreadPoolExecutor(1) as pool:
        limits: list[Limit] = []

        def ask() -> None:
            with limited() as limit:
                limits.append(limit)
                ask_slowly(kb)

        asking = pool.submit(ask)
        wait_for(lambda: observer.execute(running).fetchall() == [(1,)])
        limits[0].cancel()
        wait_for(lambda: observer.execute(running).fetchall() == [(0,)])
        assert isinstance(asking.exception(SOON), QuestionCancelledError)


def test_cancelling_takes_no_longer_for_many_statements(clock: Clock) -> None:
    limit, asked = Limit(), []

    def take_time_and_not_obey() -> None:
        asked.append(clock.now)
        clock.now += 0.4 * limits.CANCEL_WITHIN

    for guard in [StatementGuard(limit, None, take_time_and_not_obey) for _ in range(30)]:
        guard.join()
        guard.is_running = True
    limit.cancel()
    assert len(asked) == 3
    assert limit.is_cancelled


@pytest.mark.parametrize("shared_url", ["postgresql"], indirect=True)
def test_the_servers_own_timeout_is_named(shared_url: str, connect: Connect) -> None:
    url = f"{shared_url}{'&' if '?' in shared_url else '?'}options=-cstatement_timeout="
    for seconds in TRIED:
        with retried(seconds):
            kb = connect(f"{url}{seconds * 1000}")
            break
    with pytest.raises(StatementTimeoutError, match="statement_timeout"):
        ask_slowly(kb)
    with limited(seconds=0.05), pytest.raises(StatementTimeoutError, match=r"0\.05 s"):
        ask_slowly(kb)
    with pytest.raises(StatementTimeoutError, match="statement_timeout"):
        ask_slowly(kb)


@pytest.mark.parametrize("shared_url", ["postgresql"], indirect=True)
def test_equal_limits_set_the_servers_timeout_once(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    with recorded() as statements:
        for _ in range(3):
            with limited(seconds=PATIENCE):
                assert kb.propositions.get_all() == [robot_at()]
    assert [sql for sql in statements if "timeout" in sql] == [
        f"SET statement_timeout = {PATIENCE * 1000}"
    ]
    with recorded() as statements:
        for _ in range(3):
            assert kb.propositions.get_all() == [robot_at()]
    assert [sql for sql in statements if "timeout" in sql] == ["SET statement_timeout = DEFAULT"]


@pytest.mark.parametrize("junk", [-1, "1", float("nan"), True])
def test_a_limit_is_a_number_of_seconds(junk: object) -> None:
    with pytest.raises(InvalidTimeoutError), limited(seconds=junk):  # type: ignore[arg-type]
        pass

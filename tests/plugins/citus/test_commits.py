"""An error at COMMIT, for which Citus has words of its own, leaves all written or nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import ConnectionLostError
from kant_sql.sql.dialects.base import Row, Session
from kant_sql.sql.dialects.postgresql import PostgresqlSession
from kant_sql.sql.query import Insert, Query
from tests.support.chain import check_chain
from tests.support.citus import Cluster
from tests.support.statements import text_of
from tests.support.worlds.robots import WP2, robot_at, waypoint


@pytest.fixture
def url(distributed_url: str) -> str:
    return distributed_url


@pytest.fixture
def kb(url: str) -> Iterator[KnowledgeBase]:
    with kant_sql.connect(url, knowledge_base="tiago") as opened:
        opened.propositions.save(robot_at())
        yield opened


def save_in_block(kb: KnowledgeBase) -> None:
    """Save a fact in a block, which is not repeated."""
    with kb.transaction():
        kb.propositions.save(robot_at(place=WP2))


def assert_unwritten(kb: KnowledgeBase, url: str) -> None:
    assert kb.propositions.get_all() == [robot_at()]
    assert check_chain(url) == {"tiago": 1}
    kb.propositions.save(robot_at(place=waypoint(7)))
    assert kb.store.verify().findings == ()


def test_a_key_that_is_missing_at_the_commit(
    kb: KnowledgeBase, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    insert = PostgresqlSession.insert

    def without_revision(self: PostgresqlSession, into: Insert, rows: Sequence[Row]) -> None:
        if into.table.name != "revision":
            insert(self, into, rows)

    with monkeypatch.context() as patch:
        patch.setattr(PostgresqlSession, "insert", without_revision)
        with pytest.raises(ConnectionLostError, match=r"COMMIT was answered by an error .*shard"):
            save_in_block(kb)
    assert_unwritten(kb, url)


def at_the_commit(monkeypatch: pytest.MonkeyPatch, before: Callable[[], object]) -> None:
    """Do something before the next COMMIT."""
    commit, first = Session.commit, iter([before])

    def spy(self: Session, changed: int | None = None) -> None:
        for call in first:
            call()
        commit(self, changed)

    monkeypatch.setattr(Session, "commit", spy)


def end_workers(cluster: Cluster, url: str) -> list[Any]:
    """End what runs on the workers in a database, as when they are killed."""
    return cluster.run(
        "SELECT * FROM run_command_on_workers('SELECT count(pg_terminate_backend(pid)) FROM "
        "pg_stat_activity WHERE datname = current_database() AND pid <> pg_backend_pid() "
        "AND backend_type = ''client backend''')",
        url,
    )


def test_workers_that_are_gone_at_the_commit(
    kb: KnowledgeBase, url: str, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        at_the_commit(patch, lambda: end_workers(cluster, url))
        with pytest.raises(ConnectionLostError):
            save_in_block(kb)
    assert_unwritten(kb, url)


def test_a_call_is_repeated_when_workers_are_gone_at_the_commit(
    kb: KnowledgeBase, url: str, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_the_commit(monkeypatch, lambda: end_workers(cluster, url))
    kb.propositions.save(robot_at(place=WP2))
    assert check_chain(url) == {"tiago": 2}


def test_a_commit_that_was_answered_by_an_error_is_found(
    kb: KnowledgeBase, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    execute, lost = PostgresqlSession._execute, iter([True])

    def commits_and_fails(
        self: PostgresqlSession, statement: str | Query, parameters: Any = ()
    ) -> None:
        execute(self, statement, parameters)
        if text_of(self, statement).startswith("COMMIT; NOTIFY"):
            for _ in lost:
                # As the coordinator says when it does not hear from the worker.
                execute(self, "DO 'BEGIN RAISE ''could not commit transaction for shard 1''; END'")

    monkeypatch.setattr(PostgresqlSession, "_execute", commits_and_fails)
    save_in_block(kb)
    assert check_chain(url) == {"tiago": 2}

"""Settings of a session reach the worker that has the rows, and so do its errors come back."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import pairwise

import psycopg
import pytest
from sqlalchemy import make_url

from kant_sql import StoreBusyError
from kant_sql.errors import ConnectionLostError
from kant_sql.sql.dialects import create_backend, postgresql
from kant_sql.sql.dialects.base import Session
from kant_sql.store.head import lock_head
from tests.support.citus import Cluster
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at

# Run by the node that has the row.
ON_WORKER = "SELECT kb_id, current_setting('{}') FROM head WHERE kb_id = 1"


@pytest.fixture
def one_url(distributed_url: str, connect: Connect) -> str:
    """The URL of a distributed store with one knowledge base."""
    connect(distributed_url, knowledge_base="tiago").propositions.save(robot_at())
    return distributed_url


@contextmanager
def opened(url: str) -> Iterator[Session]:
    """Open a session of a backend of its own."""
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        try:
            yield session
        finally:
            session.rollback()


def setting(session: Session, name: str) -> str:
    return str(session.rows_of(ON_WORKER.format(name))[0][1])


def test_a_writer_gives_up_waiting_for_another_on_a_worker(
    one_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(postgresql, "LOCK_TIMEOUT", "300ms")
    with psycopg.connect(one_url) as holder, opened(one_url) as session:
        holder.execute("SELECT * FROM head WHERE kb_id = 1 FOR NO KEY UPDATE")
        session.begin(write=True)
        began = time.monotonic()
        with pytest.raises(StoreBusyError, match="another writer held the knowledge base"):
            lock_head(session, 1)
        assert 0.25 < time.monotonic() - began < 10
        session.rollback()
        holder.rollback()
        session.begin(write=True)
        assert lock_head(session, 1) is not None


@pytest.mark.parametrize("asked", ["off", "remote_write"])
def test_what_a_commit_waits_for_reaches_the_worker(one_url: str, asked: str) -> None:
    url = make_url(one_url).update_query_dict({"options": f"-csynchronous_commit={asked}"})
    with opened(url.render_as_string(hide_password=False)) as session:
        assert setting(session, "synchronous_commit") == "on"
        session.begin(write=True)
        assert setting(session, "synchronous_commit") == asked
        session.rollback()
        session.make_durable()
        session.begin(write=True)
        assert setting(session, "synchronous_commit") == ("on" if asked == "off" else asked)


def test_a_durable_commit_is_durable_on_a_worker_that_commits_lazily(
    cluster: Cluster, one_url: str
) -> None:
    name = make_url(one_url).database
    for group, _, _ in cluster.nodes:
        if group:
            lazily = f'ALTER DATABASE "{name}" SET synchronous_commit = off'
            cluster.run(
                f"SET citus.enable_ddl_propagation = off; {lazily}", cluster.at_node(one_url, group)
            )
    # The coordinator's connections to the workers are made again.
    with opened(one_url) as session:
        session.begin(write=True)
        assert setting(session, "synchronous_commit") == "off"
        session.rollback()
        session.make_durable()
        session.begin(write=True)
        assert setting(session, "synchronous_commit") == "on"


def test_a_worker_makes_its_plans_again_each_time(one_url: str) -> None:
    with opened(one_url) as session:
        session.begin(write=True)
        paths = [setting(session, "search_path")]
        for _ in range(3):
            session.replan()
            paths.append(setting(session, "search_path"))
        session.commit()
        session.begin(write=True)
        assert setting(session, "search_path") == paths[0]
        session.rollback()
    assert all(one != other for one, other in pairwise(paths))
    assert paths[1] == paths[3]


def test_a_key_that_is_checked_at_commit_is_refused(one_url: str, connect: Connect) -> None:
    with opened(one_url) as session:
        session.begin(write=True)
        session.define("INSERT INTO type (kb_id, id, name, key) VALUES (1, 900, 'ghost', 'ghost')")
        session.define(
            "INSERT INTO type_version (kb_id, type_id, since, text) VALUES (1, 900, 77, 'ghost')"
        )
        with pytest.raises(ConnectionLostError, match="could not commit transaction for shard"):
            session.commit(1)
    assert connect(one_url, knowledge_base="tiago").types.get("ghost") is None

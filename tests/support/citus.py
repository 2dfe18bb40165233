"""Databases of a Citus cluster, a new one for each test.

Creating the extension, 48 tables and their shards takes seconds. So a database is a copy, made on
every node at once: Citus knows nodes by their addresses and tables by their numbers, which are the
same in a copy.
"""

from __future__ import annotations

import itertools
import os
import time
from typing import Any

import psycopg
from sqlalchemy import URL, make_url

import kant_sql
from kant_sql_plugins.citus import distribute
from tests.support.reading import store_of

VARIABLE = "KANT_SQL_TEST_CITUS_URL"
MISSING = f"no Citus: set {VARIABLE} to the URL of an empty database on a coordinator"
# Enough for two knowledge bases to be on different nodes, few enough to copy fast.
SHARDS = 4
TRIES = 6
# Citus reads these views, with recursive queries, only for a single knowledge base.
OF_ONE = {"audit_action_literal"}
_NODES = "SELECT groupid, nodename, nodeport FROM pg_dist_node WHERE noderole = 'primary'"
_numbers = itertools.count(1)


def citus_url() -> str | None:
    """The URL of the database of the test cluster, if there is one."""
    return os.environ.get(VARIABLE)


def is_distributed(url: str) -> bool:
    """Return whether the tables of a store are distributed."""
    if citus_url() is None or not url.startswith("postgresql"):
        return False
    with psycopg.connect(url) as connection:
        [found] = connection.execute("SELECT to_regclass('pg_dist_partition')").fetchone() or [None]
    return found is not None


def view_of(url: str, view: str, knowledge_base: str) -> str:
    """Return the text that a query reads a view from: a cluster requires one knowledge base."""
    if view not in OF_ONE or not is_distributed(url):
        return view
    with (
        kant_sql.connect(url, knowledge_base=knowledge_base) as kb,
        store_of(kb).backend.open_session() as session,
    ):
        name = f"SELECT id FROM knowledge_base WHERE name = '{knowledge_base}'"
        [(kb_id,)] = session.rows_of(name)
        return f"({session.query_of_view(view, kb_id)}) AS {view}"


class Cluster:
    """A Citus cluster whose user may create databases on each node.

    Attributes:
        url: the URL of a database on the coordinator.
        nodes: group number, host and port of each node; the coordinator's group is 0.
    """

    def __init__(self, url: str) -> None:
        self.url: URL = make_url(url)
        self.nodes: list[tuple[int, str, int]] = [
            (row[0], row[1], row[2]) for row in self.run(_NODES)
        ]
        self._templates: dict[int | None, str] = {}
        self._made: set[str] = set()

    def run(self, sql: str, url: str | URL | None = None) -> list[tuple[Any, ...]]:
        """Run a statement on the coordinator."""
        address = make_url(url or self.url).render_as_string(hide_password=False)
        with psycopg.connect(address, autocommit=True) as connection:
            cursor = connection.execute(sql.encode())
            return cursor.fetchall() if cursor.description else []

    def run_everywhere(self, sql: str, url: str | URL | None = None) -> None:
        """Run a statement on each node."""
        quoted = sql.replace("'", "''")
        for node, success, result in self.run(
            f"SELECT * FROM run_command_on_all_nodes('{quoted}')", url
        ):
            assert success, (node, result)

    def at_node(self, url: str, group: int) -> str:
        """Return the URL of the same database on another node."""
        (host, port), *_ = [(host, port) for number, host, port in self.nodes if number == group]
        return make_url(url).set(host=host, port=port).render_as_string(hide_password=False)

    def new_database(self) -> str:
        """Create a database with the extension and without tables, and return its URL."""
        if None not in self._templates:
            self._templates[None] = self._make_template()
        return self._copy(self._templates[None])

    def new_store(self, shards: int = SHARDS) -> str:
        """Create a database with tables, distributed unless `shards` is 0, and return its URL."""
        if shards not in self._templates:
            url = self.new_database() if shards == 0 else self.new_store(0)
            if shards == 0:
                kant_sql.upgrade(url)
            else:
                distribute(url, shards=shards)
            self._templates[shards] = self._close(url)
        return self._copy(self._templates[shards])

    def copy(self, url: str) -> str:
        """Copy a database without connections."""
        name = self._close(url)
        try:
            return self._copy(name)
        finally:
            self.run_everywhere(f'ALTER DATABASE "{name}" ALLOW_CONNECTIONS true')

    def drop_database(self, url: str) -> None:
        """Drop the database of a test."""
        self._drop(str(make_url(url).database))

    def drop(self) -> None:
        """Drop all created databases."""
        for name in [*self._made]:
            self._drop(name)

    def _drop(self, name: str) -> None:
        self._made.discard(name)
        self._retried(f'DROP DATABASE IF EXISTS "{name}" WITH (FORCE)')

    def _make_template(self) -> str:
        name = self._new_name()
        self.run_everywhere(f'CREATE DATABASE "{name}"')
        url = self.url.set(database=name)
        for _, host, port in self.nodes:
            self.run("CREATE EXTENSION citus", url.set(host=host, port=port))
        for group, host, port in sorted(self.nodes):
            add = "citus_add_node" if group else "citus_set_coordinator_host"
            self.run(f"SELECT {add}('{host}', {port})", url)
        return self._close(url)

    def _close(self, url: str | URL) -> str:
        """Refuse all connections to a database, even of Citus itself, so it can be copied."""
        name = str(make_url(url).database)
        self.run_everywhere(f'ALTER DATABASE "{name}" ALLOW_CONNECTIONS false')
        self.run_everywhere(
            "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity "
            f"WHERE datname = '{name}'"
        )
        return name

    def _copy(self, template: str) -> str:
        name = self._new_name()
        self._retried(
            f'CREATE DATABASE "{name}" TEMPLATE "{template}" STRATEGY wal_log',
            undo=f'DROP DATABASE IF EXISTS "{name}"',
        )
        return self.url.set(database=name).render_as_string(hide_password=False)

    def _retried(self, sql: str, undo: str | None = None) -> None:
        """Run a statement on each node; retry while Citus still runs something in the database."""
        for attempt in itertools.count(1):
            try:
                self.run_everywhere(sql)
                return
            except AssertionError:
                # It ends a moment after the request.
                if undo is not None:
                    self.run_everywhere(undo)
                if attempt == TRIES:
                    raise
                time.sleep(0.5)

    def _new_name(self) -> str:
        name = f"kant_sql_test_{os.getpid()}_{next(_numbers)}"
        self._made.add(name)
        return name

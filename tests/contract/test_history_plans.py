"""What is asked of one element, or one moment, looks at its rows alone, before any statistics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import psycopg
import pytest

import kant_sql
from kant_sql import KnowledgeBase
from tests.support.servers import Server, is_old
from tests.support.statements import Statement, explain, is_bracket, seen, work
from tests.support.worlds.robots import RB1, WP1, robot_at, waypoint

FACTS, TIMES = 3_000, 300
FLAPPING, CALM = robot_at(RB1, WP1), robot_at(RB1, waypoint(7))

# What is asked, and how many rows the busiest step may look at.
ASKED: dict[str, tuple[Callable[[KnowledgeBase], Any], int]] = {
    "blame": (lambda kb: kb.blame(FLAPPING), 3),
    "blame in the past": (lambda kb: kb.at(30).blame("(robot_at rb1 wp1)"), 3),
    "history of one version": (lambda kb: kb.history(CALM), 3),
    # Each revision that began or ended one of them is looked up once, 2 * TIMES + 1 in all.
    "history of many versions": (lambda kb: kb.history(FLAPPING), 2 * TIMES + 1),
    "history of a name": (lambda kb: kb.history("wp7"), 3),
    "log of an element": (lambda kb: list(kb.log(element=CALM)), 3),
    "log of few": (lambda kb: list(kb.log(limit=3)), 3),
    "a moment": (lambda kb: kb.at(kb.store.revisions(after=9, limit=1)[0].committed_at), 3),
}


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def store(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A store with many facts, and one that came and went; PostgreSQL from 17 on knows nothing."""
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path_factory.mktemp('asked') / 'store.db'}"
    else:
        server: Server = request.getfixturevalue("server")
        url = server.new_store()
        with psycopg.connect(url, autocommit=True) as connection:
            for table in ("proposition", "proposition_version", "revision", "object"):
                connection.execute(f"ALTER TABLE {table} SET (autovacuum_enabled = off)".encode())
    with kant_sql.connect(url) as kb:
        kb.propositions.save_all(robot_at(RB1, waypoint(each)) for each in range(FACTS))
        for _ in range(TIMES):
            kb.propositions.delete(FLAPPING)
            kb.propositions.save(FLAPPING)
    if is_old(url):
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute("ANALYZE")
    return url


def statements(url: str, call: Callable[[KnowledgeBase], Any]) -> list[Statement]:
    with kant_sql.connect(url) as kb, seen() as found:
        call(kb)
    return [statement for statement in found if not is_bracket(statement.sql)]


@pytest.mark.parametrize("name", ASKED)
@pytest.mark.more
def test_it_looks_at_the_rows_of_what_is_asked(store: str, name: str) -> None:
    call, most = ASKED[name]
    for statement in statements(store, call):
        if "key = ANY" in statement.sql or "revision.number = ANY" in statement.sql:
            # Of so few rows PostgreSQL reads all, before it has statistics; of more, it does not.
            continue
        if store.startswith("sqlite"):
            steps = [step for step in explain(store, statement) if "_version" in step]
            assert not [each for each in steps if "SCAN" in each or "(kb_id=?)" in each], steps
        elif statement.sql.startswith("SELECT") and "kb" in statement.parameters:
            if is_old(store):
                # Of one element, it may read all versions.
                most = max(most, 2 * TIMES)
            assert work(store, statement) <= most, statement.sql

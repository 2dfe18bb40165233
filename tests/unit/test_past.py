"""Where versions are kept, and where what held at a revision is looked for."""

from __future__ import annotations

import sqlite3
from typing import Any

import psycopg
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import BigInteger, bindparam, create_engine, select

from kant_sql.sql.intervals import HOLDS_NOW, Fork, fork, forks_at
from tests.support.servers import Server

LARGEST = 2**63 - 1
_revisions = st.one_of(st.integers(1, 300), st.integers(1, LARGEST))
_intervals = st.tuples(_revisions, _revisions).filter(lambda ends: ends[0] != ends[1]).map(sorted)
INTERVALS = [(1, 2), (1, 3), (3, 4), (4, 5), (5, 9), (2**62, LARGEST), (1, LARGEST)]


def most_even(since: int, until: int) -> int:
    """The fork, as its column's comment says it."""
    return max(range(since, until), key=lambda number: number & -number)


def test_the_fork_is_the_revision_that_the_highest_power_of_two_divides() -> None:
    for since in range(1, 70):
        for until in range(since + 1, 70):
            assert fork(since, until) == most_even(since, until)
    assert fork(5, None) == HOLDS_NOW


@given(_intervals, _revisions)
def test_an_interval_is_looked_for_where_it_is_kept(interval: list[int], at: int) -> None:
    since, until = interval
    assert since <= fork(since, until) < until
    if since <= at < until:
        assert fork(since, until) in forks_at(at)


@given(_revisions)
def test_few_places_are_looked_at(at: int) -> None:
    places = forks_at(at)
    assert len(places) <= 64
    assert all(0 <= place <= LARGEST for place in places)


def sql(url: str) -> str:
    options: Any = {"paramstyle": "named"} if url == "sqlite://" else {}
    dialect = create_engine(url, **options).dialect
    parameters = (bindparam(name, type_=BigInteger) for name in ("since", "until"))
    return str(select(Fork(*parameters)).compile(dialect=dialect))


def test_sqlite_computes_the_same() -> None:
    connection = sqlite3.connect(":memory:")
    query = sql("sqlite://")
    for since, until in [*INTERVALS, *((s, u) for s in range(1, 20) for u in range(s + 1, 40))]:
        row = connection.execute(query, {"since": since, "until": until}).fetchone()
        assert row == (fork(since, until),)
    connection.close()


@pytest.mark.parametrize(("since", "until"), INTERVALS)
def test_postgresql_computes_the_same(server: Server, since: int, until: int) -> None:
    query = sql("postgresql://")
    url = server.url.render_as_string(hide_password=False)
    with psycopg.connect(url) as connection:
        row = connection.execute(query.encode(), {"since": since, "until": until}).fetchone()
    assert row == (fork(since, until),)

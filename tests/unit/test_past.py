"""Where versions are kept, and where what held at a revision is looked for."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from typing import Any

import psycopg
from hypothesis import example, given
from hypothesis import strategies as st
from sqlalchemy import BigInteger, bindparam, create_engine, make_url, select

from kant_sql.sql.dialects import backend_class
from kant_sql.sql.intervals import HOLDS_NOW, fork, forks_at
from kant_sql.sql.query import Fork
from tests.support.servers import Server

LARGEST = 2**63 - 1
_revisions = st.one_of(st.integers(1, 300), st.integers(1, LARGEST))
_intervals = st.tuples(_revisions, _revisions).filter(lambda ends: ends[0] != ends[1]).map(sorted)
# Gives what a database computes of the two ends.
Compute = Callable[[dict[str, int]], int]


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
    # Registers how the dialect writes it.
    backend_class(make_url(url).get_backend_name())
    dialect = create_engine(url, **options).dialect
    parameters = (bindparam(name, type_=BigInteger) for name in ("since", "until"))
    return str(select(Fork(*parameters)).compile(dialect=dialect))


def check_forks(compute: Compute) -> None:
    """Compare a database's forks with those of the library, for all small and for large ends."""

    @given(_intervals)
    @example([2**62, LARGEST])
    @example([1, LARGEST])
    def check(interval: list[int]) -> None:
        since, until = interval
        assert compute({"since": since, "until": until}) == fork(since, until)

    check()
    for since in range(1, 20):
        for until in range(since + 1, 40):
            assert compute({"since": since, "until": until}) == fork(since, until)


def test_sqlite_computes_the_same() -> None:
    text = sql("sqlite://")
    with closing(sqlite3.connect(":memory:")) as connection:
        check_forks(lambda ends: connection.execute(text, ends).fetchone()[0])


def test_postgresql_computes_the_same(server: Server) -> None:
    text = sql("postgresql://").encode()
    with psycopg.connect(server.url.render_as_string(hide_password=False)) as connection:
        check_forks(lambda ends: connection.execute(text, ends).fetchall()[0][0])

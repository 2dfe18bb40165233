"""The benchmark's bare driver does the same as the library, or the comparison is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

import kant_sql
from kant_sql import PddlPropositionDto
from tests.benchmarks.coffee_shop import Stores, measure, postgresql_stores, sqlite_stores
from tests.benchmarks.comparing import compare_results, compare_tables
from tests.benchmarks.recording import record
from tests.support.servers import Server
from tests.support.worlds.robots import WP2, robot_at


def check(stores: Stores, folder: Path) -> None:
    """Replay on both sides, which compares what they store, and see that all was timed."""
    measured = measure(stores, 1, folder)
    assert measured.bare.keys() == measured.library.keys() == measured.steps.keys()
    assert all(time > 0 for time in (*measured.bare.values(), *measured.library.values()))


@pytest.mark.more
@pytest.mark.parametrize("backend", ["sqlite-file", "sqlite-memory"])
def test_both_sides_keep_the_same_history_on_sqlite(backend: str, tmp_path: Path) -> None:
    check(sqlite_stores(backend, tmp_path), tmp_path)


@pytest.mark.more
def test_both_sides_keep_the_same_history_on_postgresql(server: Server, tmp_path: Path) -> None:
    check(postgresql_stores(server, wait=False), tmp_path)


def test_the_workload_is_about_as_long_as_the_papers(tmp_path: Path) -> None:
    filling, iteration = record(tmp_path)
    assert 430 <= sum(len(step.calls) for step in iteration) <= 460
    alone = sum(not step.in_transaction for step in iteration)
    assert alone > len(iteration) / 2
    assert len({step.actor for step in iteration}) >= 5
    assert {step.actor for step in filling} == {"mission"}


def test_another_row_is_noticed(tmp_path: Path) -> None:
    urls = [f"sqlite:///{tmp_path / name}.db" for name in ("one", "two")]
    for url, place in zip(urls, (robot_at(), robot_at(place=WP2)), strict=True):
        with kant_sql.connect(url) as kb:
            kb.propositions.save(place)
    compare_tables(urls[0], urls[0])
    with pytest.raises(AssertionError, match="differ"):
        compare_tables(*urls)


@pytest.mark.parametrize("result", [[], [robot_at(place=WP2)], [robot_at(is_goal=True)]])
def test_another_result_is_noticed(result: list[PddlPropositionDto]) -> None:
    compare_results([[robot_at()]], [[(False, "(robot_at rb1 wp1)")]])
    with pytest.raises(AssertionError):
        compare_results([result], [[(False, "(robot_at rb1 wp1)")]])

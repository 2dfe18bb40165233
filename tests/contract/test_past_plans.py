"""What is asked of the past visits about as much as what is asked of the present.

The stores have a history that is far larger than any state, with and without statistics. What a
statement visits is counted, in steps of SQLite's virtual machine or rows of PostgreSQL's plans.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any

import pytest

import kant_sql
from kant_sql.sql import estimates
from tests.benchmarks.drivers import bare
from tests.benchmarks.past import CONDITIONS, NAME, PERIODS, fill
from tests.benchmarks.two_clocks import LATE, LONGEST, say_late
from tests.benchmarks.years import START, STEP
from tests.contract.test_plans import keep_without_statistics
from tests.support.servers import Server
from tests.support.statements import Statement, is_bracket, seen, work

BOXES, FACTS, REVISIONS, SAYINGS = 1_200, 3_000, 600, 300
ALL = CONDITIONS["all boxes"]
LAST = REVISIONS + 3
FILTERED = "beside a sealed box"


def filled(url: str) -> str:
    say_late(url, SAYINGS * LATE, fill(url, BOXES, FACTS, REVISIONS))
    return url


@pytest.fixture(scope="module")
def filled_server(server: Server) -> str:
    url = server.new_store()
    keep_without_statistics(url)
    return filled(url)


@pytest.fixture(
    scope="module",
    params=["sqlite", "sqlite after ANALYZE", "postgresql", "postgresql after ANALYZE"],
)
def url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    name: str = request.param
    if name.startswith("sqlite"):
        url = filled(f"sqlite:///{tmp_path_factory.mktemp('past') / 'store.db'}")
    else:
        server: Server = request.getfixturevalue("server")
        url = request.getfixturevalue("filled_server")
        if name.endswith("ANALYZE"):
            url = server.copy(url)
    if name.endswith("ANALYZE"):
        store = bare(url)
        store.execute("ANALYZE")
        store.close()
    return url


def visited(url: str, call: Callable[[kant_sql.KnowledgeBase], Any]) -> float:
    """Count what the statements of a call visit, once it is prepared."""
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        call(kb)
        with seen() as statements:
            call(kb)
    return sum(work(url, each) for each in statements if not is_bracket(each.sql))


def answers(text: str, at: int | None, kb: kant_sql.KnowledgeBase) -> list[Any]:
    return list((kb if at is None else kb.at(at)).query(text))


def true_halfway(kb: kant_sql.KnowledgeBase) -> kant_sql.KnowledgeBase:
    """What was true at half of the history, at a time of which much was said."""
    return kb.at(known=LAST, valid=START + (LAST // 2 - LONGEST // 2) * STEP)


def filtered(url: str) -> float:
    """Count what some versions of SQLite visit once, with statistics, for a Bloom filter.

    They make it of a whole table if they expect more lookups in it than it has rows.
    """
    if not url.startswith("sqlite") or not (3, 38) <= sqlite3.sqlite_version_info < (3, 42):
        return 0
    has = Statement("SELECT 1 FROM sqlite_master WHERE name = 'sqlite_stat1'", {})
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as lite:
        if not lite.execute(has.sql).fetchall():
            return 0
    made = "kb_id, predicate_id, fork, second_object_id, is_goal = 0, until IS NULL OR until > 1"
    return 2 * work(url, Statement(f"SELECT {made} FROM proposition_version", {}))


def check_visits(url: str, name: str, at: int) -> None:
    now, then = (visited(url, partial(answers, CONDITIONS[name], each)) for each in (None, at))
    # What the present finds by an index, the past finds among the facts of that revision.
    whole = visited(url, partial(answers, ALL, at))
    assert then <= max(3 * now, 2 * whole) + (filtered(url) if name == FILTERED else 0)


def test_facts_of_two_objects_are_looked_up_and_not_compared(url: str) -> None:
    check_visits(url, "places of two articles", LAST // 2)


def test_a_join_of_the_past_goes_by_how_many_facts_hold_also_where_these_are_many(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    call = partial(answers, CONDITIONS["articles with one at p7"], LAST // 2)
    counted = visited(url, call)
    monkeypatch.setattr(estimates, "COUNTED", 10)
    assert visited(url, call) == counted


@pytest.mark.more
@pytest.mark.parametrize("at", [4, LAST // 2, LAST - 1])
@pytest.mark.parametrize("name", CONDITIONS)
def test_an_answer_of_the_past_visits_as_much_as_one_of_the_present(
    url: str, name: str, at: int
) -> None:
    check_visits(url, name, at)


@pytest.mark.more
@pytest.mark.parametrize("name", CONDITIONS)
def test_an_answer_of_a_valid_time_visits_about_as_much_as_one_of_a_revision(
    url: str, name: str
) -> None:
    text = CONDITIONS[name]
    true = visited(url, lambda kb: list(true_halfway(kb).query(text)))
    assert true <= 6 * visited(url, partial(answers, text, LAST // 2))


@pytest.mark.more
@pytest.mark.parametrize("name", CONDITIONS)
def test_further_answers_of_a_view_of_valid_time_visit_about_as_much_as_those_of_a_revision(
    url: str, name: str
) -> None:
    text = CONDITIONS[name]
    views: list[kant_sql.KnowledgeBase] = []

    def further(kb: kant_sql.KnowledgeBase) -> object:
        if not views:
            views.append(true_halfway(kb))
            list(views[0].query(text))
        return list(views[0].query(text))

    assert visited(url, further) <= 3 * visited(url, partial(answers, text, LAST // 2))


def test_facts_of_an_object_at_a_valid_time_visit_about_as_much_as_at_a_revision(url: str) -> None:
    def visited_in(view: Callable[[kant_sql.KnowledgeBase], kant_sql.KnowledgeBase]) -> float:
        return visited(url, lambda kb: view(kb).propositions.get_by_object("b7"))

    assert visited_in(true_halfway) <= 4 * visited_in(lambda kb: kb.at(LAST // 2))


# What reads a part of the history, whatever its length.
PARTS: dict[str, Callable[[kant_sql.KnowledgeBase], Any]] = {
    "corrections": lambda kb: kb.corrections(limit=10),
    "contradicted": lambda kb: kb.contradicted(limit=10),
    "unconfirmed": lambda kb: kb.unconfirmed(limit=10),
    "a value of the past": lambda kb: kb.at(LAST // 2).function_values.get("(level b7)"),
}


@pytest.mark.parametrize("name", PARTS)
def test_a_part_of_the_history_is_found_without_the_whole(url: str, name: str) -> None:
    every = visited(url, lambda kb: kb.diff(0, LAST))
    assert visited(url, PARTS[name]) < every / 4


@pytest.mark.parametrize("name", ["of one box", "of two boxes", "of one fact"])
@pytest.mark.more
def test_periods_are_found_by_the_objects_of_their_facts(url: str, name: str) -> None:
    periods = visited(url, lambda kb: kb.when(PERIODS[name]))
    assert periods <= visited(url, partial(answers, ALL, None))


def test_a_question_about_one_object_visits_what_mentions_it(url: str) -> None:
    then = visited(url, partial(answers, "(at b7 ?s)", LAST // 2))
    assert 4 * then <= visited(url, partial(answers, ALL, LAST // 2))


def test_what_is_derived_from_a_fact_is_found_by_its_objects(url: str) -> None:
    every = visited(url, lambda kb: kb.diff(0, LAST))
    own = visited(url, lambda kb: kb.consequences(f"(at b7 {kb.query('(at b7 ?s)')[0][0]})"))
    assert own < every / 8

"""The log: by time, by actor, by element; newest first, in pages, in constant memory.

And `kb.changes`: a feed that can be resumed, ordered and without gaps.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from itertools import islice, pairwise, product
from typing import Any

import pytest
from sqlalchemy import make_url

from kant_sql import (
    InvalidArgumentError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlObjectDto,
    PddlTypeDto,
    Plan,
    PlanStep,
)
from kant_sql.dto.formulas import Comparison
from kant_sql.errors import ArchivedError, StoreIntegrityError, UnknownNameError
from kant_sql.history import follow as following
from kant_sql.history import revisions as pages
from kant_sql.history import versions
from kant_sql.history.revisions import LogEntry
from tests.support.pages import opened
from tests.support.processes.workers import change, in_processes
from tests.support.statements import count
from tests.support.stores import Connect
from tests.support.worlds.depot import fuel, load, number
from tests.support.worlds.robots import BATTERY, RB1, ROBOT, WP1, WP2, robot_at, waypoint

PAGES = {"LOG_PAGE": 3, "LOG_CHANGES": 4}


def numbers(entries: Any) -> list[int]:
    return [entry.revision.number for entry in entries]


def lines(entries: Iterator[LogEntry]) -> list[tuple[int, list[str]]]:
    told = ((entry.revision.number, entry.changes) for entry in entries)
    return [(number, [" ".join(change) for change in changes]) for number, changes in told]


@pytest.fixture
def told(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """Ten revisions: a robot goes to and fro, and its battery drains; a driver writes a third."""
    fresh_kb.propositions.save(robot_at())
    for step in range(2, 11):
        with fresh_kb.transaction(actor="driver" if step % 3 == 0 else None):
            here, there = (WP1, WP2) if step % 2 == 0 else (WP2, WP1)
            fresh_kb.propositions.delete(robot_at(RB1, here))
            fresh_kb.propositions.save(robot_at(RB1, there))
            fresh_kb.function_values.set(BATTERY, objects=[RB1], value=100 - step)
    return fresh_kb


@pytest.fixture(params=["one page", "many pages", "pages of many changes"])
def paged(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "pages of many changes":
        monkeypatch.setattr("kant_sql.sql.changes.FEW", 3)
    if request.param != "one page":
        for name, value in PAGES.items():
            monkeypatch.setattr(f"kant_sql.history.log.{name}", value)
        monkeypatch.setattr("kant_sql.history.log.VERSION_PAGE", 2)


@pytest.mark.usefixtures("paged")
def test_entries_come_newest_first_with_all_that_changed(told: KnowledgeBase) -> None:
    entries = list(told.log())
    assert [entry.revision for entry in entries] == told.store.revisions()[::-1]
    assert lines(iter(entries[:1])) == [
        (
            10,
            [
                "+ fact (robot_at rb1 wp2)",
                "+ value (= (battery rb1) 90)",
                "- fact (robot_at rb1 wp1)",
                "- value (= (battery rb1) 91)",
            ],
        )
    ]
    for entry in entries:
        assert list(entry.changes) == sorted(entry.changes)
        assert set(entry.changes) == set(
            told.diff(entry.revision.number - 1, entry.revision.number)
        )


BOUNDS: list[tuple[dict[str, Any], Iterable[int]]] = [
    ({}, range(10, 0, -1)),
    ({"limit": 0}, []),
    ({"limit": 4}, [10, 9, 8, 7]),
    ({"limit": 99}, range(10, 0, -1)),
    ({"since": 8}, [10, 9, 8]),
    ({"since": 0}, range(10, 0, -1)),
    ({"until": 2}, [2, 1]),
    ({"until": 0}, []),
    ({"since": 4, "until": 6}, [6, 5, 4]),
    ({"since": 2, "until": 9, "limit": 2}, [9, 8]),
    ({"actor": "driver"}, [9, 6, 3]),
    ({"actor": "driver", "limit": 2}, [9, 6]),
    ({"actor": "driver", "since": 4, "until": 8}, [6]),
    ({"actor": "test"}, [10, 8, 7, 5, 4, 2, 1]),
    ({"element": "wp2 - wp"}, [2]),
    ({"element": "wp2", "limit": 3}, [10, 9, 8]),
    ({"element": "wp2", "actor": "driver", "until": 8}, [6, 3]),
    ({"element": robot_at(RB1, WP1)}, range(10, 0, -1)),
    ({"element": robot_at(RB1, WP1), "actor": "driver"}, [9, 6, 3]),
    ({"element": robot_at(RB1, WP1), "actor": "driver", "limit": 1}, [9]),
    ({"element": "(battery rb1)", "limit": 3}, [10, 9, 8]),
    ({"element": "(battery rb1)", "since": 3, "until": 5}, [5, 4, 3]),
    ({"element": robot_at(RB1, WP1, is_goal=True)}, []),
]


@pytest.mark.usefixtures("paged")
def test_each_bound_and_filter(told: KnowledgeBase) -> None:
    for options, expected in BOUNDS:
        assert numbers(told.log(**options)) == list(expected), options


@pytest.mark.usefixtures("paged")
def test_of_an_element_only_its_own_changes_are_told(told: KnowledgeBase) -> None:
    at_wp1 = lines(told.log(element=robot_at(RB1, WP1)))
    assert at_wp1 == [
        (step, [f"{'-' if step % 2 == 0 else '+'} fact (robot_at rb1 wp1)"])
        for step in range(10, 0, -1)
    ]
    battery = lines(told.log(element="(= (BATTERY rb1) 0)", since=9))
    assert battery == [
        (10, ["+ value (= (battery rb1) 90)", "- value (= (battery rb1) 91)"]),
        (9, ["+ value (= (battery rb1) 91)", "- value (= (battery rb1) 92)"]),
    ]


def test_what_several_things_are_called_is_told_together(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.goals.save(robot_at(is_goal=True))
    fresh_kb.propositions.delete(robot_at())
    assert lines(fresh_kb.log(element="(robot_at rb1 wp1)")) == [
        (3, ["- fact (robot_at rb1 wp1)"]),
        (2, ["+ goal (robot_at rb1 wp1)"]),
        (1, ["+ fact (robot_at rb1 wp1)"]),
    ]


def test_a_formula_is_an_element(depot_kb: KnowledgeBase) -> None:
    goal = Comparison(">", fuel(), number("2.50"))
    depot_kb.goals.save(goal)
    depot_kb.goals.delete(goal)
    expected = [(3, ["- goal (> (fuel t1) 2.50)"]), (2, ["+ goal (> (fuel t1) 2.50)"])]
    assert lines(depot_kb.log(element=goal)) == expected
    assert lines(depot_kb.log(element="( > (FUEL T1)\n2.5 )")) == expected


def test_times_bound_it_inclusively(told: KnowledgeBase) -> None:
    revisions = told.store.revisions()
    tick = timedelta(microseconds=1)
    for revision in revisions:
        moment = revision.committed_at
        since = [each.number for each in revisions if each.committed_at >= moment]
        until = [each.number for each in revisions if each.committed_at <= moment]
        assert numbers(told.log(since=moment)) == since[::-1]
        assert numbers(told.log(until=moment)) == until[::-1]
        assert numbers(told.log(until=moment - tick)) == list(range(since[0] - 1, 0, -1))
        assert numbers(told.log(since=moment + tick)) == list(range(10, until[-1], -1))
    assert numbers(told.log(since=datetime.min.replace(tzinfo=UTC))) == list(range(10, 0, -1))
    assert numbers(told.log(until=datetime.min.replace(tzinfo=UTC))) == []


def test_an_element_that_is_none_is_refused_at_once(told: KnowledgeBase) -> None:
    with pytest.raises(InvalidKnowledgeError):
        told.log(element="(robot_at rb1")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"actor": "Driver"}, r"by actor 'Driver' \(did you mean driver\?\)"),
        ({"actor": ""}, "by actor ''"),
        ({"element": "nobody"}, "has never had an element 'nobody'"),
        ({"element": "(robot_at rb1 wp11)"}, r"an object 'wp11' \(did you mean wp1\?\)"),
        ({"element": "(robot_att rb1 wp1)"}, r"'robot_att' \(did you mean robot_at\?\)"),
        ({"element": robot_at(RB1, WP1), "actor": "nobody"}, "by actor 'nobody'"),
    ],
)
def test_what_never_was_is_refused_with_a_similar_name(
    told: KnowledgeBase, asked: dict[str, Any], said: str
) -> None:
    for kb in (told, told.at(4)):
        entries = kb.log(**asked)
        with pytest.raises(UnknownNameError, match=said):
            next(entries)


def test_it_is_of_the_moment_when_it_was_asked_for(told: KnowledgeBase) -> None:
    entries = told.log()
    told.objects.save(waypoint(9))
    assert numbers(entries) == list(range(10, 0, -1))


@pytest.mark.usefixtures("paged")
def test_a_page_ends_with_the_revision_that_has_very_many_changes(fresh_kb: KnowledgeBase) -> None:
    for start in range(0, 40, 10):
        fresh_kb.objects.save_all(waypoint(each) for each in range(start, start + 10))
        fresh_kb.objects.save(waypoint(start + 100))
    entries = list(fresh_kb.log())
    assert numbers(iter(entries)) == list(range(8, 0, -1))
    assert [len(entry.changes) for entry in entries] == [1, 10, 1, 10, 1, 10, 1, 11]


def test_pages_are_read_as_they_are_asked_for(
    told: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kant_sql.history.log.LOG_PAGE", 2)
    entries: Iterator[LogEntry] = told.log()
    assert count(lambda: next(entries)) == 2
    assert count(lambda: next(entries)) == 0
    assert count(lambda: next(entries)) == 2
    by_actor = told.log(actor="driver")
    assert count(lambda: next(by_actor)) == 2


def test_an_element_that_changed_once_costs_no_walk_through_the_log(
    told: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kant_sql.history.log.LOG_PAGE", 1)
    assert count(lambda: list(told.log(element="wp2 - wp"))) == 3


@pytest.mark.usefixtures("paged")
def test_an_element_s_log_agrees_with_the_whole_log(told: KnowledgeBase) -> None:
    text = "(robot_at rb1 wp1)"
    for low, high in itertools.combinations_with_replacement(range(1, 11, 2), 2):
        whole = [
            (number, [line for line in of_revision if line.endswith(text)])
            for number, of_revision in lines(told.log(since=low, until=high))
        ]
        own = lines(told.log(since=low, until=high, element=text))
        assert own == [entry for entry in whole if entry[1]]


@pytest.fixture
def of_hub(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """Changes that involve the place `hub` in each way, between such that do not."""
    kb = fresh_kb
    load(kb)  # its declaration, and the value of (home t1)
    kb.propositions.save("(at t2 hub)")
    kb.propositions.save("(at t2 p1)")
    kb.goals.save("(at t1 hub)")
    kb.goals.save("(or (at t1 hub) (at t2 p2))")
    kb.goals.save("(or (at t1 p1) (at t2 p2))")
    kb.function_values.set("distance", objects=["hub", "p1"], value=3)
    kb.function_values.set("home", objects=["t1"], value="p2")
    kb.function_values.set("home", objects=["t1"], value="hub")
    for needed, effect in (("p1", "hub"), ("hub", "p1"), ("p2", "p1")):
        kb.actions.save(
            f"(:action back :parameters (?t - truck) :precondition (at ?t {needed})"
            f" :effect (at ?t {effect}))"
        )
    kb.actions.save("(:action go :parameters (?t - truck ?p - place) :effect (at ?t ?p))")
    steps = PlanStep(None, "back", ("t1",)), PlanStep(None, "go", ("t1", "hub"))
    for step in kb.plans.record(Plan(steps, "me", "found")).steps:
        kb.plans.set_status(step, status="running")
        kb.plans.set_status(step, status="succeeded")
    with kb.transaction():
        for each in range(5):
            kb.objects.save(f"q{each} - place")
            kb.propositions.save(f"(linked q{each} hub)")
    kb.propositions.delete("(at t2 hub)")
    kb.objects.delete("hub")
    return kb


def involved(
    kb: KnowledgeBase, low: int = 1, high: int | None = None
) -> list[tuple[int, list[str]]]:
    """What the whole log says of what names `hub`, as step 1 of the plan does."""
    found = []
    for revision, of_revision in lines(kb.log(since=low, until=high)):
        own = [
            line
            for line in of_revision
            if re.search(r"\bhub\b|:step 1", line) and not re.match(r". (plan|document) \(", line)
        ]
        found += [(revision, own)] if own else []
    return found


@pytest.mark.usefixtures("paged")
@pytest.mark.parametrize("most", [20_000, 3])
def test_the_log_of_an_object_has_every_change_that_involves_it(
    of_hub: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    monkeypatch.setattr(versions, "INVOLVED", most)
    monkeypatch.setattr(versions, "NEAR", 3)
    monkeypatch.setattr(versions, "WINDOW", 5)
    built = versions._versions_of_object, versions._involving
    for query in built:
        query.cache_clear()
    for element in ("HUB", PddlObjectDto(PddlTypeDto("place"), "hub")):
        assert lines(of_hub.log(element=element)) == involved(of_hub)
    for low, high in itertools.combinations_with_replacement(range(1, of_hub.revision, 4), 2):
        assert lines(of_hub.log(low, until=high, element="hub")) == involved(of_hub, low, high)
    declared = [1, of_hub.revision]
    assert numbers(of_hub.log(element="hub - place")) == declared[::-1]
    for query in built:
        query.cache_clear()


def test_it_ends_where_versions_were_moved_to_an_archive(
    shared_url: str, connect: Connect, file_url: str
) -> None:
    kb = connect(shared_url, actor="test")
    for _ in range(2):
        kb.propositions.save(robot_at())
        kb.propositions.delete(robot_at())
    kb.propositions.save(robot_at(RB1, WP2))
    kb.store.archive(3, to=file_url)
    whole: dict[str, Any]
    for whole, complete in (
        ({"until": 5}, [5, 4, 3]),
        ({"until": 5, "actor": "test"}, [5, 4, 3]),
        ({"element": robot_at()}, [4, 3]),
        ({"element": robot_at(WP1, WP2)}, []),
    ):
        assert numbers(kb.log(since=3, **whole)) == complete
        assert numbers(kb.log(limit=len(complete), **whole)) == complete
        entries = kb.log(**whole)
        assert numbers(islice(entries, len(complete))) == complete
        with pytest.raises(ArchivedError, match=r"ask the one in sqlite:///.*file\.db$"):
            next(entries)
    with pytest.raises(UnknownNameError, match="has no revision by actor 'nobody'"):
        list(kb.log(actor="nobody"))
    with pytest.raises(InvalidArgumentError, match="unpaired surrogate"):
        list(kb.log(actor="\ud800"))
    assert [each.since.number for each in kb.history(robot_at())] == [3]
    for call in (lambda: kb.diff(1, 5), lambda: kb.restore(1)):
        with pytest.raises(ArchivedError):
            call()


@pytest.mark.usefixtures("paged")
@pytest.mark.parametrize(
    "asked", [{}, {"actor": "test"}, {"element": "(robot_at rb1 wp1)"}, {"element": "rb1"}], ids=str
)
def test_its_pages_are_of_one_history_although_others_write_and_archive(
    shared_url: str, connect: Connect, file_url: str, asked: dict[str, Any]
) -> None:
    kb, other = connect(shared_url, actor="test"), connect(shared_url, actor="test")

    def move(times: int) -> None:
        for _ in range(times):
            other.propositions.save(robot_at())
            other.propositions.delete(robot_at())

    move(10)
    whole, entries = lines(kb.log(**asked)), kb.log(**asked)
    found = lines(islice(entries, 2))
    move(2)
    found += lines(islice(entries, 2))
    other.store.archive(8, to=file_url)
    move(1)
    is_refused = True
    with suppress(ArchivedError):
        for entry in entries:
            found += lines(iter([entry]))
        is_refused = False
    # A page that was read before has what is in the archive now.
    assert found == whole[: len(found)]
    assert (len(found) == len(whole)) is not is_refused


# The head, the revisions, the changes.
PAGE_STATEMENTS = 3


def write(kb: KnowledgeBase, number: int) -> None:
    """Make so many revisions more."""
    first = kb.revision
    for place in range(first, first + number):
        kb.objects.save(waypoint(1000 + place))


@pytest.fixture
def small_pages(monkeypatch: pytest.MonkeyPatch) -> int:
    """Pages of three revisions."""
    monkeypatch.setattr(following, "PAGE", 3)
    return 3


def test_revisions_come_oldest_first_with_what_they_changed(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    with kb.transaction(actor="executive", reason="navigation finished", source={"step": 3}):
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(place=WP2))
    feed = list(kb.changes())
    assert feed == list(kb.log())[::-1]
    assert numbers(feed) == [1, 2]
    assert feed[1].revision.reason == "navigation finished"
    assert [f"{sign} {kind} {text}" for sign, kind, text in feed[1].changes] == [
        "+ fact (robot_at rb1 wp2)",
        "+ object wp2 - wp",
        "- fact (robot_at rb1 wp1)",
    ]


@pytest.mark.usefixtures("small_pages")
def test_it_is_resumed_anywhere_and_limited_to_any_number(kb: KnowledgeBase) -> None:
    write(kb, 7)
    everything = [1, 2, 3, 4, 5, 6, 7]
    for after, limit in product(range(8), [None, 0, 1, 2, 3, 4, 6, 7, 8, 100]):
        assert numbers(kb.changes(after, limit=limit)) == everything[after:][:limit]


@pytest.mark.usefixtures("small_pages")
def test_it_goes_on_to_the_head_as_it_is_when_it_comes_there(kb: KnowledgeBase) -> None:
    write(kb, 2)
    feed = kb.changes()
    assert numbers(islice(feed, 1)) == [1]
    write(kb, 5)
    # The first page ended at what was the head.
    assert numbers(feed) == [2, 3, 4, 5, 6, 7]


def test_a_feed_may_begin_after_a_time(kb: KnowledgeBase) -> None:
    write(kb, 3)
    then = kb.store.revisions(limit=2)[1].committed_at
    assert numbers(kb.changes("yesterday")) == [1, 2, 3]
    assert numbers(kb.changes("now")) == [] == kb.store.revisions("now")
    assert numbers(kb.changes(then)) == [one.number for one in kb.store.revisions(then)]
    assert numbers(kb.changes(kb.at(then).revision)) == numbers(kb.changes(then))
    assert kb.watch("yesterday", timeout=0) == 3
    assert kb.watch("now", timeout=0) is None


def test_what_other_processes_write_is_seen(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    write(kb, 1)
    assert numbers(kb.changes(1)) == []
    in_processes((change, shared_url, _write_two))
    assert [(entry.revision.number, entry.revision.actor) for entry in kb.changes(1)] == [
        (2, "elsewhere"),
        (3, "elsewhere"),
    ]


def _write_two(kb: KnowledgeBase) -> None:
    write(kb, 2)


# What it costs.


def test_nothing_new_costs_one_statement(kb: KnowledgeBase) -> None:
    write(kb, 3)
    assert count(lambda: list(kb.changes(3))) == 1


def test_a_page_costs_three_statements_however_many_rows_it_has(kb: KnowledgeBase) -> None:
    for size in (1, 40):
        for each in range(size):
            robots = (PddlObjectDto(ROBOT, f"r{size}_{each}_{other}") for other in range(size))
            kb.propositions.save_all(map(robot_at, robots))
        # And the head once more, which has not moved.
        assert count(lambda: list(kb.changes())) == PAGE_STATEMENTS + 1


@pytest.mark.usefixtures("small_pages")
def test_pages_cost_three_statements_each(kb: KnowledgeBase) -> None:
    write(kb, 12)
    assert count(lambda: list(kb.changes())) == 4 * PAGE_STATEMENTS + 1
    assert count(lambda: list(islice(kb.changes(), 3))) == PAGE_STATEMENTS


def test_a_page_ends_early_when_its_revisions_changed_much(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    for each in range(6):
        kb.objects.save_all(waypoint(10 * each + other) for other in range(1 + each % 4))
    whole = list(kb.log())[::-1]
    sizes: list[int] = []

    def read_page(*arguments: Any) -> list[LogEntry]:
        page = pages.read_page(*arguments)
        sizes.append(sum(len(entry.changes) for entry in page[:-1]))
        return page

    monkeypatch.setattr(following, "read_page", read_page)
    for bound in (1, 2, 5, 9):
        monkeypatch.setattr(pages, "PAGE_CHANGES", bound)
        sizes.clear()
        assert list(kb.changes()) == whole
        assert list(kb.changes(2, limit=3)) == whole[2:5]
        assert max(sizes) <= bound


# What must never be passed over in silence.


@pytest.mark.parametrize("missing", [4, 6])
def test_a_missing_revision_is_an_error_and_no_gap(
    shared_url: str, connect: Connect, missing: int
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    write(kb, 6)
    _execute(shared_url, f"DELETE FROM revision WHERE number = {missing}")
    assert numbers(kb.changes(missing)) == [*range(missing + 1, 7)]
    with pytest.raises(StoreIntegrityError, match=f"revision {missing} is missing"):
        list(kb.changes(1))


@pytest.mark.usefixtures("small_pages")
def test_what_was_archived_is_refused_also_on_the_way(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    write(kb, 9)
    feed = kb.changes()
    assert numbers(islice(feed, 3)) == [1, 2, 3]
    _execute(
        shared_url,
        "INSERT INTO archive (kb_id, id, since, revision, target, versions, text, rest)"
        " VALUES (1, 999, 9, 5, 'sqlite:///old.db', 3, 'archive', 'x')",
    )
    _execute(shared_url, "UPDATE head SET archived_revision = 5")
    with pytest.raises(ArchivedError, match=r"up to revision 5.*sqlite:///old\.db"):
        list(feed)
    with pytest.raises(ArchivedError, match="begin after that one"):
        kb.changes(4)
    assert numbers(kb.changes(5)) == [6, 7, 8, 9]
    assert all(one + 1 == other for one, other in pairwise(numbers(kb.changes(5))))


def _execute(url: str, sql: str) -> None:
    """Change a store behind the library's back."""
    with opened(url) as store:
        if make_url(url).get_backend_name() == "sqlite":
            store.execute(sql, {})
            return
        # Citus hands on to its nodes what is set within a transaction, if the first one says so.
        settings = ("citus.propagate_set_commands = local", "session_replication_role = replica")
        for statement in ("BEGIN", *(f"SET LOCAL {each}" for each in settings), sql, "COMMIT"):
            store.execute(statement, {})


@pytest.mark.parametrize("limit", ["1", 1.5, True, -1, float("nan"), -(10**30)])
def test_a_limit_is_a_whole_number(kb: KnowledgeBase, limit: Any) -> None:
    kb.objects.save(waypoint(0))
    for call in (kb.changes, kb.store.revisions, kb.log):
        with pytest.raises(InvalidArgumentError, match="whole number from 0 on, or None for all"):
            list(call(limit=limit))


def test_a_limit_and_a_place_may_be_larger_than_any_number(kb: KnowledgeBase) -> None:
    kb.objects.save(waypoint(0))
    for call in (kb.changes, kb.store.revisions, kb.log):
        assert len(list(call(limit=10**30))) == 1
        assert list(call(limit=0)) == []
    assert kb.store.revisions(after=2**70) == []

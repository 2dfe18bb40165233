"""`kb.changes`: a feed that can be resumed, ordered and without gaps."""

from __future__ import annotations

from itertools import islice, pairwise, product
from typing import Any

import pytest
from sqlalchemy import make_url

from kant_sql import InvalidArgumentError, KnowledgeBase, PddlObjectDto
from kant_sql.errors import ArchivedError, StoreIntegrityError
from kant_sql.history import follow as following
from kant_sql.history import revisions as pages
from kant_sql.history.revisions import LogEntry
from tests.support.pages import opened
from tests.support.processes.workers import change, in_processes
from tests.support.statements import count
from tests.support.stores import Connect
from tests.support.worlds.robots import ROBOT, WP2, robot_at, waypoint

# The head, the revisions, the changes.
PAGE_STATEMENTS = 3


def write(kb: KnowledgeBase, number: int) -> None:
    """Make so many revisions more."""
    first = kb.revision
    for place in range(first, first + number):
        kb.objects.save(waypoint(1000 + place))


def numbers(entries: Any) -> list[int]:
    return [entry.revision.number for entry in entries]


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


def test_what_never_was_written_to_has_no_changes(kb: KnowledgeBase) -> None:
    assert list(kb.changes()) == []
    assert list(kb.changes(0, limit=5)) == []


def test_a_feed_may_begin_after_a_time(kb: KnowledgeBase) -> None:
    write(kb, 3)
    then = kb.store.revisions(limit=2)[1].committed_at
    assert numbers(kb.changes("yesterday")) == [1, 2, 3]
    assert numbers(kb.changes("now")) == [] == kb.store.revisions("now")
    assert numbers(kb.changes(then)) == [one.number for one in kb.store.revisions(then)]
    assert numbers(kb.changes(kb.at(then).revision)) == numbers(kb.changes(then))
    assert kb.watch("yesterday", timeout=0) == 3
    assert kb.watch("now", timeout=0) is None


def test_other_knowledge_bases_have_feeds_of_their_own(url: str, connect: Connect) -> None:
    if url == "sqlite://":
        pytest.skip("each store in memory has one knowledge base")
    one, other = connect(url, knowledge_base="one"), connect(url, knowledge_base="other")
    write(one, 2)
    write(other, 3)
    write(one, 1)
    assert numbers(one.changes()) == numbers(other.changes()) == [1, 2, 3]
    assert {change.text for entry in one.changes(2) for change in entry.changes} == {"wp1002 - wp"}


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
        for number in range(size):
            robots = (PddlObjectDto(ROBOT, f"r{size}_{number}_{other}") for other in range(size))
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
    for number in range(6):
        kb.objects.save_all(waypoint(10 * number + other) for other in range(1 + number % 4))
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


def test_a_missing_revision_is_an_error_and_no_gap(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    write(kb, 6)
    _execute(shared_url, "DELETE FROM revision WHERE number = 4")
    assert numbers(kb.changes(4)) == [5, 6]
    with pytest.raises(StoreIntegrityError, match="revision 4 is missing"):
        list(kb.changes(1))


def test_a_missing_last_revision_is_an_error(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    write(kb, 3)
    _execute(shared_url, "DELETE FROM revision WHERE number = 3")
    with pytest.raises(StoreIntegrityError, match="revision 3 is missing"):
        list(kb.changes(2))


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

"""How much a state holds, and who made a range of revisions: counted, and as counted by hand."""

from __future__ import annotations

from collections import Counter

import pytest

from kant_sql import KnowledgeBase, UnknownRevisionError
from kant_sql.history.overview import read_overview, read_tally
from kant_sql.html import ROWS
from kant_sql.knowledge_base import state_of
from tests.audit.story import record_store
from tests.support.statements import count, fill
from tests.support.stores import Connect
from tests.support.worlds.robots import BATTERY, RB1, WP1, robot_at

MOST = 3


@pytest.fixture
def story(shared_url: str, connect: Connect) -> KnowledgeBase:
    return connect(record_store(shared_url), knowledge_base="courier")


def test_each_state_holds_what_its_daos_read(story: KnowledgeBase) -> None:
    for revision in range(story.revision + 1):
        state = story.at(revision)
        facts, goals = state.propositions.get_all(), state.goals.get_propositions()
        objects, values = state.objects.get_all(), state.function_values.get_all()
        read = len(objects), len(facts), len(goals), len(values)
        assert tuple(read_overview(state_of(state))) == read, revision
    now = story.at(story.revision)
    assert read_overview(state_of(story)) == read_overview(state_of(now))


def test_what_is_pending_counts(kb: KnowledgeBase) -> None:
    assert tuple(read_overview(state_of(kb))) == (0, 0, 0, 0)
    with kb.transaction():
        kb.propositions.save(robot_at(RB1, WP1))
        kb.function_values.set(BATTERY, objects=[RB1], value=1)
        assert tuple(read_overview(state_of(kb))) == (2, 1, 0, 1)


@pytest.mark.parametrize("ends", [(None, None), (4, None), (None, 9), (8, 14), (36, 36)])
@pytest.mark.more
def test_a_range_is_tallied_as_its_log_says(
    story: KnowledgeBase, ends: tuple[int | None, int | None]
) -> None:
    since, until = ends
    entries = list(story.log(since, until=until))
    tally = read_tally(state_of(story), since, until, MOST)
    assert (tally.first, tally.last) == (entries[-1].revision.number, entries[0].revision.number)
    changes = Counter((change.kind, change.sign) for each in entries for change in each.changes)
    assert {(kind, sign): number for kind, sign, number in tally.changes} == changes
    actors = Counter(each.revision.actor for each in entries)
    assert tally.actors == len(actors)
    assert [one.revisions for one in tally.busiest] == [n for _, n in actors.most_common(MOST)]
    for one in tally.busiest:
        own = [each.revision.number for each in entries if each.revision.actor == one.actor]
        assert (one.revisions, one.first, one.last) == (len(own), min(own), max(own))


def test_a_past_state_knows_no_later_revision(story: KnowledgeBase) -> None:
    past = state_of(story.at(9))
    assert read_tally(past, None, None, MOST) == read_tally(state_of(story), None, 9, MOST)
    with pytest.raises(UnknownRevisionError):
        read_tally(past, None, 10, MOST)


def test_a_range_without_a_revision_has_nothing(kb: KnowledgeBase) -> None:
    tally = read_tally(state_of(kb), None, None, MOST)
    assert tally.last < tally.first
    assert (tally.actors, tally.busiest, tally.changes) == (0, (), ())


def test_counting_takes_as_many_statements_however_much_there_is(kb: KnowledgeBase) -> None:
    taken, state = set(), state_of(kb)
    for size in (1, 10 * ROWS):
        fill(kb, size)
        overview = count(lambda: read_overview(state))
        taken.add((overview, count(lambda: read_tally(state, None, None, MOST))))
    ((overview, tally),) = taken
    assert overview <= 2
    assert tally <= 6

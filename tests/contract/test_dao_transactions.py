"""Transactions: what they say and expect; `test_dao_programs` has what they leave behind."""

from __future__ import annotations

import pytest

from kant_sql import KnowledgeBase, PddlTypeDto, StaleRevisionError
from tests.support.reading import Undone, facts, last_changes, nothing_changes, state, undone
from tests.support.statements import recorded
from tests.support.worlds.robots import RB1, ROBOT, WP1, WP2, robot_at, waypoint

VEHICLE = PddlTypeDto("vehicle")


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with definitions and a fact."""
    with fresh_kb.transaction():
        fresh_kb.propositions.save(robot_at())
        fresh_kb.objects.save(WP2)
        fresh_kb.types.save(VEHICLE)
        fresh_kb.types.save(PddlTypeDto("car"))
    return fresh_kb


def test_the_outer_transaction_says_who_and_why(kb: KnowledgeBase) -> None:
    with kb.transaction(actor="outer", reason="because"), kb.transaction(actor="inner", source=1):
        kb.types.save(PddlTypeDto("new"))
    last = kb.store.revisions()[-1]
    assert (last.actor, last.reason, last.source) == ("outer", "because", None)


def test_a_transaction_expects_the_revision_that_its_writer_has_read(kb: KnowledgeBase) -> None:
    with kb.transaction(expected_revision=1):
        kb.propositions.delete(robot_at())
        with kb.transaction(expected_revision=1):
            kb.types.save(PddlTypeDto("new"))
        with pytest.raises(StaleRevisionError), kb.transaction(expected_revision=2):
            raise AssertionError
    assert kb.revision == 2
    for expected in (0, 1, 3):
        with nothing_changes(kb), pytest.raises(StaleRevisionError) as caught:
            kb.transaction(expected_revision=expected).__enter__()
        assert (caught.value.expected, caught.value.actual) == (expected, 2)
        assert ("another writer came first" in str(caught.value)) == (expected < 2)
    assert state(kb)["types"] == ["robot", "wp", "vehicle", "car", "new"]


def test_the_first_transaction_expects_revision_0(fresh_kb: KnowledgeBase) -> None:
    with pytest.raises(StaleRevisionError):
        fresh_kb.transaction(expected_revision=1).__enter__()
    with fresh_kb.transaction(expected_revision=0):
        fresh_kb.types.save(ROBOT)
    assert fresh_kb.revision == 1


def test_the_past_can_be_read_within_a_transaction(kb: KnowledgeBase) -> None:
    before = state(kb)
    with kb.transaction():
        kb.types.delete_all()
        assert (kb.revision, facts(kb)) == (1, [])
        assert state(kb.at(1)) == before
        assert state(kb.at(0))["types"] == []
        assert [revision.number for revision in kb.store.revisions()] == [1]
        assert [entry.revision.number for entry in kb.log()] == [1]
        kb.propositions.save(robot_at(RB1, WP1))
    assert last_changes(kb) == ["- object wp2 - wp", "- type car", "- type vehicle"]


# Within one another.


def test_an_error_that_leaves_a_nested_transaction_undoes_all_when_nobody_stops_it(
    kb: KnowledgeBase,
) -> None:
    def work() -> None:
        with kb.transaction():
            kb.propositions.save(robot_at(RB1, WP2))
            with kb.transaction():
                kb.propositions.delete(robot_at())
                raise Undone

    with nothing_changes(kb), pytest.raises(Undone):
        work()


def test_no_savepoint_outlives_its_nested_transaction(kb: KnowledgeBase) -> None:
    with recorded() as statements, kb.transaction():
        kb.objects.save(waypoint(5))
        for number in (6, 7):
            with kb.transaction():
                kb.objects.save(waypoint(number))
                state(kb)
            with undone(kb):
                kb.objects.save(waypoint(8))
                state(kb)
    made, released = (
        [sql.removeprefix(word) for sql in statements if sql.startswith(word)]
        for word in ("SAVEPOINT ", "RELEASE SAVEPOINT ")
    )
    assert made == released
    assert len(made) == 4

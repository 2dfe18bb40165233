"""Nested transactions join the outer one, and undo just their own part when they fail."""

from __future__ import annotations

import pytest

from kant_sql import KnowledgeBase, PddlTypeDto
from tests.support.reading import (
    Undone,
    facts,
    fail_within,
    last_changes,
    nothing_changes,
    state,
    undone,
    versions,
)
from tests.support.statements import recorded
from tests.support.worlds.robots import RB1, WP2, robot_at, waypoint


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with a fact and what it refers to, and another object."""
    with fresh_kb.transaction():
        fresh_kb.propositions.save(robot_at())
        fresh_kb.objects.save(WP2)
    return fresh_kb


def test_a_nested_transaction_that_fails_is_undone_alone(kb: KnowledgeBase) -> None:
    with kb.transaction():
        kb.propositions.save(robot_at(RB1, WP2))
        fail_within(kb)
        assert facts(kb) == ["(robot_at rb1 wp1)", "(robot_at rb1 wp2)"]
        fail_within(kb)
        kb.objects.save(waypoint(3))
    assert last_changes(kb) == ["+ fact (robot_at rb1 wp2)", "+ object wp3 - wp"]


@pytest.mark.parametrize("reading", range(4))
def test_nested_transactions_that_fail_level_by_level_undo_their_own_part(
    kb: KnowledgeBase, reading: int
) -> None:
    def read_at(level: int) -> None:
        if level == reading:
            state(kb)

    with kb.transaction():
        kb.propositions.save(robot_at(RB1, waypoint(3)))
        read_at(0)
        with undone(kb):
            kb.types.save(PddlTypeDto("one"))
            read_at(1)
            with undone(kb):
                kb.propositions.save(robot_at(RB1, WP2))
                read_at(2)
                with undone(kb):
                    kb.propositions.delete(robot_at())
                    read_at(3)
                kb.objects.save(waypoint(4))
            kb.types.save(PddlTypeDto("two"))
        kb.objects.save(waypoint(5))
    assert last_changes(kb) == [
        "+ fact (robot_at rb1 wp3)",
        "+ object wp3 - wp",
        "+ object wp5 - wp",
    ]
    assert state(kb)["types"] == ["robot", "wp"]
    assert facts(kb) == ["(robot_at rb1 wp1)", "(robot_at rb1 wp3)"]
    assert kb.objects.insert(waypoint(4)) is True


def test_what_a_nested_transaction_did_outlives_a_sibling_that_fails(kb: KnowledgeBase) -> None:
    with kb.transaction():
        with kb.transaction():
            kb.propositions.save(robot_at(RB1, WP2))
            state(kb)
        with undone(kb):
            kb.propositions.delete_all()
            state(kb)
        with kb.transaction():
            kb.propositions.delete(robot_at())
    assert facts(kb) == ["(robot_at rb1 wp2)"]
    assert versions(kb, "proposition") == [
        ("(robot_at rb1 wp1)", 1, 2),
        ("(robot_at rb1 wp2)", 2, None),
    ]


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

"""An empty knowledge base answers, and two in one database do not see each other."""

from __future__ import annotations

from itertools import count

import pytest

from kant_sql import KnowledgeBase, PddlTypeDto, UnknownNameError
from tests.support.parts import dao_of
from tests.support.reading import State, beside, facts, nothing_changes, state, undone
from tests.support.stores import Connect
from tests.support.worlds import robots

EMPTY: State = {
    "types": [],
    "objects": [],
    "predicates": [],
    "actions": [],
    "facts": [],
    "goals": [],
}
_numbers = count(1)


@pytest.fixture
def pair(common_url: str, connect: Connect) -> tuple[KnowledgeBase, KnowledgeBase]:
    """Two knowledge bases in one database."""
    number = next(_numbers)
    one = connect(common_url, knowledge_base=f"one {number}", actor="one")
    if common_url == "sqlite://":
        # A store in memory belongs to the one who opened it.
        return one, beside(one, f"other {number}", "other")
    return one, connect(common_url, knowledge_base=f"other {number}", actor="other")


def test_an_empty_knowledge_base_answers_every_question(fresh_kb: KnowledgeBase) -> None:
    for kb in (fresh_kb, fresh_kb.at(0)):
        assert state(kb) == EMPTY
        assert kb.types.get("robot") is None
        assert kb.objects.get("rb1") is None
        assert kb.predicates.get("robot_at") is None
        assert kb.actions.get("navigation") is None
        with pytest.raises(UnknownNameError):
            kb.propositions.get_by_predicate("robot_at")
        assert kb.revision == 0
        assert kb.store.revisions() == []
        assert list(kb.log()) == list(kb.changes()) == list(kb.changes(0, limit=5)) == []
        with pytest.raises(UnknownNameError):
            kb.history("rb1")
        assert kb.history(robots.RB1) == []
        assert kb.blame(robots.robot_at()) is None
    with fresh_kb.transaction():
        assert fresh_kb.revision == 0
    assert fresh_kb.revision == 0


def test_an_empty_knowledge_base_has_nothing_to_delete_or_update(fresh_kb: KnowledgeBase) -> None:
    with nothing_changes(fresh_kb):
        for kind, element in robots.ELEMENTS.items():
            dao = dao_of(fresh_kb, kind)
            assert dao.delete(element) is False
            assert dao.update(element) is False
            assert dao.delete_all() == 0
            assert dao.save_all([]) == 0
    with nothing_changes(fresh_kb), undone(fresh_kb):
        fresh_kb.propositions.save(robots.robot_at())


def test_knowledge_bases_do_not_see_each_other(pair: tuple[KnowledgeBase, KnowledgeBase]) -> None:
    one, other = pair
    one.propositions.save(robots.robot_at())
    one.actions.save(robots.navigation())
    assert state(other) == EMPTY
    assert other.revision == 0
    assert other.store.revisions() == []
    # The same names, with other definitions.
    other.types.save(PddlTypeDto("WP", parent=robots.ROBOT))
    other.propositions.save(robots.robot_at(robots.RB1, robots.WP2))
    assert state(other)["types"] == ["robot", "WP - robot"]
    assert facts(other) == ["(robot_at rb1 wp2)"]
    assert facts(one) == ["(robot_at rb1 wp1)"]
    with nothing_changes(other):
        assert one.types.delete_all() == 2
        assert one.propositions.delete_all() == 0
    assert state(one) == EMPTY
    assert [revision.actor for revision in one.store.revisions()] == ["one"] * 3
    assert [revision.actor for revision in other.store.revisions()] == ["other"] * 2
    entries = [*other.changes()]
    assert [entry.revision.number for entry in entries] == [1, 2]
    assert entries == [*other.log()][::-1]
    assert str(robots.robot_at()) not in str(entries)
    assert other.history(robots.robot_at()) == []
    assert facts(one.at(1)) == ["(robot_at rb1 wp1)"]


def test_deleting_in_one_knowledge_base_leaves_the_facts_of_the_other(
    pair: tuple[KnowledgeBase, KnowledgeBase],
) -> None:
    for kb in pair:
        kb.propositions.save_all([robots.robot_at(), robots.robot_at(robots.RB1, robots.WP2)])
    one, other = pair
    one.objects.delete(robots.WP1)
    one.predicates.delete(robots.robot_at().predicate)
    assert facts(one) == []
    assert facts(other) == ["(robot_at rb1 wp1)", "(robot_at rb1 wp2)"]
    one.types.delete(robots.WAYPOINT)
    assert other.propositions.delete(robots.robot_at()) is True
    assert facts(other) == ["(robot_at rb1 wp2)"]


def test_names_of_knowledge_bases_are_compared_exactly(common_url: str, connect: Connect) -> None:
    if common_url == "sqlite://":
        pytest.skip("a store in memory has one knowledge base")
    names = [f"{name} {next(_numbers)}" for name in ("Tiago", "a b", "%", "ü", "u\u0308", "🤖")]
    names += [names[0].upper(), names[0] + " "]
    for number, name in enumerate(names):
        connect(common_url, knowledge_base=name).types.save(PddlTypeDto(f"t{number}"))
    for number, name in enumerate(names):
        kb = connect(common_url, knowledge_base=name)
        assert state(kb)["types"] == [f"t{number}"]
        assert kb.revision == 1


def test_two_stores_in_memory_are_two(connect: Connect) -> None:
    one, other = connect("sqlite://"), connect("sqlite://")
    one.types.save(robots.ROBOT)
    assert one.types.get_all() == [robots.ROBOT]
    assert other.types.get_all() == []

"""What depends on a type, an object or a predicate: named where that changes, and gone with it."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from kant_sql import DependantsError, KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlTypeDto
from tests.support.parts import dao_of
from tests.support.reading import last_changes, nothing_changes, refuses, state, versions
from tests.support.worlds.robots import ROBOT, WAYPOINT

ACTION = "(:durative-action {} :parameters ({}) :duration (= ?duration 10) :effect (at end {}))"
FACTS = ["(drives t1)", "(robot_at rb1 wp1)", "(robot_at rb1 wp2)", "(raining)"]


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """Facts, goals and actions that depend on definitions, and some that do not; at revision 1."""
    with fresh_kb.transaction():
        fresh_kb.types.save(["vehicle", "car - vehicle", "taxi - car", "robot", "wp"])
        fresh_kb.objects.save(["t1 - taxi", "rb1 - robot", "wp1 - wp", "wp2 - wp"])
        fresh_kb.predicates.save(["(drives ?v0 - vehicle)", "(robot_at ?r0 - robot ?w1 - wp)"])
        fresh_kb.predicates.save("(raining)")
        fresh_kb.propositions.save(FACTS)
        fresh_kb.goals.save(FACTS[:2])
        fresh_kb.actions.save(ACTION.format("start", "?c - car", "(drives ?c)"))
        fresh_kb.actions.save(ACTION.format("go_home", "?r - robot", "(robot_at ?r wp1)"))
    return fresh_kb


class Case(NamedTuple):
    """A definition, others of its name, and what goes with each: as the log has it."""

    stored: str
    others: list[Any]
    becomes: str
    dependants: list[str]
    called: Any
    gone_besides: list[str]
    new: Any
    known: int


CASES = {
    "types": Case(
        "car - vehicle",
        [PddlTypeDto("car"), PddlTypeDto("car", parent=PddlTypeDto("toy"))],
        "car",
        ["action start", "fact (drives t1)", "goal (drives t1)"],
        PddlTypeDto("CAR"),
        ["object t1 - taxi", "type taxi - car"],
        "ship",
        5,
    ),
    "objects": Case(
        "wp1 - wp",
        [PddlObjectDto(ROBOT, "wp1")],
        "wp1 - robot",
        ["action go_home", "fact (robot_at rb1 wp1)", "goal (robot_at rb1 wp1)"],
        PddlObjectDto(PddlTypeDto("any"), "WP1"),
        [],
        "wp3 - wp",
        4,
    ),
    "predicates": Case(
        "(robot_at ?r0 - robot ?w1 - wp)",
        [PddlPredicateDto("robot_at", [WAYPOINT, ROBOT])],
        "(robot_at ?w0 - wp ?r1 - robot)",
        ["action go_home", *(f"fact {fact}" for fact in FACTS[1:3]), "goal (robot_at rb1 wp1)"],
        PddlPredicateDto("Robot_At"),
        [],
        "(snowing)",
        3,
    ),
}
EACH = pytest.mark.parametrize("kind", CASES)


def held(kb: KnowledgeBase) -> list[str]:
    """All that holds, each with its kind, as the log has it; of actions the names alone."""
    return [
        f"{kind.removesuffix('s')} {short(text)}"
        for kind, texts in state(kb).items()
        for text in texts
    ]


def short(text: str) -> str:
    return text.splitlines()[0].replace("(:durative-action ", "")


@EACH
def test_redefining_it_is_refused_with_the_list(kb: KnowledgeBase, kind: str) -> None:
    dao, case = dao_of(kb, kind), CASES[kind]
    for other in case.others:
        for call in (dao.save, dao.update, lambda dto: dao.save_all([case.new, dto])):
            caught = refuses(kb, DependantsError, call, other)
            assert isinstance(caught.value, DependantsError)
            assert [*caught.value.dependants] == case.dependants
            message, shown = str(caught.value), str(other)
            shown = shown if kind == "predicates" else repr(shown)
            assert f"{kind[:-1]} {case.stored} cannot become {shown}" in message
            assert f"{', '.join(case.dependants)} depend on it" in message
            assert "cascade=True" in message


@EACH
@pytest.mark.parametrize("method", ["save", "update"])
def test_redefining_it_with_cascade_retracts_them_in_the_same_revision(
    kb: KnowledgeBase, kind: str, method: str
) -> None:
    before, case = held(kb), CASES[kind]
    old, new = f"{kind[:-1]} {case.stored}", f"{kind[:-1]} {case.becomes}"
    assert getattr(dao_of(kb, kind), method)(case.others[0], cascade=True) is True
    assert kb.revision == 2
    left = [each for each in before if each not in case.dependants]
    assert held(kb) == [new if each == old else each for each in left]
    gone = sorted([*case.dependants, old])
    assert [*map(short, last_changes(kb))] == [f"+ {new}", *(f"- {each}" for each in gone)]
    assert {(case.stored, 1, 2), (case.becomes, 2, None)} <= {*versions(kb, kind[:-1])}


@EACH
def test_deleting_it_deletes_them_in_one_revision(kb: KnowledgeBase, kind: str) -> None:
    before, case = held(kb), CASES[kind]
    assert dao_of(kb, kind).delete(case.called) is True
    assert kb.revision == 2
    gone = sorted([*case.dependants, f"{kind[:-1]} {case.stored}", *case.gone_besides])
    assert [*map(short, last_changes(kb))] == [f"- {each}" for each in gone]
    assert held(kb) == [each for each in before if each not in gone]


LEFT = {
    "types": ("predicate (raining)", "fact (raining)"),
    "objects": ("type", "predicate", "action start", "fact (raining)"),
    "predicates": ("type", "object"),
}


@EACH
def test_deleting_all_leaves_what_needs_none(kb: KnowledgeBase, kind: str) -> None:
    before = held(kb)
    assert dao_of(kb, kind).delete_all() == CASES[kind].known
    assert kb.revision == 2
    assert held(kb) == [each for each in before if each.startswith(LEFT[kind])]
    with nothing_changes(kb):
        assert dao_of(kb, kind).delete_all() == 0

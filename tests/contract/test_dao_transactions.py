"""What many calls in one transaction leave behind: the state, the log and the very rows.

Nested transactions join the outer one, and undo just their own part when they fail.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    StaleRevisionError,
)
from tests.support.parts import dao_of
from tests.support.reading import (
    Undone,
    facts,
    fail_within,
    last_changes,
    nothing_changes,
    rows,
    state,
    undone,
    versions,
)
from tests.support.statements import recorded
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
    waypoint,
)

VEHICLE = PddlTypeDto("vehicle")
SWAPPED = PddlPredicateDto("robot_at", [WAYPOINT, ROBOT])
ELEMENTS = {
    "types": PddlTypeDto("car", parent=VEHICLE),
    "objects": PddlObjectDto(PddlTypeDto("car"), "c1"),
    "predicates": PddlPredicateDto("near", [WAYPOINT, WAYPOINT]),
    "propositions": robot_at(RB1, WP2),
    "actions": navigation(),
}
EACH = pytest.mark.parametrize("kind", ELEMENTS)
# Between two calls: nothing, or reads, which have to write first what is pending.
BETWEEN: dict[str, Callable[[KnowledgeBase], object]] = {
    "unread": lambda kb: None,
    "read": state,
    "one read": lambda kb: kb.propositions.get_by_predicate("robot_at"),
}
READS = pytest.mark.parametrize("between", BETWEEN.values(), ids=BETWEEN)


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with the definitions that the elements refer to, and a fact."""
    with fresh_kb.transaction():
        fresh_kb.propositions.save(robot_at())
        fresh_kb.objects.save(WP2)
        fresh_kb.types.save(VEHICLE)
        fresh_kb.types.save(PddlTypeDto("car"))
    return fresh_kb


def test_a_transaction_that_raises_has_not_happened(kb: KnowledgeBase) -> None:
    for between in BETWEEN.values():
        with nothing_changes(kb), undone(kb):
            kb.types.delete_all()
            between(kb)
            kb.propositions.save(robot_at(RB1, waypoint(3)))
            between(kb)


@READS
@EACH
@pytest.mark.parametrize("is_there", [False, True], ids=["asserted first", "retracted first"])
def test_what_comes_and_goes_leaves_no_version_and_no_revision(
    kb: KnowledgeBase, kind: str, between: Callable[[KnowledgeBase], object], is_there: bool
) -> None:
    dao, element, table = dao_of(kb, kind), ELEMENTS[kind], kind.removesuffix("s")
    if is_there:
        dao.save(element)
    elif kind == "types":
        dao.delete(element)
    there, back = (dao.delete, dao.insert) if is_there else (dao.insert, dao.delete)
    before, revision = versions(kb, table), kb.revision
    for _ in range(2):
        with nothing_changes(kb), kb.transaction():
            assert there(element) is True
            between(kb)
            assert back(element) is True
            between(kb)
            assert back(element) is False
        assert versions(kb, table) == before
    assert back(element) is False
    assert there(element) is True
    assert (element in dao.get_all()) is not is_there
    assert kb.revision == revision + 1
    assert back(element) is True
    assert (element in dao.get_all()) is is_there


@READS
def test_the_same_beside_another_change_leaves_no_trace_of_it_either(
    kb: KnowledgeBase, between: Callable[[KnowledgeBase], object]
) -> None:
    with kb.transaction():
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(RB1, WP2))
        between(kb)
        kb.propositions.save(robot_at())
        kb.propositions.delete(robot_at(RB1, WP2))
        between(kb)
        kb.goals.save(robot_at(is_goal=True))
    assert last_changes(kb) == ["+ goal (robot_at rb1 wp1)"]
    assert versions(kb, "proposition") == [
        ("(robot_at rb1 wp1)", 1, None),
        ("goal (robot_at rb1 wp1)", 2, None),
    ]
    assert kb.propositions.insert(robot_at()) is False
    assert kb.propositions.insert(robot_at(RB1, WP2)) is True


def join(kb: KnowledgeBase) -> None:
    """A nested transaction that changes nothing in the end."""
    with kb.transaction():
        place = PddlObjectDto(PddlTypeDto("place"), "p1")
        kb.propositions.save(PddlPropositionDto(PddlPredicateDto("free", [place.type]), [place]))
        assert [str(fact) for fact in kb.propositions.get_by_predicate("free")] == ["(free p1)"]
        kb.types.delete(place.type)


NESTED = {**BETWEEN, "failing": fail_within, "joining": join}


@pytest.mark.parametrize("between", NESTED.values(), ids=NESTED)
def test_deleting_and_re_creating_with_another_definition_is_one_change_of_definition(
    kb: KnowledgeBase, between: Callable[[KnowledgeBase], object]
) -> None:
    kb.actions.save(navigation())
    with kb.transaction():
        assert kb.predicates.delete(ROBOT_AT) is True
        between(kb)
        assert kb.predicates.get("robot_at") is None
        assert kb.predicates.insert(PddlPredicateDto("ROBOT_AT", [ROBOT])) is True
        between(kb)
        assert kb.predicates.delete(ROBOT_AT) is True
        between(kb)
        assert kb.predicates.insert(SWAPPED) is True
        between(kb)
    assert last_changes(kb) == [
        "+ predicate (robot_at ?w0 - wp ?r1 - robot)",
        f"- action {navigation()}",
        "- fact (robot_at rb1 wp1)",
        "- predicate (robot_at ?r0 - robot ?w1 - wp)",
    ]
    assert versions(kb, "predicate") == [
        ("(robot_at ?r0 - robot ?w1 - wp)", 1, 3),
        ("(robot_at ?w0 - wp ?r1 - robot)", 3, None),
    ]
    parameters = "SELECT since, position, name FROM predicate_parameter WHERE kb_id = :kb"
    assert sorted(rows(kb, parameters)) == [(1, 0, "r0"), (1, 1, "w1"), (3, 0, "w0"), (3, 1, "r1")]
    assert versions(kb, "proposition") == [("(robot_at rb1 wp1)", 1, 3)]
    assert versions(kb, "action") == [(str(navigation()), 2, 3)]
    assert state(kb)["predicates"] == ["(robot_at ?w0 - wp ?r1 - robot)"]


@pytest.mark.parametrize("between", NESTED.values(), ids=NESTED)
def test_redefining_there_and_back_changes_nothing(
    kb: KnowledgeBase, between: Callable[[KnowledgeBase], object]
) -> None:
    kb.actions.save(navigation())
    before = {kind: versions(kb, kind) for kind in ("type", "object", "predicate", "action")}
    with nothing_changes(kb), kb.transaction():
        kb.types.save(PddlTypeDto("robot", parent=VEHICLE), cascade=True)
        between(kb)
        kb.objects.save(PddlObjectDto(WAYPOINT, "rb1"))
        between(kb)
        kb.predicates.save(SWAPPED)
        between(kb)
        kb.types.save(ROBOT)
        kb.predicates.save(ROBOT_AT)
        between(kb)
        kb.objects.save(RB1)
        kb.propositions.save(robot_at())
        kb.actions.save(navigation())
        between(kb)
    assert {kind: versions(kb, kind) for kind in before} == before
    assert versions(kb, "proposition") == [("(robot_at rb1 wp1)", 1, None)]
    assert kb.propositions.insert(robot_at()) is False
    assert kb.propositions.delete(robot_at()) is True


def test_an_action_is_redefined_in_one_transaction_as_often_as_one_likes(kb: KnowledgeBase) -> None:
    with kb.transaction():
        for duration in range(5):
            kb.actions.save(PddlActionDto("navigation", duration=duration))
            assert kb.actions.get("navigation") is not None
        kb.actions.save(navigation())
        kb.actions.get_all()
    assert versions(kb, "action") == [(str(navigation()), 2, None)]
    nodes = "SELECT section, operator FROM action_node WHERE kb_id = :kb"
    assert len(rows(kb, nodes)) == 3 + 3 + 6
    assert [str(action) for action in kb.at(2).actions.get_all()] == [str(navigation())]


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
    assert state(kb)["types"] == ["robot", "wp", "vehicle", "car", "new"]


def test_the_first_transaction_expects_revision_0(fresh_kb: KnowledgeBase) -> None:
    with pytest.raises(StaleRevisionError):
        fresh_kb.transaction(expected_revision=1).__enter__()
    with fresh_kb.transaction(expected_revision=0):
        fresh_kb.types.save(ROBOT)
    assert fresh_kb.revision == 1


def test_a_transaction_object_that_ended_badly_leaves_the_next_one_free(kb: KnowledgeBase) -> None:
    for _ in range(3):
        with undone(kb), undone(kb):
            kb.propositions.delete(robot_at())
            state(kb)
    assert kb.propositions.delete(robot_at()) is True
    assert kb.propositions.insert(robot_at(RB1, WP1)) is True
    assert facts(kb) == ["(robot_at rb1 wp1)"]


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
    assert state(kb)["types"] == ["robot", "wp", "vehicle", "car"]
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

"""When a condition held: the periods, with who began and ended them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import pytest

from kant_sql import (
    Held,
    InvalidArgumentError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlError,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    UnknownRevisionError,
    aio,
)
from kant_sql.errors import ArchivedError
from tests.contract.test_reasoning_rules import (
    AT,
    CHILD,
    HALL,
    KITCHEN,
    RB1,
    RB2,
    ROBOT,
    ROOM,
    at,
    child,
    step,
)
from tests.support.reading import present, undone
from tests.support.statements import count, recorded
from tests.support.stores import Connect
from tests.support.worlds.depot import DOMAIN


@pytest.fixture
def day(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """Revision 1: rb1 in the hall; 2: rb2 in the kitchen; 3: a child there, too; and so on."""
    kb = fresh_kb
    step(kb, "installer", ("+", at(RB1, HALL)))
    step(kb, "installer", ("+", at(RB2, KITCHEN)))
    step(kb, "camera", ("+", child(KITCHEN)))
    step(kb, "driver", ("-", at(RB2, KITCHEN)), ("+", at(RB2, HALL)))
    step(kb, "driver", ("-", at(RB1, HALL)), ("+", at(RB1, KITCHEN)))
    step(kb, "camera", ("-", child(KITCHEN)), ("+", child(HALL)))
    step(kb, "camera", ("-", child(HALL)), ("+", child(KITCHEN)))
    return kb


def numbers(periods: Any) -> list[tuple[Any, ...]]:
    """The objects of each period, and the numbers of its ends."""
    return [
        (
            *held.binding.values(),
            None if held.since is None else held.since.number,
            None if held.until is None else held.until.number,
        )
        for held in periods
    ]


# Conjunctions of atoms.


def test_a_fact_held_from_one_revision_until_another(day: KnowledgeBase) -> None:
    [held] = day.when("(robot_at rb2 kitchen)")
    assert isinstance(held, Held)
    assert held.binding == {}
    since, until = present(held.since), present(held.until)
    assert (since.number, since.said()) == (2, ["installer", "installer did it"])
    assert (until.number, until.actor) == (4, "driver")
    assert [held.since, held.until] == [day.store.revisions(n - 1, limit=1)[0] for n in (2, 4)]
    assert since.committed_at.utcoffset() is not None


def test_a_conjunction_is_where_all_its_atoms_held(day: KnowledgeBase) -> None:
    both = "(and (robot_at rb1 kitchen) (child_in kitchen))"
    assert numbers(day.when(both)) == [(5, 6), (7, None)]
    assert numbers(day.when("(and (robot_at rb2 kitchen) (child_in kitchen))")) == [(3, 4)]
    assert numbers(day.when("(and (robot_at rb1 hall) (robot_at rb1 kitchen))")) == []


def test_free_variables_are_columns(day: KnowledgeBase) -> None:
    periods = day.when("(and (robot_at ?r ?w) (child_in ?w))")
    assert periods.columns == ("r", "w")
    assert numbers(periods) == [
        ("rb2", "kitchen", 3, 4),
        ("rb1", "kitchen", 5, 6),
        ("rb2", "hall", 6, 7),
        ("rb1", "kitchen", 7, None),
    ]
    assert periods[0].binding == {"r": "rb2", "w": "kitchen"}
    # In the order in which the objects were declared, where they begin together.
    step(day, "driver", ("+", at(RB2, KITCHEN)), ("+", child(HALL)))
    assert numbers(day.when("(robot_at ?r kitchen)", since=8)) == [
        ("rb1", None, None),
        ("rb2", 8, None),
    ]


def test_a_variable_that_occurs_twice_is_one_object(day: KnowledgeBase) -> None:
    near = PddlPredicateDto("near", [ROOM, ROOM])
    day.propositions.save_all(
        PddlPropositionDto(near, pair) for pair in ([HALL, KITCHEN], [HALL, HALL])
    )
    assert numbers(day.when("(near ?x ?x)")) == [("hall", 8, None)]
    assert numbers(day.when("(and (near ?x ?y) (child_in ?y))")) == [("hall", "kitchen", 8, None)]


def test_bindings_and_types(day: KnowledgeBase) -> None:
    text = "(robot_at ?r ?w)"
    assert numbers(day.when(text, r="rb2")) == [("kitchen", 2, 4), ("hall", 4, None)]
    assert numbers(day.when(text, r=RB2, w="KITCHEN")) == [(2, 4)]
    typed = day.when(text, parameters="(?w - room ?r - robot)")
    assert typed.columns == ("w", "r")
    assert numbers(typed)[0] == ("hall", "rb1", 1, 5)
    assert numbers(day.when(text, parameters="(?w - room ?r - robot)", w=HALL)) == [
        ("rb1", 1, 5),
        ("rb2", 4, None),
    ]
    given: Any
    for given in ({"x": "rb1"}, {"r": 3}):
        with pytest.raises(InvalidArgumentError, match=r"no free variable \?x|is not an object"):
            day.when(text, **given)
    with pytest.raises(InvalidKnowledgeError):
        day.when(text, r="hall")


def test_a_goal_is_no_fact(day: KnowledgeBase) -> None:
    day.goals.save(PddlPropositionDto(AT, [RB1, HALL], True))
    assert numbers(day.when("(robot_at rb1 hall)")) == [(1, 5)]
    assert numbers(day.when("(not (robot_at rb1 hall))")) == [(5, None)]


# Ranges.


def test_a_range_cuts_periods_off(day: KnowledgeBase) -> None:
    conjunction, other = "(and (robot_at rb1 ?w) (child_in kitchen))", "(not (child_in hall))"
    quantified = "(and (exists (?r - robot) (robot_at ?r ?w)) (not (child_in ?w)))"
    for low in range(1, day.revision + 1):
        for high in range(low, day.revision + 1):
            for text in (conjunction, other, quantified, "(robot_at ?r ?w)"):
                whole = numbers(day.when(text, until=high))
                cut = [
                    (*row[:-2], row[-2] if row[-2] and row[-2] >= low else None, row[-1])
                    for row in whole
                    if row[-1] is None or row[-1] > low
                ]
                found = numbers(day.when(text, since=low, until=high))
                assert sorted(found, key=str) == sorted(cut, key=str), (text, low, high)


def test_times_name_a_range(day: KnowledgeBase) -> None:
    times = [revision.committed_at for revision in day.store.revisions()]
    found = day.when("(robot_at rb2 ?w)", since=times[2], until=times[3])
    assert numbers(found)[-1][0] == "hall"
    with pytest.raises(UnknownRevisionError):
        day.when("(robot_at rb2 ?w)", since=99)
    with pytest.raises(UnknownRevisionError, match="zone"):
        day.when("(robot_at rb2 ?w)", until=datetime(2024, 1, 1))


def test_a_past_state_knows_nothing_later(day: KnowledgeBase) -> None:
    past = day.at(5)
    assert numbers(past.when("(child_in ?w)")) == [("kitchen", 3, None)]
    assert numbers(past.when("(not (child_in hall))")) == [(3, None)]
    assert numbers(day.at(3).when("(robot_at rb1 kitchen)")) == []


def test_only_what_was_committed_counts(day: KnowledgeBase) -> None:
    before = numbers(day.when("(robot_at ?r ?w)"))
    with undone(day):
        day.propositions.delete(at(RB1, KITCHEN))
        assert numbers(day.when("(robot_at ?r ?w)")) == before
    with day.transaction():
        day.propositions.delete(at(RB1, KITCHEN))
        assert numbers(day.when("(not (robot_at rb1 kitchen))", since=7)) == []


def test_nothing_was_ever_written(fresh_kb: KnowledgeBase) -> None:
    with pytest.raises(PddlError):
        fresh_kb.when("(robot_at rb1 hall)")
    assert numbers(fresh_kb.when("(and)")) == []


# Any other condition.


def test_other_conditions_are_swept(day: KnowledgeBase) -> None:
    found: dict[str, list[tuple[int, int | None]]] = {
        "(or (child_in hall) (robot_at rb1 hall))": [(3, 5), (6, 7)],
        "(exists (?r - robot) (and (robot_at ?r kitchen) (child_in kitchen)))": [
            (3, 4),
            (5, 6),
            (7, None),
        ],
        "(forall (?r - robot) (robot_at ?r hall))": [(1, 2), (4, 5)],
        "(imply (child_in kitchen) (not (robot_at rb1 kitchen)))": [(3, 5), (6, 7)],
        "(and (robot_at rb1 hall) (not (= rb1 rb2)))": [(2, 5)],
    }
    for text, periods in found.items():
        # `child_in` is defined from revision 3 on.
        since = 3 if "child" in text else 1
        wanted = [(max(a, since), b) for a, b in periods if b is None or b > since]
        assert numbers(day.when(text)) == wanted, text


def test_a_variable_under_a_negation_ranges_over_its_type(day: KnowledgeBase) -> None:
    assert numbers(day.when("(not (child_in ?w))")) == [
        ("hall", 3, 6),
        ("kitchen", 6, 7),
        ("hall", 7, None),
    ]
    cellar = PddlObjectDto(ROOM, "cellar")
    day.objects.save(cellar)
    assert numbers(day.when("(not (child_in ?w))"))[-1] == ("cellar", 8, None)
    assert numbers(day.when("(not (robot_at rb1 ?w))", since=8)) == [
        ("hall", None, None),
        ("cellar", 8, None),
    ]


def test_numbers_and_object_fluents(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    kb.load_domain(DOMAIN)
    kb.load_problem(
        "(define (problem p) (:domain depot) (:objects t1 t2 - truck p1 - place) (:init))"
    )
    for truck, value in (("t1", 5), ("t2", 7), ("t1", 2), ("t1", 2.5), ("t2", 1), ("t1", 9)):
        kb.function_values.set("fuel", objects=[truck], value=value)
    kb.function_values.set("home", objects=["t1"], value="hub")
    kb.function_values.unset("fuel", objects=["t1"])
    assert numbers(kb.when("(< (fuel t1) 3)")) == [(5, 8)]
    assert numbers(kb.when("(not (< (fuel t1) 3))")) == [(2, 5), (8, None)]
    assert numbers(kb.when("(< (fuel t1) (fuel t2))")) == [(4, 7)]
    assert numbers(kb.when("(> (fuel ?t) 4)")) == [("t1", 3, 5), ("t2", 4, 7), ("t1", 8, 10)]
    assert numbers(kb.when("(= (home ?t) hub)")) == [("t1", 9, None)]
    assert numbers(kb.when("(> (+ (fuel t1) 1) (* 2 (fuel t2)))")) == [(7, 10)]


def test_derived_predicates_follow_their_rules(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    domain = """(define (domain d) (:requirements :derived-predicates :typing) (:types room)
      (:predicates (door ?a ?b - room) (path ?a ?b - room))
      (:derived (path ?a ?b - room)
        (or (door ?a ?b) (exists (?c - room) (and (door ?a ?c) (path ?c ?b))))))"""
    kb.load_domain(domain)
    kb.load_problem("(define (problem p) (:domain d) (:objects a b c - room) (:init (door a b)))")
    kb.propositions.save("(door b c)")
    kb.propositions.delete("(door b c)")
    assert numbers(kb.when("(path a c)")) == [(3, 4)]
    assert numbers(kb.when("(path a ?x)")) == [("b", 2, None), ("c", 3, 4)]
    # Other rules from revision 5 on.
    kb.load_domain(domain.replace("(or (door ?a ?b) ", "(or (door ?b ?a) "))
    assert numbers(kb.when("(path b a)")) == [(5, None)]
    assert numbers(kb.when("(path a b)")) == [(2, 5)]


def test_definitions_are_those_of_each_revision(day: KnowledgeBase) -> None:
    """A type, an object and a predicate that are defined otherwise for a time."""
    text, typed = "(not (child_in kitchen))", "(robot_at ?x ?w)"
    day.predicates.delete(CHILD)
    assert numbers(day.when(text)) == [(6, 7)]
    day.predicates.save(PddlPredicateDto("child_in", [ROBOT]))
    assert numbers(day.when(text)) == [(6, 7)]
    day.predicates.save(PddlPredicateDto("child_in", [ROOM]))
    assert numbers(day.when(text)) == [(6, 7), (10, None)]
    day.objects.delete(KITCHEN)
    assert numbers(day.when(text)) == [(6, 7), (10, 11)]
    # rb2 is a machine that is not a robot any more.
    machine = PddlTypeDto("machine")
    day.objects.save(PddlObjectDto(machine, "rb2"), cascade=True)
    day.types.save(PddlTypeDto("robot", parent=machine), cascade=True)
    thing = "(?x - machine ?w - room)"
    assert ("rb2", "hall", 4, 12) in numbers(day.when(typed))
    with_types = numbers(day.when(typed, parameters=thing))
    # At revision 13, robots are machines, but none is in a room.
    assert with_types == []


def test_a_name_that_is_gone_still_has_a_past(day: KnowledgeBase) -> None:
    day.objects.delete(RB2)
    assert numbers(day.when("(robot_at rb2 kitchen)")) == [(2, 4)]
    assert numbers(day.when("(not (robot_at rb2 kitchen))")) == [(4, 8)]
    day.types.delete_all()
    assert numbers(day.when("(and (robot_at ?r kitchen) (child_in kitchen))")) == [
        ("rb2", 3, 4),
        ("rb1", 5, 6),
        ("rb1", 7, 9),
    ]


def test_objects_that_never_coexisted_are_asked_about_together(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    step(kb, "installer", ("+", at(RB1, HALL)))
    kb.objects.delete(RB1)
    step(kb, "installer", ("+", at(RB2, HALL)))
    step(kb, "driver", ("-", at(RB2, HALL)), ("+", at(RB2, KITCHEN)))
    first, second = "(robot_at rb1 hall)", "(robot_at rb2 hall)"
    assert numbers(kb.when(f"(or {first} {second})")) == [(1, 2), (3, 4)]
    assert numbers(kb.when(f"(or {first} {second})", since=2)) == [(3, 4)]
    assert numbers(kb.when(f"(or {first} (or {second} (robot_at rb2 kitchen)))")) == [
        (1, 2),
        (3, None),
    ]
    both = "(or (robot_at rb1 ?w) (robot_at rb2 ?w))"
    assert numbers(kb.when(both)) == [("hall", 1, 2), ("hall", 3, 4), ("kitchen", 4, None)]
    assert numbers(kb.when(both, w="hall")) == [(1, 2), (3, 4)]
    for text in (f"(or {first} (robot_at rb3 hall))", f"(or {first} {second} (robot_at rb2 ?w))"):
        with pytest.raises(InvalidKnowledgeError):
            kb.when(text)


def test_a_name_that_never_was_is_refused(day: KnowledgeBase) -> None:
    for text, word in (
        ("(robot_ta rb1 hall)", "robot_at"),
        ("(robot_at rb1 hal)", "hall"),
        ("(not (child_in kitchn))", "kitchen"),
    ):
        with pytest.raises(PddlError, match=word):
            day.when(text)
    for text in (
        "(robot_at rb1)",
        "(robot_at hall rb1)",
        "(robot_at rb1 hall",
        "(always (child_in hall))",
    ):
        with pytest.raises(PddlError):
            day.when(text)
    anything: Any = day
    with pytest.raises(InvalidKnowledgeError, match="not a formula"):
        anything.when(3)


# The sequence.


def test_it_is_a_sequence(day: KnowledgeBase) -> None:
    periods = day.when("(robot_at ?r ?w)")
    assert len(periods) == 4
    assert periods[-1] == list(periods)[3]
    assert list(periods[1:3]) == list(periods)[1:3]
    with pytest.raises(IndexError, match="4 periods"):
        periods[4]
    [first, *_] = periods.to_dicts()
    assert {key: first[key] for key in ("?r", "?w", "since", "until", "since_actor")} == {
        "?r": "rb1",
        "?w": "hall",
        "since": 1,
        "until": 5,
        "since_actor": "installer",
    }
    assert str(periods).splitlines()[0].startswith("rb1 hall: 1 (")
    assert "until the end" in str(periods)
    assert str(day.when("(robot_at rb1 ?w)", until=1)).count("\n") == 0
    assert str(day.when("(and (child_in hall) (child_in kitchen))")) == "at no time"


@pytest.mark.more
def test_many_periods_are_read_in_pages(fresh_kb: KnowledgeBase) -> None:
    kb, on = fresh_kb, PddlPropositionDto(PddlPredicateDto("on"), [])
    for _ in range(225):
        kb.propositions.save(on)
        kb.propositions.delete(on)
    periods = kb.when("(on)")
    assert numbers(periods) == [(n, n + 1) for n in range(1, 450, 2)]
    assert numbers(periods[200:202]) == [(401, 402), (403, 404)]
    assert numbers(kb.when("(not (on))")) == [(n, n + 1) for n in range(2, 450, 2)] + [(450, None)]


# Cost.


def test_a_conjunction_takes_as_many_statements_however_long_the_past(day: KnowledgeBase) -> None:
    def join() -> None:
        list(day.when("(and (robot_at ?r ?w) (child_in ?w) (child_in kitchen))"))

    def sweep() -> None:
        list(day.when("(and (robot_at ?r ?w) (not (child_in ?w)))"))

    join()
    joined, swept = count(join), count(sweep)
    assert joined <= 8
    assert swept <= 16
    for _ in range(30):
        step(day, "driver", ("-", at(RB1, KITCHEN)), ("+", at(RB1, HALL)))
        step(day, "driver", ("+", at(RB1, KITCHEN)), ("-", at(RB1, HALL)))
    assert count(join) == joined
    assert count(sweep) == swept


def test_definitions_that_matter_as_now_are_not_read_again(day: KnowledgeBase) -> None:
    def reads() -> int:
        with recorded() as statements:
            assert numbers(day.when("(not (child_in kitchen))", since=4, until=9)) == [(6, 7)]
        return sum("action_version" in sql for sql in statements)

    day.objects.save("elsewhere - room")
    day.objects.save("nowhere - room")
    reads()
    assert reads() == 0
    # A type may be another for all that is mentioned.
    day.types.save("door")
    reads()
    assert reads() == 1


def test_an_archived_past_is_refused(shared_url: str, file_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    step(kb, "a", ("+", at(RB1, HALL)), ("+", child(HALL)))
    step(kb, "b", ("-", at(RB1, HALL)), ("+", at(RB1, KITCHEN)))
    step(kb, "c", ("-", at(RB1, KITCHEN)), ("+", at(RB1, HALL)))
    step(kb, "d", ("-", child(HALL)))
    kb.store.archive(4, to=file_url)
    for text in ("(robot_at rb1 hall)", "(not (robot_at rb1 hall))"):
        for since in (None, 1, 2):
            with pytest.raises(ArchivedError, match=r"file\.db"):
                kb.when(text, since=since)
    assert numbers(kb.when("(robot_at rb1 ?w)", since=3)) == [("hall", 3, None)]
    assert numbers(kb.when("(not (robot_at rb1 kitchen))", since=3)) == [(None, None)]
    assert numbers(kb.when("(not (child_in hall))", since=3)) == [(4, None)]


async def test_the_asynchronous_front_door_has_the_same_periods_and_verdicts(url: str) -> None:
    async with aio.connect(url, knowledge_base="tiago", actor="test") as kb:
        await kb.propositions.save(at(RB1, HALL))
        await kb.propositions.delete(at(RB1, HALL))
        found = [held async for held in kb.when("(robot_at ?r hall)")]
        assert numbers(found) == [("rb1", 1, 2)]
        verdicts = await kb.pddl.check_rules("(always (not (robot_at rb1 hall)))")
        assert [one.revision and one.revision.number for one in verdicts] == [1]

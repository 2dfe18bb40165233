"""Facts are confirmed: part of the history and its hashes, never a change of the state."""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kant_sql
from kant_sql import KnowledgeBase, Version, errors
from tests.support.archives import damage
from tests.support.reading import last_changes, loaded, nothing_changes, present, undone
from tests.support.statements import count, recorded

DOMAIN = """
(define (domain shelf) (:requirements :typing) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (clean ?p - place))
  (:action move :parameters (?r - robot ?a ?b - place) :precondition (at ?r ?a)
    :effect (and (not (at ?r ?a)) (at ?r ?b)))
  (:action sweep :parameters (?p - place) :effect (clean ?p)))
"""
PROBLEM = """
(define (problem day) (:domain shelf) (:objects rb1 rb2 - robot hall room - place)
  (:init (at rb1 hall) (at rb2 hall)) (:goal (at rb1 room)))
"""
AT_ROOM, AT_HALL = "(at rb1 room)", "(at rb1 hall)"


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base in which a robot has moved."""
    loaded(fresh_kb, DOMAIN, PROBLEM)
    apply(fresh_kb, "(move rb1 hall room)")
    return fresh_kb


def apply(kb: KnowledgeBase, step: str, actor: str = "executive") -> None:
    with kb.transaction(actor=actor):
        kb.apply(step)


def confirm(kb: KnowledgeBase, *facts: str, actor: str = "camera", **given: Any) -> int:
    with kb.transaction(actor=actor):
        return kb.propositions.confirm(facts, **given)


def test_a_confirmation_is_a_revision_and_no_change_of_the_state(kb: KnowledgeBase) -> None:
    before = kb.revision
    state = {*map(str, kb.propositions.get_all())}
    assert confirm(kb, AT_ROOM) == 1
    assert last_changes(kb) == [f"+ confirmation {AT_ROOM}"]
    assert kb.revision == before + 1
    assert {*map(str, kb.propositions.get_all())} == state
    assert kb.diff(before, kb.revision) == []
    assert kb.store.verify().is_intact


def test_what_does_not_hold_cannot_be_confirmed(kb: KnowledgeBase) -> None:
    with nothing_changes(kb):
        for facts in ([AT_HALL], [AT_ROOM, AT_HALL], ["(clean hall)"]):
            with pytest.raises(errors.InvalidKnowledgeError, match=r"does not hold.*save"):
                kb.propositions.confirm(facts)
        for wrong in (-1, True, "soon", float("nan")):
            with pytest.raises(errors.InvalidArgumentError, match="not_within"):
                kb.propositions.confirm(AT_ROOM, not_within=wrong)  # type: ignore[arg-type]
        for odd in (3, None, b"(at rb1 room)", [3]):
            with pytest.raises(errors.InvalidKnowledgeError, match="a fact"):
                kb.propositions.confirm(odd)  # type: ignore[arg-type]
        with pytest.raises(errors.ReadOnlyError):
            kb.at(kb.revision).propositions.confirm(AT_ROOM)


def test_repeated_ones_by_one_actor_write_nothing(kb: KnowledgeBase) -> None:
    assert confirm(kb, AT_ROOM, not_within=60) == 1
    with nothing_changes(kb):
        assert confirm(kb, AT_ROOM, not_within=60) == 0
    assert confirm(kb, AT_ROOM, "(at rb2 hall)", not_within=1e300) == 1
    assert confirm(kb, AT_ROOM, actor="lidar", not_within=60) == 1
    assert confirm(kb, AT_ROOM, not_within=0) == 1
    assert confirm(kb, AT_ROOM) == 1


def test_what_has_no_confirmations_is_refused_for_what_it_is(kb: KnowledgeBase) -> None:
    kb.functions.save("(battery ?r - robot) - number")
    kb.function_values.save("(= (battery rb1) 5)")
    with nothing_changes(kb):
        for value in ("(battery rb1)", "(= (battery rb1) 5)"):
            with pytest.raises(errors.InvalidKnowledgeError, match="values have no confirmations"):
                confirm(kb, value)
        with pytest.raises(errors.PddlError):
            confirm(kb, "(batery rb1)")
    kb.pddl.derived_predicates.save(
        "(:derived (clean ?p - place) (exists (?r - robot) (at ?r ?p)))"
    )
    with pytest.raises(errors.InvalidKnowledgeError, match=r"\(clean room\) .* rules derive it"):
        confirm(kb, "(clean room)")


def test_what_came_back_is_confirmed_however_soon(kb: KnowledgeBase) -> None:
    assert confirm(kb, AT_ROOM, not_within=60) == 1
    kb.propositions.delete(AT_ROOM)
    kb.propositions.save(AT_ROOM)
    assert confirm(kb, AT_ROOM, not_within=60) == 1
    assert confirm(kb, AT_ROOM, not_within=60) == 0


def test_a_transaction_confirms_what_it_saves_again(kb: KnowledgeBase) -> None:
    with kb.transaction(actor="camera", confirm=True):
        kb.propositions.save_all([AT_ROOM, "(at rb2 hall)", "(clean hall)"])
        kb.propositions.save([AT_ROOM, "(clean hall)"])
        with kb.transaction():
            kb.propositions.save(AT_ROOM)
    assert last_changes(kb) == [
        f"+ confirmation {AT_ROOM}",
        "+ confirmation (at rb2 hall)",
        "+ fact (clean hall)",
    ]
    with nothing_changes(kb), kb.transaction():
        kb.propositions.save(AT_ROOM)
    with kb.transaction():
        with kb.transaction(confirm=True):
            kb.propositions.save(AT_ROOM)
        kb.propositions.save("(at rb2 hall)")
    assert last_changes(kb) == [f"+ confirmation {AT_ROOM}"]
    assert kb.store.verify().is_intact


def test_a_scope_that_fails_takes_its_confirmations_back(kb: KnowledgeBase) -> None:
    with kb.transaction():
        kb.propositions.confirm("(at rb2 hall)")
        with undone(kb):
            kb.propositions.confirm(AT_ROOM)
            # What is pending is written for it.
            kb.query("(at rb1 ?p)")
        assert kb.propositions.confirm("(at rb2 hall)") == 0
    assert last_changes(kb) == ["+ confirmation (at rb2 hall)"]


def test_one_may_be_confirmed_and_then_retracted(kb: KnowledgeBase) -> None:
    with kb.transaction(actor="camera"):
        kb.propositions.confirm(AT_ROOM)
        kb.propositions.delete(AT_ROOM)
        kb.propositions.save("(clean room)")
        assert kb.propositions.confirm("(clean room)") == 0
    assert last_changes(kb)[0] == f"+ confirmation {AT_ROOM}"
    assert kb.store.verify().is_intact


def test_the_statements_are_few_however_many_facts(kb: KnowledgeBase) -> None:
    robot = kant_sql.PddlTypeDto("robot")
    kb.objects.save_all([kant_sql.PddlObjectDto(robot, f"r{n}") for n in range(240)])
    facts = [f"(at r{n} hall)" for n in range(240)]
    kb.propositions.save_all(facts)
    for within in (None, 60):
        few, *many = (
            count(partial(kb.propositions.confirm, some, not_within=within))
            for some in (facts[:2], facts[:60], facts)
        )
        # PostgreSQL writes a few rows of several tables in one statement.
        assert few in (many[0], many[0] - 1)
        assert many[0] == many[1]


def texts(found: list[Version]) -> list[str]:
    return [each.text for each in found]


def test_what_an_act_asserts_is_expected_until_another_confirms_it(kb: KnowledgeBase) -> None:
    [fact] = kb.unconfirmed()
    [done] = kb.executions.get_all()
    assert (fact.text, fact.acts, fact.confirmed) == (AT_ROOM, (done.id,), None)
    assert (fact.since.actor, fact.since.number) == ("executive", done.revision)
    confirm(kb, AT_ROOM, actor="executive")
    assert texts(kb.unconfirmed()) == [AT_ROOM]
    confirm(kb, AT_ROOM)
    assert kb.unconfirmed() == []
    assert texts(kb.at(kb.revision - 1).unconfirmed()) == [AT_ROOM]
    # The next time that it is asserted it is expected again.
    apply(kb, "(move rb1 room hall)")
    apply(kb, "(move rb1 hall room)")
    assert texts(kb.unconfirmed()) == [AT_ROOM]
    assert texts(kb.at(kb.revision - 1).unconfirmed()) == [AT_HALL]


def test_effects_of_steps_that_were_named_and_of_none(kb: KnowledgeBase) -> None:
    confirm(kb, AT_ROOM)
    running = kb.executions.report("mop", outcome="running")
    with kb.transaction(execution=running, actor="executive"):
        kb.propositions.save("(clean hall)")
    kb.propositions.save("(clean room)")
    with kb.transaction():
        kb.executions.report(running, outcome="failed")
        kb.propositions.save("(at rb2 room)")
    [fact] = kb.unconfirmed()
    assert (fact.text, fact.acts) == ("(clean hall)", (running.id,))


def test_the_oldest_come_first_and_the_young_are_left_out(kb: KnowledgeBase) -> None:
    apply(kb, "(sweep hall)")
    apply(kb, "(sweep room)")
    found = kb.unconfirmed()
    assert texts(found) == [AT_ROOM, "(clean hall)", "(clean room)"]
    assert texts(kb.unconfirmed(limit=2)) == texts(found)[:2]
    assert kb.unconfirmed(older_than=3600) == []
    assert texts(kb.unconfirmed(older_than=0)) == texts(found)
    # A past state is as old as it was then.
    assert kb.at(found[1].since.number).unconfirmed(older_than=3600) == []
    with pytest.raises(errors.InvalidArgumentError, match="older_than is a number of s"):
        kb.unconfirmed(older_than=-1)


def test_what_somebody_retracted_unseen_is_contradicted(kb: KnowledgeBase) -> None:
    apply(kb, "(sweep hall)")
    confirm(kb, "(clean hall)")
    first = kb.revision
    with kb.transaction(actor="lidar"):
        kb.propositions.delete_all([AT_ROOM, "(clean hall)"])
    [wrong] = kb.contradicted()
    assert (wrong.text, wrong.until and wrong.until.actor) == (AT_ROOM, "lidar")
    assert kb.executions.get(wrong.acts[0]) is not None
    assert kb.at(first).contradicted() == []
    assert kb.contradicted(until=first) == []
    # What the executive itself or another act ends was no mistake.
    for step, actor in (("(move rb2 hall room)", "executive"), ("(move rb2 room hall)", "other")):
        apply(kb, step, actor)
    with kb.transaction(actor="other"):
        kb.propositions.delete("(at rb2 hall)")
    assert texts(kb.contradicted()) == [AT_ROOM]
    assert texts(kb.contradicted(limit=1, since=first + 1)) == [AT_ROOM]


def test_stale_facts_of_a_condition(kb: KnowledgeBase) -> None:
    apply(kb, "(sweep room)")
    condition = "(and (AT ?R ?p) (not (clean hall)) (clean ?p) (not (= ?r rb2)))"
    assert texts(kb.stale(condition, than=0)) == [AT_ROOM, "(clean room)"]
    assert kb.stale(condition, than=60) == []
    assert kb.stale("(clean hall)", than=0) == []
    assert texts(kb.at(kb.revision - 1).stale("(at rb1 ?p)", than=0)) == [AT_ROOM]
    for wrong in ("(exists (?p - place) (clean ?p))", "(or (clean hall) (clean room))"):
        with pytest.raises(errors.UnsupportedConstructError, match="conjunction"):
            kb.stale(wrong, than=1)
    with pytest.raises(errors.InvalidArgumentError, match="than is a number of seconds, from 0"):
        kb.stale("(clean hall)", than=-1)


def test_blame_and_history_say_who_confirmed_last(kb: KnowledgeBase) -> None:
    assert (found := kb.blame(AT_ROOM)) is not None
    assert found.confirmed is None
    confirm(kb, AT_ROOM)
    confirm(kb, AT_ROOM, actor="lidar")
    for now in (present(kb.blame(AT_ROOM)), kb.history(AT_ROOM)[-1]):
        assert now.acts == found.acts
        assert now.confirmed == kb.store.revisions()[-1]
    assert (then := kb.at(kb.revision - 1).blame(AT_ROOM)) is not None
    assert present(then.confirmed).actor == "camera"


def test_blame_of_a_value_names_its_act(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(
        "(define (domain pump) (:requirements :fluents) (:functions (level))"
        " (:action fill :parameters () :effect (increase (level) 5)))"
    )
    fresh_kb.function_values.set("(level)", value=1)
    fresh_kb.apply("(fill)")
    now = present(fresh_kb.blame("(= (level) 6)"))
    [done] = fresh_kb.executions.get_all()
    assert (now.acts, now.confirmed) == ((done.id,), None)
    [before, after] = fresh_kb.history("(level)")
    assert (before.acts, after.acts) == ((), now.acts)


@given(st.lists(st.tuples(st.sampled_from(["move", "confirm", "retract", "save"]), st.booleans())))
@settings(max_examples=25, deadline=None)
def test_expected_facts_as_a_model_has_them(steps: list[tuple[str, bool]]) -> None:
    """What is expected follows from the last assertion, and from what came after."""
    expected: dict[str, bool] = {}
    with kant_sql.connect("sqlite://", knowledge_base="model", actor="executive") as kb:
        loaded(kb, DOMAIN, PROBLEM)
        for what, is_first in steps:
            place = "hall" if is_first else "room"
            fact = f"(clean {place})"
            if what == "move":
                kb.apply(f"(sweep {place})")
                expected.setdefault(fact, True)
            elif what == "confirm" and fact in expected:
                confirm(kb, fact)
                expected[fact] = False
            elif what == "retract":
                kb.propositions.delete(fact)
                expected.pop(fact, None)
            elif what == "save":
                kb.propositions.save(fact)
                expected.setdefault(fact, False)
        assert {*texts(kb.unconfirmed())} == {fact for fact, is_so in expected.items() if is_so}
        assert kb.store.verify().is_intact


def test_the_statements_do_not_grow_with_the_rows(kb: KnowledgeBase) -> None:
    def counts() -> list[int]:
        ask = partial(kb.stale, "(at ?r ?p)", than=0)
        calls = (kb.unconfirmed, kb.contradicted, ask, partial(kb.blame, AT_ROOM))
        return [count(call) for call in calls]

    def contradict(*places: str) -> None:
        for place in places:
            apply(kb, f"(sweep {place})")
            with kb.transaction(actor="camera"):
                kb.propositions.delete(f"(clean {place})")

    contradict("hall")
    counts()
    before = counts()
    contradict("hall", "room")
    apply(kb, "(move rb2 hall room)")
    assert counts() == before


SAVED = ["revision", "proposition", "proposition_argument", "proposition_version", "head"]
CHANGED = ["revision", "proposition_version", "head"]
WRITTEN: dict[str, tuple[Callable[[KnowledgeBase], Any], int, list[str]]] = {
    "a new fact": (lambda kb: kb.propositions.save("(clean hall)"), 2, SAVED),
    "one that holds": (lambda kb: kb.propositions.save(AT_ROOM), 1, []),
    "several": (lambda kb: kb.propositions.save_all([AT_ROOM, "(clean room)"]), 2, SAVED),
    "a deletion": (lambda kb: kb.propositions.delete(AT_ROOM), 1, CHANGED),
    "an act": (
        lambda kb: kb.apply("(move rb1 room hall)"),
        2,
        [
            *CHANGED,
            *["proposition_version", "execution", "execution_argument", "execution_version"],
        ],
    ),
}


@pytest.mark.parametrize("what", WRITTEN)
def test_nothing_of_it_is_on_the_way_of_who_does_not_use_it(kb: KnowledgeBase, what: str) -> None:
    call, reads, written = WRITTEN[what]
    with recorded() as found:
        call(kb)
    # A server inserts into several tables by one statement.
    tables = [re.findall(r"(?:INSERT INTO|COPY|^UPDATE) (\w+)", sql) for sql in found]
    assert sorted(name for names in tables for name in names) == sorted(written)
    assert sum(not names for names in tables) == reads


def test_confirmations_are_changes_that_can_be_followed(kb: KnowledgeBase) -> None:
    before = kb.revision
    confirm(kb, AT_ROOM, "(at rb2 hall)")
    assert kb.watch(before, timeout=0) == before + 1
    [entry] = kb.changes(before)
    assert (entry.revision.number, entry.revision.actor) == (before + 1, "camera")
    expected = {("+", "confirmation", AT_ROOM), ("+", "confirmation", "(at rb2 hall)")}
    assert {(one.sign, one.kind, one.text) for one in entry.changes} == expected
    confirm(kb, AT_ROOM, not_within=60)
    assert kb.watch(before + 1, timeout=0) is None


def test_writers_at_once_of_one_actor_confirm_once(kb: KnowledgeBase) -> None:
    with ThreadPoolExecutor(4) as pool:
        made = [pool.submit(confirm, kb, AT_ROOM, not_within=60) for _ in range(8)]
        assert sum(one.result() for one in made) == 1
    assert confirm(kb, AT_ROOM, actor="Kämera 📷", not_within=60) == 1
    assert confirm(kb, AT_ROOM, actor="Kämera 📷", not_within=60) == 0
    assert kb.store.verify().is_intact


def test_verification_finds_which_fact_was_confirmed(file_url: str) -> None:
    with kant_sql.connect(file_url, knowledge_base="shelf") as kb:
        loaded(kb, DOMAIN, PROBLEM)
        kb.propositions.save_all([AT_ROOM, "(clean hall)"])
        confirm(kb, AT_ROOM)
        apply(kb, "(sweep room)")
        assert kb.store.verify().is_intact
    # Only its kind tells a goal from a fact: the text is the same.
    for which in ("text = '(at rb2 hall)'", "text = '(at rb1 room)' AND is_goal"):
        one = f"(SELECT id FROM proposition WHERE {which})"
        damage(file_url, f"UPDATE confirmation SET proposition_id = {one}")
        with kant_sql.connect(file_url, knowledge_base="shelf") as kb:
            assert not kb.store.verify(structure=False).is_intact


def test_replicas_archives_branches_and_restored_states(kb: KnowledgeBase, tmp_path: Path) -> None:
    name = kb.store.factory.name
    replica, archive = (f"sqlite:///{tmp_path / each}.db" for each in ("replica", "archive"))
    confirm(kb, AT_ROOM)
    kb.store.push(replica)
    confirm(kb, AT_ROOM, "(at rb2 hall)")
    apply(kb, "(move rb2 hall room)")
    kb.objects.delete("rb2")
    kb.store.push(replica)
    kb.store.archive(kb.revision, to=archive)
    for url in (replica, archive):
        with kant_sql.connect(url, knowledge_base=name) as other:
            assert other.store.verify().is_intact
            assert confirmed(other) == confirmed(kb)
    assert len(confirmed(kb)) == 3
    assert kb.store.verify().is_intact
    before = kb.revision
    kb.propositions.delete(AT_ROOM)
    kb.restore(before)
    assert kb.holds(AT_ROOM)
    assert len(confirmed(kb)) == 3
    with kb.branch() as branch:
        assert confirmed(branch) == []


def confirmed(kb: KnowledgeBase) -> list[tuple[int, str]]:
    rows = kb.store.to_arrow("confirmation").to_pylist()
    return [(row["revision"], row["text"]) for row in rows]

"""What notebooks show of a knowledge base and of what it answers, on every backend."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import Any

import pytest
from sqlalchemy import make_url

from kant_sql import KnowledgeBase, Plan, PlanStep, aio
from kant_sql.html import ROWS
from tests.support.notebooks import check_harmless
from tests.support.servers import Server
from tests.support.statements import count, fact, fill, recorded
from tests.support.stores import Connect
from tests.support.worlds.hostile import KNOWLEDGE_BASE, NAMES, record_hostile
from tests.support.worlds.robots import RB1, navigation, robot_at, waypoint

# Statements that each of them takes at most; what a read found costs nothing to show.
SHOWN: dict[str, tuple[int, Callable[[KnowledgeBase], Any]]] = {
    "knowledge base": (4, lambda kb: kb),
    "past state": (5, lambda kb: kb.at(1)),
    "log": (4, lambda kb: kb.log()),
    "log of an element": (5, lambda kb: kb.log(element="rb1")),
    "changes": (4, lambda kb: kb.changes()),
    "revisions": (0, lambda kb: kb.store.revisions()),
    "revision": (0, lambda kb: kb.store.revisions()[0]),
    "log entry": (0, lambda kb: next(kb.log())),
    "difference": (0, lambda kb: kb.diff(0, kb.revision)),
    "difference of two": (0, lambda kb: kb.diff(kb, kb.at(1))),
    "change": (0, lambda kb: kb.diff(0, kb.revision)[0]),
    "history": (0, lambda kb: kb.history("rb1")),
    "version": (0, lambda kb: kb.history("rb1")[0]),
    "plans": (0, lambda kb: kb.plans.get_all()),
    "plan": (0, lambda kb: kb.plans.get_all()[0]),
    "plan's step": (0, lambda kb: kb.plans.get_all()[0].steps[0]),
    "answers": (1, lambda kb: kb.query("(robot_at ?r ?w)")),
    "answer": (1, lambda kb: kb.query("(robot_at rb1 wp0)")),
    "periods": (2, lambda kb: kb.when("(robot_at ?r ?w)")),
    "period": (0, lambda kb: kb.when("(robot_at ?r ?w)")[0]),
    "verdicts": (0, lambda kb: kb.pddl.check_rules("(always (not (robot_at rb1 wp1)))")),
    "verdict": (0, lambda kb: kb.pddl.check_rules("(always (not (robot_at rb1 wp1)))")[0]),
    "verification": (0, lambda kb: kb.store.verify(structure=False)),
    "anchor": (0, lambda kb: kb.store.anchor()),
    "statistics": (0, lambda kb: kb.statistics()),
    "validation": (0, lambda kb: kb.validate(kb.plans.get_all()[0])),
}


def shown(value: object) -> str:
    made = value._repr_html_()  # type: ignore[attr-defined]
    assert isinstance(made, str)
    check_harmless(made)
    return made


def told(kb: KnowledgeBase, size: int) -> KnowledgeBase:
    """Give a knowledge base so many facts, an act, and a plan."""
    fill(kb, size)
    kb.executions.report("dock", outcome="failed", code="E4")
    kb.actions.save(navigation())
    kb.objects.save(waypoint(0))
    kb.plans.record(Plan((PlanStep(None, "navigation", ("rb1", "wp0", "wp1")),), "hand", "found"))
    return kb


@pytest.mark.parametrize("size", [3, 300])
def test_showing_takes_as_many_statements_however_much_there_is(
    fresh_kb: KnowledgeBase, size: int
) -> None:
    kb = told(fresh_kb, size)
    taken = {name: count(partial(shown, make(kb))) for name, (_, make) in SHOWN.items()}
    assert {name: most for name, most in taken.items() if most > SHOWN[name][0]} == {}


def test_a_knowledge_base_shows_what_it_holds_and_who_changed_it_last(kb: KnowledgeBase) -> None:
    assert "revision</th>" in shown(kb)
    fill(kb, 7)
    with kb.transaction(actor="perception", reason="saw it"):
        kb.propositions.delete(fact(1))
    made = shown(kb)
    cells = ("tiago", "facts", ">6<", "goals", ">4<", "perception", "saw it", "test")
    assert [cell for cell in cells if cell not in made] == []
    past = shown(kb.at(kb.revision - 1))
    assert ">7<" in past
    assert "saw it" not in past


def test_a_log_is_shown_without_being_consumed(kb: KnowledgeBase) -> None:
    for number in range(ROWS + 5):
        kb.propositions.save(robot_at(RB1, waypoint(number)))
    head = kb.revision
    log, changes = kb.log(), kb.changes()
    assert next(log).revision.number == head
    assert next(changes).revision.number == 1
    for feed in (log, changes):
        made = shown(feed)
        assert iter(feed) is feed
        assert "and more" in made
        assert made.count("<tr>") == ROWS + 1
    assert f">{head}<" in shown(log)
    assert [each.revision.number for each in islice(log, 2)] == [head - 1, head - 2]
    assert next(changes).revision.number == 2


def test_a_limited_log_shows_no_more_than_its_limit(kb: KnowledgeBase) -> None:
    fill(kb, 3)
    for feed in (kb.log(limit=1), kb.changes(limit=1)):
        assert "1 revision<" in shown(feed)
        assert len([*feed]) == 1


def test_a_closed_knowledge_base_says_so(url: str, connect: Connect) -> None:
    kb = connect(url)
    fill(kb, 3)
    log = kb.log()
    kb.close()
    assert repr(kb).endswith(", closed>")
    for value in (kb, log):
        assert "was closed" in shown(value)


def test_no_password_is_shown(server: Server, connect: Connect) -> None:
    url = f"{server.new_store()}&application_name=shown"
    secret = make_url(url).set(username="postgres", password="s3cret")
    kb = connect(secret.render_as_string(hide_password=False), knowledge_base="tiago")
    for text in (repr(kb), shown(kb), repr(kb.at(0)), shown(kb.at(0))):
        assert "tiago" in text
        assert "***" in text
        assert "s3cret" not in text


def test_hostile_texts_are_data(shared_url: str, connect: Connect) -> None:
    kb = connect(record_hostile(shared_url), knowledge_base=KNOWLEDGE_BASE)
    fact, name = NAMES[3], NAMES[0]
    plans = kb.plans.get_all()
    values: list[Any] = [
        *(kb, kb.at(3), kb.log(), kb.changes(), *kb.log(), kb.store.revisions()),
        *(kb.diff(0, kb.revision), kb.diff(kb, kb.at(0)), kb.history(name)),
        *(kb.history(f"({fact} {name})"), plans, *plans, *plans[0].steps),
        *(kb.query(f"({fact} ?x)"), kb.when(f"({fact} ?x)"), *kb.when(f"({fact} ?x)")),
        *(kb.pddl.check_rules(), kb.store.verify(structure=False), kb.store.anchor()),
        kb.validate(plans[0]),
    ]
    for value in values:
        shown(value)


async def test_the_asynchronous_front_door_says_which_it_is() -> None:
    async with aio.connect("sqlite://", knowledge_base="tiago") as kb:
        assert repr(kb) == "<AsyncKnowledgeBase 'tiago' of sqlite://>"
        assert repr(await kb.at(0)) == "<AsyncKnowledgeBase 'tiago' of sqlite:// at revision 0>"
        # It would have to read, and a notebook does not wait for a coroutine.
        assert not hasattr(kb, "_repr_html_")


def test_repr_of_a_knowledge_base_reads_nothing(kb: KnowledgeBase) -> None:
    with recorded() as statements:
        text = repr(kb)
    assert text.startswith("<KnowledgeBase 'tiago' of ")
    assert statements == []


def test_lists_of_elements_failures_and_steps_are_tables(kb: KnowledgeBase) -> None:
    kb.load_domain(
        "(define (domain d) (:types wp) (:predicates (at ?w - wp)) (:functions (fuel ?w - wp))"
        " (:action go :parameters (?w - wp) :precondition (not (at ?w)) :effect (at ?w)))"
    )
    kb.load_problem(
        "(define (problem p) (:domain d) (:objects a b - wp)"
        " (:init (at a) (= (fuel a) 2)) (:goal (at b)))"
    )
    shown = {
        "(at a)": kb.propositions.get_all(),
        "(at b)": kb.goals.get_propositions(),
        "b - wp": kb.objects.get_all(),
        "(= (fuel a) 2)": kb.function_values.get_all(),
        "(:action go": kb.actions.get_all(),
        "(not (at a))": kb.why_not("(go a)"),
        "(go b)": kb.applicable_actions(),
        "does not hold": kb.unsatisfied(),
    }
    for text, found in shown.items():
        made = found._repr_html_()  # type: ignore[attr-defined]
        check_harmless(made)
        assert "<table" in made
        assert text in made
    steps = kb.applicable_actions(limit=1)
    assert "1 step<" in steps._repr_html_()  # type: ignore[attr-defined]
    assert [str(step) for step in steps] == ["(go b)"]
    assert kb.why_not("(go b)") == []

"""The paper's services, without ROS: messages say what the elements say, as far as they can."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from math import ceil
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kant_sql
from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.compat import DaoFactory
from kant_sql.errors import InvalidArgumentError, InvalidKnowledgeError
from kant_sql.knowledge_base import factory_of
from kant_sql.ros import paper
from kant_sql.ros.paper import _read, _write
from tests.ros import messages
from tests.ros.messages import Client, Kinds
from tests.support.profile import PROFILE, hunting

SAVE, DELETE = ({"update_konwledge": messages.message(update_type=number)} for number in (0, 1))
DOMAIN = """(define (domain ward)
  (:requirements :typing :durative-actions :fluents :disjunctive-preconditions)
  (:types robot human - agent place - object)
  (:predicates (at ?w - (either robot human) ?p - place) (open ?p - place))
  (:functions (battery ?r - robot))
  (:durative-action wait :parameters (?p - place) :duration (= ?duration 2.5)
    :condition (at start (open ?p)) :effect (at end (not (open ?p))))
  (:durative-action rest :parameters (?p - place) :duration (<= ?duration 5)
    :condition (at start (open ?p)) :effect (at end (not (open ?p))))
  (:action enter :parameters (?r - robot ?p - place) :precondition (or (open ?p) (at ?r ?p))
    :effect (at ?r ?p))
  (:action charge :parameters (?r - robot) :precondition () :effect (assign (battery ?r) 100)))
"""

texts = st.text(min_size=1, max_size=6)
types = st.builds(PddlTypeDto, texts) | st.builds(
    kant_sql.PddlEitherTypeDto,
    st.lists(st.builds(PddlTypeDto, st.text("abä1-", min_size=1)), min_size=2, max_size=3),
)
objects = st.builds(PddlObjectDto, types, texts)
several = st.lists(objects, max_size=3)
predicates = st.builds(PddlPredicateDto, texts, st.lists(types, max_size=3))
times = st.sampled_from([None, "at start", "over all", "at end"])
literals = st.lists(
    st.builds(PddlConditionEffectDto, predicates, several, times, st.booleans()), max_size=3
)
durations = st.floats(-1e9, 1e9) | st.integers(-(2**31) + 1, 2**31 - 1) | st.decimals(-1000, 1000)
actions = st.builds(
    PddlActionDto, texts, several, literals, literals, st.booleans(), duration=durations
)
propositions = st.builds(PddlPropositionDto, predicates, several, st.booleans())


@hunting(PROFILE.texts)
@given(types | objects | predicates | propositions | actions)
def test_what_is_written_is_read_again(dto: Any) -> None:
    kind = type(dto).__name__.removeprefix("Pddl").removeprefix("Either").removesuffix("Dto")
    found = _read(kind, _write(messages, kind, dto))
    if isinstance(dto, PddlActionDto):
        dto.duration = ceil(dto.duration) if dto.durative else 0  # type: ignore[arg-type]
    assert repr(found) == repr(dto)


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with kant_sql.connect("sqlite://") as kb:
        yield kb


@pytest.fixture
def client(kb: KnowledgeBase) -> Client:
    services = paper.services(DaoFactory.of(factory_of(kb)), messages, Kinds(), object)
    return Client(list(services))


def lines(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Take what was logged."""
    found = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    caplog.clear()
    return found


def test_fifteen_services_save_answer_and_delete(kb: KnowledgeBase, client: Client) -> None:
    assert len(client) == 15
    robot, place = PddlTypeDto("robot"), PddlTypeDto("place")
    rb1, hall = PddlObjectDto(robot, "rb1"), PddlObjectDto(place, "hall")
    goal = PddlPropositionDto(PddlPredicateDto("seen", [robot, place]), [rb1, hall], is_goal=True)
    sent = _write(messages, "Proposition", goal)
    assert client("update_proposition", pddl_proposition=sent, **SAVE).success
    for get_type, count in ((paper.ALL, 1), (paper.GOALS, 1), (paper.NO_GOALS, 0)):
        found = client("get_propositions", get_type=get_type).pddl_propositions
        assert [_read("Proposition", each) for each in found] == [goal] * count
    [found] = client("get_propositions", get_type=4, predicate_name="SEEN").pddl_propositions
    assert found == sent
    assert client("get_propositions", get_type=4, predicate_name="").pddl_propositions == []
    assert [each.name for each in client("get_types", type_name="").pddl_types] == [
        "place",
        "robot",
    ]
    assert client("get_types", type_name="(").pddl_types == []
    assert client("update_object", pddl_object=sent.objects[0], **DELETE).success
    assert not client("update_object", pddl_object=sent.objects[0], **DELETE).success
    client("delete_all_propositions")
    client("delete_all_types")
    assert kb.predicates.get_all() == []


def test_what_is_no_request_is_refused_with_a_reason(
    client: Client, caplog: pytest.LogCaptureFixture
) -> None:
    nameless = messages.message(name="")
    assert not client("update_type", pddl_type=nameless, **SAVE).success
    assert "cannot name a type: it is empty" in "".join(lines(caplog))
    seven = messages.message(update_type=7)
    with pytest.raises(InvalidArgumentError, match="update_type is 7"):
        client("update_type", pddl_type=nameless, update_konwledge=seven)
    with pytest.raises(InvalidArgumentError, match="get_type is 0"):
        client("get_propositions", get_type=0)


def test_what_a_message_cannot_hold_is_rounded_or_left_out_and_logged(
    kb: KnowledgeBase, client: Client, caplog: pytest.LogCaptureFixture
) -> None:
    kb.load_domain(DOMAIN)
    [wait] = client("get_actions", action_name="").pddl_actions
    assert (wait.name, wait.duration, wait.coditions[0].time) == ("wait", 3, "at start")
    said = lines(caplog)
    assert sorted(line.split(":")[0] for line in said) == [
        "action charge is left out of an answer",
        "action enter is left out of an answer",
        "action rest is left out of an answer",
        "the duration of action wait, 2.5, is sent as 3",
    ]
    assert any("it has (or (open ?p) (at ?r ?p))" in line for line in said)
    # What is written back as it was read keeps its duration, and what is changed changes.
    for sent, stored in ((3, "2.5"), (4, "4")):
        wait.duration = sent
        assert client("update_action", pddl_action=wait, **SAVE).success
        assert f"(= ?duration {stored})" in str(kb.actions.get("wait"))
    rest = messages.message(**{**vars(wait), "name": "rest"})
    assert client("update_action", pddl_action=rest, **SAVE).success
    wait.coditions[0].time = ""
    assert not client("update_action", pddl_action=wait, **SAVE).success
    assert "time" in "".join(lines(caplog))


def test_either_is_read_and_a_goal_that_is_a_formula_is_left_out(
    kb: KnowledgeBase, client: Client, caplog: pytest.LogCaptureFixture
) -> None:
    kb.load_domain(DOMAIN)
    [at] = client("get_predicates", predicate_name="at").pddl_predicates
    assert [each.name for each in at.types] == ["(either robot human)", "place"]
    names = ("ana", "human"), ("hall", "place")
    given = [messages.message(name=one, type=messages.message(name=type_)) for one, type_ in names]
    fact = messages.message(predicate=at, objects=given, is_goal=False)
    assert client("update_proposition", pddl_proposition=fact, **SAVE).success
    kb.goals.save("(or (at ana hall) (open hall))")
    assert lines(caplog) == []
    [found] = client("get_propositions", get_type=paper.ALL).pddl_propositions
    assert found == fact
    [line] = lines(caplog)
    assert line.endswith("as goals are left out: (or (at ana hall) (open hall))")


def test_a_duration_beyond_the_message_s_numbers_is_refused() -> None:
    with pytest.raises(InvalidKnowledgeError, match="does not fit into its message"):
        _write(messages, "Action", PddlActionDto("wait", duration=2**31 - 0.5))

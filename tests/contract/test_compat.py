"""A program for the original library runs with its imports and its URI changed, nothing else."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from kant_sql import InvalidUrlError
from kant_sql.compat import DaoFactory, DaoFactoryMethod, DaoFamilies
from kant_sql.dto.actions import PddlActionDto, PddlConditionEffectDto
from kant_sql.dto.elements import (
    Dto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    assigned,
    literals,
    navigation,
    robot_at,
)

NAVIGATION = str(navigation())


@pytest.fixture
def factory(common_url: str) -> Iterator[DaoFactory]:
    """A factory on a store with nothing in it any more: its programs have one knowledge base."""
    made = DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, uri=common_url)
    for dao, _ in daos(made).values():
        dao.delete_all()
    yield made
    made._factory.close()


class ExampleNode:
    """A node as the original's programs have one: it makes the factory, the DAOs and the DTOs."""

    def __init__(self, uri: str, family: int) -> None:
        self.factory = DaoFactoryMethod().create_dao_factory(family, uri=uri, node=self)
        self.types = self.factory.create_pddl_type_dao()
        self.objects = self.factory.create_pddl_object_dao()
        self.predicates = self.factory.create_pddl_predicate_dao()
        self.propositions = self.factory.create_pddl_proposition_dao()
        self.actions = self.factory.create_pddl_action_dao()

    def load(self) -> None:
        """Save the world of the paper's walk: everything is saved by what refers to it."""
        robot, wp = PddlTypeDto("robot"), PddlTypeDto("wp")
        at = PddlPredicateDto("robot_at", [robot, wp])
        rb1, wp1, wp2 = (
            PddlObjectDto(robot, "rb1"),
            PddlObjectDto(wp, "wp1"),
            PddlObjectDto(wp, "wp2"),
        )
        r, s, d = PddlObjectDto(robot, "r"), PddlObjectDto(wp, "s"), PddlObjectDto(wp, "d")
        literal = PddlConditionEffectDto
        leaves = literal(at, [r, s], time=literal.AT_START, is_negative=True)
        action = PddlActionDto("navigation", [r, s, d])
        action.set_conditions([literal(at, [r, s], time=literal.AT_START)])
        action.set_effects([leaves, literal(at, [r, d], time=literal.AT_END)])
        goal = PddlPropositionDto(at, [rb1])
        goal.get_objects().append(wp2)
        goal.set_is_goal(True)
        assert self.objects.save(rb1)
        assert self.propositions.save(PddlPropositionDto(at, [rb1, wp1]))
        assert self.propositions.save(goal)
        assert self.actions.save(action)

    def walk(self) -> None:
        """Reach the goal: read it, replace the fact, and take the goal back."""
        (goal,) = self.propositions.get_goals()
        (fact,) = self.propositions.get_no_goals()
        assert self.propositions.delete(fact)
        reached = PddlPropositionDto(goal.get_predicate(), goal.get_objects(), is_goal=False)
        assert self.propositions.save(reached)
        assert self.propositions.delete(goal)

    def reset(self) -> None:
        for dao in (self.propositions, self.actions, self.objects, self.predicates, self.types):
            assert dao.delete_all() is True


@pytest.mark.parametrize("family", [*DaoFamilies, 1], ids=repr)
def test_the_originals_demo_program_runs(common_url: str, family: int) -> None:
    node = ExampleNode(common_url, family)
    node.reset()
    node.load()
    assert sorted(map(str, node.types.get_all())) == ["robot", "wp"]
    assert sorted(map(str, node.objects.get_all())) == ["rb1 - robot", "wp1 - wp", "wp2 - wp"]
    assert [str(dto) for dto in node.predicates.get_all()] == ["(robot_at ?r0 - robot ?w1 - wp)"]
    assert [str(dto) for dto in node.actions.get_all()] == [NAVIGATION]
    node.walk()
    assert [str(dto) for dto in node.propositions.get_all()] == ["(robot_at rb1 wp2)"]
    assert node.propositions.get_goals() == []
    (fact,) = node.propositions.get_by_predicate("robot_at")
    assert fact.get_is_goal() is False
    assert fact.get_objects()[1].get_name() == "wp2"
    assert fact.get_objects()[1].get_type().get_name() == "wp"
    node.reset()
    assert node.types.get("robot") is None
    assert node.propositions.get_all() == []
    node.factory._factory.close()


def test_the_families_have_the_originals_numbers() -> None:
    assert [(family.name, int(family)) for family in DaoFamilies] == [
        ("ROS2", 0),
        ("MONGO", 1),
        ("SQL", 2),
    ]
    assert DaoFactoryMethod().dao_families is DaoFamilies


def test_all_dtos_are_of_one_class() -> None:
    for dto in (ROBOT, RB1, ROBOT_AT, robot_at(), navigation(), navigation().effects[0]):
        assert isinstance(dto, Dto)


def daos(factory: DaoFactory) -> dict[str, tuple[Any, Dto]]:
    return {
        "type": (factory.create_pddl_type_dao(), ROBOT),
        "object": (factory.create_pddl_object_dao(), RB1),
        "predicate": (factory.create_pddl_predicate_dao(), ROBOT_AT),
        "proposition": (factory.create_pddl_proposition_dao(), robot_at()),
        "action": (factory.create_pddl_action_dao(), navigation()),
    }


@pytest.mark.parametrize("kind", ["type", "object", "predicate", "proposition", "action"])
def test_each_dao_answers_as_the_originals_does(
    factory: DaoFactory, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    dao, dto = daos(factory)[kind]
    assert dao.get_all() == []
    assert dao._update(dto) is False
    assert dao._save(dto) is True
    assert dao._save(dto) is False
    assert dao._update(dto) is True
    assert dao.save(dto) is True
    assert dao.get_all() == [dto]
    if kind != "proposition":
        assert dao.get(dto.get_name()) == dto  # type: ignore[attr-defined]
        assert dao.get("unknown") is None
    assert dao.delete(dto) is True
    assert dao.delete(dto) is False
    assert dao.save(dto) is True
    assert dao.delete_all() is True
    assert dao.get_all() == []
    assert dao.delete_all() is True
    # What is there already, or is not, is no fault: it is answered, not logged.
    assert caplog.records == []


def changed(change: Callable[[PddlActionDto], object]) -> PddlActionDto:
    action = navigation()
    change(action)
    return action


ILL_TYPED: dict[str, list[tuple[Any, str]]] = {
    "type": [(PddlTypeDto("two words"), "two words"), (None, "PddlTypeDto")],
    "object": [(PddlObjectDto(ROBOT, ""), "empty"), (ROBOT, "PddlObjectDto")],
    "predicate": [
        (PddlPredicateDto("robot_at", [WAYPOINT]), "depend on it"),
        (PddlPredicateDto("not", [WAYPOINT]), "reserved"),
    ],
    "proposition": [
        (PddlPropositionDto(ROBOT_AT, [WP1, RB1]), "argument 1"),
        (PddlPropositionDto(ROBOT_AT, [RB1]), "1 arguments, expected 2"),
        (PddlPropositionDto(ROBOT_AT, [RB1, PddlObjectDto(ROBOT, "wp1")]), "is stored as"),
        (assigned(PddlPropositionDto(ROBOT_AT, [RB1, WP1]), predicate=None), "PddlPredicateDto"),
    ],
    "action": [
        (changed(lambda action: literals(action.conditions)[0].objects.reverse()), "term 1"),
        (
            changed(lambda action: literals(action.conditions)[0].set_objects([])),
            "0 terms, expected 2",
        ),
        (
            changed(lambda action: literals(action.conditions)[0].set_time("")),
            "expected one of 'at start'",
        ),
        (changed(lambda action: action.set_durative(False)), "leave the time out"),
        (changed(lambda action: action.parameters.pop()), "neither a parameter"),
        (changed(lambda action: action.set_duration(-1)), "the duration is negative"),
    ],
}


@pytest.mark.parametrize("kind", ILL_TYPED)
def test_ill_typed_knowledge_is_answered_with_false_and_the_reason_is_logged(
    factory: DaoFactory, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    propositions = factory.create_pddl_proposition_dao()
    assert propositions.save(robot_at()) is True
    dao = daos(factory)[kind][0]
    before = dao.get_all()
    for dto, reason in ILL_TYPED[kind]:
        caplog.clear()
        assert dao.save(dto) is False
        (record,) = caplog.records
        assert (record.name, record.levelno) == ("kant_sql.compat", logging.WARNING)
        assert reason in record.getMessage()
        assert dao._save(dto) is False
        assert dao._update(dto) is False
    assert dao.get_all() == before
    assert [str(fact) for fact in propositions.get_all()] == ["(robot_at rb1 wp1)"]


def test_a_plain_action_may_have_empty_times_as_in_the_original(factory: DaoFactory) -> None:
    actions = factory.create_pddl_action_dao()
    plain = navigation()
    plain.set_durative(False)
    for literal in literals([*plain.get_conditions(), *plain.get_effects()]):
        literal.set_time("")
    assert actions._save(plain) is True
    assert actions._update(plain) is True
    assert str(actions.get("navigation")) == (
        "(:action navigation\n"
        "\t:parameters ( ?r - robot ?s - wp ?d - wp)\n"
        "\t:precondition (and\n"
        "\t\t(robot_at ?r ?s)\n"
        "\t)\n"
        "\t:effect (and\n"
        "\t\t(not (robot_at ?r ?s))\n"
        "\t\t(robot_at ?r ?d)\n"
        "\t)\n"
        ")"
    )


def test_a_fact_and_a_goal_are_two(factory: DaoFactory) -> None:
    propositions = factory.create_pddl_proposition_dao()
    assert propositions._save(robot_at()) is True
    assert propositions._save(robot_at(is_goal=True)) is True
    assert propositions._save(robot_at(RB1, WP2)) is True
    assert len(propositions.get_all()) == 3
    assert propositions.get_goals() == [robot_at(is_goal=True)]
    assert propositions.get_no_goals() == [robot_at(), robot_at(RB1, WP2)]
    assert propositions.get_by_predicate("unknown") == []


@pytest.mark.parametrize(
    "options",
    [
        {"uri": "sqlite://", "frobnicate": 1},
        {"uri": "sqlite://", "url": "sqlite://"},
        {"URI": "sqlite://"},
        {"url": "sqlite://"},
        {},
    ],
)
def test_an_unknown_keyword_raises(options: dict[str, Any]) -> None:
    with pytest.raises(TypeError):
        DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, **options)


@pytest.mark.parametrize("family", [3, -1, "SQL", None])
def test_an_unknown_family_raises(family: Any) -> None:
    with pytest.raises(ValueError, match="is not a valid DaoFamilies"):
        DaoFactoryMethod().create_dao_factory(family, uri="sqlite://")


def test_a_uri_that_no_family_answers_to_raises() -> None:
    with pytest.raises(InvalidUrlError, match=r"^mongodb: no DAO family supports this URL"):
        DaoFactoryMethod().create_dao_factory(
            DaoFamilies.MONGO, uri="mongodb://localhost:27017/kant"
        )


def test_two_programs_share_a_store_by_its_uri(shared_url: str) -> None:
    one = DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, uri=shared_url)
    other = DaoFactoryMethod().create_dao_factory(DaoFamilies.MONGO, uri=shared_url)
    assert one.create_pddl_proposition_dao().save(robot_at()) is True
    assert other.create_pddl_proposition_dao().get_all() == [robot_at()]
    assert other.create_pddl_object_dao().delete(WP1) is True
    assert one.create_pddl_proposition_dao().get_all() == []
    one._factory.close()
    other._factory.close()

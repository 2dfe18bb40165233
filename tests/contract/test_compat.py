"""A program for the original library runs with its imports and its URI changed, nothing else."""

from __future__ import annotations

import logging
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from kant_sql import InvalidArgumentError, KnowledgeBase, compat
from kant_sql.compat import (
    DaoFactory,
    DaoFactoryMethod,
    DaoFamilies,
    ParameterLoader,
    Ros2DaoFactory,
)
from kant_sql.dto.actions import PddlActionDto, PddlConditionEffectDto
from kant_sql.dto.elements import (
    Dto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.errors import InvalidUrlError
from tests.support.reading import present
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    assigned,
    changed,
    literals,
    navigation,
    robot_at,
)

pytestmark = pytest.mark.usefixtures("closed_stores")
NAVIGATION = str(navigation())


@pytest.fixture
def factory(common_url: str) -> DaoFactory:
    """A factory on a store with nothing in it any more: its programs have one knowledge base."""
    made = DaoFactoryMethod().create_dao_factory(DaoFamilies.SQL, uri=common_url)
    for dao, _ in daos(made).values():
        dao.delete_all()
    return made


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


def test_the_families_have_the_originals_numbers() -> None:
    assert [(family.name, int(family)) for family in DaoFamilies] == [
        ("ROS2", 0),
        ("MONGO", 1),
        ("SQL", 2),
    ]
    assert DaoFactoryMethod().dao_families is DaoFamilies


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
        (assigned(PddlPropositionDto(ROBOT_AT, [RB1, WP1]), predicate=None), "PddlPredicateDto"),
    ],
    "action": [
        (changed(lambda action: literals(action.conditions)[0].objects.reverse()), "term 1"),
        (changed(lambda action: action.set_durative(False)), "leave the time out"),
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


DOMAIN = """(define (domain tour) (:requirements :strips :typing)
  (:types room dock - place place robot)
  (:constants home - dock)
  (:predicates (at ?r - robot ?p - place))
  (:action leave :parameters (?r - robot) :precondition (at ?r home) :effect (not (at ?r home))))"""


def test_a_mission_begins_anew_with_the_constants_and_actions_of_its_domain(
    factory: DaoFactory,
) -> None:
    kb = KnowledgeBase(factory._factory)
    kb.load_domain(DOMAIN)
    objects, types = factory.create_pddl_object_dao(), factory.create_pddl_type_dao()
    at = PddlPredicateDto("at", [ROBOT, PddlTypeDto("place")])
    home = PddlObjectDto(PddlTypeDto("dock"), "home")
    assert objects.save(home)
    assert factory.create_pddl_proposition_dao().save(PddlPropositionDto(at, [RB1, home]))
    before = kb.revision
    assert objects.delete_all() is True
    assert kb.revision == before + 1
    (left,) = objects.get_all()
    assert (str(left), left.is_constant) == ("home - dock", True)
    assert kb.actions.get("leave") is not None
    assert kb.propositions.get_all() == []
    assert objects.delete(home)
    # As in `:types`: what is of no type comes last, else it would be of the type that follows.
    assert [str(each) for each in types.get_all()] == [
        *("dock - place", "room - place", "place", "robot")
    ]


def test_named_elements_are_sorted_by_name(factory: DaoFactory) -> None:
    types, objects = factory.create_pddl_type_dao(), factory.create_pddl_object_dao()
    predicates, actions = factory.create_pddl_predicate_dao(), factory.create_pddl_action_dao()
    for name in "zoe", "adam", "mia", "Bo":
        assert types.save(PddlTypeDto(name))
        assert objects.save(PddlObjectDto(ROBOT, name))
        assert predicates.save(PddlPredicateDto(name, []))
        assert actions.save(PddlActionDto(name, [], [], [], durative=False))
    for dao in (objects, predicates, actions):
        assert [each.get_name() for each in dao.get_all()] == ["Bo", "adam", "mia", "zoe"]
    assert [each.get_name() for each in types.get_all()] == ["Bo", "adam", "mia", "robot", "zoe"]


HUMAN = PddlTypeDto("human")
WIDER = PddlPredicateDto("robot_at", [ROBOT, WAYPOINT, WAYPOINT])


def test_a_reference_redefines_what_nothing_else_uses(factory: DaoFactory) -> None:
    predicates, objects = factory.create_pddl_predicate_dao(), factory.create_pddl_object_dao()
    propositions, actions = factory.create_pddl_proposition_dao(), factory.create_pddl_action_dao()
    assert predicates.save(ROBOT_AT)
    assert objects.save(PddlObjectDto(HUMAN, "wp2"))
    # Nothing uses the predicate, and wp2.
    revision = factory._factory.revision
    assert propositions._save(PddlPropositionDto(WIDER, [RB1, WP1, WP2]))
    assert factory._factory.revision == revision + 1
    assert [str(each) for each in predicates.get_all()] == [str(WIDER)]
    assert objects.get("wp2") == WP2
    assert str(objects.get("wp2")) == "wp2 - wp"
    # A fact uses them: nothing is written.
    assert propositions.save(robot_at()) is False
    assert (
        propositions.save(PddlPropositionDto(WIDER, [RB1, WP1, PddlObjectDto(HUMAN, "wp2")]))
        is False
    )
    assert factory._factory.revision == revision + 1
    # Only the saved one does.
    seen = PddlPredicateDto("seen", [PddlTypeDto("thing")])
    thing = PddlObjectDto(PddlTypeDto("thing"), "cup")
    assert propositions.save(PddlPropositionDto(seen, [thing]))
    cup = PddlObjectDto(HUMAN, "cup")
    assert propositions.save(PddlPropositionDto(PddlPredicateDto("seen", [HUMAN]), [cup]))
    assert str(propositions.get_by_predicate("seen")[0].get_objects()[0]) == "cup - human"
    # An action that alone uses a predicate says it anew.
    assert propositions.delete_all()
    assert actions.save(navigation()) is True
    assert str(predicates.get("robot_at")) == str(ROBOT_AT)
    action = navigation()
    for literal in literals([*action.conditions, *action.effects]):
        literal.set_predicate(WIDER)
        literal.set_objects([*literal.get_objects(), literal.get_objects()[1]])
    assert actions._update(action) is True
    assert str(predicates.get("robot_at")) == str(WIDER)
    assert actions.get("navigation") == action


def test_references_that_contradict_each_other_redefine_nothing(factory: DaoFactory) -> None:
    near = PddlPredicateDto("near", [WAYPOINT, ROBOT])
    propositions = factory.create_pddl_proposition_dao()
    assert factory.create_pddl_object_dao().save(PddlObjectDto(HUMAN, "wp1"))
    revision = factory._factory.revision
    both = [WP1, PddlObjectDto(ROBOT, "wp1")]
    assert propositions.save(PddlPropositionDto(near, both)) is False
    assert factory._factory.revision == revision
    assert str(factory.create_pddl_object_dao().get("wp1")) == "wp1 - human"


def test_a_type_without_a_parent_keeps_the_one_that_it_has(factory: DaoFactory) -> None:
    types = factory.create_pddl_type_dao()
    place, area = PddlTypeDto("place"), PddlTypeDto("area")
    assert types.save(PddlTypeDto("wp", parent=place))
    revision = factory._factory.revision
    assert types.save(PddlTypeDto("wp"))
    assert types._update(PddlTypeDto("WP"))
    assert factory.create_pddl_object_dao().save(WP1)
    assert present(types.get("wp")).parent == place
    assert factory._factory.revision == revision + 1
    assert types.save(PddlTypeDto("wp", parent=area))
    assert present(types.get("wp")).parent == area


@dataclass
class Value:
    """A parameter's value, as a message of ROS 2 has it."""

    value: object


@dataclass
class RosNode:
    """A node with the signatures of `rclpy`, and what a launch file sets."""

    overrides: dict[str, object] = field(default_factory=dict)
    name: str = "executor"
    declared: dict[str, Value] = field(default_factory=dict)

    def get_name(self) -> str:
        return self.name

    def has_parameter(self, name: str) -> bool:
        return name in self.declared

    def declare_parameter(
        self,
        name: str,
        value: object = None,
        descriptor: object = None,
        ignore_override: bool = False,
    ) -> Value:
        assert name not in self.declared, "ParameterAlreadyDeclaredException"
        assert type(value) in (int, str), "InvalidParameterTypeException"
        self.declared[name] = Value(self.overrides.get(name, value))
        return self.declared[name]

    def get_parameter(self, name: str) -> Value:
        return self.declared[name]


def written_by(factory: DaoFactory) -> tuple[str, str | None]:
    """Write, and tell to which knowledge base and as whom."""
    assert factory.create_pddl_type_dao().save(PddlTypeDto("robot"))
    made = KnowledgeBase(factory._factory).store.revisions()[-1]
    return factory._factory.name, made.actor


@pytest.mark.parametrize("name", ["uri", "mongo_uri", None])
def test_a_node_loads_the_factory_from_its_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str | None
) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    monkeypatch.setenv("KANT_SQL_URL", url if name is None else "sqlite:///elsewhere.db")
    node = RosNode({name: url} if name else {})
    factory = ParameterLoader(node).get_dao_factory()
    assert (factory.get_uri(), factory.get_node()) == (url, node)
    assert (factory.knowledge_base, factory.actor) == ("default", "executor")
    assert written_by(factory) == ("default", "executor")
    # A second one of the same node declares nothing again.
    assert ParameterLoader(node).get_dao_factory().create_pddl_type_dao().get("robot") == ROBOT
    more = {"uri": url, "knowledge_base": "tiago", "actor": "boss", "dao_family": 1}
    factory = ParameterLoader(RosNode(more)).get_dao_factory()
    assert written_by(factory) == ("tiago", "boss")
    with pytest.raises(ValueError, match="is not a valid DaoFamilies"):
        ParameterLoader(RosNode({**more, "dao_family": 7}))


def test_a_factory_without_a_uri_takes_that_of_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("KANT_SQL_URL", raising=False)
    make = DaoFactoryMethod().create_dao_factory
    with pytest.raises(InvalidUrlError, match=r"no database is named: give uri=.*KANT_SQL_URL"):
        make(DaoFamilies.ROS2, node=RosNode())
    url = f"sqlite:///{tmp_path / 'store.db'}"
    monkeypatch.setenv("KANT_SQL_URL", url)
    for factory in (make(DaoFamilies.ROS2, node=RosNode()), Ros2DaoFactory(RosNode())):
        assert factory.get_uri() == url
        assert written_by(factory) == ("default", "executor")
    named = make(DaoFamilies.MONGO, uri=url, knowledge_base="tiago", actor="boss", node=RosNode())
    assert written_by(named) == ("tiago", "boss")


def test_a_factory_goes_to_another_database_and_to_another_node(tmp_path: Path) -> None:
    one, other = (f"sqlite:///{tmp_path / name}.db" for name in ("one", "other"))
    factory = DaoFactory(one)
    assert written_by(factory) == ("default", None)
    before = factory.create_pddl_type_dao()
    factory.set_uri(other)
    assert (factory.get_uri(), factory.create_pddl_type_dao().get_all()) == (other, [])
    assert before.get_all() == [ROBOT]
    node = RosNode(name="planner")
    factory.set_node(node)
    assert (factory.get_node(), factory.actor) == (node, "planner")
    assert written_by(factory) == ("default", "planner")


PROGRAM = """
import sys
from kant_sql import compat
compat.install()
compat.install()
import kant_dao.dao_factory
from kant_dao import ParameterLoader
from kant_dao.parameter_loader import ParameterLoader as Same
from kant_dao.dao_factory import DaoFactoryMethod, DaoFamilies
from kant_dao.dao_factory.dao_factory_method import DaoFactoryMethod
from kant_dao.dao_factory.dao_factories import DaoFactory, MongoDaoFactory, Ros2DaoFactory
from kant_dao.dao_factory.dao_factories.dao_factory import DaoFactory
from kant_dao.dao_interface import Dao, PddlActionDao, PddlObjectDao, PddlPredicateDao
from kant_dao.dao_interface import PddlPropositionDao, PddlTypeDao
from kant_dto import Dto, PddlActionDto, PddlConditionEffectDto, PddlObjectDto, PddlPredicateDto
from kant_dto import PddlPropositionDto, PddlTypeDto
from kant_dto.pddl_type_dto import PddlTypeDto as Type
import kant_dto.pddl_action_dto
assert kant_dto.pddl_action_dto.PddlActionDto is PddlActionDto
assert (Same, Type, kant_dao.dao_factory.DaoFamilies) == (ParameterLoader, PddlTypeDto, DaoFamilies)
factory = DaoFactoryMethod().create_dao_factory(DaoFamilies.MONGO, uri="sqlite://")
dao = factory.create_pddl_type_dao()
assert isinstance(dao, PddlTypeDao) and isinstance(dao, Dao) and isinstance(factory, DaoFactory)
print(dao.save(PddlTypeDto("robot")), *dao.get_all())
"""


@pytest.mark.more
def test_a_program_keeps_its_imports() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("True robot\n", "")


def test_the_original_is_not_replaced_once_it_is_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [
        name for name in sys.modules if name.partition(".")[0] in ("kant_dto", "kant_dao")
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "kant_dao", ModuleType("kant_dao"))
    with pytest.raises(
        InvalidArgumentError, match="kant_dao of another package is imported already"
    ):
        compat.install()
    assert "kant_dto" not in sys.modules

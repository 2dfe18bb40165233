"""What the services answer, without ROS: requests and responses with the fields of the messages."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal
from functools import partial

import pytest

import kant_sql
from kant_sql import KnowledgeBase, planning
from kant_sql.errors import InvalidKnowledgeError, KantSqlError, SourceError
from kant_sql.planning import PlanStep
from kant_sql.ros.experts import DomainExpert, ProblemExpert, planner_services
from kant_sql.ros.node_trees import FUNCTION, PREDICATE, write_tree
from tests.ros import messages
from tests.ros.messages import Client, Kinds
from tests.ros.test_node_trees import MADE
from tests.support.statements import count as statements

DOMAIN = """(define (domain ward)
  (:requirements :typing :durative-actions :fluents :derived-predicates :existential-preconditions)
  (:types robot place - object dock - place)
  (:constants home - dock)
  (:predicates (at ?r - robot ?p - place) (door ?a ?b - place) (docked ?r - robot))
  (:functions (battery ?r - robot))
  (:derived (docked ?r - robot) (exists (?d - dock) (at ?r ?d)))
  (:action charge :parameters (?r - robot) :precondition (and (at ?r home))
    :effect (and (assign (battery ?r) 100)))
  (:durative-action move :parameters (?r - robot ?a ?b - place) :duration (= ?duration 5)
    :condition (and (at start (at ?r ?a)) (over all (door ?a ?b)) (at start (> (battery ?r) 20)))
    :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b))
                 (at end (decrease (battery ?r) 2.5)))))
"""
PROBLEM = """(define (problem round) (:domain ward) (:objects rb1 - robot hall - place)
  (:init (at rb1 hall) (door hall home) (= (battery rb1) 80.5)) (:goal (and (docked rb1))))"""


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with kant_sql.connect("sqlite://", actor="executive") as kb:
        kb.load_domain(DOMAIN)
        yield kb


@pytest.fixture
def problem(kb: KnowledgeBase) -> Client:
    return Client(list(ProblemExpert(kb, messages).services(Kinds())))


@pytest.fixture
def domain(kb: KnowledgeBase) -> Client:
    return Client(list(DomainExpert(kb, messages).services(Kinds())))


def node(kind: int, name: str, *terms: str, value: float = 0.0) -> messages.Node:
    parameters = [messages.Param(each) for each in terms]
    return messages.Node(node_type=kind, name=name, parameters=parameters, value=value)


def test_the_domain_is_described_as_plansys2_does(domain: Client) -> None:
    assert domain("get_domain_name").name == "ward"
    assert domain("get_domain_types").types == ["object", "robot", "place", "dock"]
    assert domain("get_domain_constants", type="place").constants == ["home"]
    assert domain("get_domain_actions").actions == ["charge"]
    assert domain("get_domain_durative_actions").actions == ["move"]
    assert [each.name for each in domain("get_domain_functions").states] == ["battery"]
    assert [each.name for each in domain("get_domain_derived_predicates").states] == ["docked"]
    found = domain("get_domain_predicate_details", expression="AT").node
    assert [(each.name, each.type, each.sub_types) for each in found.parameters] == [
        ("?robot0", "robot", []),
        ("?place1", "place", ["dock"]),
    ]
    [rule] = domain("get_domain_derived_predicate_details", predicate="docked").predicates
    exists, inner = rule.preconditions.nodes
    assert [(each.name, each.type) for each in exists.parameters] == [("?1", "dock")]
    assert [each.name for each in inner.parameters] == ["?0", "?1"]


def test_a_durative_action_has_a_tree_for_each_time(domain: Client) -> None:
    given = {"durative_action": "move", "parameters": ["rb1", "hall"]}
    found = domain("get_domain_durative_action_details", **given).durative_action
    assert [each.name for each in found.parameters] == ["rb1", "hall", "?2"]
    start = found.at_start_requirements.nodes
    assert [each.name for each in start if each.node_type == PREDICATE] == ["at"]
    assert [each.value for each in start if each.node_type == 9] == [20.0]
    assert [each.name for each in found.over_all_requirements.nodes[1].parameters] == ["hall", "?2"]
    assert not hasattr(found, "at_end_requirements")
    with pytest.raises(KantSqlError, match="no 'charge' in the durative-actions"):
        domain("get_domain_durative_action_details", durative_action="charge", parameters=[])


def test_the_problem_is_written_and_read(kb: KnowledgeBase, problem: Client) -> None:
    problem("add_problem_instance", param=messages.Param("rb1", "robot"))
    problem("add_problem_instance", param=messages.Param("hall", "place"))
    with pytest.raises(KantSqlError, match="no type 'SCIENTIFIC'"):
        problem("add_problem_instance", param=messages.Param("Paco", "SCIENTIFIC"))
    with pytest.raises(KantSqlError, match="exists already"):
        problem("add_problem_instance", param=messages.Param("rb1", "place"))
    at = node(PREDICATE, "at", "rb1", "hall")
    problem("add_problem_predicate", node=at)
    assert problem("exist_problem_predicate", node=at).exist
    battery = node(FUNCTION, "battery", "rb1", value=1.1)
    with pytest.raises(KantSqlError, match="no value yet"):
        problem("update_problem_function", node=battery)
    problem("add_problem_function", node=battery)
    assert problem("get_problem_function", expression="(battery rb1)").node.value == 1.1
    assert str(kb.function_values.get("(battery rb1)")) == "1.1"
    problem("remove_problem_function", node=battery)
    assert not problem("exist_problem_function", node=battery).exist
    problem("remove_problem_predicate", node=at)
    problem("remove_problem_predicate", node=at)
    assert problem("get_problem_predicates").states == []
    problem("remove_problem_instance", param=messages.Param("rb1", "robot"))
    assert [each.name for each in problem("get_problem_instances").instances] == ["home", "hall"]


def test_a_problem_is_added_solved_and_cleared(kb: KnowledgeBase, problem: Client) -> None:
    problem("add_problem", problem=PROBLEM)
    problem("add_problem", problem=PROBLEM)
    goal = problem("get_problem_goal").tree
    assert not problem("is_problem_goal_satisfied", tree=goal).satisfied
    kb.apply("(move rb1 hall home)")
    assert problem("is_problem_goal_satisfied", tree=goal).satisfied
    assert [each.name for each in problem("get_problem_predicates").states][-1] == "docked"
    assert [each.value for each in problem("get_problem_functions").states] == [78.0]
    assert "(:goal" in problem("get_problem").problem
    problem("add_problem_goal", tree=messages.Tree(write_tree(kb.goals.get_all()[0], MADE)))
    problem("remove_problem_goal")
    assert kb.goals.get_all() == []
    with pytest.raises(InvalidKnowledgeError, match="empty tree"):
        problem("add_problem_goal", tree=messages.Tree())
    problem("clear_problem_knowledge")
    assert [str(each) for each in kb.objects.get_all()] == ["home - dock"]


def test_what_does_not_fit_is_refused_and_changes_nothing(
    kb: KnowledgeBase, problem: Client
) -> None:
    problem("add_problem", problem=PROBLEM)
    revision, home = kb.revision, messages.Param("home", "dock")
    for service, request in (
        ("remove_problem_function", {"node": node(FUNCTION, "battery", "rb1", "hall")}),
        ("remove_problem_predicate", {"node": node(PREDICATE, "at", "hall", "rb1")}),
        ("add_problem_predicate", {"node": node(PREDICATE, "at", "rb2", "hall")}),
        # Without the constant, the domain would lose an action.
        ("remove_problem_instance", {"param": home}),
        ("add_problem", {"problem": PROBLEM.replace("at rb1 hall", "at hall hall")}),
        ("add_problem", {"problem": PROBLEM.replace("rb1 -", "rb2 home -")}),
        ("add_problem", {"problem": "/etc/hostname"}),
        ("get_problem_function", {"expression": "(battery rb2)"}),
        ("get_problem_predicate", {"expression": "(at rb1 home)"}),
    ):
        with pytest.raises(KantSqlError) as refused:
            problem(service, **request)
        assert not isinstance(refused.value, SourceError)
    assert kb.revision == revision


def test_each_call_is_one_revision_of_the_node(kb: KnowledgeBase, problem: Client) -> None:
    problem("add_problem", problem=PROBLEM)
    start = kb.revision
    problem("remove_problem_predicate", node=node(0, "at", "rb1", "hall"))
    problem("add_problem_predicate", node=node(0, "at", "rb1", "home"))
    problem("update_problem_function", node=node(0, "battery", "rb1", value=78))
    found = [
        (entry.revision.actor, change.sign, change.text)
        for entry in kb.changes(start)
        for change in entry.changes
    ]
    assert found == [
        ("executive", "-", "(at rb1 hall)"),
        ("executive", "+", "(at rb1 home)"),
        ("executive", "+", "(= (battery rb1) 78)"),
        ("executive", "-", "(= (battery rb1) 80.5)"),
    ]
    problem("add_problem_predicate", node=node(0, "at", "rb1", "home"))
    assert kb.revision == start + 3


def test_knowledge_is_what_holds(kb: KnowledgeBase, problem: Client) -> None:
    expert = ProblemExpert(kb, messages)
    # A constant is no instance before there is a problem.
    assert (expert.knowledge().instances, expert.knowledge().goal) == ([], "")
    problem("add_problem", problem=PROBLEM)
    kb.propositions.save("(at rb1 home)")
    assert expert.knowledge() == messages.message(
        instances=["home", "rb1", "hall"],
        predicates=["(at rb1 hall)", "(door hall home)", "(at rb1 home)", "(docked rb1)"],
        functions=["(battery rb1)"],
        goal="(and (docked rb1))",
    )


def test_reads_do_not_grow_with_the_facts(kb: KnowledgeBase, problem: Client) -> None:
    kb.load_problem(PROBLEM)
    at, battery = {"node": node(0, "at", "rb1", "hall")}, {"node": node(0, "battery", "rb1")}

    def counts() -> list[int]:
        return [
            statements(partial(problem, service, **request))
            for service, request in (
                ("get_problem_predicates", {}),
                ("get_problem_instances", {}),
                ("get_problem_predicate", {"expression": "(at rb1 hall)"}),
                ("exist_problem_predicate", at),
                ("exist_problem_function", battery),
                ("add_problem_predicate", at),
            )
        ]

    few = counts()
    kb.objects.save_all(f"p{number} - place" for number in range(50))
    kb.propositions.save_all(f"(door p{number} hall)" for number in range(50))
    assert counts() == few
    domain = Client(list(DomainExpert(kb, messages).services(Kinds())))
    assert statements(lambda: domain("get_domain")) == 1


def test_a_plan_is_made_of_the_texts_of_the_request(monkeypatch: pytest.MonkeyPatch) -> None:
    planner = Client(list(planner_services(messages, Kinds())))
    simple = "(define (domain d) (:predicates (p)) (:action a :parameters () :effect (p)))"
    asked = {"domain": simple, "problem": "(define (problem q) (:domain d) (:init) (:goal (p)))"}

    def planned(*steps: PlanStep) -> list[tuple[str, float, float]]:
        found = messages.message(steps=steps)
        monkeypatch.setattr(planning, "solve", lambda domain, problem, timeout: found)
        items = planner("get_plan", **asked).plan.items
        return [(each.action, each.time, each.duration) for each in items]

    # Steps of one time would run at once.
    untimed = [PlanStep(None, "go", ("rb1", "hall")), PlanStep(None, "a")]
    assert planned(*untimed) == [("(go rb1 hall)", 0.0, 0.0), ("(a)", 0.001, 0.0)]
    timed = PlanStep(Decimal("1.5"), "a", duration=Decimal(5))
    assert planned(timed) == [("(a)", 1.5, 5.0)]
    planner("validate_domain", domain=simple)
    with pytest.raises(KantSqlError):
        planner("validate_domain", domain="(define (domain d) (:predicates (p)")

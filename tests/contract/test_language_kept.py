"""Formulas are kept as they are written wherever they may stand, and actions, on every backend."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from typing import Any, NamedTuple

import pytest

from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlEventDto,
    PddlObjectDto,
    PddlProcessDto,
    ReadOnlyError,
)
from kant_sql import PddlTypeDto as Type
from kant_sql.dto import formulas as f
from kant_sql.errors import ConflictError, InvalidKnowledgeError
from kant_sql.pddl.document import Action, Domain
from tests.support.parts import dao_of
from tests.support.reading import documents, last_changes, nothing_changes, present, rows
from tests.support.worlds.depot import (
    C1,
    CONDITIONS,
    CONSTRAINTS,
    DURATION,
    DURATIONS,
    EFFECTS,
    HUB,
    IDLE,
    P1,
    P2,
    PLACE,
    T1,
    T2,
    TIMED_EFFECTS,
    TRUCK,
    P,
    T,
    again,
    at,
    calculated,
    check_text,
    distance,
    fuel,
    home,
    load,
    number,
)


def test_each_condition_is_kept_as_a_goal(fresh_kb: KnowledgeBase) -> None:
    world, conditions = load(fresh_kb), [*CONDITIONS.values()]
    for condition in conditions:
        assert fresh_kb.goals.save(condition) is True
        # `object` comes to be with what first mentions it.
        assert set(last_changes(fresh_kb)) - {"+ type object"} == {f"+ goal {condition}"}
        assert fresh_kb.goals.insert(condition) is False
    made = world + len(conditions)
    assert fresh_kb.revision == made
    formulas = [condition for condition in conditions if not is_ground(condition)]
    for reader in (fresh_kb, again(fresh_kb), fresh_kb.at(made)):
        assert sorted(map(str, reader.goals.get_all())) == sorted(map(str, conditions))
        assert {*reader.pddl.problem().goal} == {*conditions}
        # Literals are kept as propositions, and come first.
        assert reader.pddl.problem().goal[-len(formulas) :] == tuple(formulas)
        check_text(reader)
    for condition in conditions:
        assert fresh_kb.goals.delete(condition) is True
        assert last_changes(fresh_kb) == [f"- goal {condition}"]
        assert fresh_kb.goals.delete(condition) is False
    assert fresh_kb.pddl.problem().goal == ()
    for count in (0, 1, 7):
        assert {*fresh_kb.at(world + count).goals.get_all()} == {*conditions[:count]}


def is_ground(condition: f.Formula) -> bool:
    return isinstance(condition, f.Atom) and "(" not in "".join(map(str, condition.terms))


def test_a_conjunction_of_goals_is_each_of_them(depot_kb: KnowledgeBase) -> None:
    crane = f.Atom("ready", (T,))
    someone = f.Exists((TRUCK,), crane)
    goal = f.And((at(), someone, f.And((IDLE, f.Not(IDLE)))))
    depot_kb.goals.save(goal)
    assert last_changes(depot_kb) == [
        "+ goal (at t1 p1)",
        "+ goal (exists (?t - truck) (ready ?t))",
        "+ goal (idle)",
        "+ goal (not (idle))",
    ]
    # Ground atoms are propositions, as ever.
    literals = depot_kb.goals.get_propositions()
    assert [str(dto) for dto in literals] == ["(at t1 p1)", "(idle)"]
    assert depot_kb.goals.get_all() == [at(), IDLE, someone, f.Not(IDLE)]
    depot_kb.goals.delete(literals[0])
    assert at() not in depot_kb.pddl.problem().goal
    assert depot_kb.goals.delete(f.And((IDLE, at()))) is True
    assert depot_kb.goals.delete_all() == 2
    assert depot_kb.pddl.problem().goal == ()


def test_a_goal_refers_to_what_it_mentions(depot_kb: KnowledgeBase) -> None:
    depot_kb.goals.save(f.Exists((TRUCK,), at(T, P1)))
    joined = (
        "SELECT node.position, node.parent, operator, predicate.name, object.name, "
        "variable.name, type.name "
        "FROM formula_version AS version JOIN formula_node AS node "
        "USING (kb_id, formula_id, since) "
        "LEFT JOIN predicate ON (predicate.kb_id, predicate.id) = (node.kb_id, predicate_id) "
        "LEFT JOIN formula_term AS term ON (term.kb_id, term.formula_id, term.since, term.position)"
        " = (node.kb_id, node.formula_id, node.since, node.position) AND object_id IS NOT NULL "
        "LEFT JOIN object ON (object.kb_id, object.id) = (node.kb_id, object_id) "
        "LEFT JOIN formula_variable AS variable ON (variable.kb_id, variable.formula_id, "
        "variable.since, variable.position) "
        "= (node.kb_id, node.formula_id, node.since, node.position) "
        "LEFT JOIN formula_variable_type AS variable_type ON (variable_type.kb_id, "
        "variable_type.formula_id, variable_type.since, variable_type.position) "
        "= (node.kb_id, node.formula_id, node.since, node.position) "
        "LEFT JOIN type ON (type.kb_id, type.id) = (node.kb_id, type_id) "
        "WHERE version.kb_id = :kb AND version.until IS NULL AND version.section = 'goal' "
        "ORDER BY node.position"
    )
    assert rows(depot_kb, joined) == [
        (0, None, "exists", None, None, "t", "truck"),
        (1, 0, "predicate", "at", "p1", None, None),
    ]


class Sort(NamedTuple):
    """A sort of formulas: its DAO, its lines in the log, its place in the documents."""

    dao: str
    kind: str
    said: Callable[[KnowledgeBase], tuple[f.Node, ...]]
    examples: dict[str, Any]


X, Y = f.TypedName("x", ("place",)), f.TypedName("y", ("place",))
SORTS = [
    Sort(
        "derived_predicates",
        "derived",
        lambda kb: kb.pddl.domain().derived,
        {
            "rule": f.Derived("reachable", (PLACE,), f.Exists((TRUCK,), at(T, P))),
            "another rule of it": f.Derived("reachable", (X,), f.Atom("open", (f.Variable("x"),))),
            "recursive": f.Derived(
                "linked",
                (X, Y),
                f.Exists(
                    (PLACE,), f.And((f.Atom("linked", (f.Variable("x"), P)), f.Equal(P, HUB)))
                ),
            ),
            "no parameters": f.Derived("idle", (), f.Not(at(T1, HUB))),
        },
    ),
    Sort(
        "timed_initial_literals",
        "timed",
        lambda kb: kb.pddl.problem().timed,
        {
            "add": f.TimedLiteral(number("5"), at()),
            "delete": f.TimedLiteral(number("7.50"), f.Not(at())),
            "add again later": f.TimedLiteral(number("12"), at()),
            "number": f.TimedLiteral(number("0.5"), f.Assign("assign", fuel(), number("9"))),
            "object": f.TimedLiteral(number("1"), f.Assign("assign", home(T2), HUB)),
        },
    ),
    Sort(
        "initial_literals",
        "initial",
        lambda kb: kb.pddl.problem().literals,
        {
            "negative": f.Not(at(T2)),
            "equality": f.Equal(T1, T2),
            "inequality": f.Not(f.Equal(T1, C1)),
        },
    ),
    Sort("constraints", "constraint", lambda kb: kb.pddl.problem().constraints, CONSTRAINTS),
    Sort(
        "domain_constraints",
        "domain constraint",
        lambda kb: kb.pddl.domain().constraints,
        CONSTRAINTS,
    ),
]
METRICS = {
    "time": f.Metric("minimize", f.Fluent("total-time")),
    "cost": f.Metric("minimize", f.Fluent("total-cost")),
    "preferences": f.Metric(
        "maximize",
        calculated(
            "-",
            calculated("*", number("2.50"), f.IsViolated("p1")),
            calculated("+", f.Fluent("total-time"), fuel(), distance(HUB, HUB)),
        ),
    ),
}


@pytest.mark.parametrize("sort", SORTS, ids=[sort.dao for sort in SORTS])
def test_each_formula_of_a_sort_is_kept(fresh_kb: KnowledgeBase, sort: Sort) -> None:
    world, examples = load(fresh_kb), [*sort.examples.values()]
    dao = dao_of(fresh_kb, sort.dao)
    for formula in examples:
        assert dao.save(formula) is True
        assert last_changes(fresh_kb) == [f"+ {sort.kind} {formula}"]
    with nothing_changes(fresh_kb):
        assert dao.save_all(examples) == 0
        assert dao.insert(examples[0]) is False
    for reader in (fresh_kb, again(fresh_kb), fresh_kb.at(fresh_kb.revision)):
        assert dao_of(reader, sort.dao).get_all() == examples
        assert sort.said(reader) == tuple(examples)
        check_text(reader)
    for count in range(len(examples) + 1):
        assert sort.said(fresh_kb.at(world + count)) == tuple(examples[:count])


@pytest.mark.parametrize("sort", SORTS, ids=[sort.dao for sort in SORTS])
def test_formulas_of_a_sort_are_deleted(depot_kb: KnowledgeBase, sort: Sort) -> None:
    examples, dao = [*sort.examples.values()], dao_of(depot_kb, sort.dao)
    assert dao.save_all(examples) == len(examples)
    first = depot_kb.revision
    assert dao.delete(examples[1]) is True
    assert last_changes(depot_kb) == [f"- {sort.kind} {examples[1]}"]
    with nothing_changes(depot_kb):
        assert dao.delete(examples[1]) is False
    assert sort.said(depot_kb) == (examples[0], *examples[2:])
    # What comes back is the same formula: one identity, another version.
    assert dao.insert(examples[1]) is True
    assert dao.get_all() == examples
    assert dao.delete_all() == len(examples)
    assert dao.get_all() == []
    assert dao.delete_all() == 0
    check_text(depot_kb)
    assert sort.said(depot_kb.at(first)) == tuple(examples)
    counted = (
        "SELECT (SELECT count(*) FROM formula WHERE kb_id = :kb), count(*), count(until), "
        "min(section) FROM formula_version WHERE kb_id = :kb"
    )
    number_of = len(examples)
    assert rows(depot_kb, counted) == [(number_of, number_of + 1, number_of + 1, sort.kind)]
    with pytest.raises(ReadOnlyError):
        dao_of(depot_kb.at(first), sort.dao).delete_all()


@pytest.mark.parametrize("dao", ["goals", "constraints", "domain_constraints"])
def test_a_conjunction_is_its_conjuncts(depot_kb: KnowledgeBase, dao: str) -> None:
    parts = [f.Modal("always", (), (IDLE,)), f.Modal("sometime", (), (at(),))]
    if dao == "goals":
        parts = [f.Not(IDLE), f.Preference("p", at())]  # type: ignore[list-item]
    nested = f.And((parts[0], f.And((parts[1], f.And(())))))
    dao_of(depot_kb, dao).save(nested)
    assert dao_of(depot_kb, dao).get_all() == parts
    assert dao_of(depot_kb, dao).delete(nested) is True
    assert dao_of(depot_kb, dao).get_all() == []


@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS)
def test_a_metric_is_kept(fresh_kb: KnowledgeBase, metric: f.Metric) -> None:
    world = load(fresh_kb)
    assert fresh_kb.pddl.metric.get() is None
    assert fresh_kb.pddl.metric.set(metric) is True
    assert last_changes(fresh_kb) == [f"+ metric {metric}"]
    assert fresh_kb.pddl.metric.set(metric) is False
    for reader in (fresh_kb, again(fresh_kb)):
        assert reader.pddl.metric.get() == reader.pddl.problem().metric == metric
        check_text(reader)
    other = f.Metric("maximize", fuel())
    assert fresh_kb.pddl.metric.set(other) is True
    assert last_changes(fresh_kb) == [f"+ metric {other}", f"- metric {metric}"]
    assert fresh_kb.pddl.problem().metric == other
    assert fresh_kb.pddl.metric.set(None) is True
    assert fresh_kb.pddl.metric.set(None) is False
    assert fresh_kb.pddl.problem().metric is None
    assert fresh_kb.at(world + 1).pddl.metric.get() == metric
    assert fresh_kb.at(world + 2).pddl.metric.get() == other


def test_one_text_in_two_sections_is_two_formulas(depot_kb: KnowledgeBase) -> None:
    formula = f.Modal("always", (), (IDLE,))
    depot_kb.pddl.constraints.save(formula)
    depot_kb.pddl.domain_constraints.save(formula)
    depot_kb.goals.save(f.Not(at()))
    depot_kb.pddl.initial_literals.save(f.Not(at()))
    depot_kb.pddl.constraints.delete_all()
    depot_kb.goals.delete_all()
    assert depot_kb.pddl.domain_constraints.get_all() == [formula]
    assert depot_kb.pddl.initial_literals.get_all() == [f.Not(at())]


def test_names_are_kept_in_their_first_spelling(depot_kb: KnowledgeBase) -> None:
    shouted = f.Exists(
        (f.TypedName("T", ("TRUCK",)),), f.Atom("AT", (f.Variable("t"), f.Variable("T")))
    )
    with pytest.raises(InvalidKnowledgeError, match="expected place as argument 2"):
        depot_kb.goals.save(shouted)
    shouted = f.Exists((f.TypedName("T", ("TRUCK",)),), f.Atom("AT", (f.Variable("t"), HUB)))
    depot_kb.goals.save(shouted)
    assert [str(goal) for goal in depot_kb.goals.get_all()] == ["(exists (?T - truck) (at ?T hub))"]
    with nothing_changes(depot_kb):
        depot_kb.goals.save(shouted)
    assert depot_kb.goals.delete(shouted) is True


def test_what_a_transaction_saves_and_deletes_leaves_nothing(fresh_kb: KnowledgeBase) -> None:
    world = load(fresh_kb)
    constraint = CONSTRAINTS["always"]
    with fresh_kb.transaction():
        fresh_kb.pddl.constraints.save(constraint)
        assert fresh_kb.pddl.problem().constraints == (constraint,)
        fresh_kb.pddl.constraints.delete(constraint)
    assert fresh_kb.revision == world
    assert rows(fresh_kb, "SELECT count(*) FROM formula_version WHERE kb_id = :kb") == [(0,)]


PARAMETERS = [PddlObjectDto(Type("truck"), "t"), PddlObjectDto(Type("place"), "p")]
END = f.Timed("at end", IDLE)
FIXED = (f.Comparison("=", DURATION, number("10")),)
# Whether an action is durative, its duration, its condition, its effect.
Parts = tuple[bool, tuple[f.Formula, ...], tuple[f.Formula, ...], tuple[f.Formula, ...]]
CHARGE = PddlProcessDto(
    "charge",
    PARAMETERS,
    [at(T, P)],
    [f.Assign("increase", fuel(T), calculated("*", f.ContinuousTime(), number("0.5")))],
)
FULL = PddlEventDto(
    "full",
    PARAMETERS,
    [f.Comparison(">=", fuel(T), number("100"))],
    [f.Not(at(T, P)), f.Assign("assign", fuel(T), number("0"))],
)


def only_action(domain: Domain) -> Action:
    (action,) = domain.actions
    return action


def check(kb: KnowledgeBase, parts: list[Parts]) -> None:
    """Save actions of such parts in every way of asking, and delete them."""
    world = load(kb)
    dtos = [
        PddlActionDto(f"a{number}", PARAMETERS, needed, effect, durative, duration=duration)
        for number, (durative, duration, needed, effect) in enumerate(parts)
    ]
    wanted = tuple(
        Action(
            "durative-action" if durative else "action",
            f"a{number}",
            (TRUCK, PLACE),
            duration,
            needed,
            effect,
        )
        for number, (durative, duration, needed, effect) in enumerate(parts)
    )
    assert kb.actions.save_all(dtos) == len(dtos)
    made = [line for line in last_changes(kb) if line.startswith("+ action")]
    assert made == sorted(f"+ action {dto}" for dto in dtos)
    for reader in (kb, again(kb), kb.at(world + 1)):
        assert reader.pddl.domain().actions == wanted
        check_text(reader)
        found = reader.actions.get_all()
        assert [str(dto) for dto in found] == [str(dto) for dto in dtos]
    # What is read can be saved: it says the same.
    assert kb.actions.save_all(found) == 0
    for dto in dtos:
        assert kb.actions.delete(dto) is True
    assert kb.pddl.domain().actions == ()
    assert kb.at(world + 1).pddl.domain().actions == wanted
    live = "SELECT count(*) FROM action_version WHERE kb_id = :kb AND until IS NULL"
    assert rows(kb, live) == [(0,)]


def test_each_condition_is_kept_as_a_precondition(fresh_kb: KnowledgeBase) -> None:
    check(fresh_kb, [(False, (), (condition,), (IDLE,)) for condition in CONDITIONS.values()])


def test_each_condition_with_a_time_is_kept(fresh_kb: KnowledgeBase) -> None:
    # A preference has its place outside of what is timed.
    inside = [each for each in CONDITIONS.values() if "(preference" not in str(each)]
    check(fresh_kb, [(True, FIXED, (f.Timed("over all", each),), (END,)) for each in inside])


def test_each_effect_is_kept(fresh_kb: KnowledgeBase) -> None:
    check(fresh_kb, [(False, (), (), (effect, IDLE)) for effect in EFFECTS.values()])


def test_each_effect_with_a_time_is_kept(fresh_kb: KnowledgeBase) -> None:
    check(fresh_kb, [(True, FIXED, (), (effect, END)) for effect in TIMED_EFFECTS.values()])


def test_each_duration_is_kept(fresh_kb: KnowledgeBase) -> None:
    check(fresh_kb, [(True, duration, (), (END,)) for duration in DURATIONS.values()])


def test_a_fixed_duration_is_read_as_the_number_that_it_is(depot_kb: KnowledgeBase) -> None:
    for given in (5, 2.5, Decimal("0.10"), Decimal("1E+2")):
        depot_kb.actions.save(PddlActionDto("act", PARAMETERS, [], [END], duration=given))
        assert present(depot_kb.actions.get("act")).duration == given
        (constraint,) = only_action(depot_kb.pddl.domain()).duration
        assert constraint == f.Comparison("=", DURATION, number(str(given)))


def test_processes_and_events_have_daos_of_their_own(depot_kb: KnowledgeBase) -> None:
    with depot_kb.transaction():
        depot_kb.pddl.processes.save(CHARGE)
        depot_kb.pddl.events.save(FULL)
    assert last_changes(depot_kb) == [f"+ action {FULL}", f"+ action {CHARGE}"]
    made = depot_kb.revision
    assert depot_kb.actions.get_all() == []
    assert depot_kb.actions.get("charge") is None
    for reader in (depot_kb, again(depot_kb), depot_kb.at(made)):
        assert [str(dto) for dto in reader.pddl.processes.get_all()] == [str(CHARGE)]
        assert [str(dto) for dto in reader.pddl.events.get_all()] == [str(FULL)]
        kinds = [(action.kind, action.name) for action in reader.pddl.domain().actions]
        assert kinds == [("process", "charge"), ("event", "full")]
        check_text(reader)
    assert ":time" in depot_kb.pddl.requirements()
    assert rows(depot_kb, "SELECT kind FROM action_version WHERE kb_id = :kb ORDER BY kind") == [
        ("event",),
        ("process",),
    ]
    with nothing_changes(depot_kb):
        with pytest.raises(ConflictError, match="is a stored process"):
            depot_kb.actions.save(PddlActionDto("Charge", durative=False))
        with pytest.raises(InvalidKnowledgeError, match="has a DAO of its own"):
            depot_kb.actions.save(FULL)
        assert depot_kb.pddl.events.delete(PddlEventDto("charge")) is False
    assert depot_kb.pddl.processes.delete(CHARGE) is True
    assert depot_kb.pddl.events.delete_all() == 1
    assert depot_kb.pddl.domain().actions == ()
    assert len(depot_kb.at(made).pddl.domain().actions) == 2


def test_conjunctions_within_a_list_are_its_items(depot_kb: KnowledgeBase) -> None:
    nested = f.And((at(T, P), f.And((IDLE, f.And(())))))
    dto = PddlActionDto("act", PARAMETERS, [nested], [nested], durative=False)
    depot_kb.actions.save(dto)
    action = only_action(depot_kb.pddl.domain())
    assert action.condition == action.effect == (at(T, P), IDLE)
    check_text(depot_kb)


def test_which_actions_can_make_an_atom_false_is_one_join(depot_kb: KnowledgeBase) -> None:
    depot_kb.actions.save_all(
        PddlActionDto(name, PARAMETERS, [at(T, P)], [effect], durative=False)
        for name, effect in EFFECTS.items()
        if " " not in name
    )
    depot_kb.pddl.events.save(FULL)
    sql = (
        "SELECT DISTINCT action.name FROM action_version AS version "
        "JOIN action ON (action.kb_id, action.id) = (version.kb_id, version.action_id) "
        "JOIN action_node AS atom ON (atom.kb_id, atom.action_id, atom.since) "
        "= (version.kb_id, version.action_id, version.since) "
        "JOIN predicate ON (predicate.kb_id, predicate.id) = (atom.kb_id, atom.predicate_id) "
        "JOIN action_node AS above ON (above.kb_id, above.action_id, above.since, above.section, "
        "above.position) = (atom.kb_id, atom.action_id, atom.since, atom.section, atom.parent) "
        "WHERE version.kb_id = :kb AND version.until IS NULL AND atom.section = 'effect' "
        "AND predicate.key = 'at' AND above.operator = 'not' ORDER BY action.name"
    )
    assert [name for (name,) in rows(depot_kb, sql)] == ["delete", "forall", "full"]


def test_an_object_an_action_mentions_is_a_constant_of_the_domain(depot_kb: KnowledgeBase) -> None:
    depot_kb.actions.save(PddlActionDto("act", [], [at(T2, P2)], [], durative=False))
    assert [part.name for part in depot_kb.pddl.domain().constants] == ["hub", "t2", "p2"]
    assert [part.name for part in depot_kb.pddl.problem().objects] == ["t1", "c1", "p1"]
    check_text(depot_kb)
    text, problem = documents(depot_kb)
    # A problem does not retract what the domain needs.
    depot_kb.load_problem(problem)
    assert documents(depot_kb) == (text, problem)
    depot_kb.load_domain(text, mode="merge")
    assert present(depot_kb.objects.get("t2")).is_constant
    assert documents(depot_kb) == (text, problem)


def test_a_redefined_action_keeps_its_history(depot_kb: KnowledgeBase) -> None:
    one = PddlActionDto("act", PARAMETERS, [], [at(T, P)], durative=False)
    other = PddlActionDto(
        "Act", PARAMETERS, [], [END], duration=(f.Comparison("<=", DURATION, distance(P, home(T))),)
    )
    depot_kb.actions.save(one)
    before = depot_kb.domain_pddl()
    depot_kb.actions.save(other)
    assert only_action(depot_kb.pddl.domain()).kind == "durative-action"
    assert only_action(depot_kb.pddl.domain()).name == "act"
    check_text(depot_kb)
    assert depot_kb.at(depot_kb.revision - 1).domain_pddl() == before
    depot_kb.actions.save(one)
    assert depot_kb.domain_pddl() == before

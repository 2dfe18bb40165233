"""Each condition, as a goal and as a precondition, on every backend."""

from __future__ import annotations

import pytest

from kant_sql import KnowledgeBase, PddlActionDto
from kant_sql.dto.formula import And, Atom, Exists, Formula, Not, Timed
from tests.language import (
    CONDITIONS,
    IDLE,
    P1,
    TRUCK,
    T,
    again,
    at,
    check_text,
    load,
)
from tests.reading import last_changes, rows


@pytest.mark.parametrize("condition", CONDITIONS.values(), ids=CONDITIONS)
def test_a_condition_is_kept_as_a_goal(fresh_kb: KnowledgeBase, condition: Formula) -> None:
    world = load(fresh_kb)
    assert fresh_kb.goals.save(condition) is True
    # `object` comes to be with what first mentions it.
    assert set(last_changes(fresh_kb)) - {"+ type object"} == {f"+ goal {condition}"}
    assert fresh_kb.goals.insert(condition) is False
    assert fresh_kb.revision == world + 1
    for reader in (fresh_kb, again(fresh_kb)):
        assert reader.goals.get_all() == [condition]
        assert reader.problem().goal == (condition,)
        check_text(reader)
    assert fresh_kb.goals.delete(condition) is True
    assert fresh_kb.goals.delete(condition) is False
    assert last_changes(fresh_kb) == [f"- goal {condition}"]
    assert fresh_kb.problem().goal == ()
    assert fresh_kb.at(world + 1).problem().goal == (condition,)
    assert fresh_kb.at(world).goals.get_all() == []


@pytest.mark.parametrize("condition", CONDITIONS.values(), ids=CONDITIONS)
def test_a_condition_is_kept_as_a_precondition(fresh_kb: KnowledgeBase, condition: Formula) -> None:
    world = load(fresh_kb)
    # A preference has its place outside of what is timed.
    timed = condition if "(preference" in str(condition) else Timed("over all", condition)
    plain = PddlActionDto("plain", [], [condition], [IDLE], durative=False)
    actions = [plain]
    if timed is not condition:
        actions.append(PddlActionDto("timed", [], [timed], [Timed("at end", IDLE)]))
    fresh_kb.actions.save_all(actions)
    for reader in (fresh_kb, again(fresh_kb)):
        found = reader.domain().actions
        assert [action.condition for action in found] == [(condition,), (timed,)][: len(actions)]
        check_text(reader)
    read = fresh_kb.actions.get("plain")
    assert read is not None
    assert str(read) == str(plain)
    # What is read can be saved: it says the same.
    assert fresh_kb.actions.save_all(fresh_kb.actions.get_all()) == 0
    fresh_kb.actions.delete_all()
    assert fresh_kb.domain().actions == ()
    assert fresh_kb.at(world + 1).domain().actions[0].condition == (condition,)


def test_a_conjunction_of_goals_is_each_of_them(fresh_kb: KnowledgeBase) -> None:
    load(fresh_kb)
    crane = Atom("ready", (T,))
    someone = Exists((TRUCK,), crane)
    goal = And((at(), someone, And((IDLE, Not(IDLE)))))
    fresh_kb.goals.save(goal)
    assert last_changes(fresh_kb) == [
        "+ goal (at t1 p1)",
        "+ goal (exists (?t - truck) (ready ?t))",
        "+ goal (idle)",
        "+ goal (not (idle))",
    ]
    # Ground atoms are propositions, as ever.
    literals = fresh_kb.propositions.get_goals()
    assert [str(dto) for dto in literals] == ["(at t1 p1)", "(idle)"]
    assert fresh_kb.goals.get_all() == [at(), IDLE, someone, Not(IDLE)]
    fresh_kb.propositions.delete(literals[0])
    assert at() not in fresh_kb.problem().goal
    assert fresh_kb.goals.delete(And((IDLE, at()))) is True
    assert fresh_kb.goals.delete_all() == 2
    assert fresh_kb.problem().goal == ()


def test_a_goal_refers_to_what_it_mentions(fresh_kb: KnowledgeBase) -> None:
    load(fresh_kb)
    fresh_kb.goals.save(Exists((TRUCK,), at(T, P1)))
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
    assert rows(fresh_kb, joined) == [
        (0, None, "exists", None, None, "t", "truck"),
        (1, 0, "predicate", "at", "p1", None, None),
    ]

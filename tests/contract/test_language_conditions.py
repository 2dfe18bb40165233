"""Each condition, as a goal and as a precondition, on every backend."""

from __future__ import annotations

from kant_sql import KnowledgeBase, PddlActionDto
from kant_sql.dto.formulas import And, Atom, Exists, Formula, Not, Timed
from tests.support.reading import last_changes, rows
from tests.support.worlds.depot import CONDITIONS, IDLE, P1, TRUCK, T, again, at, check_text, load


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


def is_ground(condition: Formula) -> bool:
    return isinstance(condition, Atom) and "(" not in "".join(map(str, condition.terms))


def test_each_condition_is_kept_as_a_precondition(depot_kb: KnowledgeBase) -> None:
    actions, wanted = [], []
    for number, condition in enumerate(CONDITIONS.values()):
        actions.append(PddlActionDto(f"a{number}", [], [condition], [IDLE], durative=False))
        wanted.append(condition)
        # A preference has its place outside of what is timed.
        if "(preference" not in str(condition):
            timed = Timed("over all", condition)
            actions.append(PddlActionDto(f"d{number}", [], [timed], [Timed("at end", IDLE)]))
            wanted.append(timed)
    assert depot_kb.actions.save_all(actions) == len(actions)
    made = depot_kb.revision
    for reader in (depot_kb, again(depot_kb), depot_kb.at(made)):
        found = reader.pddl.domain().actions
        assert [action.condition for action in found] == [(part,) for part in wanted]
        assert [str(dto) for dto in reader.actions.get_all()] == [str(dto) for dto in actions]
        check_text(reader)
    # What is read can be saved: it says the same.
    assert depot_kb.actions.save_all(again(depot_kb).actions.get_all()) == 0
    assert depot_kb.actions.delete_all() == len(actions)
    assert depot_kb.pddl.domain().actions == ()
    assert len(depot_kb.at(made).pddl.domain().actions) == len(actions)


def test_a_conjunction_of_goals_is_each_of_them(depot_kb: KnowledgeBase) -> None:
    crane = Atom("ready", (T,))
    someone = Exists((TRUCK,), crane)
    goal = And((at(), someone, And((IDLE, Not(IDLE)))))
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
    assert depot_kb.goals.get_all() == [at(), IDLE, someone, Not(IDLE)]
    depot_kb.goals.delete(literals[0])
    assert at() not in depot_kb.pddl.problem().goal
    assert depot_kb.goals.delete(And((IDLE, at()))) is True
    assert depot_kb.goals.delete_all() == 2
    assert depot_kb.pddl.problem().goal == ()


def test_a_goal_refers_to_what_it_mentions(depot_kb: KnowledgeBase) -> None:
    depot_kb.goals.save(Exists((TRUCK,), at(T, P1)))
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

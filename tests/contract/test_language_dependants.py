"""What mentions a definition goes with it, or keeps it as it is, on every backend."""

from __future__ import annotations

from typing import Any

import pytest
from sqlalchemy import text

from kant_sql import (
    DependantsError,
    KnowledgeBase,
    PddlActionDto,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlTypeDto,
)
from kant_sql.dto import formulas as f
from tests.support.parts import dao_of
from tests.support.reading import last_changes, nothing_changes, rows, undone
from tests.support.worlds.depot import (
    HUB,
    IDLE,
    PLACE,
    T1,
    T2,
    TRUCK,
    P,
    T,
    again,
    at,
    check_text,
    fuel,
    home,
    number,
)

TRUCKS, PLACES = PddlTypeDto("truck", parent=PddlTypeDto("machine")), PddlTypeDto("place")
# Each sort of formula, and of action, with what it mentions.
MENTIONS: dict[str, dict[str, Any]] = {
    "predicate": {
        "derived_predicates": f.Derived("reachable", (PLACE,), f.Exists((TRUCK,), at(T, P))),
        "timed_initial_literals": f.TimedLiteral(number("5"), f.Not(at(T2))),
        "initial_literals": f.Not(at(T2)),
        "goals": f.Or((at(T2),)),
        "constraints": f.Modal("sometime", (), (at(T2),)),
        "domain_constraints": f.Modal("always", (), (f.Not(at(T1, HUB)),)),
        "actions": PddlActionDto("act", [], [f.Not(at())], [], durative=False),
    },
    "function": {
        "derived_predicates": f.Derived("idle", (), f.Comparison("<", fuel(), number("1"))),
        "timed_initial_literals": f.TimedLiteral(
            number("5"), f.Assign("assign", fuel(), number("1"))
        ),
        "goals": f.Comparison(">", fuel(T2), number("1")),
        "constraints": f.Modal("always", (), (f.Comparison(">", fuel(T2), number("1")),)),
        "metric": f.Metric("minimize", fuel()),
        "actions": PddlActionDto("act", [], [], [f.Assign("increase", fuel(), number("1"))], False),
    },
    "object": {
        "derived_predicates": f.Derived("idle", (), at()),
        "timed_initial_literals": f.TimedLiteral(number("5"), f.Not(at())),
        "initial_literals": f.Equal(T1, T2),
        "goals": f.Or((f.Equal(home(T2), HUB), at())),
        "constraints": f.Modal("sometime", (), (at(),)),
        "metric": f.Metric("minimize", fuel()),
        "actions": PddlActionDto("act", [], [at()], [], durative=False),
    },
    "type": {
        "derived_predicates": f.Derived("idle", (), f.Exists((TRUCK,), IDLE)),
        "goals": f.Exists((f.TypedName("x", ("place", "truck")),), IDLE),
        "constraints": f.Modal("always", (), (f.Exists((TRUCK,), IDLE),)),
        "actions": PddlActionDto(
            "act", [PddlObjectDto(TRUCKS, "t")], [], [f.Atom("ready", (f.Variable("t"),))], False
        ),
    },
}
DELETES: dict[str, tuple[str, Any]] = {
    "predicate": ("predicates", PddlPredicateDto("at")),
    "function": ("functions", PddlFunctionDto("fuel")),
    "object": ("objects", PddlObjectDto(TRUCKS, "t1")),
    "type": ("types", TRUCKS),
}
REDEFINITIONS: dict[str, tuple[str, Any]] = {
    "predicate": ("predicates", PddlPredicateDto("at", [TRUCKS])),
    "function": ("functions", PddlFunctionDto("fuel", [TRUCKS, TRUCKS])),
    "object": ("objects", PddlObjectDto(PLACES, "t1")),
    "type": ("types", PddlTypeDto("truck")),
}


def save(kb: KnowledgeBase, dao: str, dto: Any) -> None:
    if dao == "metric":
        kb.pddl.metric.set(dto)
    else:
        dao_of(kb, dao).save(dto)


def held(kb: KnowledgeBase, dao: str) -> list[str]:
    """What a DAO of formulas or actions gives, as text."""
    if dao == "metric":
        metric = kb.pddl.metric.get()
        return [] if metric is None else [str(metric)]
    return [str(each) for each in dao_of(kb, dao).get_all()]


@pytest.mark.parametrize("kind", MENTIONS)
def test_what_mentions_it_is_deleted_with_it(depot_kb: KnowledgeBase, kind: str) -> None:
    mentions = MENTIONS[kind]
    for dao, dto in mentions.items():
        save(depot_kb, dao, dto)
    made = depot_kb.revision
    deleting, what = DELETES[kind]
    assert dao_of(depot_kb, deleting).delete(what) is True
    assert depot_kb.revision == made + 1
    lines = last_changes(depot_kb)
    for dao, dto in mentions.items():
        assert [line for line in lines if line.startswith("- ") and str(dto) in line], dao
    for reader in (depot_kb, again(depot_kb)):
        assert {dao: held(reader, dao) for dao in mentions} == {dao: [] for dao in mentions}
        check_text(reader)
    for dao, dto in mentions.items():
        assert held(depot_kb.at(made), dao) == [str(dto)]
    check_text(depot_kb.at(made))


@pytest.mark.parametrize("kind", MENTIONS)
def test_what_mentions_it_refuses_its_redefinition(depot_kb: KnowledgeBase, kind: str) -> None:
    mentions = MENTIONS[kind]
    redefining, other = REDEFINITIONS[kind]
    with depot_kb.transaction():
        depot_kb.propositions.delete_all()
        depot_kb.function_values.delete_all()
        if kind == "type":
            depot_kb.objects.delete_all()
    for dao, dto in mentions.items():
        with undone(depot_kb):
            save(depot_kb, dao, dto)
            with pytest.raises(DependantsError) as alone:
                dao_of(depot_kb, redefining).save(other)
            assert len(alone.value.dependants) == 1, dao
    with undone(depot_kb):
        dao_of(depot_kb, redefining).save(other)
    with depot_kb.transaction():
        for dao, dto in mentions.items():
            save(depot_kb, dao, dto)
    wanted = {
        "action act" if dao == "actions" else f"formula {dto}" for dao, dto in mentions.items()
    }
    with nothing_changes(depot_kb), pytest.raises(DependantsError) as caught:
        dao_of(depot_kb, redefining).save(other)
    assert {*caught.value.dependants} == wanted
    assert all(each in str(caught.value) for each in wanted)
    made = depot_kb.revision
    dao_of(depot_kb, redefining).save(other, cascade=True)
    assert depot_kb.revision == made + 1
    assert {dao: held(depot_kb, dao) for dao in mentions} == {dao: [] for dao in mentions}
    check_text(depot_kb)
    for dao, dto in mentions.items():
        assert held(depot_kb.at(made), dao) == [str(dto)]


def test_what_mentions_something_else_stays(depot_kb: KnowledgeBase) -> None:
    stay: list[f.Formula] = [f.Not(IDLE), f.Exists((PLACE,), IDLE), f.Equal(home(T2), HUB)]
    depot_kb.goals.save_all([*stay, f.Or((at(),)), f.Exists((TRUCK,), at(T, HUB))])
    depot_kb.predicates.delete(PddlPredicateDto("at"))
    assert depot_kb.goals.get_all() == stay
    depot_kb.objects.delete(PddlObjectDto(TRUCKS, "t1"))
    assert depot_kb.goals.get_all() == stay
    depot_kb.objects.delete(PddlObjectDto(TRUCKS, "t2"))
    assert depot_kb.goals.get_all() == stay[:2]


def test_names_of_parameters_may_change_below_formulas(depot_kb: KnowledgeBase) -> None:
    goal = f.Exists((TRUCK,), at(T, HUB))
    depot_kb.goals.save(goal)
    renamed = PddlPredicateDto("at", [TRUCKS, PLACES], parameter_names=["who", "where"])
    depot_kb.predicates.save(renamed)
    assert depot_kb.goals.get_all() == [goal]
    predicate = next(each for each in depot_kb.pddl.domain().predicates if each.name == "at")
    assert [part.name for part in predicate.parameters] == ["who", "where"]
    check_text(depot_kb)


DANGLING = {
    "predicate": ("formula_node", "predicate_id"),
    "function": ("formula_node", "function_id"),
    "object": ("formula_term", "object_id"),
    "type": ("formula_variable_type", "type_id"),
    "node": ("formula_term", "position"),
    "variable": ("formula_term", "variable"),
    "action's predicate": ("action_node", "predicate_id"),
    "action's parameter": ("action_term", "parameter"),
}


def test_the_database_refuses_what_dangles(depot_kb: KnowledgeBase) -> None:
    depot_kb.goals.save(f.Exists((TRUCK,), f.Or((at(T), f.Comparison("<", fuel(T), number("1"))))))
    truck = PddlObjectDto(TRUCKS, "t")
    depot_kb.actions.save(PddlActionDto("act", [truck], [at(T)], [], durative=False))
    store: Any = depot_kb.store.factory._store  # type: ignore[attr-defined]
    (id_,) = rows(depot_kb, "SELECT id FROM knowledge_base WHERE id = :kb")[0]
    driver: Any = store.backend.driver_errors
    for name, (table, column) in DANGLING.items():
        where = f"kb_id = :kb AND {column} IS NOT NULL"
        assert rows(depot_kb, f"SELECT count(*) FROM {table} WHERE {where}") != [(0,)], name
        with store.backend.engine.connect() as connection:
            statement = text(f"UPDATE {table} SET {column} = {column} + 4000000 WHERE {where}")
            with pytest.raises(Exception, match=r"(?i)foreign key") as caught:
                connection.execute(statement, {"kb": id_})
            assert isinstance(caught.value.__cause__, driver), name
            connection.rollback()
    check_text(again(depot_kb))


def test_fluents_within_terms_are_mentioned(depot_kb: KnowledgeBase) -> None:
    depot_kb.goals.save(f.Not(at(T1, home(T2))))
    depot_kb.functions.delete(PddlFunctionDto("home"))
    assert depot_kb.goals.get_all() == []
    assert f.Fluent("home", (T1,)) not in [value.fluent for value in depot_kb.pddl.problem().values]

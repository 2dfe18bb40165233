"""Formulas that stand on their own, each sort through its DAO, on every backend."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from kant_sql import KnowledgeBase, ReadOnlyError
from kant_sql.dto import formulas as f
from kant_sql.errors import InvalidKnowledgeError
from tests.support.parts import dao_of
from tests.support.reading import last_changes, nothing_changes, rows
from tests.support.worlds.depot import (
    C1,
    CONSTRAINTS,
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
    calculated,
    check_text,
    distance,
    fuel,
    home,
    load,
    number,
)


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
    with pytest.raises(InvalidKnowledgeError, match="term 2 of"):
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

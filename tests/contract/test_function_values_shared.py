"""How writers share the values of functions, and that nothing of them is lost."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import KnowledgeBase, PddlFunctionDto
from kant_sql.knowledge.atoms import FluentKey, FluentValue
from tests.support.chain import check_chain
from tests.support.processes.workers import change, in_processes
from tests.support.profile import PROFILE, hunting
from tests.support.reading import last_changes, rows, undone
from tests.support.stores import Connect, Everywhere
from tests.support.worlds import robots
from tests.support.worlds.depot import again


def test_the_seam_for_files_takes_rows_without_dtos(kb: KnowledgeBase) -> None:
    kb.function_values.save_all(map(robots.distance, range(2)))
    store: Any = kb.store.factory._store  # type: ignore[attr-defined]
    with store.transaction() as transaction:
        functions, objects = transaction.definitions.functions, transaction.definitions.objects
        one, zero = objects.named("wp1"), objects.named("wp0")
        key = FluentKey(functions.named("distance").id, f"{zero.id} {one.id}")
        entries = [
            (key, "(distance wp0 wp1)", FluentValue("3.50")),
            (key, "(distance wp0 wp1)", FluentValue("3.5")),
            (key._replace(arguments=f"{one.id} {zero.id}"), "(distance wp1 wp0)", FluentValue("1")),
        ]
        assert transaction.values.set_many(entries) == 1
    assert last_changes(kb) == ["+ value (= (distance wp0 wp1) 3.50)"]
    assert kb.function_values.get("distance", objects=["wp0", "wp1"]) == Decimal("3.5")


def test_a_process_sees_what_another_has_set_and_defined(shared_url: str, connect: Connect) -> None:
    one, other = connect(shared_url), connect(shared_url)
    one.propositions.save(robots.robot_at())
    assert other.function_values.get_all() == []
    one.function_values.set(robots.LOCATION, objects=[robots.RB1], value=robots.WP2)
    assert other.function_values.get("loc", objects=["rb1"]) == robots.WP2
    one.function_values.set(robots.BATTERY, objects=[robots.RB1], value=1)
    assert other.function_values.increase("battery", objects=["rb1"], by=1) == 2
    assert one.function_values.increase("battery", objects=["rb1"], by=1) == 3
    assert other.function_values.set("battery", objects=["rb1"], value=3) is False
    one.functions.delete(robots.BATTERY)
    assert other.function_values.get("battery", objects=["rb1"]) is None
    assert [str(dto) for dto in other.function_values.get_all()] == ["(= (loc rb1) wp2)"]


def test_threads_that_increase_lose_no_update(kb: KnowledgeBase) -> None:
    kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=0)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(robots.charge, [kb] * 4, [5] * 4))
    assert kb.function_values.get("battery", objects=["rb1"]) == 20 * robots.STEP
    assert kb.revision == 41


def test_processes_that_increase_lose_no_update(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=0)
    in_processes(*[(change, shared_url, robots.charge_often)] * 3)
    assert kb.function_values.get("battery", objects=["rb1"]) == 30 * robots.STEP
    assert check_chain(shared_url) == {"tiago": 61}


def test_a_transaction_that_comes_to_nothing_leaves_nothing_behind(kb: KnowledgeBase) -> None:
    cost = PddlFunctionDto("total-cost")
    kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=1)
    kb.objects.save(robots.WP1)
    kb.functions.save_all([robots.LOCATION, cost])
    with kb.transaction():
        kb.function_values.set(robots.LOCATION, objects=[robots.RB1], value=robots.WP1)
        assert len(kb.function_values.get_all()) == 2  # Now it has an id in the tables.
        kb.function_values.unset(robots.LOCATION, objects=[robots.RB1])
    kb.function_values.set(cost, objects=[], value=5)  # Now another one has this id.
    assert kb.function_values.set(robots.LOCATION, objects=[robots.RB1], value=robots.WP1) is True
    assert [str(dto) for dto in kb.function_values.get_all()] == [
        "(= (battery rb1) 1)",
        "(= (total-cost) 5)",
        "(= (loc rb1) wp1)",
    ]
    assert kb.revision == 5


def test_values_are_part_of_a_revision_that_was_too_much_to_keep(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kant_sql.store.transaction.SPILL_AT", 2)
    kb = connect(shared_url)
    kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=1)
    with kb.transaction():
        kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=2)
        kb.function_values.set(robots.LOCATION, objects=[robots.RB1], value=robots.WP1)
        kb.propositions.save_all(
            robots.robot_at(robots.RB1, robots.waypoint(number)) for number in range(9)
        )
        kb.function_values.set(robots.BATTERY, objects=[robots.RB1], value=3)
        kb.function_values.unset(robots.LOCATION, objects=[robots.RB1])
    values = [line for line in last_changes(kb) if " value " in line]
    assert values == ["+ value (= (battery rb1) 3)", "- value (= (battery rb1) 1)"]
    assert kb.function_values.increase("battery", objects=["rb1"], by=1) == 4
    assert check_chain(shared_url) == {"default": 3}


FLUENTS: list[tuple[str, tuple[str, ...]]] = [
    ("battery", ("rb1",)),
    ("battery", ("rb2",)),
    ("distance", ("wp1", "wp2")),
]
READ = ("get_all", FLUENTS[0], 0)
_calls = st.tuples(
    st.sampled_from(["set", "unset", "increase", "get", "get_all"]),
    st.sampled_from(FLUENTS),
    st.integers(0, 2),
)
_blocks = st.tuples(st.booleans(), st.lists(_calls, min_size=1, max_size=6))
_programs = st.lists(
    st.one_of(_calls, st.tuples(st.booleans(), st.lists(st.one_of(_calls, _blocks), max_size=5))),
    max_size=8,
)
State = dict[Any, Any]


def run(kb: KnowledgeBase, state: State, step: Any) -> None:
    """Do a step, or a transaction of steps that fails or not, to a knowledge base and a dict."""
    if isinstance(step[0], bool):
        fails, steps = step
        before = dict(state)
        with undone(kb) if fails else kb.transaction():
            for each in steps:
                run(kb, state, each)
        if fails:
            state.clear()
            state.update(before)
        return
    call, fluent, number = step
    values: Any = kb.function_values
    function, objects = fluent
    if call == "set":
        assert values.set(function, objects=objects, value=number) is (state.get(fluent) != number)
        state[fluent] = number
    elif call == "unset":
        assert values.unset(function, objects=objects) is (state.pop(fluent, None) is not None)
    elif call == "increase" and fluent in state:
        state[fluent] += number
        assert values.increase(function, objects=objects, by=number) == state[fluent]
    elif call == "get":
        assert values.get(function, objects=objects) == state.get(fluent)
    else:
        assert read(kb) == state


def read(kb: KnowledgeBase) -> State:
    return {
        (dto.function.name, tuple(object_.name for object_ in dto.objects)): dto.value
        for dto in kb.function_values.get_all()
    }


def text(fluent: tuple[str, tuple[str, ...]], value: int) -> str:
    return f"(= ({' '.join((fluent[0], *fluent[1]))}) {value})"


def check(kb: KnowledgeBase, program: list[Any]) -> None:
    """Run a program on a new knowledge base and on a dict, step by step."""
    kb.functions.save_all([robots.BATTERY, robots.DISTANCE])
    kb.propositions.save_all([robots.robot_at(), robots.robot_at(place=robots.WP2)])
    kb.objects.save(type(robots.RB1)(robots.RB1.type, "rb2"))
    state: State = {}
    states = [dict(state)]
    for step in program:
        revision = kb.revision
        run(kb, state, step)
        assert kb.revision - revision == (state != states[-1])
        if kb.revision > revision:
            states.append(dict(state))
    newcomer = again(kb)
    assert read(newcomer) == state
    came = 0
    for number, (before, then) in enumerate(pairwise(states), start=4):
        assert read(newcomer.at(number)) == then
        [entry] = newcomer.log(since=number, until=number)
        changes = {
            *(("+", text(*one)) for one in then.items() - before.items()),
            *(("-", text(*one)) for one in before.items() - then.items()),
        }
        assert {(one.sign, one.text) for one in entry.changes} == changes
        came += len(then.items() - before.items())
    versions = "SELECT count(*) FROM function_value_version WHERE kb_id = :kb"
    assert rows(kb, versions) == [(came,)]


def test_any_program_has_the_results_of_a_dict(everywhere: Everywhere) -> None:
    @hunting(PROFILE.programs)
    @given(_programs)
    def holds_for(program: list[Any]) -> None:
        everywhere(lambda kb: check(kb, program))

    holds_for()

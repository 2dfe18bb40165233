"""The page of a state: what held, since when, and what changed against the revision before."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql.history import state_parts
from kant_sql.history.state_parts import StateFilter, read_state
from kant_sql.knowledge_base import state_of
from tests.support.servers import Server
from tests.support.statements import explain, fill, seen
from tests.web.conftest import Filled


def part(data: Any, kind: str) -> Any:
    return next(one for one in data["parts"] if one["kind"] == kind)


def texts(data: Any, kind: str, key: str = "elements") -> list[str]:
    """The elements of one kind."""
    return [one["text"] for one in part(data, kind)[key]]


def test_a_state_has_all_that_held_and_who_said_so(client: TestClient) -> None:
    data = client.get("/api/state?kb=courier&at=9").json()
    assert (data["number"], data["head"]) == (9, 36)
    assert data["revision"]["actor"] == "executive"
    facts = part(data, "fact")
    assert (facts["total"], facts["is_counted"], facts["next"]) == (6, True, None)
    assert texts(data, "fact") == sorted(texts(data, "fact"))
    assert {one["text"]: (one["since"]["number"], one["is_new"]) for one in facts["elements"]} == {
        "(carrying rb1 cup1)": (2, False),
        "(carrying rb1 cup2)": (2, False),
        "(robot_at rb1 t1)": (9, True),
        "(robot_at rb2 kitchen)": (2, False),
        "(waiting t1)": (4, False),
        "(waiting t2)": (5, False),
    }
    assert texts(data, "goal") == ["(served t1)", "(served t2)"]
    assert texts(data, "value") == ["(= (battery rb1) 100)", "(= (battery rb2) 80)"]
    assert len(texts(data, "object")) == 12
    assert {one["kind"] for one in data["parts"]} >= {"type", "predicate", "function", "action"}


def test_what_changed_against_the_revision_before_is_marked(client: TestClient) -> None:
    data = client.get("/api/state?kb=courier").json()
    assert data["number"] == data["head"] == 36
    assert texts(data, "fact", "gone") == ["(robot_at rb1 kitchen)"]
    assert part(data, "fact")["gone"][0]["since"]["reason"] == "empty"
    page = client.get("/state?kb=courier").text
    assert "<del><a" in page
    assert 'class="tag good">new</span>' in page


@pytest.mark.parametrize(
    ("query", "facts"),
    [
        ("text=RB1", ["(carrying rb1 cup1)", "(carrying rb1 cup2)", "(robot_at rb1 t1)"]),
        ("predicate=ROBOT_AT", ["(robot_at rb1 t1)", "(robot_at rb2 kitchen)"]),
        ("object=t1", ["(robot_at rb1 t1)", "(waiting t1)"]),
        ("object=rb1&predicate=carrying&text=2", ["(carrying rb1 cup2)"]),
        ("text=%25", []),
        ("text=robot_at+rb1", ["(robot_at rb1 t1)"]),
        ("text=robotXat", []),
    ],
)
@pytest.mark.more
def test_a_state_is_filtered(client: TestClient, query: str, facts: list[str]) -> None:
    data = client.get(f"/api/state?kb=courier&at=9&kind=fact&{query}").json()
    assert texts(data, "fact") == facts
    assert part(data, "fact")["total"] == len(facts)
    assert client.get(f"/state?kb=courier&at=9&{query}").status_code == 200


def test_a_time_is_as_good_as_a_revision(client: TestClient) -> None:
    for moment, number in {"2026-03-02T09:06:26Z": 9, "0": 0, "now": 36}.items():
        answer = client.get("/api/state", params={"kb": "courier", "at": moment}).json()
        assert answer["number"] == number
    assert client.get("/state?kb=courier&at=0").status_code == 200


def walk(client: TestClient, address: str) -> Iterator[Any]:
    """Read the pages of the facts one after the other."""
    after: str | None = ""
    while after is not None:
        data = client.get(f"{address}&kind=fact&after={after}").json()
        yield part(data, "fact")
        after = part(data, "fact")["next"]


@pytest.mark.parametrize("bound", [10_000, 100])
def test_pages_have_each_element_once(
    filled: Filled, monkeypatch: pytest.MonkeyPatch, bound: int
) -> None:
    monkeypatch.setattr(state_parts, "SORTED", bound)
    kb, client = filled
    fill(kb, 450)
    kb.propositions.delete("(robot_at rb1 wp7)")
    for address, size in (("/api/state?kb=courier", 449), ("/api/state?kb=courier&at=2", 450)):
        pages = list(walk(client, address))
        assert [len(one["elements"]) for one in pages] == [200, 200, size - 400]
        assert {one["total"] for one in pages} == {size}
        assert len({each["text"] for one in pages for each in one["elements"]}) == size


@pytest.mark.parametrize("bound", [10_000, 0])
@pytest.mark.more
def test_pages_go_on_after_their_last_element(
    filled: Filled, monkeypatch: pytest.MonkeyPatch, bound: int
) -> None:
    monkeypatch.setattr(state_parts, "SORTED", bound)
    kb, _ = filled
    with kb.transaction():
        kb.load_domain(
            "(define (domain d) (:types wp) (:functions (level ?a - wp))"
            "(:predicates (awake) (zealous) (clean ?a - wp) (linked ?a ?b ?c - wp)))"
        )
        places = "wp0", "wp1", "wp2", "wp3"
        kb.objects.save_all(f"{place} - wp" for place in places)
        for place in places:
            for dao in (kb.propositions, kb.goals):
                dao.save(f"(clean {place})")
                for other in ("wp0", "wp1"):
                    dao.save(f"(linked wp0 {other} {place})")
            kb.function_values.save(f"(= (level {place}) 1)")
        kb.propositions.save_all(["(awake)", "(zealous)"])
        kb.goals.save("(or (awake) (zealous))")
    kb.propositions.delete("(clean wp1)")
    then = kb.revision
    kb.propositions.save("(clean wp1)")
    kb.propositions.delete("(awake)")
    for at in (None, then, then - 1):
        state = kb if at is None else kb.at(at)
        for kind, asked in itertools.product(
            ("fact", "goal", "value", "object"),
            (
                StateFilter(),
                StateFilter("wp1"),
                StateFilter(None, "linked"),
                StateFilter(object="wp1"),
            ),
        ):
            found: list[str] = []
            after: str | None = ""
            whole = read_state(state_of(kb), at, asked, kind, limit=500).parts
            while after is not None:
                parts = read_state(state_of(kb), at, asked, kind, after, 2).parts
                assert all(each.offset == len(found) or asked.text for each in parts)
                found += [each.text for one in parts for each in one.elements]
                after = parts[0].next if parts else None
            expected = [each.text for one in whole for each in one.elements]
            assert found == expected, (at, kind, asked)
            if asked == StateFilter() and kind == "fact":
                assert sorted(found) == sorted(map(str, state.propositions.get_all()))


def test_a_text_is_looked_for_in_a_long_state_part_by_part(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    state_parts._indexed.cache_clear()
    monkeypatch.setattr(state_parts, "SORTED", 100)
    monkeypatch.setattr(state_parts, "SEARCHED", 150)
    kb, client = filled
    fill(kb, 450)
    for at in ("", "&at=2"):
        pages = list(walk(client, f"/api/state?kb=courier&text=wp44{at}"))
        found = sorted(each["text"] for one in pages for each in one["elements"])
        assert len(pages) == 3
        assert all(one["is_searched"] for one in pages)
        assert found == sorted(f"(robot_at rb1 wp{n})" for n in (44, *range(440, 450)))
    state_parts._indexed.cache_clear()


def test_a_state_is_planned_for_the_tables_as_they_are(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A prepared statement keeps its plan for small tables when these have grown."""
    prepares: set[int | None] = set()
    execute = psycopg.Cursor.execute

    def noted(self: Any, query: Any, *args: Any, **options: Any) -> Any:
        if "count_1" in str(query):
            prepares.add(self.connection.prepare_threshold)
        return execute(self, query, *args, **options)

    with kant_sql.connect(server.new_store()) as kb:
        fill(kb, 2)
        monkeypatch.setattr(psycopg.Cursor, "execute", noted)
        assert read_state(state_of(kb), None, StateFilter(object="rb1")).parts
    assert prepares == {None}


def test_what_names_an_object_is_looked_up_one_by_one(server: Server) -> None:
    """Without statistics, an index of all open versions of a knowledge base seems as good."""
    url = server.new_store()
    with kant_sql.connect(url) as kb:
        fill(kb, 400)
        with seen() as statements:
            assert read_state(state_of(kb), None, StateFilter(object="rb1")).parts
    plans = [explain(url, one) for one in statements if "AS held" in one.sql]
    assert len(plans) == 3
    assert not [step for plan in plans for step in plan if "proposition_version_now" in step]

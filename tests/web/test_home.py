"""The first page: what it says of goals, and pages of many knowledge bases."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from kant_sql import UnsupportedConstructError
from kant_sql.knowledge_base import state_of
from kant_sql.reasoning.explain import is_goal_reached
from kant_sql.sql import inventory
from kant_sql.store.state import State
from kant_sql.web.application import create_app
from kant_sql.web.pages import home
from tests.support.faults import change
from tests.support.statements import count
from tests.support.stores import Connect
from tests.support.worlds.robots import WP2, robot_at, waypoint
from tests.web.conftest import BASE, Filled


def listed(client: TestClient, query: str = "") -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.get(f"/api/{query}").json()["knowledge_bases"]
    return found


def test_goals_are_counted_or_asked_for(filled: Filled) -> None:
    kb, client = filled
    kb.propositions.save(robot_at())
    assert 'class="none">none' in client.get("/").text
    kb.goals.save(robot_at(is_goal=True))
    kb.goals.save(robot_at(place=WP2, is_goal=True))
    assert [(one["goals"], one["reached"]) for one in listed(client)] == [(2, 1)]
    assert "1 of 2" in client.get("/").text
    kb.goals.save("(not (robot_at rb1 wp2))")
    assert [one["is_goal_reached"] for one in listed(client)] == [False]
    assert "not all reached" in client.get("/").text


def test_a_goal_that_cannot_be_judged_hides_nothing(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(state: State) -> bool:
        raise UnsupportedConstructError("not this")

    monkeypatch.setattr(home, "is_goal_reached", refuse)
    kb, client = filled
    kb.propositions.save(robot_at())
    kb.goals.save("(not (robot_at rb1 wp1))")
    assert [one["is_goal_reached"] for one in listed(client)] == [None]
    assert 'href="/ask?kb=courier"' in client.get("/").text


@pytest.mark.parametrize("goals", [2, 300])
def test_the_head_the_goals_and_whether_all_hold_take_a_statement_each(
    filled: Filled, goals: int
) -> None:
    kb, _ = filled
    kb.propositions.save(robot_at())
    kb.goals.save("(or (robot_at rb1 wp1) (robot_at rb1 wp1))")
    places = [waypoint(number) for number in range(goals)]
    kb.goals.save_all([robot_at(place=place, is_goal=True) for place in places])
    assert not is_goal_reached(state_of(kb))
    assert count(lambda: is_goal_reached(state_of(kb))) == 3


def test_many_knowledge_bases_are_paged_and_searched(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        inventory.Catalog.overview, "__kwdefaults__", {"after": None, "part": None, "limit": 2}
    )
    for number in range(5):
        connect(shared_url, knowledge_base=f"robot & {number}").propositions.save(robot_at())
    with TestClient(create_app(shared_url), base_url=BASE) as client:
        assert [one["name"] for one in listed(client)] == ["robot & 0", "robot & 1"]
        page = client.get("/").text
        assert 'href="/?after=robot+%26+1"' in page
        assert 'name="part"' in page
        assert [one["name"] for one in listed(client, "?after=robot+%26+3")] == ["robot & 4"]
        assert [one["name"] for one in listed(client, "?part=%26+3")] == ["robot & 3"]
        assert "has this text in its name" in client.get("/?part=nobody").text


def test_replicas_and_kept_verifications_are_shown(shared_url: str, connect: Connect) -> None:
    connect(shared_url, knowledge_base="tiago").propositions.save(robot_at())
    change(
        shared_url,
        "UPDATE head SET origin = 'sqlite:///<b>robot.db', origin_revision = 3,"
        " origin_committed_at = committed_at, heard_at = committed_at",
        "INSERT INTO verification (kb_id, revision, hash, verified_at)"
        " VALUES (1, 1, 'abc', '2026-03-02T15:00:00.000000Z')",
    )
    with TestClient(create_app(shared_url), base_url=BASE) as client:
        [one] = listed(client)
        assert (one["behind"], one["verified_revision"]) == (2, 1)
        page = client.get("/").text
    assert "sqlite:///&lt;b&gt;robot.db" in page
    assert "<b>robot" not in page
    assert "2 revisions behind" in page
    assert '<span class="good">up to 1</span>' in page

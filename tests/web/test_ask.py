"""Asking a condition: of a state, and when it held; names as they are typed; the description."""

from __future__ import annotations

import sqlite3
from urllib.parse import urlencode

import pytest
from fastapi.testclient import TestClient

from tests.web.conftest import get

QUESTION = "(robot_at ?r ?p)"


def test_a_condition_is_asked_of_a_state(client: TestClient) -> None:
    state = get(client, "/ask", condition=QUESTION, at="30")["state"]
    assert state["columns"] == ["r", "p"]
    assert ["rb1", "t3"] in state["answers"]
    assert (state["revision"], state["is_cut"]) == (30, False)
    at_time = get(client, "/ask", condition=QUESTION, at="2026-03-02T14:03:00Z")["state"]
    assert at_time["answers"] == state["answers"]
    one = get(client, "/ask", condition=QUESTION, at="30", limit=1)["state"]
    assert (one["answers"], one["is_cut"]) == (state["answers"][:1], True)


def test_the_statement_finds_the_same(sqlite_story: str, client: TestClient) -> None:
    state = get(client, "/ask", condition=QUESTION)["state"]
    if "sqlite" not in str(client.app.state.store.url):  # type: ignore[attr-defined]
        pytest.skip("the statement is for PostgreSQL")
    with sqlite3.connect(sqlite_story.removeprefix("sqlite:///")) as store:
        rows = store.execute(state["sql"]).fetchall()
    store.close()
    assert sorted(map(list, rows)) == sorted(state["answers"])


def test_a_condition_without_variables_says_why_it_does_not_hold(client: TestClient) -> None:
    state = get(client, "/ask", condition="(waiting t2)", at="36")["state"]
    assert (state["columns"], state["answers"]) == ([], [])
    [part] = state["unsatisfied"]
    assert part["condition"] == "(waiting t2)"
    assert part["retracted"]["actor"]
    assert get(client, "/ask", condition="(not (waiting t2))")["state"]["answers"] == [[]]


def test_when_it_held_has_both_ends(client: TestClient) -> None:
    when = get(client, "/ask", condition="(waiting ?t)", mode="when")["when"]
    assert when["total"] == len(when["periods"]) > 2
    first = when["periods"][0]
    assert first["binding"] == {"t": "t1"}
    assert first["since"]["committed_at"] == when["begin"]
    page = client.get("/ask", params={"kb": "courier", "condition": "(waiting ?t)", "mode": "when"})
    assert page.text.count('class="bar"') == when["total"]
    later = get(client, "/ask", condition="(waiting ?t)", mode="when", since="30")["when"]
    assert later["total"] < when["total"]


@pytest.mark.parametrize(
    "query",
    [
        {"condition": "(robot_at ?r"},
        {"condition": "(robot_att ?r ?p)"},
        {"condition": QUESTION, "at": "soon"},
        {"condition": QUESTION, "mode": "when", "since": "soon"},
        {"condition": QUESTION, "parameters": "(?r - nothing)"},
    ],
)
def test_what_is_wrong_is_said_beside_the_form(client: TestClient, query: dict[str, str]) -> None:
    page = client.get("/ask", params={"kb": "courier", **query})
    assert page.status_code == 400
    assert 'role="alert"' in page.text
    assert "</textarea>" in page.text
    assert client.get("/api/ask", params={"kb": "courier", **query}).status_code == 400


def test_without_a_condition_there_is_the_form(client: TestClient) -> None:
    assert get(client, "/ask") == {"condition": "", "state": None, "when": None}
    assert client.get("/ask", params={"kb": "nobody"}).status_code == 404


def test_names_are_completed(client: TestClient) -> None:
    query = urlencode({"kb": "courier", "beginning": "RO"})
    names = client.get(f"/api/names?{query}").json()["names"]
    assert names[0]["kind"] == "predicate"
    assert names[0]["name"] == "robot_at"
    assert client.get(f"/api/names?{query}&at=0").json()["names"] == []


@pytest.mark.more
def test_the_description_links_every_document(client: TestClient) -> None:
    page = client.get("/api").text
    assert "/api/ask" in page
    assert 'id="Revision"' in page
    for part in page.split('href="#')[1:]:
        target = part.split('"')[0]
        assert f'id="{target}"' in page, target

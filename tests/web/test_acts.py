"""The pages of executions: their list by pages, and each with what it changed."""

from __future__ import annotations

import re

import pytest
from fastapi.testclient import TestClient

from kant_sql.json_values import json_value
from kant_sql.web.pages import acts
from tests.support.crawling import Markup
from tests.web.conftest import Filled, get, statements_of, walk


def test_an_outcome_is_told_from_the_words_of_its_act(filled: Filled) -> None:
    kb, client = filled
    told = kb.executions.report('say ") failed', arguments=[") refused (x)"], outcome="succeeded")
    page = client.get("/act", params={"kb": "courier", "id": told.id}).text
    assert "<tr><td>succeeded</td>" in page


def test_acts_are_the_librarys_and_lead_to_names(busy: Filled) -> None:
    kb, client = busy
    listed = get(client, "/acts")["executions"]
    assert listed == [json_value(one) for one in kb.executions.get_all()]
    outcomes = ["running", "failed", "refused", "succeeded"]
    assert [one["outcome"] for one in listed] == outcomes
    running, failed, refused, moved = listed
    assert failed["arguments"] == ["rb1", "bay <b>4</b>"]
    assert failed["references"] == [False, True, False]
    assert moved["references"] == [True] * 4
    assert running["due_at"] is not None
    assert {one["due_at"] for one in (failed, refused, moved)} == {None}
    links = Markup(client.get("/acts?kb=courier").text).links
    assert "/action?kb=courier&name=dock" in links
    assert "/object?kb=courier&name=room" in links
    assert not any("name=Dock" in link or "bay" in link for link in links)
    assert f"/act?kb=courier&id={failed['execution']}" in links


@pytest.mark.parametrize(
    ("query", "acts_found"),
    [
        ({"outcome": "failed"}, ["Dock"]),
        ({"object": "ROOM"}, ["move", "move"]),
        ({"action": "dock", "actor": "filler"}, ["dock"]),
        ({"since": "1", "until": "4"}, ["move"]),
    ],
)
@pytest.mark.more
def test_acts_are_found_as_at_the_prompt(
    busy: Filled, query: dict[str, str], acts_found: list[str]
) -> None:
    found = get(busy[1], "/acts", **query)["executions"]
    assert [one["action"] for one in found] == acts_found


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("/acts?action=mov", 404, "never had the action"),
        ("/acts?object=rb9", 404, "never had the object"),
        ("/acts?actor=nobody", 404, "nobody"),
        ("/acts?outcome=done", 422, "outcome"),
        ("/acts?after=[[0,[1],0]]", 400, "the value of `next` of a page"),
        ("/act?id=77", 404, "no execution 77"),
        ("/act?id=1.9", 404, "no execution 1.9"),
        ("/act?id=one", 400, "is not the id of an execution"),
    ],
)
@pytest.mark.more
def test_what_never_was_done_is_said(client: TestClient, path: str, status: int, said: str) -> None:
    for prefix in ("/api", ""):
        answer = client.get(f"{prefix}{path}&kb=courier")
        assert (answer.status_code, said in answer.text) == (status, True), answer.text


@pytest.mark.more
def test_pages_go_on_and_cost_the_same_with_more_rows(
    busy: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = busy
    monkeypatch.setattr(acts, "EXECUTIONS", 3)
    before = statements_of(client, "/acts?kb=courier")
    with kb.transaction():
        for number in range(8):
            kb.executions.report(f"act {number}", outcome="succeeded")
    assert statements_of(client, "/acts?kb=courier") <= before
    seen = [one["execution"] for page in walk(client, "/acts") for one in page["executions"]]
    assert seen == [one.id for one in kb.executions.get_all()]


def test_an_act_has_its_outcomes_and_what_it_changed(busy: Filled) -> None:
    kb, client = busy
    (dock,) = kb.executions.get_all(outcome="running")
    with kb.transaction(execution=dock, reason="half way"):
        kb.propositions.save("(at rb1 hall)")
    kb.end(dock)
    data = get(client, "/act", id=dock.id)
    assert [one["kind"] for one in data["outcomes"]] == ["execution", "execution"]
    changes = [
        [change["sign"] + change["text"] for change in one["changes"] if change["kind"] == "fact"]
        for one in data["changed"]
    ]
    assert changes == [["-(docking rb1)"], ["+(at rb1 hall)"], ["+(docking rb1)"]]
    assert (data["total"], data["outcome"], data["due_at"]) == (3, "succeeded", None)
    page = client.get(f"/act?kb=courier&id={dock.id}").text
    assert page.index("half way") < page.index("(docking rb1)</code>", page.index("half way"))
    # The revision that names it, and the object, lead here.
    number = data["changed"][1]["number"]
    for other in (f"/revision?number={number}", "/object?name=rb1", "/log?"):
        assert (
            f"/act?kb=courier&id={dock.id}" in Markup(client.get(f"{other}&kb=courier").text).links
        )


def test_what_an_act_shows_is_bounded(busy: Filled, monkeypatch: pytest.MonkeyPatch) -> None:
    kb, client = busy
    (dock,) = kb.executions.get_all(outcome="running")
    monkeypatch.setattr(acts, "REVISIONS", 2)
    before = statements_of(client, f"/act?kb=courier&id={dock.id}")
    for _ in range(6):
        with kb.transaction(execution=dock):
            kb.executions.report("wait", outcome="succeeded")
    assert statements_of(client, f"/act?kb=courier&id={dock.id}") <= before
    data = get(client, "/act", id=dock.id)
    assert (data["total"], len(data["changed"]), len(data["revisions"])) == (7, 2, 2)
    assert re.search(r"the last 2 of\s+7", client.get(f"/act?kb=courier&id={dock.id}").text)


def test_a_step_of_a_plan_is_an_act(client: TestClient) -> None:
    data = get(client, "/act", id="1.2")
    assert (data["plan"], data["position"], data["outcome"]) == (1, 2, "failed")
    assert "/plan?kb=courier&id=1" in Markup(client.get("/act?kb=courier&id=1.2").text).links
    assert "/act?kb=courier&id=1.2" in Markup(client.get("/plan?kb=courier&id=1").text).links

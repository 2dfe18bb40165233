"""The timeline as JSON, as a figure and as a page."""

from __future__ import annotations

import html
import re
from typing import Any

import plotly.graph_objects as go
import pytest
from fastapi.testclient import TestClient

from kant_sql.web.pages import timeline as page_of_timelines
from kant_sql.web.plotly_script import style_ids

NARROW = "kb=courier&object=rb1&since=2026-03-02 14:00&until=2026-03-02 14:30"


def test_the_json_says_who_and_why(client: TestClient) -> None:
    data = client.get(f"/api/timeline?{NARROW}&predicate=robot_at").json()
    bars = {lane["text"]: lane["bars"] for lane in data["lanes"]}
    (visit,) = bars["(robot_at rb1 t3)"]
    assert (visit["since_at"], visit["until_at"]) == (
        "2026-03-02T14:01:00.000000Z",
        "2026-03-02T14:20:00.000000Z",
    )
    assert (visit["actor"], visit["reason"], visit["ended_reason"]) == (
        "executive",
        "arrived",
        "empty",
    )
    assert (data["since"], data["until"]) == (
        "2026-03-02T14:00:00.000000Z",
        "2026-03-02T14:30:00.000000Z",
    )
    assert data["next"] is None


def test_plans_have_their_outcomes(client: TestClient) -> None:
    (plan,) = client.get("/api/timeline?kb=courier&kind=plan").json()["plans"]
    assert [step["status"] for step in plan["steps"]] == [
        "succeeded",
        "succeeded",
        "failed",
        "aborted",
    ]
    assert plan["steps"][2]["ended_reason"] == "blocked by a chair"


def test_what_is_too_short_is_counted(client: TestClient) -> None:
    data = client.get("/api/timeline?kb=courier&predicate=open&slices=1").json()
    ((density,),) = (lane["densities"] for lane in data["lanes"])
    assert (density["count"], density["is_capped"]) == (3, False)


def test_the_figure_is_one_of_plotly(client: TestClient) -> None:
    def figure(more: str = "") -> Any:
        return client.get(f"/api/timeline/figure?{NARROW}{more}").json()

    assert len(go.Figure(figure()).data) > 1
    assert figure() != figure("&dark=true")
    targets = {target for trace in figure()["data"] for target in trace["customdata"]}
    assert "/fact?kb=courier&text=%28robot_at+rb1+t3%29" in targets


def test_the_page_has_the_same_as_text(client: TestClient) -> None:
    page = client.get(f"/timeline?{NARROW}").text
    assert "(robot_at rb1 t3)" in page
    assert "arrived" in page
    assert "More lanes" not in page
    assert "data-live" not in page.partition('id="shown"')[2][:20]
    assert 'id="shown" data-live' in client.get("/timeline?kb=courier").text


def test_lanes_come_in_pages(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_of_timelines, "LANES", 15)
    first = client.get("/api/timeline?kb=courier").json()
    assert len(first["lanes"]) == 15
    page = client.get("/timeline?kb=courier&kind=&text=").text
    (address,) = re.findall(r'rel="next" href="([^"]*)"', page)
    rest = client.get(f"/api{html.unescape(address)}").json()
    assert len(rest["lanes"]) == 3
    assert rest["next"] is None
    assert "First lanes" in client.get(html.unescape(address)).text


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("since=5&until=3", "the window ends before it begins"),
        ("since=yesteryear", "neither a revision"),
        ("after=somewhere", "expected the value of `next` of a timeline"),
    ],
)
def test_a_wrong_question_is_answered_in_the_form(
    client: TestClient, query: str, said: str
) -> None:
    answer = client.get(f"/timeline?kb=courier&{query}")
    assert answer.status_code == 400
    assert said in answer.text.replace("&#39;", "'")
    assert 'name="predicate"' in answer.text
    assert client.get(f"/api/timeline?kb=courier&{query}").status_code == 400


def test_the_script_of_plotly_finds_its_styles_made(client: TestClient) -> None:
    page = client.get("/timeline?kb=courier").text
    assert style_ids()
    assert all(f'id="{name}"' in page for name in style_ids())
    script = client.get("/static/plotly.min.js").text
    assert script.count('createElement("style")') == 2
    assert ".no-inline-styles" in script

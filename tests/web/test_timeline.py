"""The timeline as JSON, and as a page with its drawing."""

from __future__ import annotations

import html
import re
from urllib.parse import parse_qs

import pytest
from fastapi.testclient import TestClient

from kant_sql.web.pages import timeline as page_of_timelines
from tests.support.statements import count

NARROW = "kb=courier&object=rb1&since=2026-03-02 14:00&until=2026-03-02 14:30"


def test_the_json_says_who_and_why(client: TestClient) -> None:
    data = client.get(f"/api/timeline?{NARROW}&predicate=robot_at").json()
    bars = {lane["text"]: lane["bars"] for lane in data["lanes"]}
    (visit,) = bars["(robot_at rb1 t3)"]
    assert visit["since_at"] == "2026-03-02T14:01:00.000000Z"
    assert visit["until_at"] == "2026-03-02T14:20:00.000000Z"
    said = visit["actor"], visit["reason"], visit["ended_reason"]
    assert said == ("executive", "arrived", "empty")
    assert data["since"] == "2026-03-02T14:00:00.000000Z"
    assert data["until"] == "2026-03-02T14:30:00.000000Z"
    assert data["next"] is None


def test_plans_have_their_outcomes(client: TestClient) -> None:
    (plan,) = client.get("/api/timeline?kb=courier&kind=plan").json()["plans"]
    statuses = [step["status"] for step in plan["steps"]]
    assert statuses == ["succeeded", "succeeded", "failed", "aborted"]
    assert plan["steps"][2]["ended_reason"] == "blocked by a chair"


def test_what_is_too_short_is_counted(client: TestClient) -> None:
    data = client.get("/api/timeline?kb=courier&predicate=open&slices=1").json()
    ((density,),) = (lane["densities"] for lane in data["lanes"])
    assert (density["count"], density["is_capped"]) == (3, False)


def test_the_page_has_a_drawing_that_leads_to_facts(client: TestClient) -> None:
    page = client.get(f"/timeline?{NARROW}").text
    assert "robot_at rb1: dock, t3, kitchen" in page or "robot_at rb1: t3, kitchen" in page
    assert "/fact?kb=courier&amp;text=%28robot_at+rb1+t3%29" in page
    assert "executive: arrived" in page
    plan = client.get("/timeline?kb=courier&kind=plan").text
    assert "(move rb1 dock t1) succeeded" in plan
    assert "/plan?kb=courier&amp;id=1" in plan


def test_the_page_reads_its_lanes_once(client: TestClient) -> None:
    client.get(f"/timeline?{NARROW}")
    drawn = count(lambda: client.get(f"/timeline?{NARROW}"))
    assert drawn == count(lambda: client.get(f"/api/timeline?{NARROW}"))
    assert drawn <= 25


def test_other_windows_are_links(client: TestClient) -> None:
    page = client.get(f"/timeline?{NARROW}&predicate=robot_at").text
    tools = {
        name: parse_qs(html.unescape(address).partition("?")[2])
        for address, name in re.findall(r'<a class="button" href="([^"]*)"[^>]*>([^<]*)<', page)
    }
    assert [*tools] == ["← Earlier", "Later →", "Zoom in", "Zoom out", "Everything"]
    inner = tools["Zoom in"]
    assert inner["since"] == ["2026-03-02T14:07:30.000000Z"]
    assert inner["until"] == ["2026-03-02T14:22:30.000000Z"]
    assert tools["Later →"]["until"] == ["2026-03-02T14:45:00.000000Z"]
    assert tools["Everything"] == {"kb": ["courier"], "object": ["rb1"], "predicate": ["robot_at"]}
    # A part of the axis leads to its own window.
    (part,) = re.findall(r'<a href="([^"]*)" aria-label="Zoom to 2026-03-02 14:10:00 until', page)
    assert "since=2026-03-02T14%3A10%3A00.000000Z" in part
    for address in re.findall(r'href="(/timeline[^"]*)"', page):
        assert client.get(html.unescape(address)).status_code == 200


def test_what_never_changed_is_folded_away_with_a_link_to_it(client: TestClient) -> None:
    address = "/timeline?kb=courier&since=2026-03-02 14:30&until=2026-03-02 15:30"
    page = client.get(address).text
    assert client.get(f"/api{address}").json()["folded"] == 8
    assert "8 more never changed in this time." in page
    assert "(served t1)" not in page
    (unfold,) = re.findall(r'<a href="([^"]*unchanged=True[^"]*)"', page)
    assert "(served t1)" in client.get(html.unescape(unfold)).text
    data = client.get(f"/api{html.unescape(unfold)}").json()
    assert data["folded"] is None
    assert len(data["lanes"]) == 9


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
        ("kind=facts", "a kind"),
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

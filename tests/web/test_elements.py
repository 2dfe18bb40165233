"""The pages of facts, objects, definitions and plans, and the search."""

from __future__ import annotations

import sys
from pathlib import Path
from urllib.parse import urlencode

import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql import PddlObjectDto, PddlTypeDto
from kant_sql.history import versions
from kant_sql.json_values import json_value
from kant_sql.planning import Plan, PlanStep
from kant_sql.web.pages import plans
from kant_sql.web.pages.elements import _difference
from kant_sql.web.rendering import address_of
from tests.support.statements import fill
from tests.web.conftest import Filled, archive_some, get, walk


def plan_id(client: TestClient) -> int:
    (plan,) = get(client, "/plans")["plans"]
    found: int = plan["plan"]
    return found


@pytest.mark.parametrize(
    "text",
    ["(robot_at rb1 t1)", "(ROBOT_AT  rb1 t1)", "(battery rb1)", "rb1 - robot", "(served t1)"],
)
@pytest.mark.more
def test_the_history_of_an_element_is_the_librarys(
    client: TestClient, story_url: str, text: str
) -> None:
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        expected = [json_value(version) for version in kb.history(text)]
    data = get(client, "/fact", text=text)
    assert sorted(map(str, data["versions"])) == sorted(map(str, expected))
    since = [version["since"]["number"] for version in data["versions"]]
    assert since == sorted(since, reverse=True)
    assert data["before"] is None


def test_a_fact_says_what_it_led_to_and_each_link_can_be_followed(filled: Filled) -> None:
    kb, client = filled
    kb.load_domain(
        "(define (domain doors) (:predicates (open) (shut) (seen))"
        " (:action look :precondition (and (open) (not (shut))) :effect (seen)))"
    )
    with kb.transaction(actor="camera"):
        kb.propositions.save_all(["(open)"])
    kb.apply("(look)")
    data = get(client, "/fact", text="(open)")
    [used] = data["consequences"]["links"]
    assert (used["kind"], used["used"], used["made"]) == ("execution", ["(open)"], ["(seen)"])
    assert data["origins"]["links"][0]["revision"]["actor"] == "camera"
    found = get(client, "/fact", text="(seen)")["origins"]["links"]
    assert [one["kind"] for one in found] == ["execution", "observation"]
    page = client.get("/fact", params={"kb": "courier", "text": "(seen)"}).text
    assert f"/act?kb=courier&amp;id={used['id']}" in page
    assert "/fact?kb=courier&amp;text=%28shut%29" in page


def test_a_fact_says_of_which_act_it_is_an_effect_and_who_confirmed_it(filled: Filled) -> None:
    kb, client = filled
    kb.load_domain("(define (domain day) (:predicates (lit)) (:action light :effect (lit)))")
    kb.apply("(light)")
    [done] = kb.executions.get_all()

    def lead() -> str:
        page = client.get("/fact", params={"kb": "courier", "text": "(lit)"}).text
        return page[page.index('class="lead"') :].split("</p>")[0]

    assert f"execution {done.id}</a>. Not confirmed." in lead()
    with kb.transaction(actor="camera 4"):
        kb.propositions.confirm("(lit)")
    confirmed = lead().split("Confirmed last in")[1]
    assert "camera 4" in confirmed
    [version] = get(client, "/fact", text="(lit)")["versions"]
    assert (version["acts"], version["confirmed"]["actor"]) == ([done.id], "camera 4")


def test_the_first_line_of_a_fact_says_who_when_and_why(client: TestClient) -> None:
    page = client.get("/fact", params={"kb": "courier", "text": "(robot_at rb2 t4)"}).text
    lead = page[page.index('class="lead"') :].split("</p>")[0]
    for said in ("Fact holds", "perception", "2026-03-02 14:00:00", "seen by camera 4"):
        assert said in lead
    gone = get(client, "/fact", text="(robot_at rb1 kitchen)")["latest"][0]
    assert gone["until"]["actor"] == "operator"
    goal = get(client, "/fact", text="(served t1)")["latest"]
    assert {(one["kind"], one["until"]) for one in goal} == {("fact", None), ("goal", None)}


@pytest.mark.more
def test_a_fact_leads_to_its_objects_and_to_steps_of_plans(client: TestClient) -> None:
    data = get(client, "/fact", text="(robot_at rb1 t1)")
    assert (data["head"], data["objects"]) == ("robot_at", ["rb1", "t1"])
    assert [(step["position"], step["text"], step["status"]) for step in data["steps"]] == [
        (2, "(move rb1 t1 t2)", "failed"),
        (1, "(serve rb1 cup1 t1)", "succeeded"),
        (0, "(move rb1 dock t1)", "succeeded"),
    ]
    assert data["versions"][0]["since"]["execution"]["position"] == 2


def test_an_object_has_everything_that_involves_it(client: TestClient) -> None:
    data = get(client, "/object", name="RB1")
    assert data["name"] == "rb1"
    assert [one["text"] for one in data["held"]] == [
        "(carrying rb1 cup2)",
        "(robot_at rb1 dock)",
        "(= (battery rb1) 100)",
    ]
    changes = [(one["revision"]["number"], one["sign"], one["text"]) for one in data["changes"]]
    assert changes[:3] == [
        (36, "+", "(robot_at rb1 dock)"),
        (36, "-", "(robot_at rb1 kitchen)"),
        (33, "+", "(= (battery rb1) 100)"),
    ]
    assert changes[-1] == (2, "+", "rb1 - robot")
    # With the ten of its steps of plans.
    assert len(changes) == 34
    assert [step["position"] for step in data["steps"]] == [3, 2, 1, 0]
    gone = get(client, "/object", name="front")
    assert gone["versions"][0]["until"]["reason"] == "door taken out"
    assert gone["held"] == []


@pytest.mark.parametrize("most", [20_000, 3])
@pytest.mark.more
def test_the_pages_of_an_object_have_each_change_once(
    client: TestClient, story_url: str, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    from kant_sql.web.pages import elements

    monkeypatch.setattr(elements, "CHANGES", 5)
    monkeypatch.setattr(versions, "INVOLVED", most)
    monkeypatch.setattr(versions, "NEAR", 3)
    monkeypatch.setattr(versions, "WINDOW", 10)
    for built in (versions._versions_of_object, versions._involving):
        built.cache_clear()
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        expected = {
            (entry.revision.number, *change)
            for entry in kb.log()
            for change in entry.changes
            if change.kind == "execution" or ("rb1" in change.text and change.kind != "plan")
        }
    found = [
        (one["revision"]["number"], one["sign"], one["kind"], one["text"])
        for data in walk(client, "/object", "before", name="rb1")
        for one in data["changes"]
    ]
    for built in (versions._versions_of_object, versions._involving):
        built.cache_clear()
    assert sorted(found) == sorted(expected)


def test_an_action_shows_what_changed_in_it(client: TestClient) -> None:
    data = get(client, "/action", name="move")
    now, before = data["versions"]
    assert (now["since"]["number"], before["until"]["number"]) == (23, 23)
    different = [line for line in now["difference"] if line[:2] != "  "]
    assert different == ["-   :duration (= ?duration 60)", "+   :duration (= ?duration 90)"]
    assert before["difference"] == []
    assert [step["position"] for step in data["steps"]] == [2, 0]
    for path, name in (("predicate", "robot_at"), ("function", "battery"), ("type", "table")):
        found = get(client, f"/{path}", name=name)
        assert [one["kind"] for one in found["versions"]] == [path]


def test_a_plan_has_its_steps_with_their_outcomes(client: TestClient) -> None:
    id_ = plan_id(client)
    (line,) = get(client, "/plans")["plans"]
    assert (line["steps"], line["outcomes"]) == (4, {"succeeded": 2, "failed": 1, "aborted": 1})
    data = get(client, "/plan", id=id_)
    assert (data["plan"]["planner"], data["recorded"]["number"], data["total"]) == ("aries", 7, 4)
    steps = data["steps"]
    assert [step["outcome"] for step in steps] == ["succeeded", "succeeded", "failed", "aborted"]
    assert [step["revisions"] for step in steps] == [[8, 9], [10, 11], [12, 13], [14]]
    failed = steps[2]["outcomes"][-1]
    assert failed["since"]["actor"] == "executive"
    assert failed["since"]["reason"] == "blocked by a chair"


def test_a_plan_shows_who_wrote_while_a_step_ran(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = filled
    fill(kb, 3)
    step = PlanStep(None, "navigation", ("rb1", "wp0", "wp1"))
    plan = kb.plans.record(Plan((step, step, step), "by hand", "unknown"))
    first, second, _ = plan.steps
    kb.plans.set_status(first, status="running")
    with kb.transaction(actor="janitor", reason="closed the door"):
        kb.propositions.delete("(robot_at rb1 wp1)")
    with kb.transaction(execution=first):
        kb.plans.set_status(first, status="failed")
    kb.plans.set_status(second, status="aborted")
    kb.plans.set_status(plan.steps[2], status="running")
    begun = plan.recorded_in + 1

    def meanwhile() -> list[tuple[list[int], int]]:
        steps = get(client, "/plan", id=plan.id)["steps"]
        return [([one["number"] for one in each["meanwhile"]], each["total"]) for each in steps]

    assert meanwhile() == [([begun, begun + 1, begun + 2], 3), ([], 0), ([kb.revision], 1)]
    page = client.get("/plan", params={"kb": "courier", "id": plan.id}).text
    assert "janitor" in page
    assert "closed the door" in page
    monkeypatch.setattr(plans, "REVISIONS", 2)
    assert meanwhile()[0] == ([begun + 1, begun + 2], 3)


@pytest.mark.more
def test_what_a_planner_was_given_is_shown_and_downloaded(client: TestClient) -> None:
    id_ = plan_id(client)
    data = get(client, "/given", id=id_)
    assert "(define (domain restaurant)" in data["domain"]
    assert "(:init" in data["problem"]
    file = client.get(f"/api/given.pddl?kb=courier&id={id_}&part=problem")
    assert file.text == data["problem"]
    assert file.headers["content-type"].startswith("text/plain")
    assert "attachment" in file.headers["content-disposition"]
    assert client.get("/api/given.pddl?kb=courier&id=9999&part=problem").status_code == 404


@pytest.mark.parametrize(
    ("q", "first"),
    [
        ("rb1", ("object", "rb1")),
        ("MOVE", ("action", "move")),
        ("robot_at", ("predicate", "robot_at")),
        ("batt", ("function", "battery")),
        ("(robot_at rb1 t1)", ("fact", "(robot_at rb1 t1)")),
        ("%", None),
    ],
)
@pytest.mark.more
def test_a_search_leads_to_what_is_meant(
    client: TestClient, q: str, first: tuple[str, str] | None
) -> None:
    matches = get(client, "/search", q=q)["matches"]
    assert (matches[0]["kind"], matches[0]["text"]) == first if first else matches == []
    for match in matches:
        place = address_of(match["kind"], match["text"])
        assert place is not None
        assert client.get(place.path, params={"kb": "courier", **place.query}).status_code == 200


@pytest.mark.more
def test_the_name_itself_is_found_among_thousands_that_begin_so(filled: Filled) -> None:
    kb, client = filled
    kb.load_domain(
        "(define (domain d) (:types box) (:predicates (full ?b - box) (by ?a ?b - box)))"
    )
    names = [f"Box-{number}" for number in (1, *range(100, 220), *range(1000, 12_000))]
    kb.objects.save_all(PddlObjectDto(PddlTypeDto("box"), name) for name in [*names, "Big-box-1"])
    kb.propositions.save("(full Box-1)")
    kb.propositions.save_all(f"(by {one} {names[0]})" for one in names[1:3])
    kb.propositions.save_all(f"(full {name})" for name in [*names[1:], "Big-box-1"])
    with kb.transaction(actor="box-1"):
        kb.propositions.delete("(full Box-100)")
    with kb.transaction(actor="the box-1 seller"):
        kb.propositions.save("(full Box-100)")
    found = get(client, "/search", q="box-1")
    matches = [(one["kind"], one["text"]) for one in found["matches"]]
    assert set(matches[:2]) == {("object", "Box-1"), ("actor", "box-1")}
    assert all(kind == "object" and text.startswith("Box-1") for kind, text in matches[2:51])
    assert (len(matches), found["is_cut"]) == (100, True)
    assert matches.index(("fact", "(full Box-1)")) < matches.index(("object", "Big-box-1"))
    found = get(client, "/search", q="seller")
    assert ([one["text"] for one in found["matches"]], found["is_cut"]) == (
        ["the box-1 seller"],
        False,
    )
    # Few are listed of each kind.
    assert get(client, "/search", q="(full")["is_cut"]
    assert get(client, "/search", q="full box-1")["matches"][0]["text"] == "(full Box-1)"


@pytest.mark.more
def test_a_search_knows_revisions_and_times(client: TestClient) -> None:
    assert get(client, "/search", q="12")["revision"] == 12
    assert get(client, "/search", q="37")["revision"] is None
    moment = get(client, "/search", q="2026-03-02 14:03")["moment"]
    assert get(client, "/state", at=moment)["number"] == 30
    assert get(client, "/search")["matches"] == []


@pytest.mark.more
def test_the_history_of_a_fact_is_read_page_by_page(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 3)
    for _ in range(60):
        kb.propositions.delete("(robot_at rb1 wp1)")
        kb.propositions.save("(robot_at rb1 wp1)")
    pages = walk(client, "/fact", "before", text="(robot_at rb1 wp1)")
    found = [version["since"]["number"] for data in pages for version in data["versions"]]
    assert found == [version.since.number for version in kb.history("(robot_at rb1 wp1)")][::-1]


@pytest.mark.more
def test_an_archive_is_named(filled: Filled, tmp_path: Path) -> None:
    kb, client = filled
    archive_some(kb, tmp_path)
    data = get(client, "/fact", text="(robot_at rb1 wp1)")
    assert data["archived"] == 5
    page = client.get("/fact", params={"kb": "courier", "text": "(robot_at rb1 wp1)"}).text
    assert "up to revision 5 are in an archive" in page


@pytest.mark.parametrize("text", ["a&b=c", "50%", "a+b", "é ü", "“quoted”", "x" * 10_000, "#?/"])
@pytest.mark.more
def test_names_survive_addresses(filled: Filled, text: str) -> None:
    kb, client = filled
    with kb.transaction(actor=text, reason=text):
        fill(kb, 2)
    assert [one["actor"] for one in get(client, "/log", actor=text)["revisions"]] == [text]
    assert urlencode({"actor": text}) in client.get("/log?kb=courier").text
    assert [one["number"] for one in get(client, "/log", text=text)["revisions"]] == [1]


def test_definitions_with_many_lines_are_compared_in_no_time() -> None:
    older = [f"  (and (robot_at ?r wp{n * 7919 % 104729}) (x {n}))" for n in range(1000)]
    newer = [f"  (and (robot_at ?r wp{n * 7907 % 104723}) (y {n}))" for n in range(1000)]
    steps = 0

    def count(*_: object) -> None:
        nonlocal steps
        steps += 1

    sys.setprofile(count)
    try:
        lines = list(_difference(["(:action a", *older], ["(:action a", *newer]))
    finally:
        sys.setprofile(None)
    assert (lines[0], len(lines)) == ("  (:action a", 2001)
    assert steps < 100_000

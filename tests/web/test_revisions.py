"""The pages of the log, of a revision, and of the difference of two states."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

import kant_sql
from kant_sql.history import diff
from kant_sql.history import log as log_module
from kant_sql.json_values import json_value
from kant_sql.sql import changes
from kant_sql.web.rendering import shifted
from kant_sql.web.report import report_html
from tests.support.statements import fill
from tests.web.conftest import Filled, archive_some, get, walk


def numbers(page: Any) -> list[int]:
    return [line["number"] for line in page["revisions"]]


def test_the_log_is_the_librarys(client: TestClient, story_url: str) -> None:
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        entries: list[Any] = [json_value(entry) for entry in kb.log()]
    lines = get(client, "/log")["revisions"]
    for line, entry in zip(lines, entries, strict=True):
        assert {"total", "is_counted", "is_archived"} == line.keys() - entry.keys()
        assert line == {**line, **entry}


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ({"actor": "door_sensor"}, [21, 20, 19, 18, 17]),
        ({"text": "GUEST"}, [16, 15, 5, 4]),
        ({"text": "t4)"}, [34, 29]),
        ({"text": "guest", "actor": "operator"}, [16]),
        ({"text": "executive", "until": 10}, [10, 9, 8]),
        ({"text": "_"}, "any"),
        ({"text": "%"}, []),
        ({"element": "(robot_at rb1 t1)"}, [24, 13, 12, 9]),
        ({"element": "(robot_at rb1 t1)", "text": "chair"}, [13]),
        ({"element": "(robot_at rb1 t1)", "actor": "executive", "before": 13}, [12, 9]),
        ({"since": "2026-03-02T14:00Z", "until": "2026-03-02T14:01Z"}, [30, 29]),
        ({"since": 35}, [36, 35]),
    ],
)
@pytest.mark.more
def test_the_log_is_filtered(client: TestClient, query: dict[str, Any], expected: Any) -> None:
    page = get(client, "/log", **query)
    if expected == "any":
        assert 0 < len(numbers(page)) < 36
    else:
        assert numbers(page) == expected
    assert page["searched"] is None


def test_a_range_that_begins_now_is_not_the_whole_history(client: TestClient) -> None:
    for path, rows in (("log", "revisions"), ("acts", "executions"), ("statistics", "groups")):
        assert get(client, f"/{path}")[rows]
        assert get(client, f"/{path}", since="now")[rows] == []
    ended = get(client, "/ask", condition="(robot_at rb1 ?t)", mode="when", since=" NOW ")["when"]
    assert ended["periods"] == []
    assert get(client, "/timeline", since="now")["first"] == 36
    assert get(client, "/difference", a="now", b="1")["a"] == 36


def test_the_source_is_shown_and_searched_wherever_who_and_why_are(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 3)
    seen = {"sensor": "Camera 7", "confidence": 0.75}
    with kb.transaction(reason="looked", source=seen):
        kb.propositions.delete("(robot_at rb1 wp1)")
    with kb.transaction(source={"topic": "/door"}):
        kb.propositions.save("(robot_at rb1 wp1)")
    for query in ({"text": "camera 7"}, {"text": "0.75", "element": "(robot_at rb1 wp1)"}):
        assert numbers(get(client, "/log", **query)) == [kb.revision - 1]
    shown: dict[str, dict[str, Any]] = {
        **{"log": {}, "revision": {"number": kb.revision - 1}, "timeline": {}},
        **{"fact": {"text": "(robot_at rb1 wp1)"}, "object": {"name": "wp1"}},
        **{"ask": {"condition": "(robot_at rb1 wp1)", "mode": "when"}},
    }
    for path, query in shown.items():
        page = client.get(f"/{path}", params={"kb": "courier", **query}).text
        assert "Camera 7" in page, path
    assert "/door" in client.get("/state", params={"kb": "courier"}).text
    assert "Camera 7" in kb.timeline().svg()
    assert "Camera 7" in report_html(kb, verify=False).split("<h2>Log</h2>")[0]
    assert "Camera 7" in kb.history("(robot_at rb1 wp1)")._repr_html_()  # type: ignore[attr-defined]
    (period, *_) = kb.when("(robot_at rb1 wp1)")
    assert "Camera 7" in str(period)


def test_the_pages_of_a_log_have_each_revision_once(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 60)
    for number in range(60):
        kb.propositions.delete(f"(robot_at rb1 wp{number})")
    pages = list(walk(client, "/log", "before"))
    assert [number for page in pages for number in numbers(page)] == list(range(62, 0, -1))
    of_object = list(walk(client, "/log", "before", element="rb1"))
    assert [number for page in of_object for number in numbers(page)] == list(range(62, 1, -1))


def test_a_page_says_how_far_it_searched(filled: Filled, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SEARCHED_FOR_ACTOR", "SEARCHED_FOR_TEXT"):
        monkeypatch.setattr(log_module, name, 20)
    kb, client = filled
    fill(kb, 60)
    for number in range(60):
        kb.propositions.delete(f"(robot_at rb1 wp{number})")
    with kb.transaction(actor="somebody", reason="at last"):
        kb.propositions.save("(robot_at rb1 wp0)")
    for query, expected in (
        ({"actor": "filler"}, range(62, 0, -1)),
        ({"text": "wp59"}, [62, 2, 1][:2]),
        ({"text": "at last"}, [63]),
        ({"actor": "somebody"}, [63]),
    ):
        pages = list(walk(client, "/log", "before", **query))
        assert [number for page in pages for number in numbers(page)] == list(expected)
        assert len(pages) <= 5
    assert [page["searched"] for page in pages] == [44, 24, 4, None]
    assert "Searched back to revision 44" in client.get("/log?kb=courier&actor=somebody").text


def test_a_text_is_looked_for_in_so_many_changes(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = filled
    fill(kb, 40)
    for number in range(30):
        kb.propositions.delete(f"(robot_at rb1 wp{number})")
    monkeypatch.setattr(log_module, "SEARCHED_CHANGES", 10)
    monkeypatch.setattr(log_module, "_END_OF_SEARCH", log_module._end_of_search())
    pages = list(walk(client, "/log", "before", text="WP1)"))
    assert [number for page in pages for number in numbers(page)] == [4, 2]
    assert [page["searched"] for page in pages][:3] == [23, 13, 3]


def test_a_revision_of_many_changes_is_read_page_by_page(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = filled
    fill(kb, 300)
    entry = next(kb.log(since=2, until=2))
    (line,) = [one for one in get(client, "/log")["revisions"] if one["number"] == 2]
    assert (line["changes"], line["total"]) == ([], len(entry.changes))
    for bound in (5_000, 10):
        monkeypatch.setattr(changes, "SORTED", bound)
        pages = [*walk(client, "/revision", number=2)]
        assert {page["total"] for page in pages} == {len(entry.changes)}
        found = [change for page in pages for change in page["revision"]["changes"]]
        expected: Any = json_value(entry.changes)
        assert sorted(map(str, found)) == sorted(map(str, expected))
        assert found == expected or bound == 10
    assert "1 to 200 of" in client.get("/revision?kb=courier&number=2").text


@pytest.mark.parametrize(("a", "b"), [(9, 30), (30, 9), (0, 36), (36, 0), (22, 23), (5, 5), (2, 3)])
@pytest.mark.parametrize("narrow", [20_000, 0])
@pytest.mark.more
def test_the_difference_is_the_librarys(
    client: TestClient, story_url: str, monkeypatch: pytest.MonkeyPatch, a: int, b: int, narrow: int
) -> None:
    monkeypatch.setattr(diff, "NARROW", narrow)
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        expected: Any = json_value(kb.diff(a, b))
    data = client.get(f"/api/difference?kb=courier&a={a}&b={b}").json()
    assert sorted(map(str, data["changes"])) == sorted(map(str, expected))
    assert (data["a"], data["b"], data["next"], data["is_cut"]) == (a, b, None, False)
    low, high = sorted((a, b))
    between = numbers(data["between"])
    assert between == list(range(high, max(low, high - 20), -1))
    page = client.get(f"/difference?kb=courier&a={a}&b={b}").text
    assert f"/difference?kb=courier&amp;a={b}&amp;b={a}" in page


def test_a_state_is_compared_with_the_one_before(client: TestClient) -> None:
    for query, expected in {
        "": (35, 36),
        "&b=9": (8, 9),
        "&b=2026-03-02T09:06:26Z": (8, 9),
    }.items():
        data = client.get(f"/api/difference?kb=courier{query}").json()
        assert (data["a"], data["b"]) == expected


def test_a_long_difference_is_read_page_by_page(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = filled
    fill(kb, 300)
    pages = walk(client, "/difference", a=1, b=2)
    found = {str(change) for data in pages for change in data["changes"]}
    assert found == {str(json_value(change)) for change in kb.diff(1, 2)}
    diff._page.cache_clear()
    monkeypatch.setattr(diff, "COMPARED", 100)
    data = client.get("/api/difference?kb=courier&a=1&b=2").json()
    diff._page.cache_clear()
    assert data["is_cut"] is (data["next"] is None)


def test_a_page_that_begins_nowhere_is_refused(client: TestClient) -> None:
    asked = {"revision": {"number": "2"}, "difference": {"a": "1", "b": "2"}}
    for after in (
        *("x", "[", "7", "{}", "[1]", "[[1]]", "[[1,[],0]]", "[null,null,null]", "[" * 5_000),
        *("[[0,[0,0,1],0]]", '[[-1,[0,"fact",1],0]]', '[[true,[0,"fact",1],0]]'),
        *('[[0,[0,"fact",1e9],0]]', '[[0,[0,"fact",9223372036854775808],0]]'),
        *(r'[[0,[0,"a\u0000",1],0]]', r'[[0,[0,"\ud800",1],0]]'),
    ):
        for path, own in asked.items():
            place = after.replace("[[", "[null,[", 1) if path == "difference" else after
            given = {"kb": "courier", **own, "after": place}
            answer = client.get(f"/api/{path}", params=given)
            assert answer.status_code == 400, answer.text
            assert "the value of `next` of a page" in answer.text


def test_a_revision_in_an_archive_says_so(filled: Filled, tmp_path: Path) -> None:
    kb, client = filled
    archive_some(kb, tmp_path)
    data = client.get("/api/revision?kb=courier&number=4").json()
    assert "old.db" in data["archive"]
    assert client.get("/api/revision?kb=courier&number=7").json()["archive"] is None
    assert "changes are in an archive" in client.get("/revision?kb=courier&number=4").text
    lines = get(client, "/log")["revisions"]
    assert {line["number"]: line["is_archived"] for line in lines}[4] is True
    assert "old.db" in get(client, "/log", element="(robot_at rb1 wp1)")["archive"]
    answer = client.get("/difference?kb=courier&a=3&b=8")
    assert (answer.status_code, "old.db" in answer.text) == (410, True)


def test_a_revision_leads_to_the_hour_around_it(client: TestClient) -> None:
    page = client.get("/revision?kb=courier&number=13").text
    addresses = re.findall(r'href="([^"]*since=[^"]*)"', page)
    log_address, *timelines = [address.replace("&amp;", "&") for address in addresses]
    found = client.get(f"/api{log_address}").json()
    assert numbers(found) == [14, 13, 12, 11, 10, 9, 8]
    assert [client.get(address).status_code for address in timelines] == [200, 200]
    assert "(move rb1 t1 t2)" in client.get(timelines[1]).text
    assert shifted("9999-12-31T23:59:59Z", 30) is None

"""What all pages have in common: errors, links, JSON with a description."""

from __future__ import annotations

import csv
from io import StringIO
from itertools import chain
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from kant_sql.errors import StoreBusyError
from kant_sql.history import state_parts
from kant_sql.planning import Plan, PlanStep
from kant_sql.web.rendering import breaking, csv_text
from tests.browser.addresses import ADDRESSES
from tests.support.crawling import PATHS
from tests.support.statements import fill
from tests.web.conftest import Filled, statements_of


def test_the_home_page_lists_the_knowledge_bases(client: TestClient) -> None:
    listed = client.get("/api/").json()["knowledge_bases"]
    assert {one["name"]: one["revision"] for one in listed} == {"other": 2, "courier": 36}
    assert 'href="/overview?kb=courier"' in client.get("/").text


def test_a_revision_is_the_same_as_a_page_and_as_json(client: TestClient) -> None:
    data = client.get("/api/revision?kb=courier&number=5").json()["revision"]
    assert (data["actor"], data["reason"]) == ("perception", "guest sat down")
    assert data["changes"] == [{"sign": "+", "kind": "fact", "text": "(waiting t2)"}]
    page = client.get("/revision?kb=courier&number=5").text
    assert data["hash"] in page
    assert "(waiting t2)" in page


def test_errors_are_one_sentence_with_a_status(client: TestClient) -> None:
    for query, status in {
        "kb=nobody&number=1": 404,
        "kb=courier&number=99999": 404,
        "number=1": 404,
        "kb=courier&number=none": 422,
        "kb=courier": 422,
    }.items():
        page, data = client.get(f"/revision?{query}"), client.get(f"/api/revision?{query}")
        assert (page.status_code, data.status_code) == (status, status)
        assert "Traceback" not in page.text
        assert set(data.json()) == {"error", "type"}


@pytest.mark.parametrize(
    ("path", "query", "status", "said"),
    [
        ("log", {"actor": "executiv"}, 404, "did you mean executive"),
        ("log", {"acter": "executive"}, 400, "/api/log has no parameter 'acter'; it has kb, "),
        ("log", {"element": "(robot_at rb7 t1)"}, 404, "rb7"),
        ("state", {"at": "37"}, 404, "it is at 36"),
        ("state", {"at": "never"}, 400, "2026-01-31T09:30:00Z"),
        ("state", {"object": "rb9"}, 404, "did you mean rb"),
        ("state", {"predicate": "robot"}, 404, "has never had"),
        ("state", {"kind": "nothing"}, 422, "kind"),
        ("state", {"text": "\0"}, 400, "NUL"),
        *(
            ("state", {"kind": kind, "after": after}, 400, "the value of `next` of a page")
            for kind, after in (
                *(("fact", after) for after in ("-1", "[[0,[1],0]]")),
                ("goal", "[[0,[1,2,3,4],0]]"),
            )
        ),
        ("fact", {"text": "(robot_at rb1 t4)"}, 404, "has never been"),
        ("fact", {"text": "(robot_at rb7 t4)"}, 404, "did you mean rb"),
        ("fact", {"text": "(("}, 400, "not an element"),
        ("fact", {"text": ""}, 422, "text"),
        ("fact", {"text": "\x00"}, 400, "NUL character"),
        ("object", {"name": "rb7"}, 404, "did you mean rb"),
        ("object", {"name": "("}, 404, "never had an object"),
        ("action", {"name": "mov"}, 404, "did you mean move"),
        ("predicate", {"name": "battery"}, 404, "predicate"),
        ("plan", {"id": 7777}, 404, "no plan 7777"),
        ("plan", {"id": -1}, 404, "no plan"),
        ("plan", {"id": 10**30}, 404, "no plan"),
    ],
)
@pytest.mark.more
def test_what_is_wrong_or_never_was_is_said(
    client: TestClient, path: str, query: dict[str, str | int], status: int, said: str
) -> None:
    answer = client.get(f"/api/{path}", params={"kb": "courier", **query})
    assert (answer.status_code, said in answer.text) == (status, True), answer.text


def test_the_description_documents_every_answer(client: TestClient) -> None:
    described = client.get("/api/openapi.json").json()
    for path, methods in described["paths"].items():
        for method in methods.values():
            content = method["responses"]["200"]["content"]
            assert all(each["schema"] for each in content.values()), path
            assert content, path
            assert method["description"], path
            assert "422" not in method["responses"], path
            schema = method["responses"]["default"]["content"]["application/json"]["schema"]
            assert schema["$ref"].endswith("/Refusal"), path
    wrong = client.get("/api/log?kb=courier&before=x").json()
    assert wrong.keys() == described["components"]["schemas"]["Refusal"]["properties"].keys()


def undocumented(value: Any, schema: Any, schemas: dict[str, Any]) -> set[str]:
    """Return the keys of a document in which it and its description differ."""
    kinds = [one for one in schema.get("anyOf", [schema]) if one.get("type") != "null"]
    if value is None or len(kinds) != 1:
        return set()
    name = kinds[0].get("$ref", "").rpartition("/")[2]
    (kind,) = [schemas[name]] if name else kinds
    if isinstance(value, list):
        items = (undocumented(one, kind["items"], schemas) for one in value)
        return set().union(*items)
    if not isinstance(value, dict) or "properties" not in kind:
        return set()
    known = kind["properties"]
    wrong = {*value} ^ {*known}
    return wrong.union(
        *(undocumented(value[key], known[key], schemas) for key in {*value} & {*known})
    )


def test_the_description_has_each_key_of_each_answer(client: TestClient) -> None:
    described = client.get("/api/openapi.json").json()
    schemas = described["components"]["schemas"]
    for address in chain.from_iterable(ADDRESSES.values()):
        path = f"/api{address.partition('?')[0]}"
        if path not in described["paths"]:
            continue
        answer = described["paths"][path]["get"]["responses"]["200"]["content"]
        data = client.get(f"/api{address}").json()
        assert undocumented(data, answer["application/json"]["schema"], schemas) == set(), address
    assert schemas["Revision"]["properties"]["hash"]["description"]
    assert "Attributes:" not in str(schemas)


def test_a_character_that_no_text_of_a_store_has_is_the_readers_error(client: TestClient) -> None:
    required = {"number": "1", "name": "rb1", "text": "rb1", "id": "1", "part": "domain"}
    for path, methods in client.get("/api/openapi.json").json()["paths"].items():
        for one in methods.get("get", {}).get("parameters", ()):
            if path == "/api/live" and one["name"] != "kb":
                # It never ends.
                continue
            given = {"kb": "courier", **required, "condition": "(robot_at ?r ?w)"}
            answer = client.get(path, params={**given, one["name"]: "a\0b"})
            assert answer.status_code < 500, (path, one["name"], answer.text)


def test_the_id_of_an_event_that_is_no_number_to_python_is_no_error(client: TestClient) -> None:
    # Without a place for a reader, the stream does not begin, and the test ends.
    assert isinstance(client.app, FastAPI)
    client.app.state.live.admit = refuse
    answer = client.get("/api/live?kb=courier", headers={"last-event-id": "9" * 5000})
    assert answer.status_code == 503


def refuse(_: str | None) -> None:
    """Have no place for a reader."""
    raise StoreBusyError("full")


def test_the_table_of_each_page_is_csv_too(client: TestClient) -> None:
    for path in set(PATHS) - {"/api", "/given", "/verify"}:
        for address in ADDRESSES[path]:
            answer = client.get(f"/csv{address}")
            assert answer.headers["content-type"] == "text/csv; charset=utf-8", address
            assert answer.headers["content-disposition"].startswith("attachment")
    asked = "?kb=courier&actor=executive"
    rows = list(csv.DictReader(StringIO(client.get(f"/csv/log{asked}").text)))
    revisions = client.get(f"/api/log{asked}").json()["revisions"]
    assert [int(row["number"]) for row in rows] == [one["number"] for one in revisions]
    assert [row["reason"] for row in rows] == [one["reason"] or "" for one in revisions]
    assert 'href="/csv/log?kb=courier"' in client.get("/log?kb=courier").text


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        *(
            (text, f"'{text}")
            for text in ("=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1")
        ),
        *((text, text) for text in ("-5", "+", "a=1", "2")),
    ],
)
def test_no_cell_is_a_formula(text: str, cell: str) -> None:
    made = csv_text({"rows": [{"said": text, "list": [text]}]}, ["rows"])
    (row,) = csv.DictReader(StringIO(made))
    assert row == {"said": cell, "list": cell}


@pytest.mark.parametrize(
    ("address", "field"),
    [
        ("/log?kb=courier&actor=perceptoin", "perception"),
        ("/log?kb=courier&element=rb9", "rb"),
        ("/state?kb=courier&predicate=robotat", "robot_at"),
        ("/timeline?kb=courier&object=rb9", "rb"),
    ],
)
def test_a_filter_that_nothing_fits_keeps_its_form(
    client: TestClient, address: str, field: str
) -> None:
    answer = client.get(address)
    assert answer.status_code == 404
    assert f"did you mean {field}" in answer.text
    assert f'value="{address.rpartition("=")[2]}"' in answer.text
    assert client.get(f"{address}&kb=nothing").text.count("<form") <= 1


def test_only_long_words_may_be_broken() -> None:
    words = "navigation_controller_left_front (robot_at rb1 kitchen)"
    assert breaking(words) == words
    long = "a" * 70
    assert breaking(f"<b> {long}") == f"&lt;b&gt; {'a' * 32}<wbr>{'a' * 32}<wbr>{'a' * 6}"


# The most statements of pages, whatever is stored.
BUDGETS = {
    **{
        f"/log?{query}": 12
        for query in ("", "actor=filler", "text=rb1", "element=(robot_at+rb1+wp1)")
    },
    **{"/revision?number=2": 12, "/difference?a=1": 12, "/plans?": 24, "/plan?id=1": 24},
    **{f"/state?{query}": 20 for query in ("", "at=1", "object=rb1", "predicate=robot_at")},
    **{"/state?text=wp1": 20, "/state?kind=fact": 20, "/action?name=navigation": 24},
    **{"/object?name=rb1": 24, "/object?name=wp1": 24, "/search?q=wp1": 24},
}
FACT = "/fact?text=(robot_at+rb1+wp1)"


@pytest.mark.more
def test_pages_take_as_many_statements_however_much_is_stored(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The largest state is read without being sorted.
    monkeypatch.setattr(state_parts, "SORTED", 1_000)
    kb, client = filled
    taken: dict[str, list[int]] = {}
    step = PlanStep(None, "navigation", ("rb1", "wp0", "wp1"))
    for size in (2, 400, 6_000):
        fill(kb, size)
        for number in range(1, min(size, 80)):
            kb.propositions.delete(f"(robot_at rb1 wp{number})")
        for _ in range(1, min(size, 25)):
            plan = kb.plans.record(Plan((step,) * min(size, 10), "by hand", "unknown"))
            kb.plans.set_status(plan.steps[0], status="running")
        kb.propositions.save("(robot_at rb1 wp1)")
        for path in (FACT, *BUDGETS):
            # The plan that was made last is the longest.
            asked = path.replace("id=1", f"id={plan.id}")
            taken.setdefault(path, []).append(statements_of(client, f"{asked}&kb=courier"))
    # Conditions are judged by the definitions of their times, and each size adds objects: two more.
    first, *more = taken.pop(FACT)
    assert first <= 26
    assert more == [first + 2, first + 4]
    assert {path: counts for path, counts in taken.items() if len({*counts}) > 1} == {}
    assert all(max(taken[path]) <= most for path, most in BUDGETS.items()), taken

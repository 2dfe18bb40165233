"""Objects as tables: a row has what is said of an object, as the facts of the state say it."""

from __future__ import annotations

import csv
from io import StringIO
from typing import Any

import pytest
from fastapi.testclient import TestClient

from kant_sql import KnowledgeBase
from kant_sql.history import object_tables
from tests.support.crawling import Markup
from tests.web.conftest import Filled, get, statements_of, walk

DOMAIN = """
(define (domain ward) (:requirements :typing :fluents)
  (:types place item thing - object robot nurse - thing)
  (:predicates (at ?t - thing ?p - place) (holding ?t - thing ?i - item) (docked ?r - robot)
    (beside ?a ?b - place) (passed ?t - thing ?a ?b - place) (night))
  (:functions (battery ?r - robot) (far ?a ?b - place) (total) - number
    (owner ?i - item) - nurse))
"""


def fill(kb: KnowledgeBase) -> None:
    """A ward with a robot in the corridor, which holds insulin."""
    kb.load_domain(DOMAIN)
    kb.objects.save_all(
        ["r2 - robot", "r1 - robot", "ann - nurse", "corridor - place", "ward - place"]
    )
    kb.objects.save("insulin - item")
    facts = ["at r1 corridor", "holding r1 insulin", "docked r2", "beside ward corridor", "night"]
    facts += ["at ann corridor", "passed r1 ward corridor"]
    kb.propositions.save_all([f"({fact})" for fact in facts])
    kb.goals.save("(at r1 ward)")
    for function, objects, value in (
        ("battery", ["r1"], 10),
        ("far", ["ward", "corridor"], 5),
        ("owner", ["insulin"], "ann"),
        ("total", [], 3),
    ):
        kb.function_values.set(function, objects=objects, value=value)


def rows(client: TestClient, **query: Any) -> dict[str, dict[str, list[str]]]:
    """The rows of all tables; the page itself is there, too."""
    page = get(client, "/objects", **query)
    return {row["object"]: row["cells"] for table in page["tables"] for row in table["rows"]}


def test_a_row_has_what_is_said_of_an_object(filled: Filled) -> None:
    kb, client = filled
    fill(kb)
    found = rows(client)
    assert [*found] == ["insulin", "ann", "corridor", "ward", "r1", "r2"]
    assert found["r1"] == {
        "at": ["corridor"],
        "holding": ["insulin"],
        "docked": [],
        "battery": ["10"],
    }
    assert found["r2"] == {"at": [], "holding": [], "docked": ["✓"], "battery": []}
    assert found["corridor"] == {
        "← at": ["ann", "r1"],
        "beside": [],
        "← beside": ["ward"],
        "far": [],
    }
    assert found["ward"]["far"] == ["corridor: 5"]
    assert found["insulin"] == {"← holding": ["r1"], "owner": ["ann"]}
    page = client.get("/objects?kb=courier")
    links = Markup(page.text).links
    for text in ("(at r1 corridor)", "(docked r2)", "(battery r1)", "(beside ward corridor)"):
        address = f"/fact?kb=courier&text={text.replace(' ', '+')}"
        assert any(link.replace("%28", "(").replace("%29", ")") == address for link in links), text
        assert client.get("/fact", params={"kb": "courier", "text": text}).status_code == 200


@pytest.mark.more
def test_a_type_has_its_subtypes_and_a_past_its_own_rows(filled: Filled) -> None:
    kb, client = filled
    fill(kb)
    before = kb.revision
    expected = rows(client)
    kb.propositions.delete("(at r1 corridor)")
    kb.propositions.save("(at r1 ward)")
    kb.function_values.set("battery", objects=["r1"], value=9)
    kb.objects.delete("insulin")
    assert [*rows(client, type="THING")] == ["ann", "r1", "r2"]
    assert rows(client, type="Object") == rows(client)
    assert rows(client)["r1"] == {"at": ["ward"], "docked": [], "battery": ["9"]}
    assert rows(client, at=before) == expected
    assert rows(client, at=0) == {}
    answer = client.get("/objects?kb=courier&type=robt")
    assert (answer.status_code, "did you mean robot" in answer.text) == (404, True)


def test_objects_are_read_by_pages_at_the_same_cost(
    filled: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = filled
    fill(kb)
    few = statements_of(client, "/objects?kb=courier")
    kb.objects.save_all([f"p{number} - place" for number in range(120)])
    kb.propositions.save_all([f"(beside ward p{number})" for number in range(120)])
    assert statements_of(client, "/objects?kb=courier") == few
    *pages, page = walk(client, "/objects")
    tables = [table for each in (*pages, page) for table in each["tables"]]
    seen = [row["object"] for table in tables for row in table["rows"]]
    assert sorted(seen) == sorted({one.name for one in kb.objects.get_all()})
    # Of a long cell the page has a part; the data has all.
    (ward,) = [row for row in page["tables"][-2]["rows"] if row["object"] == "ward"]
    assert len(ward["cells"]["beside"]) == 121
    last = {"kb": "courier", "after": pages[-1]["next"]}
    assert "and 101 more" in client.get("/objects", params=last).text
    monkeypatch.setattr(object_tables, "MOST", 3)
    object_tables._facts.cache_clear()
    try:
        cut = client.get("/api/objects?kb=courier").json()
    finally:
        object_tables._facts.cache_clear()
    assert (cut["is_cut"], page["is_cut"]) == (True, False)


def test_a_table_is_csv(filled: Filled) -> None:
    kb, client = filled
    fill(kb)
    text = client.get("/csv/objects?kb=courier&type=robot").text
    first, _ = csv.DictReader(StringIO(text))
    assert first == {
        **{"type": "robot", "object": "r1", "at": "corridor", "holding": "insulin"},
        **{"docked": "", "battery": "10"},
    }

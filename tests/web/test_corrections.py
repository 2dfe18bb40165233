"""What was true at a time, on pages: the page of corrections, and the clock of the others."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any
from urllib.parse import parse_qs

import pytest
from markupsafe import escape

from kant_sql.history import corrections as asked
from kant_sql.json_values import json_value
from kant_sql.knowledge.canonical import time_text
from kant_sql.web.pages import revisions
from kant_sql.web.rendering import address_of, link
from tests.support.crawling import Markup
from tests.support.statements import fill
from tests.web.conftest import Filled, statements_of

SIZE = 7
BEGIN = datetime.now(UTC) - timedelta(hours=1)
END = BEGIN + timedelta(minutes=30)


@pytest.fixture
def late(filled: Filled) -> Filled:
    """Facts of which something was said late, twice."""
    kb, _ = filled
    fill(kb, SIZE)
    facts = [f"(robot_at rb1 wp{number})" for number in range(SIZE)]
    with kb.transaction(actor="camera", valid_from=BEGIN, valid_until=END):
        kb.propositions.save_all(facts)
    middle = BEGIN + timedelta(minutes=10)
    with kb.transaction(actor="<b>door</b>", reason="seen", valid_from=middle, valid_until=END):
        for fact in facts:
            kb.propositions.delete(fact)
    return filled


def test_a_saying_links_to_the_times_at_which_it_was_true(late: Filled) -> None:
    kb, client = late
    kb.functions.save("(battery ?r - robot) - number")
    with kb.transaction(valid_from=BEGIN, valid_until=END):
        kb.propositions.save("(robot_at rb1 wp0)")
        kb.function_values.set("(battery rb1)", value=80)
    changes = next(kb.log(limit=1)).changes
    page = client.get("/revision", params={"kb": "courier", "number": kb.revision}).text
    for change, lane in zip(changes, ("(battery rb1)", "(robot_at rb1 wp0)"), strict=True):
        place = address_of(change.kind, change.text)
        assert place is not None
        address = link(place.path, kb="courier", **place.query)
        assert str(escape(address)) in page
        shown, *_ = client.get(f"/api{address}").json()["lanes"]
        assert (shown["text"], shown["bars"][0]["since"]) == (lane, kb.revision)


def test_what_was_said_of_periods_alone_has_a_page(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 3)
    kb.objects.save("wp9 - wp")
    with kb.transaction(valid_from=BEGIN, valid_until=END):
        kb.propositions.save("(robot_at rb1 wp9)")
    asked = {"kb": "courier", "text": "(robot_at rb1 wp9)"}
    page = client.get("/fact", params=asked).text
    assert escape(link("/timeline", **asked, clock="valid")) in page
    assert client.get("/api/fact", params=asked).json()["versions"] == []
    assert client.get("/fact?kb=courier&text=(robot_at wp1 wp1)").status_code == 404


def test_corrections_are_the_librarys_page_by_page(
    late: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = late
    monkeypatch.setattr(revisions, "CORRECTIONS", 3)
    monkeypatch.setattr(asked, "BATCH", 4)

    def walk(**query: Any) -> Iterator[Any]:
        after: dict[str, str] = {}
        while True:
            given = {"kb": "courier", **query, **after}
            page = client.get("/api/corrections", params=given).json()
            shown = client.get("/corrections", params=given)
            assert shown.status_code == 200
            assert "<b>door</b>" not in shown.text
            assert shown.text.count('<th scope="row"') == len(page["corrections"]) <= 3
            yield from page["corrections"]
            if page["next"] is None:
                return
            after = {"after": page["next"]}

    every = kb.corrections()
    assert len(every) == 2 * SIZE
    assert [*walk()] == [json_value(one) for one in every]
    assert [*walk(since=kb.revision)] == [json_value(one) for one in every[:SIZE]]
    wrong = client.get("/corrections", params={"kb": "courier", "after": "[[0,[1],0]]"})
    assert wrong.status_code == 400
    assert "the value of `next`" in wrong.text
    assert 0 < statements_of(client, "/api/corrections?kb=courier") <= 20


def test_pages_take_either_clock(late: Filled) -> None:
    _, client = late
    fact = "(robot_at rb1 wp3)"
    within = (BEGIN + timedelta(minutes=5)).isoformat()

    def read(path: str, **query: str) -> list[str]:
        """What a page has, and its JSON, when it goes by each clock."""
        asked = [{"kb": "courier", **query, "clock": clock} for clock in ("committed", "valid")]
        for given in asked:
            shown = client.get(path, params=given)
            assert shown.status_code == 200
            assert "/corrections?kb=courier" in shown.text
        return [client.get(f"/api{path}", params=given).text for given in asked]

    known, true = read("/ask", condition=fact, mode="when")
    assert time_text(BEGIN) not in known
    assert time_text(BEGIN) in true
    known, true = read("/timeline", object="wp3", since=(BEGIN - timedelta(minutes=1)).isoformat())
    assert time_text(BEGIN) not in known
    assert time_text(BEGIN) in true
    known, true = read("/difference", a=(BEGIN - timedelta(minutes=1)).isoformat(), b=within)
    assert fact not in known
    assert fact in true
    states = [
        client.get("/api/state", params={"kb": "courier", "kind": "fact", **valid}).text
        for valid in ({"valid": (BEGIN - timedelta(minutes=1)).isoformat()}, {"valid": within})
    ]
    assert [fact in each for each in states] == [False, True]


def test_further_pages_of_what_was_true_are_of_the_same_time(
    late: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, client = late
    monkeypatch.setattr(revisions, "FEW", 3)
    monkeypatch.setattr(revisions, "MANY", 3)
    within = (BEGIN + timedelta(minutes=5)).isoformat()
    page = client.get("/state", params={"kb": "courier", "valid": within}).text
    parts = page.partition('id="parts"')[2].partition("</main>")[0]
    every = next(one for one in Markup(parts).links if "kind=fact" in one)
    seen = set[str]()
    following: str | None = every
    while following is not None:
        assert parse_qs(following)["valid"] == [within]
        page = client.get(following).text
        seen |= set(re.findall(r"\(robot_at rb1 wp\d\)", page))
        links = [one for one in Markup(page).links if "after=" in one and one.startswith("/state")]
        following = links[0] if links else None
    assert len(seen) == SIZE

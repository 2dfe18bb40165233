"""Kept rules on the pages: among what holds, in the log, with their history, and on their own."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from kant_sql.errors import StatementTimeoutError
from kant_sql.web.pages import rules
from tests.support.crawling import Markup
from tests.web.conftest import Filled, statements_of

RULE = "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))"


def test_a_kept_rule_is_on_the_pages_of_elements(busy: Filled) -> None:
    kb, client = busy
    kb.rules.save("one-place", RULE)
    kb.rules.save("one-place", RULE, on_violation="refuse")
    text = f"(:rule one-place :on-violation refuse {RULE})"
    parts = client.get("/api/state?kb=courier").json()["parts"]
    [part] = [one for one in parts if one["kind"] == "rule"]
    assert [one["text"] for one in part["elements"]] == [text]
    history = client.get("/api/fact", params={"kb": "courier", "text": text}).json()
    assert text in str(history)
    for path in ("/state", "/log", "/fact"):
        page = client.get(path, params={"kb": "courier", "text": text if path == "/fact" else ""})
        assert page.status_code == 200
        assert "one-place" in page.text


def page_of(client: TestClient) -> dict[str, Any]:
    """The rules of the page, by their names."""
    page = client.get("/api/rules?kb=courier").json()
    assert page["error"] is None
    return {one["name"]: one for one in page["rules"]}


def test_the_page_of_rules_says_who_saved_each_and_how_it_stands(busy: Filled) -> None:
    kb, client = busy
    assert client.get("/api/rules?kb=courier").json() == {"rules": [], "error": None}
    assert "No rules are kept." in client.get("/rules?kb=courier").text
    kb.objects.save("rb2 - robot")
    kb.rules.save("one-place", RULE, on_violation="refuse")
    with kb.transaction(actor="nurse", reason="visitors"):
        kb.rules.save("one-place", RULE)
    saved = kb.revision
    kb.rules.save("free", "(sometime (not (docking rb1)))")
    kb.rules.save("gone", "(always (at rb1 hall))")
    kb.rules.delete("gone")
    found = page_of(client)
    assert [*found] == ["one-place", "free"]
    own = found["one-place"]
    assert (own["rule"], own["on_violation"]) == (RULE, "report")
    assert (own["saved"]["number"], own["saved"]["actor"]) == (saved, "nurse")
    assert own["counts"] == {"violated": 0, "pending": 0, "not judged": 0, "kept": 2}
    assert found["free"]["counts"]["pending"] == 1
    kb.propositions.save("(at rb1 hall)")
    own = page_of(client)["one-place"]
    assert own["counts"] == {"violated": 1, "pending": 0, "not judged": 0, "kept": 1}
    assert [one["verdict"] for one in own["verdicts"]] == ["violated", "kept"]
    text = client.get("/rules?kb=courier").text
    assert f"/revision?kb=courier&number={kb.revision}" in Markup(text).links
    assert 'id="rules" data-live' in text
    assert "/fact?kb=courier&text=%28%3Arule+one-place%29" in Markup(text).links
    assert "/rules?kb=courier" in Markup(client.get("/overview?kb=courier").text).links


def test_rules_that_cannot_be_judged_are_listed_with_why(
    busy: Filled, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, client = busy
    kb.rules.save("one-place", RULE)

    def slow(*_: object) -> None:
        raise StatementTimeoutError("the statement took too long")

    monkeypatch.setattr(rules, "standing", slow)
    page = client.get("/api/rules?kb=courier").json()
    assert page["error"] == "the statement took too long"
    [one] = page["rules"]
    assert (one["name"], one["counts"], one["verdicts"]) == ("one-place", None, None)
    assert "the statement took too long" in client.get("/rules?kb=courier").text


def test_statements_do_not_grow_with_rules(busy: Filled) -> None:
    kb, client = busy
    kb.rules.save("one-place", RULE)
    few = statements_of(client, "/rules?kb=courier")
    for number in range(20):
        kb.rules.save(f"rule{number}", "(always (at rb1 hall))" if number % 2 else RULE)
    assert statements_of(client, "/rules?kb=courier") <= few

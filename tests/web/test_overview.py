"""The page of a knowledge base: what runs, which goals are reached, what was done last."""

from __future__ import annotations

import re
from datetime import timedelta
from decimal import Decimal

import pytest

from kant_sql import KnowledgeBase
from kant_sql.acts import Execution
from kant_sql.errors import StatementTimeoutError
from kant_sql.planning import Plan, PlanStep
from kant_sql.web.pages import overview
from tests.support.crawling import Markup
from tests.web.conftest import Filled, statements_of


def test_it_says_what_is_going_on(busy: Filled) -> None:
    kb, client = busy
    kb.goals.save("(and (at rb1 room) (not (docking rb1)))")
    page = client.get("/api/overview?kb=courier").json()
    (running,) = page["running"]
    (own,) = kb.executions.get_all(outcome="running")
    assert own.started_at is not None
    due = own.started_at + timedelta(seconds=500)
    assert running["due_at"] == f"{due:%Y-%m-%dT%H:%M:%S.%f}Z"
    assert page["goals"] == [
        {"text": "(at rb1 room)", "is_reached": True},
        {"text": "(not (docking rb1))", "is_reached": False},
    ]
    assert [one["outcome"] for one in page["done"]] == ["failed", "refused", "succeeded"]
    numbers = [one["number"] for one in page["changes"]]
    assert numbers == [*range(kb.revision, kb.revision - 8, -1)]
    text = client.get("/overview?kb=courier").text
    assert "1 of 2 reached" in text
    left = re.search(r">(\d+) s left<", text)
    assert left is not None
    assert 400 < int(left[1]) <= 500
    assert f"/act?kb=courier&id={own.id}" in Markup(text).links


def test_what_has_no_planned_end_is_not_due_and_what_is_over_it_is_late(busy: Filled) -> None:
    kb, client = busy
    kb.executions.report("wait", outcome="running", started_at="3 hours ago")
    waiting, docking = client.get("/api/overview?kb=courier").json()["running"]
    assert waiting["due_at"] is None
    assert docking["due_at"] is not None
    late = kb.executions.report(step_of(kb), outcome="running", started_at="1 hour ago")
    page = client.get("/api/overview?kb=courier").json()
    assert page["running"][0]["execution"] == late.id
    assert re.search(r">35[34]\d s late<", client.get("/overview?kb=courier").text)


def step_of(kb: KnowledgeBase) -> Execution:
    step = PlanStep(Decimal(0), "dock", ("rb1",), Decimal(60))
    return kb.plans.record(Plan((step,), "by hand", "unknown")).steps[0]


def test_goals_that_take_long_are_left_out(busy: Filled, monkeypatch: pytest.MonkeyPatch) -> None:
    _, client = busy

    def slow(*_: object) -> None:
        raise StatementTimeoutError("the statement took too long")

    monkeypatch.setattr(overview, "read_goal_standings", slow)
    assert client.get("/api/overview?kb=courier").json()["goals"] is None
    assert "takes too long" in client.get("/overview?kb=courier").text


def test_the_standing_of_rules_follows_the_revisions(busy: Filled) -> None:
    kb, client = busy
    kb.rules.save("one-place", "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))")
    kb.rules.save("free", "(sometime (not (docking rb1)))")

    def found() -> dict[str, tuple[str, int | None]]:
        rules = client.get("/api/overview?kb=courier").json()["rules"]
        return {
            one["name"]: (one["verdict"], one["revision"] and one["revision"]["number"])
            for one in rules
        }

    before = found()
    assert {name: verdict for name, (verdict, _) in before.items()} == {
        "one-place": "kept",
        "free": "pending",
    }
    kb.propositions.save("(at rb1 hall)")
    assert found()["one-place"] == ("violated", kb.revision)
    text = client.get("/overview?kb=courier").text
    assert "1 violated" in text
    assert (
        f'in revision <a class="number" href="/revision?kb=courier&amp;number={kb.revision}"'
        in text
    )


def test_what_was_expected_and_not_seen_is_listed_until_somebody_confirms_it(busy: Filled) -> None:
    kb, client = busy
    moved, docking = client.get("/api/overview?kb=courier").json()["unconfirmed"]
    assert (moved["text"], docking["text"]) == ("(at rb1 room)", "(docking rb1)")
    text = client.get("/overview?kb=courier").text
    assert "Unconfirmed effects of acts" in text
    assert f"/act?kb=courier&id={moved['acts'][0]}" in Markup(text).links
    with kb.transaction(actor="camera"):
        kb.propositions.confirm("(at rb1 room)")
    (left,) = client.get("/api/overview?kb=courier").json()["unconfirmed"]
    assert left["text"] == "(docking rb1)"


def test_it_costs_the_same_with_more_rows(busy: Filled) -> None:
    kb, client = busy
    kb.goals.save("(at rb1 room)")
    few = statements_of(client, "/overview?kb=courier")
    with kb.transaction():
        for number in range(30):
            outcome = "running" if number % 2 else "succeeded"
            kb.executions.report(f"act {number}", outcome=outcome)  # type: ignore[arg-type]
            kb.objects.save(f"p{number} - place")
            kb.goals.save(f"(at rb1 p{number})")
    assert statements_of(client, "/overview?kb=courier") <= few
    page = client.get("/api/overview?kb=courier").json()
    assert (len(page["running"]), len(page["goals"])) == (16, 31)
    assert len(page["done"]) == overview.LAST_DONE


def test_an_empty_knowledge_base_has_nothing_going_on(filled: Filled) -> None:
    kb, client = filled
    kb.objects.save("rb1 - robot")
    page = client.get("/api/overview?kb=courier").json()
    assert (page["running"], page["goals"], page["done"]) == ([], [], [])
    assert "Nothing runs now." in client.get("/overview?kb=courier").text

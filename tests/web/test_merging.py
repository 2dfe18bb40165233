"""The page of a merge: what a branch would bring, and what both sides say differently."""

from __future__ import annotations

from kant_sql.json_values import json_value
from kant_sql.web.pages import merging
from tests.support.statements import fill
from tests.web.conftest import Filled, statements_of


def test_it_shows_what_the_library_previews(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 5)
    with kb.branch("trial") as trial:
        with trial.transaction(actor="planner", reason="<b>shorter</b>"):
            trial.propositions.delete("(robot_at rb1 wp1)")
            trial.propositions.delete("(robot_at rb1 wp2)")
        kb.propositions.delete("(robot_at rb1 wp1)")
        kb.propositions.save("(robot_at rb1 wp1)")
        found = kb.merge_preview(trial)
    data = client.get("/api/merge?kb=courier&branch=trial").json()
    assert data == {"merge": json_value(found), "changes": 1, "conflicts": 1}
    page = client.get("/merge?kb=courier&branch=trial").text
    assert "fact (robot_at rb1 wp1)" in page
    assert "planner" in page
    assert "&lt;b&gt;shorter" in page
    assert "/revision?kb=trial&amp;number=2" in page
    # What is new there was never here.
    assert "/fact?kb=trial&amp;text=%28robot_at+rb1+wp2%29" in page
    head = kb.revision
    assert client.get("/merge?kb=courier").status_code == 200
    assert kb.revision == head


def test_a_rule_that_would_break_is_a_conflict(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 5)
    with kb.branch("ruled") as branch:
        branch.propositions.delete("(robot_at rb1 wp2)")
    kb.rules.save("there", "(always (robot_at rb1 wp2))", on_violation="refuse")
    found = client.get("/api/merge?kb=courier&branch=ruled").json()["merge"]
    assert [one["element"] for one in found["conflicts"]] == [
        "rule there (always (robot_at rb1 wp2))"
    ]
    assert "rule there" in client.get("/merge?kb=courier&branch=ruled").text


def test_a_long_merge_is_cut_and_counted(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 5)
    few = _branch(filled, "few", 5)
    many = _branch(filled, "many", merging.MOST + 40)
    assert statements_of(client, f"/merge?kb=courier&branch={few}") == statements_of(
        client, f"/merge?kb=courier&branch={many}"
    )
    data = client.get(f"/api/merge?kb=courier&branch={many}").json()
    assert len(data["merge"]["changes"]) == merging.MOST
    assert data["changes"] == 2 * (merging.MOST + 40)


def _branch(filled: Filled, name: str, size: int) -> str:
    with filled[0].branch(name) as branch, branch.transaction():
        branch.objects.save([f"{name}{number} - wp" for number in range(size)])
        branch.propositions.save([f"(robot_at rb1 {name}{number})" for number in range(size)])
    return name


def test_what_is_no_branch_is_said_in_the_form(filled: Filled) -> None:
    kb, client = filled
    fill(kb, 5)
    for name in ("nobody", "courier"):
        answer = client.get(f"/merge?kb=courier&branch={name}")
        assert answer.status_code == 400
        assert "is not a branch of" in answer.text

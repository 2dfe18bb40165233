"""`kant-sql query`, `holds`, `goals`, `when` and `rules`: conditions at the prompt."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from tests.cli.conftest import write_breakfast
from tests.support.processes.commands import child, complaint, document, documents, run

IN_KITCHEN = "(at rb1 kitchen)"


def test_answers_are_a_table_with_the_variables_as_columns(breakfast: str) -> None:
    result = run("query", breakfast, "(lies ?i ?w)")
    assert result.stdout == ("\nanswers (2)\n?i     ?w\ncup    kitchen\nplate  table1\n")
    assert result.exit_code == 0


def test_answers_are_json_lines_now_and_then(breakfast: str) -> None:
    assert documents("query", breakfast, "(at ?r ?w)") == [{"r": "rb1", "w": "kitchen"}]
    assert documents("query", breakfast, "(at ?r ?w)", "--at", "1") == [{"r": "rb1", "w": "table1"}]
    assert "a predicate that is declared" in complaint(
        "query", breakfast, "(at ?r ?w)", "--at", "0"
    )


def test_variables_are_typed_fixed_and_counted(breakfast: str) -> None:
    words = "query", breakfast, "(not (lies ?i ?w))"
    assert documents(*words, "--limit", "1") == [{"i": "cup", "w": "table1"}]
    assert documents(*words, "-n", "0") == []
    assert documents(*words, "--fix", "i=plate") == [{"w": "kitchen"}]
    assert documents(*words, "--fix", "?i=cup", "--fix", "w=kitchen") == []
    (first, *_) = documents(*words, "--parameters", "(?w - wp ?i - item)")
    assert list(first) == ["w", "i"]


def test_variables_may_be_called_like_options(breakfast: str) -> None:
    words = "query", breakfast, "(at ?limit ?name)", "--fix", "limit=rb1"
    assert documents(*words) == [{"name": "kitchen"}]
    for name in ("since", "clock"):
        (held, _) = documents("when", breakfast, f"(at ?{name} ?w)", "--fix", f"{name}=rb1")
        assert held["binding"] == {"w": "table1"}


def test_a_condition_without_variables_has_no_columns(breakfast: str) -> None:
    assert run("query", breakfast, IN_KITCHEN).stdout == "holds\n"
    assert run("query", breakfast, IN_KITCHEN, "--at", "1").stdout == "does not hold\n"
    assert documents("query", breakfast, IN_KITCHEN) == [{}]


def test_the_statement_is_written_to_be_pasted(tmp_path: Path) -> None:
    path = tmp_path / "kitchen.db"
    url = f"sqlite:///{path}"
    write_breakfast(url)
    words = "query", url, "(and (lies ?i ?w) (not (at rb1 ?w)))"
    for moment, expected in ((), [("plate", "table1")]), (("--at", "1"), [("cup", "kitchen")]):
        sql = run(*words, "--sql", *moment).stdout
        assert sql.endswith(";\n")
        with sqlite3.connect(path) as connection:
            assert connection.execute(sql).fetchall() == expected
        assert f"{document(*words, '--sql', *moment)['sql']};\n" == sql
    # The statement for the present is one for the present, whatever is written later.
    sql = run(*words, "--sql").stdout
    with kant_sql.connect(url) as kb:
        kb.propositions.delete_all()
    with sqlite3.connect(path) as connection:
        assert connection.execute(sql).fetchall() == []


def test_holds_is_an_exit_code(breakfast: str) -> None:
    for words, code in (((), 0), (("--at", "1"), 1)):
        result = run("holds", breakfast, IN_KITCHEN, *words)
        assert (result.exit_code, result.stderr) == (code, "")
        assert result.stdout == ("does not hold\n" if code else "holds\n")
    assert document(
        "holds", breakfast, "(at ?r kitchen)", "--fix", "r=rb1", "--at", "1", code=1
    ) == {
        "knowledge_base": "default",
        "revision": 1,
        "condition": "(at ?r kitchen)",
        "holds": False,
    }


def test_what_is_written_meanwhile_is_no_part_of_the_answer(
    own_breakfast: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    holds = KnowledgeBase.holds

    def write_first(kb: KnowledgeBase, *words: Any, **fixed: Any) -> bool:
        asked.append(kb.revision)
        if len(asked) == 1:
            with kant_sql.connect(own_breakfast) as writer:
                writer.propositions.delete(IN_KITCHEN)
        return holds(kb, *words, **fixed)

    monkeypatch.setattr(KnowledgeBase, "holds", write_first)
    found = document("holds", own_breakfast, IN_KITCHEN)
    assert (found["revision"], found["holds"], asked) == (2, True, [2, 2])
    found = document("holds", own_breakfast, IN_KITCHEN, code=1)
    assert (found["revision"], found["holds"], asked) == (3, False, [2, 2, 3])


def test_the_url_may_come_from_the_environment(breakfast: str) -> None:
    assert run("holds", IN_KITCHEN, url=breakfast).exit_code == 0
    assert run("rules", url=breakfast).exit_code == 0
    assert run("rules", "(always (at rb1 kitchen))", url=breakfast).exit_code == 1
    assert "give a URL" in complaint("rules", code=2)
    assert "give a URL" in complaint("query", breakfast, code=2)


@pytest.mark.parametrize("command", ["query", "holds", "when"])
def test_what_cannot_be_asked_is_one_line(breakfast: str, command: str) -> None:
    assert "1:7: in the condition" in complaint(command, breakfast, "(not (lie cup kitchen))")
    assert "(did you mean kitchen?)" in complaint(command, breakfast, "(at rb1 kitchn)")
    assert "no free variable ?q" in complaint(command, breakfast, "(at ?r ?w)", "--fix", "q=rb1")
    assert "has no revision 9" in complaint(command, breakfast, IN_KITCHEN, "--at", "9")
    assert "'tiago'" in complaint(command, breakfast, IN_KITCHEN, "--kb", "tiago")
    for fix in ("r", "=rb1", "r="):
        assert "as r=rb1" in complaint(command, breakfast, "(at ?r ?w)", "--fix", fix, code=2)
    twice = "--fix", "r=rb1", "--fix", "?r=rb1"
    assert "?r is given twice" in complaint(command, breakfast, "(at ?r ?w)", *twice, code=2)


def test_goals_say_what_holds_and_what_the_metric_is(breakfast: str) -> None:
    result = run("goals", breakfast)
    assert (result.exit_code, result.stderr) == (1, "")
    assert (
        result.stdout
        == """
goals (2)
goal                 now
(holds rb1 cup)      does not hold
(lies plate table1)  holds

preferences (2)
preference  goal                                          now
home        (at rb1 table1)                               does not hold
tidy        (forall (?i - item) (not (lies ?i kitchen)))  does not hold

unsatisfied (1)
(holds rb1 cup): does not hold

metric: minimize (+ (* 3 (is-violated home)) (is-violated tidy)): 4
"""
    )


def test_goals_are_one_document(breakfast: str) -> None:
    now, then = (
        document("goals", breakfast, code=1),
        document("goals", breakfast, "--at", "1", code=1),
    )
    assert (now["revision"], now["is_reached"]) == (2, False)
    assert [part["condition"] for part in now["unsatisfied"]] == ["(holds rb1 cup)"]
    assert (now["metric"]["value"], then["metric"]["value"]) == ("4", "1")
    assert {
        "pddl": "(at rb1 table1)",
        "holds": True,
        "is_preference": True,
        "preference": "home",
    } in (then["goals"])


def test_reached_goals_are_exit_code_0(own_breakfast: str) -> None:
    with kant_sql.connect(own_breakfast) as kb:
        kb.apply("(take rb1 cup kitchen)")
        kb.load_problem(
            "(define (problem breakfast) (:domain kitchen) (:objects rb1 - robot cup - item)"
            "(:init (holds rb1 cup)) (:goal (holds rb1 cup)) (:metric minimize (total-time)))"
        )
    result = run("goals", own_breakfast)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "unsatisfied" not in result.stdout
    assert "metric: minimize (total-time): " in result.stdout
    metric = document("goals", own_breakfast)["metric"]
    assert metric["value"] is None
    assert "total-time" in metric["error"]
    assert document("goals", own_breakfast, "--at", "0")["goals"] == []


def test_a_fact_that_was_retracted_names_the_revision(own_breakfast: str) -> None:
    with kant_sql.connect(own_breakfast, actor="cat") as kb, kb.transaction(reason="it fell"):
        [plate] = [fact for fact in kb.propositions.get_all() if str(fact) == "(lies plate table1)"]
        kb.propositions.delete(plate)
    assert "  retracted in revision 3" in run("goals", own_breakfast).stdout
    parts = document("goals", own_breakfast, code=1)["unsatisfied"]
    (retracted,) = [part["retracted"] for part in parts if part["retracted"]]
    assert (retracted["number"], retracted["actor"]) == (3, "cat")


def test_when_shows_both_ends_of_each_period(breakfast: str) -> None:
    lines = run("when", breakfast, "(at rb1 ?w)").stdout.splitlines()
    assert [line for line in lines if "revision" not in line] == [
        "?w=table1",
        "    actor: operator",
        "    reason: breakfast",
        "    actor: executive",
        "    reason: the cup is there",
        "",
        "?w=kitchen",
        "    actor: executive",
        "    reason: the cup is there",
        "  holds at the end",
    ]
    assert [line.split("  ")[1] for line in lines if "revision" in line] == [
        "from revision 1",
        "until revision 2",
        "from revision 2",
    ]
    first, second = documents("when", breakfast, "(at rb1 ?w)")
    assert (first["binding"], first["since"]["actor"]) == ({"w": "table1"}, "operator")
    assert (first["until"]["number"], first["until"]["reason"]) == (2, "the cup is there")
    assert (second["since"]["number"], second["until"]) == (2, None)


def test_when_is_bounded(breakfast: str) -> None:
    words = "when", breakfast, "(at rb1 table1)"
    (held,) = documents(*words, "--at", "1")
    assert (held["since"]["number"], held["until"]) == (1, None)
    assert documents(*words, "--until", "1")[0]["until"] is None
    assert documents(*words, "--since", "2") == []
    assert run(*words, "--since", "2").stdout == "at no time\n"
    inside = run("when", breakfast, "(lies plate table1)", "--since", "2").stdout
    assert inside == "(lies plate table1)\n  held before\n  holds at the end\n"


RULE = "(always (not (at rb1 kitchen)))"


def test_a_violated_rule_is_exit_code_1(breakfast: str) -> None:
    result = run("rules", breakfast, RULE)
    assert (result.exit_code, result.stderr) == (1, "")
    head, end, *metadata = result.stdout.splitlines()
    assert head == f"violated rule: {RULE}"
    assert end.startswith("  in revision 2  ")
    assert metadata == ["    actor: executive", "    reason: the cup is there"]
    found = document("rules", breakfast, RULE, code=1)
    assert (found["first"], found["last"], found["is_satisfied"]) == (1, 2, False)
    (verdict,) = found["rules"]
    assert (verdict["rule"], verdict["revision"]["actor"]) == (RULE, "executive")
    assert float(verdict["time"]) > 0


def test_rules_are_judged_in_a_range(breakfast: str) -> None:
    satisfied = f"kept rule: {RULE}\n"
    for words in (["--at", "1"], ["--until", "1"]):
        result = run("rules", breakfast, RULE, *words)
        assert (result.exit_code, result.stdout) == (0, satisfied)
    observed = ["--since", "2", "--clock", "observed"]
    assert document("rules", breakfast, RULE, *observed, code=1)["rules"][0]["time"] == "0"
    assert "clock" in complaint("rules", breakfast, RULE, "--clock", "sun")


def test_a_rule_that_is_not_judged_has_an_exit_code(file_url: str) -> None:
    write_breakfast(file_url)
    with kant_sql.connect(file_url) as kb:
        kb.propositions.delete_all()
        kb.objects.delete_all()
        since = kb.revision
    rule = "(sometime (at rb1 kitchen))"
    result = run("rules", file_url, rule, "--since", str(since))
    assert (result.exit_code, result.stdout) == (3, f"not judged rule: {rule}\n")
    found = document("rules", file_url, rule, "--since", str(since), code=3)
    assert (found["is_satisfied"], found["rules"][0]["verdict"]) == (False, "not judged")


def test_rules_come_from_the_store_or_a_file(breakfast: str, tmp_path: Path) -> None:
    assert run("rules", breakfast).stdout == "kept rule: (sometime (at rb1 kitchen))\n"
    assert document("rules", breakfast, "--at", "1", code=1)["is_satisfied"] is False
    file = tmp_path / "safety.pddl"
    file.write_text(f"; of the house\n{RULE}\n(preference warm (always (at rb1 table1)))\n")
    lines = run("rules", breakfast, str(file)).stdout.splitlines()
    assert f"violated rule: {RULE}" in lines
    assert "violated preference: (preference warm (always (at rb1 table1)))" in lines
    # A preference alone is not a violation.
    file.write_text("(preference warm (always (at rb1 table1)))")
    found = document("rules", breakfast, str(file))
    assert (found["is_satisfied"], found["rules"][0]["preference"]) == (True, "warm")
    assert "No such file" in complaint("rules", breakfast, str(tmp_path / "missing.pddl"))
    assert "'at'" not in complaint("rules", breakfast, "(always (ta rb1 kitchen))")
    with kant_sql.connect(f"sqlite:///{tmp_path / 'none.db'}") as kb:
        kb.types.save(kant_sql.PddlTypeDto("robot"))
    none = f"sqlite:///{tmp_path / 'none.db'}"
    said = "there are no rules; --kept judges those of the store\n"
    assert run("rules", none).stdout == said
    assert run("rules", none, "--kept").stdout == "there are no rules\n"
    assert "since it was saved" in complaint("rules", none, "--kept", "--since", "1", code=2)
    assert "judge nothing" in complaint("rules", none, "--delete", "a", "--kept", code=2)
    assert "no rule 'calm' is kept" in complaint("rules", none, "--delete", "calm")


def test_rules_come_from_standard_input(file_url: str) -> None:
    write_breakfast(file_url)
    for rules, code, said in (
        (f"\n{RULE}\n", 1, f"violated rule: {RULE}\n"),
        ("(always (at rb1))", 1, "kant-sql: <stdin>:1:"),
    ):
        done = child("rules", file_url, "-", given=rules)
        assert done.returncode == code
        assert (done.stdout or done.stderr).startswith(said)

"""`kant-sql why-not`, `applicable`, `apply`, `validate` and `branch`: acting at the prompt."""

from __future__ import annotations

import json
import re
from pathlib import Path

import kant_sql
from kant_sql import Plan
from tests.cli.conftest import write_breakfast
from tests.support.processes.commands import child, complaint, document, documents, run

TAKE, BACK = "(take rb1 cup kitchen)", "(move rb1 kitchen table1)"


def test_why_not_names_what_does_not_hold(breakfast: str) -> None:
    result = run("why-not", breakfast, "(move rb1 table1 kitchen)")
    assert (result.exit_code, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    assert lines[0] == "(at rb1 table1): does not hold"
    assert lines[1].startswith("  retracted in revision 2  ")
    assert lines[2:4] == ["    actor: executive", "    reason: the cup is there"]
    found = document("why-not", breakfast, BACK)
    assert (found["revision"], found["step"], found["is_applicable"]) == (2, BACK, False)
    (part,) = found["unsatisfied"]
    assert part["condition"] == "(>= (battery rb1) 10)"
    assert (part["left"], part["right"], part["retracted"]) == ("5.5", "10", None)


def test_why_not_says_that_a_step_is_applicable(breakfast: str) -> None:
    assert run("why-not", breakfast, TAKE).stdout == f"{TAKE} is applicable\n"
    assert document("why-not", breakfast, TAKE)["unsatisfied"] == []
    assert document("why-not", breakfast, TAKE, "--at", "1")["is_applicable"] is False


def test_why_not_names_arguments_of_other_types_and_unknown_names(breakfast: str) -> None:
    assert "is of type item" in run("why-not", breakfast, "(take cup cup kitchen)").stdout
    assert "(did you mean take?)" in complaint("why-not", breakfast, "(tak rb1 cup kitchen)")
    assert "(did you mean cup?)" in complaint("why-not", breakfast, "(take rb1 cap kitchen)")


def test_applicable_steps_are_listed(breakfast: str) -> None:
    result = run("applicable", breakfast)
    assert (result.exit_code, result.stdout) == (0, f"{TAKE}\n")
    then = run("applicable", breakfast, "--at", "1")
    assert then.stdout == "(move rb1 table1 kitchen)\n(take rb1 plate table1)\n"
    assert run("applicable", breakfast, "--at", "1", "--limit", "1").stdout == then.stdout[:26]
    assert run("applicable", breakfast, "move").stdout == ""
    assert documents("applicable", breakfast, "--at", "1", "--fix", "i=plate") == [
        {
            "action": "take",
            "arguments": ["rb1", "plate", "table1"],
            "step": "(take rb1 plate table1)",
        }
    ]
    assert run("applicable", "take", url=breakfast).stdout == f"{TAKE}\n"
    assert "(did you mean move?)" in complaint("applicable", breakfast, "mov")
    assert "no parameter ?q" in complaint("applicable", breakfast, "move", "--fix", "q=rb1")


def test_a_step_is_applied_as_one_revision(own_breakfast: str) -> None:
    who = "--actor", "gripper", "--reason", "as planned"
    result = run("apply", own_breakfast, TAKE, *who)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == (
        f"knowledge base default, revision 3: {TAKE}\n"
        "+ fact (holds rb1 cup)\n- fact (lies cup kitchen)\n"
    )
    with kant_sql.connect(own_breakfast) as kb:
        (revision,) = kb.store.revisions(after=2)
        assert (revision.actor, revision.reason) == ("gripper", "as planned")
        assert kb.holds("(holds rb1 cup)")
        battery, rb1 = kb.functions.get("battery"), kb.objects.get("rb1")
        assert battery is not None
        assert rb1 is not None
        kb.function_values.save(kant_sql.PddlFunctionValueDto(battery, [rb1], 10))
    found = document("apply", own_breakfast, BACK)
    assert (found["knowledge_base"], found["step"], found["revision"]) == ("default", BACK, 5)
    assert {"sign": "+", "kind": "value", "text": "(= (battery rb1) 0)"} in found["changes"]


def test_a_step_that_is_not_applicable_writes_nothing(breakfast: str) -> None:
    assert "(>= (battery rb1) 10): " in complaint("apply", breakfast, BACK)
    result = run("apply", breakfast, BACK, "--json")
    assert json.loads(result.stderr)["type"] == "NotApplicableError"
    assert (result.exit_code, result.stdout) == (1, "")
    assert complaint("apply", breakfast, BACK, "--at", "1", code=2).endswith("apply --help")
    with kant_sql.connect(breakfast) as kb:
        assert kb.revision == 2


def test_a_step_that_changes_nothing_is_a_revision(file_url: str) -> None:
    with kant_sql.connect(file_url) as kb:
        kb.load_domain(
            "(define (domain doors) (:predicates (open)) (:constants front - object)"
            "(:action close :parameters () :effect (not (open))))"
        )
    said = "knowledge base default, revision 2: (close) changes nothing\n"
    assert run("apply", file_url, "(close)").stdout == said
    found = document("apply", file_url, "(close)")
    assert (found["revision"], found["changes"]) == (3, [])


def test_a_plan_of_a_file_is_validated(breakfast: str, tmp_path: Path) -> None:
    file = tmp_path / "sas_plan"
    file.write_text(f"{TAKE}\n")
    result = run("validate", breakfast, str(file))
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("the plan is valid\nmakespan 1\nmetric 3\n")
    assert "preference home violated 1 time" in result.stdout
    found = document("validate", breakfast, str(file))
    assert (found["valid"], found["revision"], found["makespan"]) == (True, 2, "1")
    assert (found["metric_value"], found["violated_preferences"]) == ("3", {"home": 1})
    with kant_sql.connect(breakfast) as kb:
        assert kb.revision == 2


def test_an_invalid_plan_is_exit_code_1(breakfast: str, tmp_path: Path) -> None:
    file = tmp_path / "sas_plan"
    file.write_text(f"{TAKE}\n{BACK}\n")
    result = run("validate", breakfast, str(file))
    assert (result.exit_code, result.stderr) == (1, "")
    assert result.stdout.splitlines()[:2] == [
        "the plan is not valid",
        f"step 1, {BACK}, fails at 2:",
    ]
    assert "  (>= (battery rb1) 10): " in result.stdout
    failed = document("validate", breakfast, str(file), code=1)["failed_step"]
    assert (failed["position"], failed["action"], failed["time"]) == (1, "move", "2")
    assert failed["unsatisfied"][0]["left"] == "5.5"
    file.write_text("; does nothing\n")
    found = document("validate", breakfast, str(file), "--at", "1", code=1)
    assert (found["revision"], found["failed_step"]) == (1, None)
    assert [part["condition"] for part in found["unsatisfied_goals"]] == ["(holds rb1 cup)"]
    assert [one["constraint"] for one in found["violated_constraints"]] == [
        "(sometime (at rb1 kitchen))"
    ]


def test_a_recorded_plan_is_validated(own_breakfast: str, tmp_path: Path) -> None:
    with kant_sql.connect(own_breakfast) as kb:
        id_ = str(kb.plans.record(Plan.read(f"{TAKE}\n")).id)
    assert run("validate", own_breakfast, "--plan", id_).exit_code == 0
    assert run("validate", own_breakfast, "--plan", id_, url=None).exit_code == 0
    run("apply", own_breakfast, TAKE)
    assert run("validate", own_breakfast, "--plan", id_).exit_code == 1
    assert run("validate", own_breakfast, "--plan", id_, "--at", "2").exit_code == 0
    assert "has no plan 77" in complaint("validate", own_breakfast, "--plan", "77")
    assert "a file or --plan" in complaint("validate", own_breakfast, code=2)
    both = "file", "--plan", id_
    assert "a file or --plan" in complaint("validate", own_breakfast, *both, code=2)
    missing = str(tmp_path / "missing")
    assert "No such file" in complaint("validate", own_breakfast, missing)


def test_a_plan_comes_from_standard_input(file_url: str) -> None:
    write_breakfast(file_url)
    for plan, code, said in (
        (TAKE, 0, "the plan is valid\n"),
        ("", 1, "the plan is not valid\n"),
        ("take", 1, "kant-sql: <string>:1:1: in the plan: "),
    ):
        done = child("validate", file_url, "-", given=plan)
        assert done.returncode == code
        assert (done.stdout or done.stderr).startswith(said)
    done = child("plan", file_url, "--read", "-", given=TAKE)
    assert done.stdout.splitlines()[-1] == TAKE


def test_a_branch_begins_with_a_state(own_breakfast: str) -> None:
    result = run("branch", own_breakfast, "monday", "--at", "1", "--actor", "operator")
    assert (result.exit_code, result.stderr) == (0, "")
    said = "knowledge base monday, revision 1: branch of default at revision 1\n"
    assert result.stdout == said
    with kant_sql.connect(own_breakfast, knowledge_base="monday") as kb:
        assert kb.holds("(at rb1 table1)")
        assert kb.store.revisions()[0].actor == "operator"
    words = "branch", own_breakfast, "monday", "--kb", "default"
    assert "knowledge base 'monday' exists there" in complaint(*words)
    found = document("branch", own_breakfast, "tuesday", "--kb", "default")
    assert (found["knowledge_base"], found["revision"]) == ("tuesday", 1)
    assert (found["source"]["parent"], found["source"]["revision"]) == ("default", 2)


def test_a_branch_may_be_in_another_store(breakfast: str, tmp_path: Path) -> None:
    path = tmp_path / "trial.db"
    target = f"sqlite:///{path}"
    assert "has no revision 9" in complaint("branch", breakfast, "--url", target, "--at", "9")
    assert not path.exists()
    assert document("branch", breakfast, "--url", target)["knowledge_base"] == "default"
    assert run("dump", target, "--problem").stdout == run("dump", breakfast, "--problem").stdout
    assert "give a name, --url or both" in complaint("branch", breakfast, code=2)
    server = "postgresql://robot:hunter2@127.0.0.1:1/fleet"
    line = complaint("branch", breakfast, "--url", server)
    assert "no connection" in line
    assert "hunter2" not in line
    empty = document("branch", breakfast, "empty", "--url", target, "--at", "0")
    assert (empty["revision"], empty["source"]) == (None, None)
    text = run("branch", breakfast, "nothing", "--url", target, "--at", "0").stdout
    assert text == "knowledge base nothing: nothing was there to begin with\n"


def test_a_state_is_what_was_true_at_a_time(tmp_path: Path) -> None:
    url, plan = f"sqlite:///{tmp_path / 'doors.db'}", tmp_path / "leave.plan"
    plan.write_text("0: (leave)\n")
    with kant_sql.connect(url) as kb:
        kb.load_domain(
            "(define (domain doors) (:predicates (open) (left))"
            " (:action leave :parameters () :precondition (open) :effect (left)))"
        )
        kb.goals.save("(left)")
        with kb.transaction(valid_from="60 minutes ago", valid_until="30 minutes ago"):
            kb.propositions.save("(open)")
    for command, asked in (("validate", str(plan)), ("holds", "(open)")):
        codes = [
            run(command, url, asked, *then).exit_code
            for then in (
                [],
                ["--valid", "45 minutes ago"],
                ["--valid", "45 minutes ago", "--at", "2"],
            )
        ]
        assert codes == [1, 0, 1], command
    header = run("show", url, "--valid", "45 minutes ago").output.splitlines()[0]
    assert re.search(r", valid at \d{4}-\d\d-\d\dT[\d:.]+Z$", header)

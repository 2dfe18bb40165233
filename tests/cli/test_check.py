"""`kant-sql check`: what is wrong with files, without a store."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest

from tests.support.processes.commands import PROGRAM, child, one_line, run

FILES = Path(__file__).parent / "files"
DOMAIN, PROBLEM = str(FILES / "delivery.pddl"), str(FILES / "coffee.pddl")
WATERING, BALCONY = str(FILES / "watering.pddl"), str(FILES / "balcony.pddl")
TINY = "(define (domain tiny) (:predicates (p)))"
TINY_PROBLEM = "(define (problem one) (:domain tiny) (:init (p)) (:goal (p)))"


def checked(*words: str, code: int = 0) -> list[str]:
    """The lines that `check` writes."""
    result = run("check", *words)
    assert result.exit_code == code, result.stdout
    assert (one_line(result.stderr) != "") if code else (result.stderr == "")
    return result.stdout.splitlines()


def report(*words: str) -> dict[str, Any]:
    """What `check --json` writes."""
    found: dict[str, Any] = json.loads(run("check", *words, "--json").stdout)
    return found


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_problems_are_checked_against_the_domain_of_their_name() -> None:
    expected = [
        f"{DOMAIN}: domain delivery",
        f"{WATERING}: domain watering",
        f"{BALCONY}: problem balcony, checked against domain watering",
        f"{PROBLEM}: problem coffee, checked against domain delivery",
    ]
    assert [
        line for line in checked(DOMAIN, WATERING, BALCONY, PROBLEM) if "warning" not in line
    ] == expected
    assert checked(PROBLEM, DOMAIN) == [expected[3], expected[0]]


def test_a_process_needs_no_store(here: Path) -> None:
    done = child("check", DOMAIN, PROBLEM, cwd=here)
    assert (done.returncode, done.stderr, list(here.iterdir())) == (0, "", [])


def test_all_files_are_checked_whatever_is_wrong_with_one(here: Path) -> None:
    (here / "a.pddl").write_text("(define (domain a) (:action go :effect (flies)))")
    (here / "b.pddl").write_text("(define (domain b)\n  (:predicates (p)")
    (here / "c.pddl").write_bytes(b"(define\n (domain \xff))")
    (here / "d.pddl").write_text(f"(define (domain d) (:action go :effect {'(and ' * 100_000}")
    (here / "folder").mkdir()
    (here / "tiny.pddl").write_text(TINY)
    names = ["a.pddl", "b.pddl", "c.pddl", "d.pddl", "folder", "missing.pddl", "tiny.pddl"]
    lines = [line for line in checked(*names, code=1) if "warning" not in line]
    assert [line.split(": ")[0].split(":")[0] for line in lines] == names
    assert lines[0].startswith("a.pddl:1:41: error: in action go, :effect: found ")
    assert lines[1].startswith("b.pddl:2:")
    assert lines[2].startswith("c.pddl:2:10: error: found the byte 0xFF")
    assert lines[3].endswith("found the end of the text, expected 100002 more ')'")
    assert lines[4:] == [
        "folder: error: Is a directory",
        "missing.pddl: error: No such file or directory",
        "tiny.pddl: domain tiny",
    ]
    assert one_line(run("check", *names).stderr) == "kant-sql: 6 errors in 7 files"


def test_what_violates_the_standard_is_a_warning_or_with_strict_an_error(here: Path) -> None:
    (here / "bent.pddl").write_text("(define (domain bent)\n (:predicates (on ?a - place)))")
    lines = checked("bent.pddl")
    warnings = [line for line in lines if ": warning: " in line]
    assert [line[:12] for line in warnings] == ["bent.pddl:1:", "bent.pddl:2:"]
    assert lines[2:] == ["bent.pddl: domain bent"]
    errors = [line.replace(": warning: ", ": error: ") for line in warnings]
    assert checked("bent.pddl", "--strict", code=1)[:2] == errors
    assert checked(DOMAIN, PROBLEM, "--strict") == checked(DOMAIN, PROBLEM)


def test_a_problem_alone_is_checked_as_far_as_possible(here: Path) -> None:
    assert checked(PROBLEM) == [
        f"{PROBLEM}: problem coffee, checked without its domain; give the file of that, too"
    ]
    (here / "wrong.pddl").write_text("(define (problem x) (:domain d) (:goal (and (p) (or))")
    assert "wrong.pddl:1:" in checked("wrong.pddl", code=1)[0]


def test_a_problem_of_another_domain_is_an_error() -> None:
    lines = checked(DOMAIN, BALCONY, code=1)
    assert f"{BALCONY}:2:12: error: in problem balcony: found the domain watering" in lines[0]


def test_a_problem_is_checked_without_a_domain_that_cannot_be_read(here: Path) -> None:
    (here / "domain.pddl").write_text("(define (domain delivery) (:predicates (at ?r - )))")
    lines = checked("domain.pddl", PROBLEM, code=1)
    assert "domain.pddl:1:" in lines[0]
    assert lines[1:] == [
        f"{PROBLEM}: problem coffee, checked without its domain; give the file of that, too"
    ]


def test_a_problem_goes_with_the_last_domain_before_it(here: Path) -> None:
    for name, predicate in (("a", "p"), ("b", "q")):
        (here / name).mkdir()
        (here / name / "domain.pddl").write_text(TINY.replace("p)", f"{predicate})"))
        (here / name / "problem.pddl").write_text(TINY_PROBLEM.replace("(p)", f"({predicate})"))
    paths = ["a/domain.pddl", "a/problem.pddl", "b/domain.pddl", "b/problem.pddl"]
    checked(*paths)
    checked(*paths[:2], paths[2])
    assert "b/problem.pddl:1:" in checked(*paths[:2], paths[3], code=1)[0]


def test_domain_files_of_one_name_in_one_folder_are_one_domain(here: Path) -> None:
    (here / "types.pddl").write_text("(define (domain tiny) (:requirements :typing) (:types t))")
    (here / "tiny.pddl").write_text(
        "(define (domain tiny) (:requirements :typing) (:predicates (p) (on ?a - t)))"
    )
    (here / "one.pddl").write_text(TINY_PROBLEM)
    assert checked("types.pddl", "tiny.pddl", "one.pddl") == [
        "types.pddl, tiny.pddl: domain tiny",
        "one.pddl: problem one, checked against domain tiny",
    ]


def test_a_file_may_hold_several(here: Path) -> None:
    more = TINY_PROBLEM.replace("one", "two")
    (here / "all.pddl").write_text(f"{TINY}\n{TINY_PROBLEM}\n{more.replace('(p)', '(q)')}\n{more}")
    lines = checked("all.pddl", code=1)
    assert lines[0].startswith("all.pddl:3:")
    assert lines[1:] == [
        "all.pddl: domain tiny",
        "all.pddl: problem one, checked against domain tiny",
        "all.pddl: problem two, checked against domain tiny",
    ]


def test_a_hyphen_is_standard_input() -> None:
    done = child("check", "-", PROBLEM, given=Path(DOMAIN).read_text() + ")")
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert lines[0].startswith("<stdin>:18:1: warning: found ')' that closes nothing")
    assert lines[1:] == [
        "<stdin>: domain delivery",
        f"{PROBLEM}: problem coffee, checked against domain delivery",
    ]


@pytest.mark.more
def test_standard_input_that_cannot_be_read_is_one_line() -> None:
    for words in ("check -", "load sqlite:// -"):
        done = child("-c", f"{shlex.join(PROGRAM)} {words} <&-", program=["sh"])
        assert one_line(done.stderr) == "kant-sql: <stdin>: Bad file descriptor"
        assert (done.returncode, done.stdout) == (1, "")


def test_json_says_all_of_it(here: Path) -> None:
    (here / "bent.pddl").write_text(TINY)
    (here / "bad.pddl").write_text(TINY_PROBLEM.replace("(:goal (p))", "(:goal (q))"))
    found = report("bent.pddl", "bad.pddl", "missing.pddl")
    assert found["documents"] == [
        {
            "kind": "domain",
            "name": "tiny",
            "sources": ["bent.pddl"],
            "is_read": True,
            "domain": None,
        },
        {
            "kind": "problem",
            "name": "one",
            "sources": ["bad.pddl"],
            "is_read": False,
            "domain": None,
        },
    ]
    findings = [each for each in found["findings"] if each["severity"] == "error"]
    assert [(each["source"], each["line"], each["column"]) for each in findings] == [
        ("bad.pddl", 1, 58),
        ("missing.pddl", None, None),
    ]
    assert findings[0]["message"].startswith("in :goal: found ")
    assert findings[1]["message"] == "No such file or directory"


def test_names_cannot_steer_a_terminal(here: Path) -> None:
    (here / "\x1b[2J.pddl").write_text(TINY)
    assert checked("\x1b[2J.pddl") == ["\\u001b[2J.pddl: domain tiny"]


def test_without_a_file_the_usage_is_wrong() -> None:
    assert run("check").exit_code == 2

"""`kant-sql load`: files become knowledge, in one revision or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import pytest

import kant_sql
from kant_sql import InvalidKnowledgeError, KnowledgeBase, PddlTypeDto
from kant_sql.cli.common import leaving_nothing
from kant_sql.pddl import read_domain, read_problem
from kant_sql.sql.catalog import written_names
from kant_sql.sql.dialects.base import Session
from tests.support.processes import commands
from tests.support.processes.workers import wait_for

FILES = Path(__file__).parent / "files"
DOMAIN, PROBLEM = str(FILES / "delivery.pddl"), str(FILES / "coffee.pddl")
WATERING, BALCONY = str(FILES / "watering.pddl"), str(FILES / "balcony.pddl")


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'robot.db'}"


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], str]:
    """Writes a file, and tells its path."""

    def write(name: str, text: str) -> str:
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return write


def revision(url: str, name: str = "default") -> int:
    with kant_sql.connect(url, knowledge_base=name) as kb:
        return kb.revision


def test_a_domain_and_a_problem_become_one_revision(new_url: str) -> None:
    kant_sql.upgrade(new_url)
    words = ["--kb", "tiago", "--actor", "operator", "--reason", "a new shift"]
    result = commands.run("load", new_url, WATERING, BALCONY, *words)
    assert result.exit_code == 0, result.stderr
    assert result.stdout == (
        "knowledge base tiago, revision 1\n"
        "+ 3 actions, 2 constraints, 1 derived predicate, 2 documents, 1 domain constraint, "
        "2 facts, 3 functions, 4 function values, 3 goals, 1 initial literal, 1 metric, 3 objects, "
        "4 predicates, 2 timed initial literals, 2 types\n"
    )
    with kant_sql.connect(new_url, knowledge_base="tiago") as kb:
        domain = read_domain(Path(WATERING))
        assert kb.pddl.domain() == domain
        assert kb.pddl.problem() == read_problem(Path(BALCONY), domain=domain)
        (made,) = kb.store.revisions()
    assert (made.actor, made.reason) == ("operator", "a new shift")
    assert made.source == {
        "files": [
            {"path": path, "sha256": hashlib.sha256(Path(path).read_bytes()).hexdigest()}
            for path in (WATERING, BALCONY)
        ]
    }


def test_a_process_of_its_own_creates_the_store(url: str) -> None:
    done = commands.child("load", url, DOMAIN, PROBLEM)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("knowledge base default, revision 1\n+ 3 actions, ")


def test_to_load_the_same_again_changes_nothing(url: str) -> None:
    commands.run("load", url, DOMAIN, PROBLEM)
    result = commands.run("load", url, DOMAIN, PROBLEM, "--actor", "somebody else")
    assert result.stdout == "knowledge base default, revision 1: nothing has changed\n"
    assert (result.exit_code, revision(url)) == (0, 1)


def test_the_order_of_the_files_does_not_matter_for_what_is_in_them_does(url: str) -> None:
    assert commands.run("load", url, PROBLEM, DOMAIN).exit_code == 0
    with kant_sql.connect(url) as kb:
        assert kb.pddl.problem().name == "coffee"


def test_several_files_are_one_domain(url: str, write: Callable[[str, str], str]) -> None:
    more = write(
        "more.pddl",
        "(define (domain delivery) (:requirements :strips :typing) (:predicates (shut ?w - wp)))",
    )
    assert commands.run("load", url, DOMAIN, more, PROBLEM).exit_code == 0
    with kant_sql.connect(url) as kb:
        assert kb.revision == 1
        assert [each.name for each in kb.pddl.domain().predicates] == [
            *("at", "lies", "holds", "shut")
        ]


def test_one_file_with_both_is_read_for_both_without_a_warning(
    url: str, write: Callable[[str, str], str]
) -> None:
    both = write("both.pddl", Path(PROBLEM).read_text() + Path(DOMAIN).read_text())
    result = commands.run("load", url, both, "--strict")
    assert (result.exit_code, result.stderr) == (0, "")
    with kant_sql.connect(url) as kb:
        domain = read_domain(Path(DOMAIN))
        assert (kb.pddl.domain(), kb.pddl.problem()) == (
            domain,
            read_problem(Path(PROBLEM), domain=domain),
        )


def test_errors_in_a_file_with_both_have_their_place(
    url: str, write: Callable[[str, str], str]
) -> None:
    domain = Path(DOMAIN).read_text()
    both = write(
        "both.pddl", f"{domain}; a comment (\n{Path(PROBLEM).read_text()}".replace("cup", "mug", 1)
    )
    line = domain.count("\n") + 1 + 4
    assert f"both.pddl:{line}:32: " in commands.complaint("load", url, both)


def test_a_hyphen_is_standard_input(url: str) -> None:
    text = Path(DOMAIN).read_bytes() + Path(PROBLEM).read_bytes()
    done = commands.child("load", url, "-", given=text.decode())
    assert (done.returncode, done.stderr) == (0, "")
    with kant_sql.connect(url) as kb:
        assert kb.store.revisions()[0].source == {
            "files": [{"path": "<stdin>", "sha256": hashlib.sha256(text).hexdigest()}]
        }


def test_a_problem_alone_is_of_the_domain_that_is_stored(url: str) -> None:
    assert commands.run("load", url, DOMAIN).exit_code == 0
    assert commands.run("load", url, PROBLEM).exit_code == 0
    assert revision(url) == 2
    assert "found the domain watering, expected the domain delivery" in commands.one_line(
        commands.run("load", url, BALCONY).stderr
    )
    assert revision(url) == 2


def test_a_problem_alone_creates_no_store_and_no_knowledge_base(url: str, tmp_path: Path) -> None:
    result = commands.run("load", url, PROBLEM)
    line = commands.one_line(result.stderr)
    assert "no such file" in line
    assert f"a problem needs its domain: give the file of the domain, too, before {PROBLEM}" in line
    assert (result.exit_code, list(tmp_path.iterdir())) == (1, [])
    commands.run("load", url, DOMAIN, "--kb", "tiago")
    assert commands.complaint("load", url, PROBLEM).endswith("choose one with --kb: 'tiago'")
    assert kant_sql.sql.catalog.written_names(url) == ["tiago"]


def test_what_the_files_do_not_say_is_retracted_or_kept(
    url: str, write: Callable[[str, str], str]
) -> None:
    other = write(
        "other.pddl",
        "(define (problem coffee) (:domain delivery) (:objects rb2 - robot kitchen - wp)"
        "(:init (at rb2 kitchen)) (:goal (and)))",
    )
    commands.run("load", url, DOMAIN, PROBLEM)
    assert commands.run("load", url, other, "--merge").exit_code == 0
    with kant_sql.connect(url) as kb:
        assert len(kb.pddl.problem().objects) == 5
    result = commands.run("load", url, other)
    assert result.stdout == (
        "knowledge base default, revision 3\n"
        "+ 1 document\n"
        "- 1 document, 2 facts, 1 goal, 3 objects\n"
    )
    with kant_sql.connect(url) as kb:
        assert kb.pddl.problem() == read_problem(Path(other), domain=read_domain(Path(DOMAIN)))


def test_what_violates_the_standard_is_warned_of_with_its_place_or_refused(
    url: str, write: Callable[[str, str], str]
) -> None:
    path = write("bent.pddl", "(define (domain bent)\n  (:predicates (near ?a - place)))")
    result = commands.run("load", url, path, "--strict")
    line = commands.one_line(result.stderr)
    assert f"{path}:" in line
    assert (result.exit_code, revision(url)) == (1, 0)
    result = commands.run("load", url, path)
    assert result.exit_code == 0
    warnings = result.stderr.splitlines()
    assert len(warnings) == 2
    assert all(warning.startswith(f"{path}:") and " warning: " in warning for warning in warnings)
    assert warnings[1].startswith(f"{path}:2:")


def test_two_problems_are_refused(url: str) -> None:
    result = commands.run("load", url, DOMAIN, PROBLEM, BALCONY)
    assert commands.one_line(result.stderr).endswith("each have a problem: load one of them")
    assert (result.exit_code, result.stdout) == (1, "")


NESTING = b"(define (domain deep) (:predicates (p)) (:action a :precondition "
NESTING += b"(not " * 100_000 + b"(p)"
# What cannot be read as PDDL, and what is said of it; None: there is no file.
UNREADABLE: dict[str, tuple[bytes | None, str]] = {
    "nesting": (NESTING, "found the end of the text, expected 100002 more ')'"),
    "parentheses": (b"(" * 100_000, "found '('"),
    "encoding": (b"(define (domain \xff\xfe))", "1:17: found the byte 0xFF"),
    "nul": (b"(define (domain d)\0)", "a NUL character"),
    "nothing": (b"", "found the end of the text"),
    "a word": (b"domain", "found 'domain', expected (define"),
    "unclosed": (b"(define (domain d) (:predicates (p)", "expected ')'"),
    "unknown": (
        b"(define (domain d) (:action a :precondition (flies) :effect (and)))",
        "in action a, :precondition: found",
    ),
    "missing": (None, "No such file or directory"),
    "folder": (None, "Is a directory"),
}


@pytest.mark.parametrize("kind", UNREADABLE)
def test_a_file_that_cannot_be_read_is_one_line_and_nothing_is_stored(
    url: str, tmp_path: Path, kind: str
) -> None:
    content, message = UNREADABLE[kind]
    path = tmp_path if kind == "folder" else tmp_path / f"{kind} (1).pddl"
    if content is not None:
        path.write_bytes(content)
    for words in ([str(path)], [DOMAIN, str(path)], [str(path), PROBLEM]):
        result = commands.run("load", url, *words)
        line = commands.one_line(result.stderr)
        assert (result.exit_code, result.stdout) == (1, "")
        assert revision(url) == 0
    result = commands.run("load", url, str(path))
    line = commands.one_line(result.stderr)
    assert line.startswith(f"kant-sql: {path}:")
    assert message in line


def test_a_process_ends_with_one_line_too(url: str) -> None:
    done = commands.child("load", url, "-", given=NESTING.decode())
    commands.one_line(done.stderr)
    assert (done.returncode, done.stdout) == (1, "")


def test_a_domain_is_not_stored_when_its_problem_is_refused(
    url: str, write: Callable[[str, str], str]
) -> None:
    path = write("wrong.pddl", Path(PROBLEM).read_text().replace("(lies cup table1)", "(lies cup)"))
    result = commands.run("load", url, DOMAIN, path)
    assert f"{path}:5:" in commands.one_line(result.stderr)
    assert (result.exit_code, revision(url)) == (1, 0)


def test_a_store_that_cannot_be_written_is_one_line(url: str) -> None:
    commands.run("load", url, DOMAIN)
    result = commands.run("load", f"{url}?mode=ro", DOMAIN, PROBLEM)
    assert "cannot be written" in commands.one_line(result.stderr)
    assert (result.exit_code, revision(url)) == (1, 1)


@pytest.mark.parametrize("words", [[DOMAIN], [DOMAIN, PROBLEM], ["sqlite:///robot.db"]])
def test_without_a_url_or_a_file_the_usage_is_wrong(words: list[str]) -> None:
    assert "(or set KANT_SQL_URL) and FILE..." in commands.complaint("load", *words, code=2)


def test_what_a_revision_cannot_keep_is_one_line(url: str) -> None:
    result = commands.run("load", url, DOMAIN, "--actor", "\udcff")
    commands.one_line(result.stderr)
    assert (result.exit_code, revision(url)) == (1, 0)


@pytest.mark.more
def test_a_path_that_is_no_unicode_text_is_kept_readable(url: str, tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/\xff.pddl"
    try:
        Path(os.fsdecode(path)).write_bytes(Path(DOMAIN).read_bytes())
    except OSError:
        pytest.skip("this file system has only names that are Unicode text")
    done = subprocess.run(
        [*(os.fsencode(word) for word in [*commands.PROGRAM, "load", url]), path],
        capture_output=True,
        env=commands.environment(),
        timeout=commands.CHILD_TIMEOUT,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    with kant_sql.connect(url) as kb:
        assert str(kb.store.revisions()[0].source).count(r"\\xff.pddl") == 1


def test_a_terminal_shows_what_is_going_on_and_a_pipe_does_not(url: str) -> None:
    assert commands.child("load", url, DOMAIN).stderr == ""
    shown, output = commands.in_terminal("load", url, PROBLEM, is_output=False)
    assert "loading" in shown
    assert re.search(r"\d+%", shown)
    assert output.startswith("knowledge base default, revision 2\n")


@pytest.mark.more
def test_nothing_is_shown_without_standard_error(url: str) -> None:
    line = shlex.join([*commands.PROGRAM, "load", url, DOMAIN])
    done = commands.child("-c", f"{line} 2>&-", program=["sh"])
    assert done.returncode == 0


def test_json_says_what_was_loaded(url: str) -> None:
    document = {
        "knowledge_base": "default",
        "revision": 1,
        "head": 1,
        "asserted": {
            "action": 3,
            "document": 2,
            "fact": 2,
            "goal": 1,
            "object": 4,
            "predicate": 3,
            "type": 3,
        },
        "retracted": {},
        "warnings": [],
    }
    result = commands.run("load", url, DOMAIN, PROBLEM, "--json")
    assert (json.loads(result.stdout), result.stderr) == (document, "")
    result = commands.run("load", url, DOMAIN, PROBLEM, "--json")
    again = {**document, "revision": None, "asserted": {}}
    assert json.loads(result.stdout) == again


def test_json_has_the_warnings_in_it(url: str, write: Callable[[str, str], str]) -> None:
    odd = write("odd.pddl", "(define (domain d) (:predicates (p)) (:requirements :strips))")
    text = commands.run("load", url, odd)
    result = commands.run("load", url, odd, "--json")
    assert result.stderr == ""
    (warning,) = json.loads(result.stdout)["warnings"]
    assert f"{warning['source']}:{warning['line']}:{warning['column']}" in text.stderr
    assert warning["message"] in text.stderr


@pytest.mark.parametrize("is_there", [False, True])
def test_a_load_that_fails_leaves_no_new_file_and_one_that_was_there(
    url: str, tmp_path: Path, write: Callable[[str, str], str], is_there: bool
) -> None:
    if is_there:
        (tmp_path / "robot.db").touch()
    wrong = write("wrong.pddl", "(define (domain d) (:predicates (p)) (:action a :effect (q)))")
    commands.complaint("load", url, wrong)
    assert ((tmp_path / "robot.db").exists(), os.path.exists(wrong)) == (is_there, True)
    assert is_there or os.listdir(tmp_path) == ["wrong.pddl"]


def test_a_load_that_fails_leaves_what_somebody_else_has_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, path = f"sqlite:///{tmp_path}/new.db", tmp_path / "new.db"

    def fail(kb: KnowledgeBase, *_: object, **__: object) -> None:
        with kant_sql.connect(url, knowledge_base="other") as other:
            other.types.save(PddlTypeDto("robot"))
        raise InvalidKnowledgeError("no")

    monkeypatch.setattr(KnowledgeBase, "transaction", fail)
    assert commands.run("load", url, DOMAIN).exit_code == 1
    assert written_names(url) == ["other"]
    path.unlink()
    opened = []

    def open_only(kb: KnowledgeBase, *_: object, **__: object) -> None:
        opened.append(kant_sql.connect(url, knowledge_base="other"))
        assert opened[0].revision == 0
        raise InvalidKnowledgeError("no")

    monkeypatch.setattr(KnowledgeBase, "transaction", open_only)
    assert commands.run("load", url, DOMAIN).exit_code == 1
    monkeypatch.undo()
    with opened[0] as other:
        other.types.save(PddlTypeDto("robot"))
    assert written_names(url) == ["other"]


@pytest.mark.more
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_load_that_is_stopped_leaves_no_new_file(tmp_path: Path, number: signal.Signals) -> None:
    facts = " ".join(f"(p o{one})" for one in range(40_000))
    objects = " ".join(f"o{one}" for one in range(40_000))
    (tmp_path / "large.pddl").write_text(
        "(define (domain d) (:predicates (p ?x)))"
        f"(define (problem q) (:domain d) (:objects {objects}) (:init {facts}) (:goal (and)))"
    )
    # The warm process does not pass this signal on.
    program = commands.PROGRAM if number == signal.SIGHUP else ()
    words = "load", f"sqlite:///{tmp_path}/new.db", f"{tmp_path}/large.pddl"
    process = commands.start(*words, program=program)
    wait_for(lambda: (tmp_path / "new.db").exists() or process.poll() is not None)
    assert process.poll() is None
    process.send_signal(number)
    output, error = process.communicate(timeout=commands.CHILD_TIMEOUT)
    assert (process.returncode, output, error) == (128 + number, b"", b"")
    assert os.listdir(tmp_path) == ["large.pddl"]


def test_an_interrupt_between_a_statement_and_its_rows_leaves_no_new_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(session: Session) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr(Session, "_fetch", interrupt)
    url = f"sqlite:///{tmp_path}/new.db"
    with pytest.raises(KeyboardInterrupt), leaving_nothing(url):
        kant_sql.connect(url)
    assert os.listdir(tmp_path) == []


def test_the_library_says_how_far_a_load_has_come(url: str) -> None:
    told: list[tuple[int, int]] = []
    objects = " ".join(f"o{one}" for one in range(3_000))
    facts = " ".join(f"(p o{one})" for one in range(3_000))
    with kant_sql.connect(url) as kb:
        kb.load_domain(
            "(define (domain d) (:predicates (p ?x)) (:action a :effect ()))",
            progress=lambda *both: told.append(both),
        )
        assert told[-1] == (2, 2)
        told.clear()
        kb.load_problem(
            f"(define (problem q) (:domain d) (:objects {objects}) (:init {facts}) (:goal (and)))",
            progress=lambda *both: told.append(both),
        )
    assert told[0][0] == 3_000
    assert told[-1] == (6_000, 6_000)
    assert told == sorted(told)
    assert len(told) > 2

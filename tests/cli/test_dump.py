"""`kant-sql dump`: domain and problem as PDDL, now and then."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import kant_sql
from kant_sql.pddl import read, read_domain, read_problem
from tests.support.processes.commands import PROGRAM, child, run, written
from tests.support.worlds.robots import WP2, robot_at

FILES = Path(__file__).parent / "files"
DOMAIN, PROBLEM = FILES / "watering.pddl", FILES / "balcony.pddl"


@pytest.fixture
def url(file_url: str) -> str:
    """The URL of a store with a domain and a problem."""
    with kant_sql.connect(file_url) as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
    return file_url


def dumped(*words: str) -> str:
    return written("dump", *words)


def test_domain_and_problem_are_one_text_that_the_reader_reads(url: str) -> None:
    domain = read_domain(DOMAIN)
    assert read(dumped(url)) == [domain, read_problem(PROBLEM, domain=domain)]


def test_one_of_them_can_be_had_alone(url: str) -> None:
    domain, problem = dumped(url, "--domain"), dumped(url, "--problem")
    assert [type(each).__name__ for each in read(domain)] == ["Domain"]
    assert [type(each).__name__ for each in read(problem)] == ["Problem"]
    assert dumped(url) == dumped(url, "--domain", "--problem") == f"{domain}\n{problem}"


def test_what_is_dumped_and_loaded_is_the_same(url: str, new_url: str, tmp_path: Path) -> None:
    path = tmp_path / "all.pddl"
    path.write_bytes(child("dump", url).stdout.encode())
    kant_sql.upgrade(new_url)
    result = run("load", new_url, str(path), "--kb", "copy")
    assert (result.exit_code, result.stderr) == (0, "")
    assert dumped(new_url, "--kb", "copy").encode() == path.read_bytes()
    with kant_sql.connect(url) as kb, kant_sql.connect(new_url, knowledge_base="copy") as copy:
        assert (kb.pddl.domain(), kb.pddl.problem()) == (copy.pddl.domain(), copy.pddl.problem())


def test_a_revision_of_the_past_is_dumped(store: str) -> None:
    for at, fact in (("1", "(robot_at rb1 wp1)"), ("2", "(robot_at rb1 wp2)")):
        (problem,) = read(dumped(store, "--at", at, "--problem"))
        assert isinstance(problem, kant_sql.pddl.Problem)
        assert [str(each) for each in problem.facts] == [fact]
    with kant_sql.connect(store, knowledge_base="tiago") as kb:
        moment = kb.store.revisions()[0].committed_at
    assert dumped(store, "--at", moment.isoformat()) == dumped(store, "--at", "1")


def test_both_are_of_one_state_whatever_is_written_meanwhile(
    own_store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = dumped(own_store)
    kind = kant_sql.KnowledgeBase
    domain_pddl = kind.domain_pddl

    def write_after(kb: kant_sql.KnowledgeBase) -> str:
        text = domain_pddl(kb)
        with kant_sql.connect(own_store, knowledge_base="tiago") as other:
            other.goals.save(robot_at(place=WP2, is_goal=True))
        return text

    monkeypatch.setattr(kind, "domain_pddl", write_after)
    assert dumped(own_store) == expected
    monkeypatch.undo()
    assert dumped(own_store) != expected


@pytest.mark.more
def test_pddl_is_utf_8_whatever_the_locale(file_url: str) -> None:
    with kant_sql.connect(file_url) as kb:
        kb.types.save(kant_sql.PddlTypeDto("机器人"))
    done = child(
        *("dump", file_url, "--domain"),
        program=PROGRAM,
        PYTHONIOENCODING="ascii",
        PYTHONUTF8="0",
        LC_ALL="C",
    )
    assert "    机器人 - object\n" in done.stdout


@pytest.mark.parametrize("words", [[], ["--domain"], ["--problem"], ["--at", "1"]])
def test_json_has_the_same_texts(store: str, words: list[str]) -> None:
    document = json.loads(run("dump", store, "--json", *words).stdout)
    assert document["knowledge_base"] == "tiago"
    assert document["revision"] == (1 if "--at" in words else 3)
    texts = [text for text in (document["domain"], document["problem"]) if text is not None]
    assert "\n".join(texts) == run("dump", store, *words).stdout
    assert len(texts) == (1 if words in (["--domain"], ["--problem"]) else 2)

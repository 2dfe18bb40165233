"""A name is erased: it is nowhere any more, and the history is verified as before."""

from __future__ import annotations

import json
import re
import signal
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import timedelta
from pathlib import Path
from typing import Any
from unicodedata import normalize

import psycopg
import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto, Plan, errors
from kant_sql.history.erasure.retention import RetentionRule, read_rules
from kant_sql.history.verify.chain import stream_chain
from kant_sql.knowledge.canonical import revision_hash
from kant_sql.sql.definition_rows import load_at
from kant_sql.sql.dialects import create_backend, postgresql
from kant_sql.sql.dialects.postgresql import PostgresqlBackend
from kant_sql.store import caches
from tests.support.processes import commands
from tests.support.reading import loaded
from tests.support.servers import Server
from tests.support.stores import Connect

NAME = "maria_sklodowska"
DOMAIN = f"""
(define (domain care) (:requirements :typing :fluents :constraints) (:types person room)
  (:constants {NAME} - person)
  (:predicates (at ?p - person ?r - room) (clean ?r - room))
  (:functions (age ?p - person) - number (guest ?r - room) - person)
  (:derived (free ?r - room) (not (at {NAME} ?r)))
  (:action move :parameters (?a ?b - room) :precondition (at {NAME} ?a)
    :effect (and (not (at {NAME} ?a)) (at {NAME} ?b))))
""".replace("(clean ?r - room)", "(clean ?r - room) (free ?r - room)")
PROBLEM = f"""
(define (problem day) (:domain care) (:objects bob - person hall bath - room)
  (:init (at {NAME} hall) (at bob bath) (= (age {NAME}) 80) (= (guest hall) {NAME}))
  (:goal (and (at {NAME} bath) (or (at {NAME} hall) (at bob hall)))))
"""


def fill(kb: KnowledgeBase) -> KnowledgeBase:
    """A history that mentions the name in each table that can."""
    loaded(kb, DOMAIN, PROBLEM)
    kb.rules.save("watch", f"(always (not (at {NAME} bath)))")
    with kb.transaction(actor="camera", reason=f"saw {NAME}", source={"who": NAME, "at": 3}):
        kb.propositions.delete(f"(at {NAME} hall)")
        kb.propositions.save(f"(at {NAME} bath)")
    with kb.transaction(actor="camera"):
        kb.propositions.confirm([f"(at {NAME} bath)"])
    kb.plans.record(Plan.read("(move bath hall)"))
    kb.plans.record(
        Plan.read("(move bath hall)"),
        planner_version=f"1.0 of {NAME}",
        domain_pddl="(define (domain d))",
        problem_pddl=f"(define (problem p) (:objects {NAME} {NAME}2))",
    )
    kb.executions.report(
        "call",
        arguments=[NAME.upper(), "bob"],
        outcome="failed",
        code="E1",
        text=f"no {NAME} there",
    )
    kb.function_values.save(f"(= (age {NAME}) 81)")
    return kb


@pytest.fixture
def kb(kb: KnowledgeBase) -> KnowledgeBase:
    return fill(kb)


def everything(kb: KnowledgeBase) -> str:
    """All that a knowledge base answers, of all revisions."""
    said: list[Any] = [kb.log(), kb.domain_pddl(), kb.problem_pddl(), kb.plans.get_all()]
    said += [kb.executions.get_all(), kb.rules.get_all(), kb.diff(0, kb.revision)]
    for number in range(1, kb.revision + 1):
        then = kb.at(number)
        said += [then.propositions.get_all(), then.function_values.get_all()]
        said += [then.objects.get_all(), then.actions.get_all()]
    for plan in kb.plans.get_all():
        said += [plan.domain_pddl(), plan.problem_pddl()]
    return repr([*map(str, said), said]).lower()


def test_an_erased_name_is_in_no_answer_and_the_chain_is_intact(kb: KnowledgeBase) -> None:
    anchor, revision = kb.store.anchor(), kb.revision
    assert kb.store.verify().findings == ()
    assert NAME in everything(kb)
    erased = kb.erase(NAME, reason="she asked for it", also=["reason", "source"])
    assert (erased.revision, erased.pseudonym, erased.form_1) == (revision + 1, "erased-1", 0)
    assert erased.parts > 15
    assert erased.revisions > 7
    said = everything(kb)
    assert f"{NAME}2" in said
    assert NAME not in said.replace(f"{NAME}2", "")
    found = kb.store.verify(anchor=anchor)
    assert (found.findings, len(found.erasures)) == ((), 1)
    assert kb.holds("(at erased-1 bath)")
    assert [*kb.when("(at erased-1 hall)")]
    assert kb.at(2).holds("(at erased-1 hall)")
    assert kb.history("(at erased-1 hall)")


def test_a_plan_that_was_read_before_an_erasure_has_the_texts_of_now(kb: KnowledgeBase) -> None:
    plans = kb.plans.get_all()
    kb.erase(NAME, reason="she asked for it")
    now = kb.plans.get_all()
    assert [one.problem_hash for one in plans] != [one.problem_hash for one in now]
    for before, after in zip(plans, now, strict=True):
        assert before.domain_pddl() == after.domain_pddl()
        assert before.problem_pddl() == after.problem_pddl()


def test_a_second_name_in_the_same_texts_is_erased_too(kb: KnowledgeBase) -> None:
    kb.erase(NAME, reason="she asked for it")
    kb.propositions.save("(at erased-1 hall)")
    assert kb.erase("bath", reason="rebuilt").pseudonym == "erased-2"
    assert kb.erase("bob", reason="left").pseudonym == "erased-3"
    kb.propositions.delete("(at erased-1 hall)")
    assert "bob" not in everything(kb).replace('"bob"', "")
    found = kb.store.verify()
    assert (found.findings, len(found.erasures)) == ((), 3)


def files_of(url: str) -> list[Path]:
    """The files in which a store keeps its rows."""
    path = url.removeprefix("sqlite:///")
    if path != url:
        return [Path(f"{path}{end}") for end in ("", "-wal") if Path(f"{path}{end}").exists()]
    with psycopg.connect(url.replace("+psycopg", ""), autocommit=True) as connection:
        connection.execute("CHECKPOINT")
        [(folder,)] = connection.execute("SHOW data_directory").fetchall()
        rows = connection.execute(
            "SELECT pg_relation_filepath(c.oid) FROM pg_class AS c JOIN pg_namespace AS n "
            "ON n.oid = c.relnamespace WHERE c.relkind IN ('r', 'i', 't') "
            "AND n.nspname IN ('public', 'pg_toast')"
        ).fetchall()
    return [Path(folder) / row[0] for row in rows if row[0] is not None]


def has_bytes(url: str, name: str) -> list[str]:
    """Name the files that have a name, in any case."""
    return [str(file) for file in files_of(url) if name.encode() in file.read_bytes().lower()]


def test_no_byte_of_it_is_left(shared_url: str, connect: Connect) -> None:
    kb = fill(connect(shared_url, knowledge_base="tiago", actor="test"))
    assert has_bytes(shared_url, NAME)
    erased = kb.erase(NAME, reason="asked", also=["reason", "source"])
    assert erased.remaining == ()
    # Another name, which contains it.
    for file in files_of(shared_url):
        assert NAME.encode() not in file.read_bytes().lower().replace(f"{NAME}2".encode(), b"")


def test_a_reader_of_the_log_is_named(tmp_path: Path, connect: Connect) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}?timeout=0.2"
    kb = fill(connect(url, knowledge_base="tiago"))
    with closing(sqlite3.connect(tmp_path / "store.db", isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM object").fetchall()
        (remaining,) = kb.erase(NAME, reason="asked", also=["reason", "source"]).remaining
        assert "wal_checkpoint" in remaining


def test_a_reader_of_a_replica_is_named(tmp_path: Path, connect: Connect) -> None:
    kb = fill(connect(f"sqlite:///{tmp_path / 'store.db'}", knowledge_base="tiago"))
    replica = f"sqlite:///{tmp_path / 'replica.db'}?timeout=0.2"
    kb.store.push(replica)
    kb.erase(NAME, reason="asked", also=["reason", "source"])
    with closing(sqlite3.connect(tmp_path / "replica.db", isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM object").fetchall()
        (remaining,) = kb.store.push(replica).remaining
    assert "wal_checkpoint" in remaining
    assert kb.store.push(replica).remaining == ()


def test_a_reader_of_a_table_is_no_hindrance_for_the_others(
    server: Server, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = server.new_store()
    kb = fill(connect(url, knowledge_base="tiago"))
    monkeypatch.setattr(PostgresqlBackend, "patience", 0.1)
    monkeypatch.setattr(postgresql, "_TURN", 0.1)
    ask = "SELECT pg_relation_filenode('object'), pg_relation_filenode('revision')"
    with psycopg.connect(url.replace("+psycopg", "")) as reader:
        (before,) = reader.execute(ask).fetchall()
        reader.execute("SELECT count(*) FROM object").fetchall()
        (remaining,) = kb.erase(NAME, reason="asked", also=["reason", "source"]).remaining
        (after,) = reader.execute(ask).fetchall()
    assert "others use object; run VACUUM (FULL, ANALYZE)" in remaining
    assert (after[0] == before[0], after[1] == before[1]) == (True, False)


def test_a_name_goes_in_each_spelling(fresh_kb: KnowledgeBase) -> None:
    kb, name = fresh_kb, "Weiß\\Ångström"
    kb.objects.save(PddlObjectDto(PddlTypeDto("person"), name))
    reasons = name.upper(), normalize("NFD", name).upper(), json.dumps({"who": name})
    for number, reason in enumerate(reasons):
        with kb.transaction(reason=f"{reason} came", source={"who": name}):
            kb.predicates.save(f"(awake{number})")
    spelled = f"no {name.upper()}, {normalize('NFD', name)}, {json.dumps(name)}"
    kb.executions.report("call", outcome="failed", text=spelled)
    found = kb.erasure_preview(name).mentions
    assert [one.place for one in found] == ["reason"] * 3 + ["source"] * 3
    kb.erase(name, reason="asked", also=["reason", "source"])
    (call,) = kb.executions.get_all()
    assert call.text == 'no erased-1, erased-1, "erased-1"'
    said = [entry.revision for entry in kb.log() if entry.revision.number in (2, 3, 4)]
    assert [(one.reason, one.source) for one in said] == [("erased-1", "erased-1")] * 3
    assert kb.store.verify().findings == ()


def test_a_short_name_is_not_found_within_words(kb: KnowledgeBase) -> None:
    kb.objects.save(PddlObjectDto(PddlTypeDto("person"), "ann"))
    for number, (actor, reason) in enumerate((("planner", "it cannot"), ("ANN", "(ann)"))):
        with kb.transaction(actor=actor, reason=reason, source={"who": reason}):
            kb.predicates.save(f"(told{number})")
    found = kb.erasure_preview("ann").mentions
    assert [(one.place, one.text) for one in found[:2]] == [("actor", "ANN"), ("reason", "(ann)")]
    assert len(found) == 3
    kb.erase("ann", reason="she cannot", also=["actor", "reason", "source"])
    said = [entry.revision for entry in kb.log(limit=3)]
    assert [(one.actor, one.reason) for one in said] == [
        *(("test", "she cannot"), ("erased-1", "erased-1"), ("planner", "it cannot"))
    ]
    assert kb.store.verify().findings == ()


def test_what_revisions_say_is_erased(kb: KnowledgeBase) -> None:
    number = next(entry.revision.number for entry in kb.log() if entry.revision.reason)
    erased = kb.erase(revisions=[number], parts=["reason", "source", "actor"], reason="asked")
    assert (erased.element_id, erased.parts, erased.revisions) == (None, 3, 1)
    said = next(entry.revision for entry in kb.log() if entry.revision.number == number)
    assert (said.reason, said.source, said.actor) == ("erased-1",) * 3
    assert kb.store.verify().findings == ()
    assert kb.erase(revisions=[number], parts=["reason"], reason="again").parts == 1
    assert kb.erase(NAME, reason="asked").pseudonym == "erased-3"
    assert kb.store.verify().findings == ()


def test_what_cannot_be_erased_is_refused_with_a_remedy(kb: KnowledgeBase) -> None:
    before = kb.revision
    for wrong, error in (
        ({"element": NAME, "reason": f"{NAME.title()} asked"}, errors.InvalidArgumentError),
        ({"element": NAME, "reason": "asked", "actor": NAME}, errors.InvalidArgumentError),
        ({"element": "bob", "reason": "Bob left"}, errors.InvalidArgumentError),
        ({"element": "nobody", "reason": "asked"}, errors.UnknownNameError),
        (
            {"revisions": [before + 1], "parts": ["reason"], "reason": "x"},
            errors.UnknownRevisionError,
        ),
        ({"reason": "x"}, errors.InvalidArgumentError),
        (
            {"element": "bob", "revisions": [1], "parts": ["reason"], "reason": "x"},
            errors.InvalidArgumentError,
        ),
        ({"revisions": [1], "reason": "x"}, errors.InvalidArgumentError),
        (
            {"revisions": [4], "parts": ["reason"], "also": ["actor"], "reason": "x"},
            errors.InvalidArgumentError,
        ),
        ({"revisions": [1], "parts": ["hash"], "reason": "x"}, errors.InvalidArgumentError),
        ({"element": NAME, "also": "reason", "reason": "x"}, errors.InvalidArgumentError),
        ({"revisions": 1, "parts": ["reason"], "reason": "x"}, errors.InvalidArgumentError),
    ):
        with pytest.raises(error):
            kb.erase(**wrong)
    with kb.transaction(), pytest.raises(errors.ReadOnlyError, match="transaction open"):
        kb.erase(NAME, reason="asked")
    assert kb.erase(revisions=[1], parts=["reason"], reason="x").revision is None
    assert kb.revision == before
    assert kb.holds(f"(at {NAME} bath)")


def test_a_preview_lists_what_would_stay_and_changes_nothing(kb: KnowledgeBase) -> None:
    kb.objects.save(PddlObjectDto(PddlTypeDto("person"), "marja_sklodowska"))
    before = kb.revision
    found = kb.erasure_preview(NAME)
    assert (found.pseudonym, found.form_1, found.similar) == ("erased-1", 0, ("marja_sklodowska",))
    assert {mention.place for mention in found.mentions} == {"reason", "source", "plan's problem"}
    assert (kb.revision, kb.store.verify().findings) == (before, ())
    assert kb.erase(NAME, reason="asked").parts == found.parts


def test_a_preview_lists_names_that_are_no_objects(url: str, connect: Connect) -> None:
    kb = connect(url, knowledge_base="home_of_maria")
    kb.load_domain(DOMAIN.replace(NAME, "maria").replace("?p - ", "?maria - "))
    kb.goals.save("(preference maria_wish (forall (?m_maria - room) (clean ?m_maria)))")
    found = {(one.place, one.text) for one in kb.erasure_preview("maria").mentions}
    assert found == {
        *(("parameter", "maria"), ("variable", "m_maria"), ("preference", "maria_wish")),
        ("knowledge base", "home_of_maria"),
    }


def test_other_connections_answer_with_the_pseudonym(shared_url: str, connect: Connect) -> None:
    kb = fill(connect(shared_url, knowledge_base="tiago"))
    other, writer = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    past = other.at(3)
    assert past.objects.get(NAME)
    assert other.objects.get(NAME)
    assert other.holds(f"(at {NAME} bath)")
    writer.propositions.save(f"(at {NAME} hall)")
    kb.erase(NAME, reason="asked", also=["reason", "source"])
    for reader in (past, other, writer):
        assert reader.objects.get(NAME) is None
        assert NAME not in str(reader.propositions.get_all())
    assert NAME not in everything(other).replace(f"{NAME}2", "")
    assert writer.propositions.delete("(at erased-1 hall)")
    assert NAME not in everything(writer).replace(f"{NAME}2", "")
    assert kb.store.verify().findings == ()


def test_a_reader_that_began_before_keeps_no_name_for_later_ones(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb, other = connect(shared_url), fill(connect(shared_url))
    kb.objects.get_all()

    def erased_meanwhile(*given: Any) -> Any:
        monkeypatch.undo()
        found = load_at(*given)
        with ThreadPoolExecutor(1) as another:
            another.submit(other.erase, NAME, reason="asked").result(60)
            assert NAME not in str(another.submit(kb.objects.get_all).result(60))
        return found

    monkeypatch.setattr(caches, "load_at", erased_meanwhile)
    assert NAME in str(kb.at(1).objects.get_all())
    assert NAME not in str(kb.at(1).objects.get_all())


def test_replicas_follow(shared_url: str, connect: Connect, tmp_path: Path) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    urls = [f"sqlite:///{tmp_path / name}.db" for name in ("near", "away", "new")]
    kb.load_domain(DOMAIN)
    kb.store.push(urls[1])
    fill(kb)
    kb.store.push(urls[0])
    kb.erase(NAME, reason="asked", also=["reason", "source"])
    # The name comes again, and is another person's.
    kb.objects.save(PddlObjectDto(PddlTypeDto("person"), NAME))
    kb.propositions.save(f"(at {NAME} hall)")
    kb.erase("bath", reason="rebuilt")
    kb.erase(NAME, reason="asked, too")
    for url in urls:
        kb.store.push(url)
        replica = connect(url, knowledge_base="tiago")
        answers = [
            ([*each.log()], each.problem_pddl(), each.domain_pddl()) for each in (kb, replica)
        ]
        assert (answers[0] == answers[1]) is True
        assert NAME not in everything(replica).replace(f"{NAME}2", "")
        assert (replica.store.verify().findings, has_bytes(url, f"{NAME} ")) == ((), [])
        replica.close()
    kb.propositions.save("(at erased-1 hall)")
    for url in urls:
        assert kb.store.push(url).revisions == 1


@pytest.mark.parametrize("writes", [False, True])
def test_a_source_that_is_restored_brings_no_name_back(
    tmp_path: Path, connect: Connect, writes: bool
) -> None:
    path, copy, replica = (tmp_path / f"{name}.db" for name in ("own", "copy", "replica"))
    kb = fill(connect(f"sqlite:///{path}", knowledge_base="tiago"))
    kb.store.push(f"sqlite:///{replica}")
    kant_sql.operations.backup(f"sqlite:///{path}", copy)
    kb.erase(NAME, reason="asked", also=["reason", "source"])
    kb.store.push(f"sqlite:///{replica}")
    head = kb.revision
    restored = connect(f"sqlite:///{copy}", knowledge_base="tiago")
    assert restored.objects.get(NAME) is not None
    if writes:
        restored.propositions.save(f"(at {NAME} hall)")
    why = f"differs is {head}" if writes else "has the erased texts again"
    with pytest.raises(errors.DivergedError, match=why) as caught:
        restored.store.push(f"sqlite:///{replica}")
    assert str(replica) in str(caught.value)
    kept = connect(f"sqlite:///{replica}", knowledge_base="tiago")
    assert (kept.revision, kept.objects.get(NAME)) == (head, None)
    assert NAME not in everything(kept).replace(f"{NAME}2", "")
    assert not has_bytes(f"sqlite:///{replica}", f"{NAME} ")
    assert not restored.store.verify(kb.store.anchor()).is_intact


def test_a_replica_that_is_behind_brings_no_name_back(tmp_path: Path, connect: Connect) -> None:
    own, behind, replica = (f"sqlite:///{tmp_path / name}.db" for name in ("own", "old", "new"))
    kb = fill(connect(own, knowledge_base="tiago"))
    for target in (behind, replica):
        kb.store.push(target)
    kb.erase(NAME, reason="asked")
    kb.store.push(replica)
    late = connect(behind, knowledge_base="tiago")
    with pytest.raises(errors.DivergedError, match=re.escape(f"push to it from {own} first")):
        late.store.push(replica)
    kb.store.push(behind)
    assert late.store.push(replica).revisions == 0


def test_old_revisions_forget_by_rules(url: str, connect: Connect) -> None:
    kb = connect(url, knowledge_base="tiago", actor="test")
    for actor in ("camera", "executive"):
        with kb.transaction(actor=actor, reason="seen", source={"by": actor}):
            kb.types.save(PddlTypeDto(f"by_{actor}"))
    rules = read_rules(["# of cameras", "  # and", "", "camera 0s reason,source"])
    done = kb.store.retain(rules)
    assert (done.revision, done.parts, done.revisions) == (3, 2, 1)
    said = {entry.revision.actor: entry.revision.reason for entry in kb.log()}
    assert said == {"test": "rules of retention", "camera": "erased-1", "executive": "seen"}
    assert kb.store.retain(rules).revision is None
    for age in ("1d", "999999d"):
        assert kb.store.retain(read_rules([f"* {age} actor,reason,source"])).revision is None
    with pytest.raises(errors.InvalidArgumentError, match="unpaired surrogate"):
        read_rules(["camera\ud800 1d reason"])
    assert kb.store.retain(read_rules(["* 0s reason"]), reason="all").parts == 1
    assert kb.store.verify().findings == ()
    for wrong in ("camera", "camera 3 reason", "camera 3d hash", "camera 3y reason"):
        with pytest.raises(errors.InvalidArgumentError, match="camera 30d reason,source"):
            read_rules([wrong])
    written = {
        'camera "2"': 'camera "2"',
        '"night  shift "': "night  shift ",
        '""c""': '"c"',
        '""': "",
    }
    for line, actor in written.items():
        assert read_rules([f"{line} 1d reason"])[0].actor == actor
    none: tuple[Any, ...] = (None, 5, "camera 30d reason", [None], [b"camera 30d reason"])
    for given in none:
        with pytest.raises(errors.InvalidArgumentError, match="rules of retention"):
            read_rules(given)


def test_rules_that_defeat_each_other_are_refused(fresh_kb: KnowledgeBase) -> None:
    for lines in (
        ["camera 30d actor", "camera 60d reason"],
        ["* 30d reason,actor", "camera 31d reason,source"],
    ):
        with pytest.raises(errors.InvalidArgumentError, match="another rule erases earlier"):
            fresh_kb.store.retain(read_rules(lines))
    for lines in (
        ["camera 30d actor", "* 60d reason", "camera 30d source", "camera 90d actor"],
        ["door 30d actor", "camera 60d reason", "camera 60d actor"],
    ):
        assert fresh_kb.store.retain(read_rules(lines)).revision is None


def test_rules_that_are_none_are_refused(fresh_kb: KnowledgeBase) -> None:
    age = timedelta(0)
    wrong: tuple[Any, ...] = (
        ("test", age, ("hash",)),
        ("test", age, "reason"),
        ("test", None, ("reason",)),
        ("test", timedelta(-1), ("reason",)),
        (5, age, ("reason",)),
    )
    for one in wrong:
        with pytest.raises(errors.InvalidArgumentError):
            fresh_kb.store.retain([RetentionRule(*one)])
    longest = RetentionRule(None, timedelta.max, ("reason",))
    assert fresh_kb.store.retain([longest]).revision is None


@pytest.mark.more
def test_a_service_forgets_again_and_again_until_it_is_asked_to_stop(
    tmp_path: Path, connect: Connect
) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    kb = connect(url, knowledge_base="tiago")
    words = "--after", "0s", "--parts", "reason", "--every", "1", "--json"
    program = commands.PROGRAM
    with kb.transaction(reason="first"):
        kb.types.save("room")
    with commands.start("retention", url, *words, program=program) as process:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["revision"] == 2
        with kb.transaction(reason="second"):
            kb.types.save("person")
        while (told := json.loads(process.stdout.readline()))["revision"] is None:
            continue
        process.send_signal(signal.SIGTERM)
        assert process.wait(commands.CHILD_TIMEOUT) == 0
    assert (told["revision"], told["parts"]) == (4, 1)
    assert [entry.revision.reason for entry in kb.log()] == [
        *("rules of retention", "erased-2", "rules of retention", "erased-1")
    ]


def test_the_prompt_is_dry_without_yes(tmp_path: Path, connect: Connect) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    fill(connect(url, knowledge_base="tiago")).close()
    dry = commands.run("erase", url, NAME)
    assert (dry.exit_code, "Nothing was changed" in dry.output, f"saw {NAME}" in dry.output) == (
        0,
        True,
        True,
    )
    assert commands.run("erase", url, NAME, "--yes").exit_code == 2
    asked = "erase", url, NAME, "--reason", "asked", "--also", "actor,reason"
    for words, lacking in (((), "; add --yes"), (("--yes", "--dry-run"), "")):
        assert f"Nothing was changed{lacking}.\n" in commands.run(*asked, *words).output
    done = commands.run(*asked, "--yes")
    assert (done.exit_code, "erased-1" in done.output, NAME in done.output) == (0, True, False)
    assert "erased by revision" in commands.run("verify", url).output
    said = "erase", url, "--revision", "4", "--parts", "actor"
    assert "would erase: actor of revision 4: camera" in commands.run(*said).output
    assert "camera" in commands.run(*said, "--json").output
    assert "they are called erased-2" in commands.run(*said, "--reason", "x", "--yes").output
    assert commands.run("erase", url, "--revision", "99").exit_code == 1
    nothing = commands.run("erase", url, "--revision", "1", "--reason", "x", "--yes")
    assert "there is nothing to erase" in nothing.output
    ignored = (
        ("erase", url, "bob", "--parts", "reason"),
        ("erase", url, "--revision", "4", "--also", "reason"),
        ("retention", url, "--rules", "rules.txt", "--of", "camera"),
        ("retention", url, "--rules", "rules.txt", "--parts", "reason"),
    )
    for refused in ignored:
        assert "needs" in commands.complaint(*refused, code=2)
    for wrong in (("erase", url), ("erase", url, "bob", "--revision", "4"), ("retention", url)):
        assert commands.run(*wrong).exit_code == 2
    (path := tmp_path / "rules").write_bytes(b"\xff 30d reason")
    assert "unpaired surrogate" in commands.complaint("retention", url, "--rules", str(path))
    path.write_bytes(b"\xef\xbb\xbfcamera 900d source\n  # and\n")
    assert "nothing is old enough" in commands.run("retention", url, "--rules", str(path)).output
    none = commands.run("retention", url, "--after", "0s", "--parts", "source", "--of", "")
    assert "nothing is old enough" in none.output
    misspelt = commands.run("retention", url, "--after", "900d", "--of", "camra")
    assert "no revision by actor 'camra' (did you mean camera?)" in misspelt.stderr
    left = commands.run("retention", url, "--after", "0s", "--parts", "source", "--json")
    assert json.loads(left.output)["parts"] == 1


def test_what_was_erased_can_be_archived(tmp_path: Path, connect: Connect) -> None:
    kb = fill(connect(f"sqlite:///{tmp_path / 'store.db'}", knowledge_base="tiago"))
    kb.erase(NAME, reason="asked", also=["reason", "source"])
    archive = f"sqlite:///{tmp_path / 'archive.db'}"
    assert kb.store.archive(kb.revision, to=archive).versions
    assert kb.store.verify().findings == ()
    assert connect(archive, knowledge_base="tiago").store.verify().findings == ()
    with pytest.raises(errors.ConflictError, match="archive"):
        kb.erase("bob", reason="asked")


def rehash(url: str) -> None:
    """Make a file one that was written in form 1 of the hash."""
    hashes: list[tuple[str, int]] = []
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        for step in stream_chain(session, 1):
            assert step.link is not None
            said = step.link.number, step.link.committed_at, step.link.metadata
            previous = hashes[-1][0] if hashes else None
            digest = revision_hash(previous, "tiago", *said, step.changes, None, 1)
            hashes.append((digest, step.link.number))
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as driver, driver:
        change = "UPDATE revision SET hash = ?, seed = NULL, form = 1 WHERE number = ?"
        driver.executemany(change, hashes)
        driver.execute("UPDATE head SET hash = ?", hashes[-1][:1])


def test_revisions_of_form_1_are_erased_when_asked(tmp_path: Path, connect: Connect) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    fill(connect(url, knowledge_base="tiago")).close()
    rehash(url)
    kb = connect(url, knowledge_base="tiago")
    anchor = kb.store.anchor()
    with pytest.raises(errors.ConflictError, match="9 revisions of form 1"):
        kb.erase(NAME, reason="asked")
    for name in (NAME, "bath"):
        assert kb.erase(name, reason="asked", also=["reason", "source"], form_1=True).form_1 > 5
        assert kb.store.verify(anchor=anchor).findings == ()
    assert NAME not in everything(kb).replace(f"{NAME}2", "")
    replica = f"sqlite:///{tmp_path / 'replica.db'}"
    kb.store.push(replica)
    assert connect(replica, knowledge_base="tiago").store.verify().findings == ()

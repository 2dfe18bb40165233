"""`docs/hash.md` says enough to recompute every hash: its statements and its program do so here.

The library makes the stores; what checks them is `sqlite3` or psycopg, and the text of the page.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from types import SimpleNamespace
from typing import Any

import pytest
import rfc8785
from hypothesis import given
from hypothesis import strategies as st

import kant_sql.sql.dialects.base
from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.dto.formulas import Atom, Constant, Or
from kant_sql.history.verify.parts import SAID_AT
from kant_sql.knowledge.canonical import Metadata, make_metadata, revision_hash, time_text
from kant_sql.store import transaction as propositions
from tests.support.pages import Page, opened
from tests.support.stores import Connect
from tests.support.worlds.robots import BATTERY, RB1, ROBOT, WP2, navigation, robot_at

PAGE = Page("hash.md")
SQL = {block.partition("\n")[0].removeprefix("-- "): block for block in PAGE.of("sql")}
PYTHON = PAGE.of("python")
# The page breaks the one line of a document.
DOCUMENTS = [block.replace("\n", "") for block in PAGE.of("json")]
HASHES = [block.strip() for block in PAGE.of("text") if len(block) == 65]

PROGRAM: dict[str, Any] = {}
exec(PYTHON[-1], PROGRAM)


EITHER_PLACE = Or(
    tuple(Atom("robot_at", (Constant("rb1"), Constant(place))) for place in ("wp1", "wp2"))
)


def last_hash(url: str, name: str = "tiago") -> str | None:
    """Check a chain as the page says."""
    with opened(url) as store:
        revisions = SQL[f"revisions, {store.dialect}"]
        statements = revisions, SQL["changes"], SQL["commitments"]
        found: str | None = PROGRAM["check_chain"](store.execute, *statements, name)
        return found


def write_history(kb: KnowledgeBase) -> None:
    """Change every kind of element, in every way."""
    kb.propositions.save(robot_at())
    kb.goals.save(robot_at(is_goal=True))
    kb.actions.save(navigation())
    kb.actions.save(PddlActionDto("navigation", durative=False))
    with kb.transaction(actor='exec "\\" \x01\t', reason="one\ntwo\r\u2028 \x7f"):
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(place=WP2))
    running = kb.executions.report("dock", arguments=["rb1", 'bay "4"'], outcome="running")
    with kb.transaction(execution=running):
        kb.fail(running, code="E4", text="no\ncharger")
    kb.types.save(PddlTypeDto("wp", parent=PddlTypeDto("Ort")), cascade=True)
    for name in ("\U0001f916", "\uff21", "Straße", "e\u0301", "a--", "%s", "\\n"):
        kb.objects.save(PddlObjectDto(ROBOT, name))
    kb.propositions.save_all(
        PddlPropositionDto(PddlPredicateDto("ready", [ROBOT]), [PddlObjectDto(ROBOT, name)])
        for name in ("\U0001f916", "\uff21", "straße", "e\u0301")
    )
    kb.predicates.save(PddlPredicateDto("ready", [ROBOT, ROBOT]), cascade=True)
    kb.function_values.set(BATTERY, objects=[RB1], value=80)
    kb.function_values.decrease(BATTERY, objects=[RB1], by=12.5)
    kb.goals.save(EITHER_PLACE)
    kb.load_domain("(define (domain d) (:predicates (p)))", mode="merge")
    kb.types.delete(ROBOT)
    kb.types.delete_all()


SOURCES: list[object] = [
    {"\U0001f916": 1, "\uff21": 2, "b": [1.0, 1e21, 1e-7, 0.1, -0.0], "a": {"c": None}},
    *("5", 0.1, 1e21, 1e-7, 0, True, [], "", 'a\0b\n"\\'),
]


def test_every_hash_recomputes_from_the_tables(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    write_history(kb)
    assert kb.revision == 23
    assert last_hash(shared_url) == kb.store.revisions()[-1].hash


def test_what_an_erasure_left_recomputes_from_the_tables(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    write_history(kb)
    known = [revision.hash for revision in kb.store.revisions()]
    assert kb.erase("rb1", reason="sold").parts > 5
    labels = ["actor", "reason"]
    erased = kb.erase(revisions=[5, 6], parts=labels, reason="asked for", actor="office")
    assert erased.parts > 1
    assert [revision.hash for revision in kb.store.revisions()][: len(known)] == known
    assert last_hash(shared_url) == kb.store.revisions()[-1].hash
    with opened(shared_url) as store:
        ((number, kept),) = store.execute(
            "SELECT number, count(salt) FROM commitment GROUP BY number ORDER BY 2 DESC LIMIT 1", {}
        )
        assert kept
        store.execute(f"UPDATE commitment SET place = 7 WHERE number = {number}", {})
    with pytest.raises(AssertionError):
        last_hash(shared_url)


def test_the_page_says_where_actor_reason_and_source_stand() -> None:
    at = [f"{place} for the {label}" for label, place in SAID_AT.items()]
    assert f"it is {at[2]}, {at[1]} and {at[0]}." in " ".join(PAGE.text.split())
    names = ", ".join(f"{place} {label}" for label, place in reversed(SAID_AT.items()))
    assert f"from 0; {names};" in Page("schema.md").text


def test_a_source_is_hashed_as_it_is_stored(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    for number, source in enumerate(SOURCES):
        with kb.transaction(source=source):
            kb.types.save(PddlTypeDto(f"type{number}"))
    assert last_hash(shared_url) == kb.store.revisions()[-1].hash
    assert [revision.source for revision in kb.store.revisions()] == SOURCES


def test_a_large_revision_is_hashed_as_a_small_one_is(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(propositions, "SPILL_AT", 1)
    kb = connect(shared_url, knowledge_base="tiago")
    write_history(kb)
    assert last_hash(shared_url) == kb.store.revisions()[-1].hash


def test_the_program_accepts_no_other_form(shared_url: str, connect: Connect) -> None:
    """Not even with a hash that fits: the page describes two forms."""
    kb = connect(shared_url, knowledge_base="tiago")
    kb.types.save(PddlTypeDto("robot"))
    (entry,) = kb.log()
    with opened(shared_url) as store:
        ((seed,),) = store.execute("SELECT seed FROM revision", {})
    said = time_text(entry.revision.committed_at), Metadata(None, None, None), entry.changes, seed
    assert entry.revision.hash == revision_hash(None, "tiago", 1, *said)
    digest = revision_hash(None, "tiago", 1, *said, form=3)
    with opened(shared_url) as store:
        store.execute("UPDATE revision SET form = 3, hash = :digest", {"digest": digest})
    with pytest.raises(AssertionError, match="form 3"):
        last_hash(shared_url)


def test_each_knowledge_base_has_a_chain_of_its_own(shared_url: str, connect: Connect) -> None:
    for name in ("tiago", "Küche 🤖"):
        kb = connect(shared_url, knowledge_base=name)
        kb.propositions.save(robot_at())
        kb.propositions.delete_all()
        assert last_hash(shared_url, name) == kb.store.revisions()[-1].hash


@pytest.mark.parametrize(
    "tampering",
    [
        "UPDATE revision SET actor = 'nobody' WHERE number = 2",
        "UPDATE revision SET reason = NULL WHERE number = 2",
        'UPDATE revision SET source = \'{"sensor":"radar"}\' WHERE number = 2',
        "UPDATE revision SET committed_at = '2001-01-01T00:00:00.000000Z' WHERE number = 2",
        "UPDATE revision SET observed_at = '2001-01-01T00:00:00.000000Z' WHERE number = 1",
        "UPDATE knowledge_base SET name = 'other'",
        "UPDATE type_version SET text = 'Robot' WHERE text = 'robot'",
        "UPDATE object_version SET since = 2 WHERE text = 'rb1 - robot'",
        "UPDATE predicate_version SET until = 2",
        "UPDATE proposition SET text = '(robot_at rb1 wp9)' WHERE text = '(robot_at rb1 wp1)'",
        "UPDATE proposition SET is_goal = NOT is_goal WHERE text = '(robot_at rb1 wp1)'",
        "UPDATE function_version SET text = '(charge ?r0 - robot)'",
        "UPDATE function_value_version SET text = '(= (battery rb1) 81)'",
        "UPDATE formula_version SET text = '(and)'",
        "UPDATE formula_version SET section = 'constraint'",
        "UPDATE proposition_version SET until = NULL",
        "DELETE FROM proposition_version WHERE until = 2",
        "UPDATE revision SET seed = (SELECT seed FROM revision WHERE number = 1) WHERE number = 2",
        "UPDATE revision SET seed = NULL WHERE number = 2",
    ],
)
def test_whoever_changes_the_tables_breaks_the_chain(
    shared_url: str, connect: Connect, tampering: str
) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="perception")
    kb.propositions.save(robot_at())
    with kb.transaction(reason="moved", source={"sensor": "lidar"}):
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(place=WP2))
        kb.function_values.set(BATTERY, objects=[RB1], value=80)
        kb.goals.save(EITHER_PLACE)
    known = kb.store.revisions()[-1].hash
    assert last_hash(shared_url) == known
    with opened(shared_url) as store:
        store.execute(tampering, {})
    name = "other" if "knowledge_base" in tampering else "tiago"
    with pytest.raises(AssertionError, match=r"is not what its hash says|no row in commitment"):
        last_hash(shared_url, name)


def test_the_example_is_what_a_store_writes(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock says what the page says; the rest is done by the page's own calls."""
    begin = datetime(2026, 1, 31, 9, 30, tzinfo=UTC)
    moments = iter([begin, begin + timedelta(seconds=5.25)])
    session = kant_sql.sql.dialects.base.Session
    monkeypatch.setattr(session, "now", lambda *_: next(moments))
    monkeypatch.setattr("kant_sql.store.transaction.time", SimpleNamespace(monotonic=lambda: 0.0))
    seeds = iter([bytes(range(16)), bytes(range(16, 32))])
    monkeypatch.setattr("os.urandom", lambda _: next(seeds))
    kb = connect(shared_url, knowledge_base="tiago", actor="perception")
    program = PYTHON[0].replace('"sqlite:///robot.db"', repr(shared_url))
    exec(program, {})
    assert [revision.hash for revision in kb.store.revisions()] == HASHES[1:]
    assert last_hash(shared_url) == HASHES[-1]


def test_the_documents_of_the_example_are_canonical_and_have_the_hashes_given() -> None:
    assert len(DOCUMENTS) == 3
    for document, digest in zip(DOCUMENTS, HASHES, strict=True):
        assert rfc8785.dumps(json.loads(document)) == document.encode()
        assert sha256(document.encode()).hexdigest() == digest


texts = st.text(st.characters(exclude_categories=["Cs"]))


@given(texts)
def test_the_program_writes_strings_as_the_standard_says(text: str) -> None:
    assert PROGRAM["write"](text).encode() == rfc8785.dumps(text)


names = texts.map(lambda text: text.replace("\0", ""))
sources = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False, allow_infinity=False) | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
)
kinds = st.sampled_from(["type", "action", "domain constraint", "document", "fact", "value"])
lines = st.lists(st.tuples(st.sampled_from("+-"), kinds, names), max_size=5)


@given(names, st.none() | names, st.none() | names, sources, lines)
def test_the_library_hashes_the_document_that_the_standard_writes(
    name: str,
    actor: str | None,
    reason: str | None,
    source: Any,
    changes: list[tuple[str, str, str]],
) -> None:
    ordered = sorted(changes)
    at = "2026-01-31T09:30:00.000000Z"
    metadata = make_metadata(actor, reason, source)
    document: dict[str, Any] = {
        "actor": actor,
        "changes": [list(line) for line in ordered],
        "committed_at": at,
        "form": 1,
        "knowledge_base": name,
        "number": 7,
        "observed_at": None,
        "plan_step": None,
        "previous": "ab",
        "reason": reason,
        "source": source,
    }
    link = "ab", name, 7, at, metadata
    expected = sha256(rfc8785.dumps(document)).hexdigest()
    assert revision_hash(*link, ordered, None, form=1) == expected
    seed = b"0123456789abcdef"
    said = {"actor": actor, "reason": reason, "source": metadata.source}
    told, listed = PROGRAM["sealed"](seed, said, ordered)
    document |= {**dict.fromkeys(said), **told, "changes": listed, "form": 2}
    expected = sha256(rfc8785.dumps(document)).hexdigest()
    assert revision_hash(*link, ordered, seed) == expected

"""Verification finds each change of what an erasure leaves, and of the seeds of the others."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any
from unittest.mock import patch

import pytest
from sqlalchemy import text

import kant_sql
from kant_sql.history.erasure import erase
from kant_sql.history.rewriting.parts import Destroyer
from kant_sql.history.rewriting.texts import Renaming, TextWriter
from kant_sql.history.verify.chain import read_links
from kant_sql.history.verify.parts import Part, kept_parts
from kant_sql.knowledge.canonical import erasure_text
from kant_sql.sql.changes import keyed_changes_of
from kant_sql.sql.query import Query
from tests.support.profile import PROFILE
from tests.support.servers import Server
from tests.support.worlds.robots import WP2, robot_at
from tests.support.worlds.story import NAME
from tests.verify.bare import Bare, Row, bare_store
from tests.verify.mutations import ERASED, mutations

# Tables whose texts mention names.
REWRITTEN = "object_version", "proposition", "predicate_version"
SALTED = "commitment", "replacement"


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def erased(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bare]:
    """A store with erased names and reasons, without constraints."""
    url = f"sqlite:///{tmp_path_factory.mktemp('erased') / 'store.db'}"
    if request.param == "postgresql":
        server: Server = request.getfixturevalue("server")
        url = server.new_store()
    with kant_sql.connect(url, knowledge_base=NAME, actor="camera") as kb:
        with kb.transaction(reason="seen", source={"sensor": "lidar"}):
            kb.propositions.save(robot_at())
        with kb.transaction(reason="moved rb1"):
            kb.propositions.delete(robot_at())
            kb.propositions.save(robot_at(place=WP2))
        kb.types.save("crane")
        kb.erase("rb1", reason="sold", also=["reason"])
        kb.erase(revisions=[1], parts=["actor"], reason="asked for", actor="office")
    with bare_store(url) as store:
        yield store


def test_every_column_of_what_an_erasure_left(erased: Bare) -> None:
    with erased.tampering():
        assert erased.findings() == []
        chosen = list(mutations(erased, {*ERASED, "revision"}))
    assert len(chosen) > 60
    # On PostgreSQL a statement takes longer, and what checks is the same.
    if erased.session.placeholder != "?":
        chosen = chosen[::10]
    missed = set()
    for each in chosen:
        with erased.tampering():
            each.apply(erased)
            if erased.is_intact():
                missed.add((each.table, each.column))
    assert missed == set()


Attacks = Iterator[Callable[[], object]]


def rename(bare: Bare, row: Row, name: str) -> TextWriter:
    """Write all that mentions an object again, with another name."""
    writer = TextWriter(bare.session, row["kb_id"], NAME, Renaming(row["id"], row["name"], name))
    writer.run()
    return writer


def renamings(bare: Bare) -> Attacks:
    """Rename without a word of it: an erased object, too."""
    for row, name in itertools.product(bare.rows("object"), ("rb1", "rb9", "somebody")):
        if row["name"] != name:
            yield partial(rename, bare, row, name)


def sealings(bare: Bare) -> Attacks:
    """Rename, and say that an erasure did it: one on record, or none."""

    def seal(row: Row, erasure_id: int, salt: bytes) -> None:
        destroyer = Destroyer(bare.session, row["kb_id"], NAME)
        with patch("kant_sql.history.rewriting.parts.next_salt", lambda _: salt):
            destroyer.destroy(rename(bare, row, "erased-9").old, {})
        destroyer.write(erasure_id, {})

    known = [row["id"] for row in bare.rows("erasure")]
    for row, id_ in itertools.product(bare.rows("object"), (*known, 999)):
        yield partial(seal, row, id_, os.urandom(16))


def saltings(bare: Bare) -> Attacks:
    """Give a part or what took its place another salt, with the text as it is and another."""
    texts = [(table, row) for table in REWRITTEN for row in bare.rows(table)]

    def salt_anew(table: str, row: Row, salt: bytes, text: tuple[str, Row] | None) -> None:
        bare.update(table, row, {"salt": salt})
        if text is not None:
            bare.update(*text, {"text": f"{text[1]['text']} "})

    rows = [(table, row) for table in SALTED for row in bare.rows(table) if row["salt"] is not None]
    for (table, row), number in itertools.product(rows, range(PROFILE.forged)):
        yield partial(salt_anew, table, row, os.urandom(16), None)
        yield partial(salt_anew, table, row, os.urandom(16), texts[number % len(texts)])


def exchanges(bare: Bare) -> Attacks:
    """Exchange what two parts have, and drop what is left of some."""

    def exchange(table: str, column: str, one: Row, other: Row) -> None:
        bare.update(table, one, {column: other[column]})
        bare.update(table, other, {column: one[column]})

    def drop(rows: tuple[Row, ...]) -> None:
        for row in rows:
            bare.delete("replacement", row)
            bare.delete("commitment", row)

    for table in SALTED:
        for one, other in itertools.combinations(bare.rows(table), 2):
            for column in ("salt", "commitment"):
                if one[column] != other[column]:
                    yield partial(exchange, table, column, one, other)
    for count in (1, 2, 3):
        for rows in itertools.combinations(bare.rows("replacement"), count):
            yield partial(drop, rows)


def restatements(bare: Bare) -> Attacks:
    """Change an erasure with the text that it should then have."""

    def restate(row: Row, changes: Row) -> None:
        said = {**row, **changes}
        names = ("id", "revision", "kind", "element_id", "pseudonym", "parts", "digest")
        text = erasure_text(*(said[name] for name in names))
        bare.update("erasure", row, {**changes, "text": text})

    for row, number in itertools.product(bare.rows("erasure"), range(PROFILE.forged)):
        yield partial(restate, row, {"parts": row["parts"] + 1 + number})
        yield partial(restate, row, {"digest": os.urandom(32).hex()})
        yield partial(restate, row, {"pseudonym": f"erased-{7 + number}"})


def test_nobody_hides_a_change_behind_an_erasure(erased: Bare) -> None:
    with erased.tampering():
        kinds = renamings, sealings, saltings, exchanges, restatements
        attacks = [attack for kind in kinds for attack in kind(erased)]
    if erased.session.placeholder != "?":
        attacks = attacks[:: PROFILE.rows_step]
    assert len(attacks) > (1_000 if PROFILE.is_whole else 10)
    missed = []
    for attack in attacks:
        with erased.tampering():
            attack()
            if erased.is_intact():
                missed.append(attack)
    assert missed == []


def test_a_document_that_named_it_by_a_formula_is_right(kb: kant_sql.KnowledgeBase) -> None:
    kb.load_domain(
        "(define (domain d) (:requirements :adl) (:constants maria bob) (:predicates (well ?x)))"
    )
    kb.load_problem("(define (problem p) (:domain d) (:init) (:goal (or (well maria) (well bob))))")
    kb.erase("maria", reason="asked for")
    assert kb.store.verify().findings == ()


_PLACE = Query(text("SELECT id FROM object WHERE kb_id = :kb AND name = 'wp1'"))


def invented(*_: object) -> dict[str, str]:
    return {"reason": "approved by the safety officer"}


@pytest.mark.parametrize(
    ("forged", "says"),
    [
        (patch.object(erase, "said_in_place", invented), "without the pseudonym"),
        (patch.object(erase, "next_pseudonym", lambda *_: "wp2"), "the pseudonym 'wp2'"),
    ],
)
def test_a_new_erasure_leaves_no_other_text_than_its_pseudonym(
    kb: kant_sql.KnowledgeBase, forged: Any, says: str
) -> None:
    with kb.transaction(reason="nobody allowed it"):
        kb.propositions.save(robot_at())
    with forged:
        kb.erase(revisions=[1], parts=["reason"], reason="asked for")
    assert [says in one.message for one in kb.store.verify().findings] == [True]


def test_a_new_erasure_changes_no_text_of_others(kb: kant_sql.KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    kb.objects.save("rb2 - robot")
    run = TextWriter.run

    def run_and_invent(writer: TextWriter) -> None:
        run(writer)
        ((place,),) = writer._session.rows(_PLACE, kb=writer._kb)
        renaming = Renaming(place, "wp1", "wp7")
        other = TextWriter(writer._session, writer._kb, writer._name, renaming)
        run(other)
        writer.old.update(other.old)

    with patch.object(TextWriter, "run", run_and_invent):
        kb.erase("rb2", reason="asked for")
    found = [one.message for one in kb.store.verify().findings]
    assert any("without the pseudonym erased-1" in message for message in found)


def test_a_seed_without_an_erasure_can_be_exchanged_for_its_salts_without_effect(
    erased: Bare,
) -> None:
    """Its commitments and texts are the same, and so is each answer."""
    with erased.tampering():
        [(kb_id,)] = erased.run("SELECT id FROM knowledge_base")
        [(number,)] = erased.run("SELECT max(number) FROM revision WHERE seed IS NOT NULL")
        (link,) = read_links(erased.session, kb_id, [number])
        lines = keyed_changes_of(erased.session, kb_id, [number])
        assert link.seed is not None
        for part in kept_parts(link.seed, link.metadata, [("+", *line[2:]) for line in lines]):
            row = dict(zip(("kb_id", "number", *Part._fields), (kb_id, number, *part), strict=True))
            erased.insert("commitment", row)
        erased.run("UPDATE revision SET seed = NULL WHERE number = ?", number)
        assert erased.findings() == []

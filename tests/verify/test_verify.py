"""What verification says of stores that nobody has tampered with, and anchors."""

from __future__ import annotations

import pytest

from kant_sql import KnowledgeBase, PddlTypeDto
from kant_sql.errors import ReadOnlyError
from kant_sql.knowledge.canonical import Metadata, revision_hash, time_text
from tests.support.pages import opened
from tests.support.statements import recorded
from tests.support.stores import Connect
from tests.support.worlds.robots import WP2, robot_at, waypoint


def test_an_unknown_form_is_a_finding_whatever_the_hash(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.types.save(PddlTypeDto("robot"))
    (entry,) = kb.log()
    said = time_text(entry.revision.committed_at), Metadata(None, None, None), entry.changes
    digest = revision_hash(None, "tiago", 1, *said, None, form=3)
    with opened(shared_url) as store:
        changed = "form = 3, seed = NULL, hash = :digest"
        store.execute(f"UPDATE revision SET {changed}", {"digest": digest})
        store.execute("UPDATE head SET hash = :digest", {"digest": digest})
    # Who has committed another hash takes that for a store that was replaced.
    kb.close()
    kb = connect(shared_url, knowledge_base="tiago")
    kb.types.save(PddlTypeDto("wp"))
    verification = kb.store.verify()
    fault = "form 3 is unknown: revisions have form 1 or 2"
    assert (1, "revision", fault) in verification.findings
    assert (verification.revisions, verification.changes) == (2, 2)


def test_verifying_tells_how_far_it_is(kb: KnowledgeBase) -> None:
    assert kb.store.verify().is_intact
    for _ in range(3):
        kb.propositions.save(robot_at())
        kb.propositions.save(robot_at(place=WP2))
        kb.propositions.delete_all()
    told: list[tuple[int, int]] = []
    verification = kb.store.verify(progress=lambda done, whole: told.append((done, whole)))
    assert verification.is_intact
    assert told == sorted(told)
    assert told[-1][0] == told[-1][1] > kb.revision


def test_the_number_of_statements_does_not_grow(kb: KnowledgeBase) -> None:
    counts = []
    for number in range(3):
        kb.propositions.save_all(robot_at(place=waypoint(10 * number + each)) for each in range(10))
        kb.propositions.delete_all()
        with recorded() as statements:
            assert kb.store.verify().is_intact
        counts.append(len(statements))
    assert counts[0] == counts[1] == counts[2]


def test_an_open_transaction_is_refused(kb: KnowledgeBase) -> None:
    with kb.transaction(), pytest.raises(ReadOnlyError, match="end it first"):
        kb.store.verify()


def test_an_anchor_names_all_knowledge_bases(shared_url: str, connect: Connect) -> None:
    first_kb, second = (connect(shared_url, knowledge_base=name) for name in ("tiago", "pepper"))
    assert first_kb.store.anchor().heads == ()
    first_kb.propositions.save(robot_at())
    second.propositions.save(robot_at())
    anchor = first_kb.store.anchor()
    assert [head.knowledge_base for head in anchor.heads] == ["tiago", "pepper"]
    assert anchor.heads[0].hash == first_kb.store.revisions()[-1].hash
    first_kb.propositions.delete_all()
    assert first_kb.store.verify(anchor).is_intact
    gone = connect(shared_url, knowledge_base="nao")
    assert gone.store.verify(anchor).is_intact
    absent = anchor._replace(heads=(anchor.heads[0]._replace(knowledge_base="nao"),))
    (finding,) = gone.store.verify(absent).findings
    assert finding.message == "knowledge base 'nao' is missing"

"""A part of a text is looked for by one rule, by each filter, whatever the database."""

from __future__ import annotations

import pytest

from kant_sql import InvalidArgumentError, KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.history.element_pages import read_matches
from kant_sql.history.log import LogFilter, read_log_page
from kant_sql.history.state_parts import StateFilter, read_state
from kant_sql.knowledge_base import state_of
from kant_sql.sql.dialects.containing import is_in

FACT = "(größe_Küche Straße-1)"
ACTOR = r"ΟΔΟΣ [a^b] *?.+$(x|y){2} \d % _ ! ÉCOLE Öl"
IN_FACT = ("KÜCHE", "küche s", "GRÖ", "STRAẞE-1", "e-1)", "GRÖßE_")
IN_ACTOR = ("οδος", "Οδοσ", "[A^", "^b]", "*?.", "+$(", "(X|Y){2}", r"\D %", "_ !", "école")
IN_NONE = ("Kuche", "kü.he", "k?che", "K*E", "[kK]", "^(", ")$", "STRASSE", "%1", "\\\\", "l ")


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    fresh_kb.load_domain(
        "(define (domain d) (:types größe) (:predicates (größe_Küche ?x - größe)))"
    )
    with fresh_kb.transaction(actor=ACTOR):
        fresh_kb.objects.save(PddlObjectDto(PddlTypeDto("größe"), "Straße-1"))
        fresh_kb.propositions.save(FACT)
    with fresh_kb.transaction(actor="other"):
        fresh_kb.objects.save(PddlObjectDto(PddlTypeDto("größe"), "later"))
    return fresh_kb


def test_case_does_not_matter_for_any_letter(kb: KnowledgeBase) -> None:
    state = state_of(kb)
    for text in (*IN_FACT, *IN_ACTOR, *IN_NONE):
        is_there, acted = text in IN_FACT, text in IN_ACTOR
        assert (is_in(text, FACT), is_in(text, ACTOR)) == (is_there, acted), text
        for when in (None, kb.revision - 1):
            (facts,) = read_state(state, when, StateFilter(text), kind="fact").parts or (None,)
            assert bool(facts and facts.elements) == is_there, text
        assert bool(kb.timeline(text=text, kinds=["fact"]).lanes) == is_there, text
        lines = read_log_page(state, LogFilter(text=text)).revisions
        assert (ACTOR in {one.revision.actor for one in lines}) == (is_there or acted), text
        kinds = {one.kind for one in read_matches(state, text)[0]}
        assert ("fact" in kinds, "actor" in kinds) == (is_there, acted), text


def test_the_log_is_searched_for_changes_of_all_kinds(kb: KnowledgeBase) -> None:
    act = kb.executions.report("dock", outcome="running")
    kb.fail(act, code="E4", text="kein Strom")
    kb.goals.save(FACT)
    kb.rules.save("calm", f"(always {FACT})")
    kb.propositions.confirm([FACT])
    with kb.transaction(valid_from="2 hours ago", valid_until="1 hour ago"):
        kb.propositions.delete(FACT)
    kb.erase("later", reason="request 4711")
    entries = [*kb.log()]
    for text in ("KEIN STROM", "e4", "running", "größe_küche", "straße", ":not-held", "erasure"):
        found = read_log_page(state_of(kb), LogFilter(text=text)).revisions
        expected = [
            entry.revision
            for entry in entries
            if any(is_in(text, change.text) for change in entry.changes)
        ]
        assert [one.revision for one in found] == expected != [], text


def test_what_no_text_can_contain_is_refused(kb: KnowledgeBase) -> None:
    for text in ("\0", "a\ud800"):
        with pytest.raises(InvalidArgumentError, match="NUL"):
            read_matches(state_of(kb), text)
        with pytest.raises(InvalidArgumentError, match="NUL"):
            kb.timeline(text=text)


def test_a_text_of_any_length_is_looked_for(kb: KnowledgeBase) -> None:
    assert read_matches(state_of(kb), "тК" * 50_000) == ([], False)

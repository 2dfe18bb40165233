"""Texts that try to be more than data in HTML, and the check that they did not succeed."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import kant_sql
from kant_sql import KnowledgeBase, Plan, PlanStep

SCRIPT = "</script><script>alert('1')</script><img/src=x onerror=\"alert(2)\">&lt;"
RIGHT_TO_LEFT = "\u202egnp.exe\u2066"
LONG = "x" * 10_000
HOSTILE = (SCRIPT, RIGHT_TO_LEFT, LONG, "<!--", "{{7*7}}{% raw %}", "]]>", "\x00\x1b[2J", "a\nb")
# A valid name in PDDL.
TAG = "</script><img/src=x/onerror=alert>&lt"
_UNSEEN = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2066-\u2069]"
)
_HARMLESS = {"table", "thead", "tbody", "tr", "th", "td", "p", "strong", "bdi", "br", "pre"}


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, list[tuple[str, str | None]]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, attrs))


def check_harmless(made: str, *, most: int = 300_000) -> None:
    """Check that HTML for notebooks has only our own tags, nothing unseen, and is bounded."""
    parser = _Tags()
    parser.feed(made)
    parser.close()
    for tag, attributes in parser.found:
        assert tag in _HARMLESS, tag
        assert {name for name, _ in attributes} <= {"style"}, attributes
    assert _UNSEEN.search(made) is None
    assert len(made) <= most


def fill_hostile(kb: KnowledgeBase) -> None:
    """Store such texts wherever a knowledge base takes text."""
    kb.load_domain(
        f"(define (domain d) (:types t{TAG}) (:predicates (p{TAG} ?x - t{TAG}))"
        f" (:functions (f{TAG} ?x - t{TAG}))"
        f" (:action a{TAG} :parameters (?x - t{TAG}) :effect (p{TAG} ?x)))"
    )
    type_ = kant_sql.PddlTypeDto(f"t{TAG}")
    objects = [kant_sql.PddlObjectDto(type_, f"o{number}{TAG}") for number in range(3)]
    kb.objects.save_all([*objects, kant_sql.PddlObjectDto(type_, "o" * 255)])
    predicate = kant_sql.PddlPredicateDto(f"p{TAG}", [type_])
    for text in HOSTILE:
        for object_ in objects:
            is_there = kb.blame(f"(p{TAG} {object_.name})") is not None
            change = kb.propositions.delete if is_there else kb.propositions.save
            with kb.transaction(actor=storable(text), reason=storable(text), source={text: [text]}):
                change(kant_sql.PddlPropositionDto(predicate, [object_]))
    kb.propositions.save(kant_sql.PddlPropositionDto(predicate, [objects[0]], is_goal=True))
    plan = kb.plans.record(
        Plan((PlanStep(None, f"a{TAG}", (objects[0].name,)),), "by hand", "unknown"),
        planner=SCRIPT,
        planner_version=LONG,
    )
    kb.plans.set_status(plan.steps[0], status="started")


def storable(text: str) -> str:
    """Return a text without the one character that no database stores."""
    return text.replace("\x00", "\x01")

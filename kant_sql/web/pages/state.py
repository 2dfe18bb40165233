"""The page of a state: all that held at a time, and what changed against the revision before."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query
from typing_extensions import TypedDict

from ...history.state_parts import PARTS, HeldElement, StateFilter, StatePart, read_state
from ...json_documents import RevisionDocument, revision_document
from ...knowledge_base import KnowledgeBase, state_of
from ..parameters import At, ElementText, ObjectName, Offset, moment
from ..registry import Pages

PAGES = Pages("state")

# How many elements a part has on the page of all parts, and on its own.
FEW, MANY = 50, 200
_TITLES = {
    "fact": "Facts",
    "goal": "Goals",
    "value": "Values",
    "object": "Objects",
    "type": "Types",
    "predicate": "Predicates",
    "function": "Functions",
    "action": "Actions",
    "derived": "Derived predicates",
    "domain constraint": "Constraints of the domain",
    "initial": "Initial literals",
    "timed": "Timed initial literals",
    "constraint": "Constraints of the problem",
    "metric": "Metric",
}
assert set(_TITLES) == set(PARTS)
Kind = Literal[
    "",
    "fact",
    "goal",
    "value",
    "object",
    "type",
    "predicate",
    "function",
    "action",
    "derived",
    "domain constraint",
    "initial",
    "timed",
    "constraint",
    "metric",
]
PredicateName = Annotated[
    str | None,
    Query(description="Only facts, goals and values of this predicate or function."),
]
OneKind = Annotated[Kind, Query(description="Only this kind, in longer pages; empty for all.")]


class HeldElementDocument(TypedDict):
    """An element that held, and the revision that asserted it: by whom, when and why."""

    kind: str
    text: str
    since: RevisionDocument | None
    is_new: bool


class StatePartDocument(TypedDict):
    """A page of the elements of one kind.

    `total` counts all if `is_counted`, else there are more. With `is_searched`, the text was looked
    for in a part of them only, which the next page goes on from.
    """

    kind: str
    title: str
    elements: list[HeldElementDocument]
    gone: list[HeldElementDocument]
    total: int
    is_counted: bool
    is_searched: bool
    offset: int
    next: int | None


class StatePage(TypedDict):
    """A state; `revision` is None before the first revision."""

    number: int
    head: int
    revision: RevisionDocument | None
    parts: list[StatePartDocument]
    kinds: dict[str, str]


@PAGES.page("/state", "state.html", is_form=True, rows=["parts.elements"])
def state(
    kb: KnowledgeBase,
    at: At = None,
    text: ElementText = None,
    predicate: PredicateName = None,
    object: ObjectName = None,
    kind: OneKind = "",
    offset: Offset = 0,
) -> StatePage:
    """Show all that held at a time, and mark what changed against the revision before.

    Each element has the revision that asserted it. `gone` has what the state's revision retracted.
    """
    asked = StateFilter(text or None, predicate or None, object or None)
    limit = MANY if kind else FEW
    found = read_state(state_of(kb), moment(at), asked, kind or None, offset, limit)
    revisions = {
        number: revision_document(revision) for number, revision in found.revisions.items()
    }

    def element(one: HeldElement) -> HeldElementDocument:
        is_new = one.since == found.revision
        since = revisions.get(one.since)
        return {"kind": one.kind, "text": one.text, "since": since, "is_new": is_new}

    def part(one: StatePart) -> StatePartDocument:
        return {
            "kind": one.kind,
            "title": _TITLES[one.kind],
            "elements": [element(each) for each in one.elements],
            "gone": [element(each) for each in found.gone if each.kind == one.kind],
            "total": one.total,
            "is_counted": one.is_counted,
            "is_searched": one.is_searched,
            "offset": one.offset,
            "next": one.next,
        }

    parts = {one.kind: one for one in found.parts}
    for one in found.gone:
        parts.setdefault(one.kind, StatePart(one.kind, [], 0, True, 0, None))
    return {
        "number": found.revision,
        "head": found.head,
        "revision": revisions.get(found.revision),
        "parts": [part(parts[kind]) for kind in PARTS if kind in parts],
        "kinds": _TITLES,
    }

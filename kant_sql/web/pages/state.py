"""The page of a state: all that held at a time, and what changed against the revision before."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from fastapi import Query

from ...history.revisions import Revision
from ...history.state_parts import PARTS, HeldElement, StateFilter, StatePart, read_state
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


class ShownElement(NamedTuple):
    """An element that held, and the revision that asserted it: by whom, when and why."""

    kind: str
    text: str
    since: Revision | None
    is_new: bool


class ShownPart(NamedTuple):
    """A page of the elements of one kind.

    `total` counts all if `is_counted`, else there are more. With `is_searched`, the text was looked
    for in a part of them only, which the next page goes on from.
    """

    kind: str
    title: str
    elements: list[ShownElement]
    gone: list[ShownElement]
    total: int
    is_counted: bool
    is_searched: bool
    offset: int
    next: int | None


class StatePage(NamedTuple):
    """A state; `revision` is None before the first revision."""

    number: int
    head: int
    revision: Revision | None
    parts: list[ShownPart]
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

    def element(one: HeldElement) -> ShownElement:
        is_new = one.since == found.revision
        return ShownElement(one.kind, one.text, found.revisions.get(one.since), is_new)

    def part(one: StatePart) -> ShownPart:
        return ShownPart(
            one.kind,
            _TITLES[one.kind],
            [element(each) for each in one.elements],
            [element(each) for each in found.gone if each.kind == one.kind],
            one.total,
            one.is_counted,
            one.is_searched,
            one.offset,
            one.next,
        )

    parts = {one.kind: one for one in found.parts}
    for one in found.gone:
        parts.setdefault(one.kind, StatePart(one.kind, [], 0, True, 0, None))
    shown = [part(parts[kind]) for kind in PARTS if kind in parts]
    revision = found.revisions.get(found.revision)
    return StatePage(found.revision, found.head, revision, shown, _TITLES)

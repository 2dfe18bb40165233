"""The page of a state: all that held at a time, and what changed against the revision before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from fastapi import Query

from ...history.state_parts import PARTS, StateFilter, StatePage, read_state
from ...knowledge_base import KnowledgeBase, state_of
from ..parameters import After, At, ElementText, ObjectName, moment
from ..registry import Pages

PAGES = Pages("state")

# How many elements a part has on the page of all parts, and on its own.
FEW, MANY = 50, 200
if TYPE_CHECKING:
    Kind = str
else:
    Kind = Literal[("", *PARTS)]
PredicateName = Annotated[
    str | None,
    Query(description="Only facts, goals and values of this predicate or function."),
]
OneKind = Annotated[Kind, Query(description="Only this kind, in longer pages; empty for all.")]


@PAGES.page("/state", "state.html", is_form=True, rows=["parts.elements"])
def state(
    kb: KnowledgeBase,
    at: At = None,
    text: ElementText = None,
    predicate: PredicateName = None,
    object: ObjectName = None,
    kind: OneKind = "",
    after: After = None,
) -> StatePage:
    """Show all that held at a time, and mark what changed against the revision before.

    Each element has the revision that asserted it. `gone` has what the state's revision retracted.
    """
    asked = StateFilter(text or None, predicate or None, object or None)
    limit = MANY if kind else FEW
    return read_state(state_of(kb), moment(at), asked, kind or None, after, limit)

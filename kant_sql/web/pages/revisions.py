"""The pages of the log, of a revision, of a state, and of the difference of two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from fastapi import Query

from ...history.corrections import CorrectionsPage, read_corrections_page
from ...history.diff import Difference, read_difference
from ...history.log import LogFilter, LogPage, RevisionPage, read_log_page, read_revision_page
from ...history.object_tables import ObjectsPage, read_objects_page
from ...history.state_parts import PARTS, StateFilter, StatePage, read_state
from ...knowledge_base import KnowledgeBase, state_of
from ...moment_text import is_now
from ..registry import (
    After,
    At,
    Before,
    Clock,
    ElementText,
    ObjectName,
    Pages,
    SinceMoment,
    UntilMoment,
    Valid,
    bound,
    moment,
    past,
)

PAGES = Pages("history")

# How many changes, and how many revisions, a page has; how many revisions between two states.
CHANGES, REVISIONS, BETWEEN = 200, 50, 20
CORRECTIONS = 50

RevisionNumber = Annotated[int, Query(ge=1, le=2**62, description="The revision's number.")]
Actor = Annotated[str, Query(description="Only revisions of this actor.")]
ElementOfLog = Annotated[
    str,
    Query(
        description="Only revisions that changed this element, and their changes of it: a name, or "
        "PDDL such as `(robot_at rb1 wp1)`."
    ),
]
Text = Annotated[
    str,
    Query(
        description="Only revisions with this in the actor, the reason, the source or a change, in "
        "any case."
    ),
]


@dataclass(frozen=True)
class DifferencePage:
    """A page of the difference of two states, and the log between them."""

    _json_ = "*difference", "between"

    difference: Difference
    between: LogPage


@PAGES.page("/log", "log.html", is_form=True, rows=["revisions"])
def log(
    kb: KnowledgeBase,
    actor: Actor = "",
    element: ElementOfLog = "",
    text: Text = "",
    since: SinceMoment = None,
    until: UntilMoment = None,
    before: Before = None,
) -> LogPage:
    """Show the revisions, newest first: who wrote, when, why, and what changed."""
    asked = LogFilter(actor or None, element.strip() or None, text or None)
    return read_log_page(state_of(kb), asked, bound(since), moment(until), before, REVISIONS)


@PAGES.page("/revision", "revision.html", rows=["revision.changes"])
def revision(kb: KnowledgeBase, number: RevisionNumber, after: After = None) -> RevisionPage:
    """Show a revision: who wrote, when, why, and what changed."""
    return read_revision_page(state_of(kb), number, after, CHANGES)


@PAGES.page("/corrections", "corrections.html", is_form=True, rows=["corrections"])
def corrections(
    kb: KnowledgeBase, since: SinceMoment = None, until: UntilMoment = None, after: After = None
) -> CorrectionsPage:
    """List the sayings that differ from what was believed of their time.

    `since` and `until` are of what was said later.
    """
    asked = bound(since), moment(until)
    return read_corrections_page(state_of(kb), *asked, after, CORRECTIONS)


OneState = Annotated[
    str,
    Query(description="A revision's number or a time; by default the one before the other."),
]
OtherState = Annotated[
    str, Query(description="Another revision or time; by default the last revision.")
]


@PAGES.page("/difference", "difference.html", rows=["changes"])
def difference(
    kb: KnowledgeBase,
    a: OneState = "",
    b: OtherState = "",
    clock: Clock = "committed",
    after: After = None,
) -> DifferencePage:
    """Compare two states: the elements of only one of them, by kind, and the log between them."""
    other = moment(b)
    if other is None:
        other = kb.revision
    one = kb.revision if is_now(a) else moment(a)
    if one is None:
        one = max(0, kb.at(other).revision - 1)
    found = read_difference(state_of(kb), one, other, after, CHANGES, clock)
    low, high = sorted((found.a, found.b))
    between = (
        LogPage(0, [])
        if low == high
        else read_log_page(state_of(kb), LogFilter(), low + 1, high, limit=BETWEEN)
    )
    return DifferencePage(found, between)


STATES = Pages("state")

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


@STATES.page("/state", "state.html", is_form=True, rows=["parts.elements"])
def state(
    kb: KnowledgeBase,
    at: At = None,
    text: ElementText = None,
    predicate: PredicateName = None,
    object: ObjectName = None,
    kind: OneKind = "",
    after: After = None,
    valid: Valid = None,
) -> StatePage:
    """Show a state, and mark the changes of its revision.

    Each element has the revision that asserted it. `gone` has what the state's revision retracted.
    """
    asked = StateFilter(text or None, predicate or None, object or None)
    limit = MANY if kind else FEW
    state, when = (past(kb, at, valid), None) if moment(valid) else (kb, moment(at))
    return read_state(state_of(state), when, asked, kind or None, after, limit)


TypeName = Annotated[str, Query(description="Only objects of this type, or of a subtype.")]


@STATES.page("/objects", "objects.html", is_form=True, rows=["tables.rows"])
def objects(
    kb: KnowledgeBase,
    type: TypeName = "",
    at: At = None,
    after: After = None,
    valid: Valid = None,
) -> ObjectsPage:
    """Show the objects of a state as tables, one for each type, with a row for each object.

    A column is a predicate or a function that has one more argument, or none.
    """
    return read_objects_page(state_of(past(kb, at, valid)), type or None, after)

"""The pages of the log, of a revision, and of the difference of two states."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated

from fastapi import Query
from typing_extensions import TypedDict

from ...history.change_pages import ChangesPage, read_difference
from ...history.log_pages import LogFilter, LogLine, read_log_page, read_revision_page
from ...json_documents import (
    ChangeDocument,
    LogEntryDocument,
    changes_document,
    revision_document,
)
from ...knowledge_base import KnowledgeBase, state_of
from ...moment_text import When
from ..parameters import Before, Offset, SinceMoment, UntilMoment, moment
from ..registry import Pages

PAGES = Pages("history")

# How many changes, and how many revisions, a page has.
CHANGES, REVISIONS = 200, 50

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


class LogLineDocument(LogEntryDocument):
    """A revision with its changes, if they are few.

    `total` counts all if `is_counted`, else there are more. `is_archived`: a part of them was moved
    to an archive.
    """

    total: int
    is_counted: bool
    is_archived: bool


class LogDocument(TypedDict):
    """A page of the log, newest first.

    The next page has the parameter `before`. Where a page ended before it was full, `searched` is
    the first revision that was searched. `archive` says where older changes are.
    """

    head: int
    revisions: list[LogLineDocument]
    before: int | None
    searched: int | None
    archive: str | None


class RevisionPage(TypedDict):
    """A revision with a page of its changes; `archive` says where a part of them is.

    `total` counts all if `is_counted`, else there are more: of a kind, the pages have 50,000.
    """

    revision: LogEntryDocument
    total: int
    is_counted: bool
    offset: int
    next: int | None
    head: int
    archive: str | None


class KindChangesDocument(TypedDict):
    """Texts of one kind."""

    kind: str
    texts: list[str]


class DifferenceDocument(TypedDict):
    """A page of what holds in only one of two states, by kind.

    `changes` are the same as `kant-sql diff` shows: `+` for what only `b` has. `is_cut`: more
    elements differ than all pages have.
    """

    a: int
    b: int
    head: int
    changes: list[ChangeDocument]
    only_a: list[KindChangesDocument]
    only_b: list[KindChangesDocument]
    offset: int
    next: int | None
    is_cut: bool
    between: LogDocument


def line_document(line: LogLine) -> LogLineDocument:
    """Return a revision of the log as JSON data."""
    return {
        **revision_document(line.revision),
        "changes": changes_document(line.changes),
        "total": line.total,
        "is_counted": line.is_counted,
        "is_archived": line.is_archived,
    }


@PAGES.page("/log", "log.html", is_form=True, rows=["revisions"])
def log(
    kb: KnowledgeBase,
    actor: Actor = "",
    element: ElementOfLog = "",
    text: Text = "",
    since: SinceMoment = None,
    until: UntilMoment = None,
    before: Before = None,
) -> LogDocument:
    """Show the revisions, newest first: who wrote, when, why, and what changed."""
    asked = LogFilter(actor or None, element.strip() or None, text or None)
    return _log(kb, asked, moment(since), moment(until), before)


def _log(
    kb: KnowledgeBase,
    asked: LogFilter,
    since: When | None,
    until: When | None,
    before: int | None,
    limit: int = REVISIONS,
) -> LogDocument:
    found = read_log_page(state_of(kb), asked, since, until, before, limit)
    return {
        "head": kb.revision,
        "revisions": [line_document(line) for line in found.lines],
        "before": found.before,
        "searched": found.searched,
        "archive": found.archive,
    }


@PAGES.page("/revision", "revision.html", rows=["revision.changes"])
def revision(kb: KnowledgeBase, number: RevisionNumber, offset: Offset = 0) -> RevisionPage:
    """Show a revision: who wrote, when, why, and what changed."""
    found = read_revision_page(state_of(kb), number, offset, CHANGES)
    changes = changes_document(change for _, change in found.page.changes)
    return {
        "revision": {**revision_document(found.line.revision), "changes": changes},
        "total": found.line.total,
        "is_counted": found.line.is_counted,
        "offset": offset,
        "next": found.page.next,
        "head": found.head,
        "archive": found.archive,
    }


OneState = Annotated[
    str,
    Query(description="A revision's number or a time; by default the one before the other."),
]
OtherState = Annotated[
    str, Query(description="Another revision or time; by default the last revision.")
]


@PAGES.page("/difference", "difference.html", rows=["changes"])
def difference(
    kb: KnowledgeBase, a: OneState = "", b: OtherState = "", offset: Offset = 0
) -> DifferenceDocument:
    """Compare two states: what only one of them has, by kind, and the log between them."""
    other = moment(b)
    if other is None:
        other = kb.revision
    one = moment(a)
    if one is None:
        one = max(0, kb.at(other).revision - 1)
    found = read_difference(state_of(kb), one, other, offset, CHANGES)
    low, high = sorted((found.a, found.b))
    between = _log(kb, LogFilter(), low + 1, high, None, 20) if low < high else _EMPTY
    sides = [("-", found.only_a), ("+", found.only_b)]
    return {
        "a": found.a,
        "b": found.b,
        "head": found.head,
        "changes": [
            {"sign": sign, "kind": change.kind, "text": change.text}
            for sign, page in reversed(sides)
            for _, change in page.changes
        ],
        "only_a": _by_kind(found.only_a),
        "only_b": _by_kind(found.only_b),
        "offset": offset,
        "next": found.only_a.next or found.only_b.next,
        "is_cut": found.is_cut,
        "between": between,
    }


_EMPTY: LogDocument = {
    "head": 0,
    "revisions": [],
    "before": None,
    "searched": None,
    "archive": None,
}


def _by_kind(page: ChangesPage) -> list[KindChangesDocument]:
    lines = sorted((change.kind, change.text) for _, change in page.changes)
    return [
        {"kind": kind, "texts": [text for _, text in of_kind]}
        for kind, of_kind in groupby(lines, key=lambda line: line[0])
    ]

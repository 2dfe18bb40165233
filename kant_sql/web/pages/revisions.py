"""The pages of the log, of a revision, and of the difference of two states."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated, NamedTuple

from fastapi import Query

from ...history.diff import read_difference
from ...history.log_pages import LogFilter, LogLine, read_log_page, read_revision_page
from ...history.revisions import LogEntry
from ...knowledge_base import KnowledgeBase, state_of
from ...moment_text import When
from ...sql.changes import Change, ChangesPage
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


class ShownLog(NamedTuple):
    """A page of the log, newest first.

    The next page has the parameter `before`. Where a page ended before it was full, `searched` is
    the first revision that was searched. `archive` says where older changes are.
    """

    head: int
    revisions: list[LogLine]
    before: int | None
    searched: int | None
    archive: str | None


class RevisionPage(NamedTuple):
    """A revision with a page of its changes; `archive` says where a part of them is.

    `total` counts all if `is_counted`, else there are more: of a kind, the pages have 50,000.
    """

    revision: LogEntry
    total: int
    is_counted: bool
    offset: int
    next: int | None
    head: int
    archive: str | None


class ChangesOfKind(NamedTuple):
    """Texts of one kind."""

    kind: str
    texts: list[str]


class DifferencePage(NamedTuple):
    """A page of what holds in only one of two states, by kind.

    `changes` are the same as `kant-sql diff` shows: `+` for what only `b` has. `is_cut`: more
    elements differ than all pages have.
    """

    a: int
    b: int
    head: int
    changes: list[Change]
    only_a: list[ChangesOfKind]
    only_b: list[ChangesOfKind]
    offset: int
    next: int | None
    is_cut: bool
    between: ShownLog


@PAGES.page("/log", "log.html", is_form=True, rows=["revisions"])
def log(
    kb: KnowledgeBase,
    actor: Actor = "",
    element: ElementOfLog = "",
    text: Text = "",
    since: SinceMoment = None,
    until: UntilMoment = None,
    before: Before = None,
) -> ShownLog:
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
) -> ShownLog:
    found = read_log_page(state_of(kb), asked, since, until, before, limit)
    return ShownLog(kb.revision, found.lines, found.before, found.searched, found.archive)


@PAGES.page("/revision", "revision.html", rows=["revision.changes"])
def revision(kb: KnowledgeBase, number: RevisionNumber, offset: Offset = 0) -> RevisionPage:
    """Show a revision: who wrote, when, why, and what changed."""
    found = read_revision_page(state_of(kb), number, offset, CHANGES)
    entry = LogEntry(found.line.revision, tuple(change for _, change in found.page.changes))
    counted = found.line.total, found.line.is_counted
    return RevisionPage(entry, *counted, offset, found.page.next, found.head, found.archive)


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
) -> DifferencePage:
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
    return DifferencePage(
        found.a,
        found.b,
        found.head,
        [
            change._replace(sign=sign)
            for sign, page in reversed(sides)
            for _, change in page.changes
        ],
        _by_kind(found.only_a),
        _by_kind(found.only_b),
        offset,
        found.only_a.next or found.only_b.next,
        found.is_cut,
        between,
    )


_EMPTY = ShownLog(0, [], None, None, None)


def _by_kind(page: ChangesPage) -> list[ChangesOfKind]:
    lines = sorted((change.kind, change.text) for _, change in page.changes)
    return [
        ChangesOfKind(kind, [text for _, text in of_kind])
        for kind, of_kind in groupby(lines, key=lambda line: line[0])
    ]

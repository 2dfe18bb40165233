"""An element, or an object and all that involves it, by pages, the newest first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from sqlalchemy import Select, literal_column, select

from ..arguments import shown
from ..dao.text import refuse_unknown
from ..dto.lexical import fold
from ..errors import UnknownNameError
from ..sql.changes import Change
from ..sql.definition_rows import find_identities
from ..sql.dialects.base import Row, Session
from ..sql.query import Query, first_rows, in_rows, integer
from ..sql.rows import KB, KIND_TABLES
from ..sql.tables import TABLES
from ..store.state import State
from .elements import Applied, Named, Sought, refuse_unknown_element, sought
from .involvement import read_involvement
from .plan_pages import StepLine, read_steps
from .revisions import LARGEST, Revision, read_numbered, read_position
from .state_parts import HeldElement, StateFilter, read_state
from .versions import Version, make_versions, read_newest

# How many elements that hold the page of an object has.
HELD = 50


class ElementPage(NamedTuple):
    """A page of the versions of an element, and what is related to it.

    Attributes:
        text: how it was asked for.
        latest: the newest version of each kind, on the first page: without `until`, it holds now.
        versions: the versions, the newest first.
        before: the revision before which the next page goes on; None after the last.
        head: the name of its predicate or function, if it applies to objects.
        objects: the names of the objects that it applies to.
        steps: the newest steps of plans that name all of its objects, or that are of this action.
        archived: versions that ended up to this revision are in an archive; 0 if there is none.
    """

    text: str
    latest: list[Version]
    versions: list[Version]
    before: int | None
    head: str | None
    objects: list[str]
    steps: list[StepLine]
    archived: int


def read_element_page(
    state: State,
    element: str,
    kind: str | None = None,
    before: int | None = None,
    limit: int = 50,
) -> ElementPage:
    """Read a page of the versions of an element.

    Args:
        state: where.
        element: PDDL or a name, as for `history`; with `kind`, a name.
        kind: the kind of what the name is of.
        before: only versions that began before this revision.
        limit: how many versions a page has, or a few more that began in one revision.

    Raises:
        UnknownNameError: there never was such an element.
        InvalidKnowledgeError: `element` is not valid.
    """
    wanted: list[Sought] = sought(element) if kind is None else [Named((kind,), fold(element))]
    last = LARGEST if state.at is None else state.at
    high = last if before is None else min(before - 1, last)
    applied = next(
        (one for one in wanted if isinstance(one, Applied)), Applied(frozenset(), "", ())
    )
    named = ("action", [element]) if kind == "action" else ("object", applied.arguments)

    def work(session: Session, kb_id: int | None) -> ElementPage | None:
        if kb_id is None:
            return None
        rows, end = _cut(read_newest(session, kb_id, wanted, high, limit + 1), limit)
        made = make_versions(session, kb_id, rows, last)[::-1]
        latest: dict[str, Version] = {}
        for version in made if before is None else ():
            latest.setdefault(version.kind, version)
        return ElementPage(
            element,
            [*latest.values()],
            [version for version in made if version.since.number >= (end or 0)],
            end,
            applied.name or None,
            [*dict.fromkeys(applied.arguments)],
            read_steps(session, kb_id, *named),
            read_position(session, kb_id).archived,
        )

    page = state.store.query_in_snapshot(work)
    if page is not None and (page.versions or before is not None):
        return page
    if kind is None:
        refuse_unknown_element(state.store, element)
    else:
        refuse_unknown(state.store, element, kind)
    raise UnknownNameError(
        f"{shown(element)} has never been in knowledge base {state.store.name!r}"
        + (", or what was of it is in an archive" if page is not None and page.archived else "")
    )


def _cut(rows: list[Row], limit: int) -> tuple[list[Row], int | None]:
    """Cut a page out of versions, with all that began in its last revision and one of each kind."""
    rows.sort(key=lambda row: row[2], reverse=True)
    if len(rows) <= limit:
        return rows, None
    end = rows[limit - 1][2]
    newest = {row[0]: row for row in reversed(rows)}
    page = [row for row in rows if row[2] >= end or row is newest[row[0]]]
    return page, end if rows[-1][2] < end else None


@dataclass(frozen=True)
class ObjectChange:
    """A change of what names an object, and the revision that made it."""

    _json_ = "*change", "revision"

    change: Change
    revision: Revision


class ObjectPage(NamedTuple):
    """An object: its definitions over time, what holds of it, and all that involved it.

    Attributes:
        name: its name, as it was spelled first.
        versions: the newest versions of its definition.
        held: the first of the elements that name it now.
        is_cut: whether there are more of these.
        changes: a page of the changes of what names it, the newest first.
        before: the revision before which the next page goes on; None after the last.
        searched: the first revision that was searched, if it is not the first of all.
        steps: the newest steps of plans that name it.
        actions: the actions that name it as a constant.
        archived: what ended up to this revision is in an archive; 0 if there is none.
    """

    name: str
    versions: list[Version]
    held: list[HeldElement]
    is_cut: bool
    changes: list[ObjectChange]
    before: int | None
    searched: int | None
    steps: list[StepLine]
    actions: list[str]
    archived: int


def _constants() -> Query:
    term, action = TABLES["action_term"].c, KIND_TABLES["action"].identity.c
    ids: Select[Any] = select(term.action_id).where(
        term.kb_id == KB, term.object_id == integer("object")
    )
    names = select(action.name).where(action.kb_id == KB, in_rows(action.id, ids))
    return Query(first_rows(names.order_by(action.name), literal_column("100")))


_CONSTANTS = _constants()


def read_object_page(
    state: State, name: str, before: int | None = None, limit: int = 100
) -> ObjectPage:
    """Read what involves an object, now and in the past.

    Raises:
        UnknownNameError: there never was such an object.
    """
    own = read_element_page(state, name, "object")
    held = read_state(state, None, StateFilter(object=name), limit=HELD).parts
    key = fold(name)

    def work(session: Session, kb_id: int | None) -> ObjectPage:
        found = None if kb_id is None else find_identities(session, kb_id, "object", {key})[key]
        assert kb_id is not None
        assert found is not None
        id_, spelled = found
        head = read_position(session, kb_id).head if state.at is None else state.at
        high = head if before is None else min(before - 1, head)
        changes, end, searched = read_involvement(session, kb_id, id_, high, limit)
        revisions = read_numbered(session, kb_id, {number for number, _ in changes})
        return ObjectPage(
            spelled,
            own.versions,
            [one for part in held if part.kind != "object" for one in part.elements],
            any(part.next is not None for part in held),
            [ObjectChange(change, revisions[number]) for number, change in changes],
            end,
            searched,
            read_steps(session, kb_id, "object", [name]),
            [row[0] for row in session.rows(_CONSTANTS, kb=kb_id, object=id_)],
            own.archived,
        )

    return state.store.query_in_snapshot(work)

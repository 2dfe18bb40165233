"""Pages of an element, or of an object and all that involves it; and the search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Text, bindparam, case, func, select, union_all

from ..arguments import shown
from ..dao.text import refuse_unknown
from ..dto.lexical import fold, is_word
from ..errors import UnknownNameError
from ..sql.changes import Change
from ..sql.definition_rows import find_identities
from ..sql.dialects.base import Row, Session
from ..sql.dialects.containing import contains, pattern_of
from ..sql.query import Query, constant, first_rows, in_rows, integer
from ..sql.rows import ATOM_TABLES, KB, KIND_TABLES, PROPOSITION, VALUE, AtomTables
from ..sql.tables import TABLES, RevisionRow
from ..store.snapshot import read_position
from ..store.state import State
from .elements import Applied, Named, Sought, refuse_unknown_element, sought
from .plan_pages import StepLine, read_steps
from .revisions import LARGEST, Revision, Version, read_numbered
from .state_parts import HeldElement, StateFilter, read_state
from .versions import make_versions, read_involvement, read_newest

# The number of present elements on the page of an object.
HELD = 50


class ElementPage(NamedTuple):
    """A page of the versions of an element, with related objects and steps.

    Attributes:
        text: the given text.
        latest: the newest version of each kind, on the first page; without `until`, it holds now.
        versions: the versions, the newest first.
        before: the revision before which the next page continues; None after the last.
        head: the name of its predicate or function, if it has one.
        objects: the names of its objects.
        steps: the newest steps of plans that name all of its objects, or this action.
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
    element: str,  # PDDL or a name, as for `history`; with `kind`, a name
    kind: str | None = None,
    before: int | None = None,
    limit: int = 50,  # the number of versions on a page, or a few more of the same revision
) -> ElementPage:
    """Read a page of the versions of an element."""
    wanted: list[Sought] = sought(element) if kind is None else [Named((kind,), fold(element))]
    last = LARGEST if state.at is None else state.at
    high = last if before is None else min(before - 1, last)
    applied = next(
        (one for one in wanted if isinstance(one, Applied)), Applied(frozenset(), "", ())
    )
    named = ("action", [element]) if kind == "action" else ("object", applied.arguments)

    def work(session: Session, kb_id: int) -> ElementPage | None:
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

    page = state.store.query_known(work, None)
    if page is not None and (page.versions or before is not None):
        return page
    if kind is None:
        refuse_unknown_element(state.store, element)
    else:
        refuse_unknown(state.store, element, kind)
    raise UnknownNameError(
        f"{shown(element)} has never been in knowledge base {state.store.name!r}"
        + (", or its versions are in an archive" if page is not None and page.archived else "")
    )


def _cut(rows: list[Row], limit: int) -> tuple[list[Row], int | None]:
    """Cut a page out of versions, with all of its last revision and one of each kind."""
    rows.sort(key=lambda row: row[2], reverse=True)
    if len(rows) <= limit:
        return rows, None
    end = rows[limit - 1][2]
    newest = {row[0]: row for row in reversed(rows)}
    page = [row for row in rows if row[2] >= end or row is newest[row[0]]]
    return page, end if rows[-1][2] < end else None


@dataclass(frozen=True)
class ObjectChange:
    """A change of an element that names an object, and its revision."""

    _json_ = "*change", "revision"

    change: Change
    revision: Revision


class ObjectPage(NamedTuple):
    """An object: its definitions over time, its present elements, and all changes that involved it.

    Attributes:
        name: its name, in its first spelling.
        versions: the newest versions of its definition.
        held: the first present elements that name it.
        is_cut: whether there are more of these.
        changes: a page of the changes of elements that name it, the newest first.
        before: the revision before which the next page goes on; None after the last.
        searched: the first searched revision, if it is not the first of all.
        steps: the newest steps of plans that name it.
        actions: the actions that name it as a constant.
        archived: versions that ended up to this revision are in an archive; 0 without one.
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
    return Query(first_rows(names.order_by(action.name), 100))


_CONSTANTS = _constants()


def read_object_page(
    state: State, name: str, before: int | None = None, limit: int = 100
) -> ObjectPage:
    """Read all that involves an object, now and in the past."""
    own = read_element_page(state, name, "object")
    held = read_state(state, None, StateFilter(object=name), limit=HELD).parts
    key = fold(name)

    def work(session: Session, kb_id: int) -> ObjectPage | None:
        found = find_identities(session, kb_id, "object", {key})[key]
        if found is None:
            return None
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

    page = state.store.query_known(work, None)
    # An erasure may have come between: then no object has this name.
    return read_object_page(state, name, before, limit) if page is None else page


# Names and facts that a search looks through, and revisions whose actors it looks through.
SEARCHED_NAMES, SEARCHED_REVISIONS = 10_000, 100_000
# Words of a text to look up as names.
MOST_WORDS = 20
DEFINED = ("action", "predicate", "function", "type")


class SearchMatch(NamedTuple):
    """An element or actor whose name or text contains the search text.

    Attributes:
        kind: its kind, as in `Change`, or `actor`.
        text: its name, or the text of a fact, a goal or a fluent.
    """

    kind: str
    text: str


# The order: exact names, names that begin with the text, facts of the object, other matches.
_EXACT, _PREFIX, _NAMING, _CONTAINING = range(4)
_ONE_KIND = 50


def _found(kind: str, text: Any, rank: Any, rows: Select[Any]) -> Select[Any]:
    """Select some rows as matches."""
    ranked = rank if isinstance(rank, ColumnElement) else constant(rank)
    columns = constant(kind).label("kind"), text.label("text"), ranked.label("rank")
    found = first_rows(rows.with_only_columns(*columns), _ONE_KIND).subquery()
    return select(found, func.count().over().label("size"))


def _newest(rows: Select[Any], number: Any, bound: int) -> Any:
    """Limit the search to the newest rows."""
    return first_rows(rows.order_by(number.desc()), bound).subquery().c


def _rank_of(text: Any) -> ColumnElement[int]:
    """Rank a text without a key: a fact without its parenthesis."""
    bare = func.ltrim(text, constant("("))
    return case(
        (contains(bare, "whole"), constant(_EXACT)),
        (contains(bare, "prefix"), constant(_PREFIX)),
        else_=constant(_CONTAINING),
    )


def _named_matches(kind: str) -> list[Select[Any]]:
    """Select names by their beginning, among all, and by any part, among the newest."""
    identity = KIND_TABLES[kind].identity.c
    folded, beyond = bindparam("folded", type_=Text), bindparam("beyond", type_=Text)
    own = identity.kb_id == KB
    is_name = case((identity.key == folded, constant(0)), else_=constant(1))
    begun = select(identity.key).where(own, identity.key >= folded, identity.key < beyond)
    names = select(identity.id, identity.name.label("text")).where(own)
    some = _newest(names, identity.id, SEARCHED_NAMES)
    part = select(some.text).where(contains(some.text)).order_by(some.id.desc())
    return [
        _found(kind, identity.name, is_name, begun.order_by(identity.key)),
        _found(kind, some.text, _CONTAINING, part),
    ]


def _atom_matches(kind: str, tables: AtomTables) -> list[Select[Any]]:
    """Select facts or fluents: the exact one, those of an object, and the newest with a text."""
    atom, argument = tables.identity.c, tables.arguments.c
    owner = argument[tables.owner]
    own, object_ = atom.kb_id == KB, KIND_TABLES["object"].identity.c
    the_object = select(object_.id).where(
        object_.kb_id == KB, object_.key == bindparam("folded", type_=Text)
    )
    of_object = select(owner).where(
        argument.kb_id == KB, argument.object_id == the_object.scalar_subquery()
    )
    of_object = first_rows(of_object.order_by(owner.desc()), _ONE_KIND)
    rows = select(atom.id, atom.text.label("text")).where(own)
    some = _newest(rows, atom.id, SEARCHED_NAMES)
    part = select(some.text).where(contains(some.text))
    very = select(atom.text).where(own, atom.text == bindparam("atom", type_=Text))
    naming = select(atom.text).where(own, in_rows(atom.id, of_object)).order_by(atom.id.desc())
    return [
        _found(kind, atom.text, _EXACT, very),
        _found(kind, atom.text, _NAMING, naming),
        _found(
            kind, some.text, _rank_of(some.text), part.order_by(_rank_of(some.text), some.id.desc())
        ),
    ]


def _matches() -> Query:
    """Select what a text may mean, the most likely first."""
    parts = [part for kind in ("object", *DEFINED) for part in _named_matches(kind)]
    parts += _atom_matches("fact", ATOM_TABLES[PROPOSITION])
    parts += _atom_matches("value", ATOM_TABLES[VALUE])
    number: Any = RevisionRow.number
    revisions = select(RevisionRow.actor.label("text"), number).where(RevisionRow.kb_id == KB)
    recent = _newest(revisions, number, SEARCHED_REVISIONS)
    actors = select(recent.text).where(contains(recent.text)).group_by(recent.text)
    rank = _rank_of(recent.text)
    parts.append(_found("actor", recent.text, rank, actors.order_by(rank, recent.text)))
    found = union_all(*parts).subquery("found").c
    best = func.min(found.rank)
    rows = select(found.kind, found.text, func.max(found.size)).group_by(found.kind, found.text)
    order = best, func.length(found.text), found.kind.desc(), found.text
    return Query(first_rows(rows.order_by(*order), integer("size")))


_MATCHES = _matches()


def _spelled(session: Session, kb_id: int, words: list[str]) -> str:
    """Return the text of a fact or a fluent, with names in their first spelling."""
    keys = {fold(word) for word in words[:MOST_WORDS] if is_word(word)}
    spelled: dict[tuple[str, str], str] = {}
    for kind in ("predicate", "function", "object") if keys else ():
        found = find_identities(session, kb_id, kind, keys)
        spelled.update(((kind, key), one[1]) for key, one in found.items() if one)
    objects = [spelled.get(("object", fold(word)), word) for word in words[1:]]
    heads = (
        spelled.get((kind, fold(word))) for word in words[:1] for kind in ("predicate", "function")
    )
    return f"({' '.join([next(filter(None, heads), words[0] if words else ''), *objects])})"


def read_matches(reader: State, text: str, limit: int = 100) -> tuple[list[SearchMatch], bool]:
    """Search for a text in names, facts, fluents and actors, in four statements at most.

    Returns:
        Some matches, and whether there may be more.
    """
    # Exact names first, then names that begin with the text, then facts of the object of this name,
    # then other matches. Names and facts of an object are searched among all, others among the
    # newest.
    bare = text.strip("() ")
    asked = {"folded": fold(bare), "beyond": f"{fold(bare)}\U0010ffff"}

    def work(session: Session, kb_id: int) -> tuple[list[SearchMatch], bool]:
        atom = _spelled(session, kb_id, bare.split())
        patterns = {
            "pattern": pattern_of(session, text),
            "prefix": pattern_of(session, bare, begins=True),
            "whole": pattern_of(session, bare, begins=True, ends=True),
        }
        rows = session.rows(_MATCHES, kb=kb_id, size=limit + 1, atom=atom, **patterns, **asked)
        is_cut = len(rows) > limit or any(row[2] == _ONE_KIND for row in rows)
        return [SearchMatch(row[0], row[1]) for row in rows[:limit]], is_cut

    nothing: tuple[list[SearchMatch], bool] = [], False
    return reader.store.query_known(work, nothing) if text else nothing

"""An element by pages: its versions, the newest first; the steps of plans that it is in; search."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Select,
    Text,
    bindparam,
    case,
    func,
    literal_column,
    select,
    union_all,
)

from ..arguments import shown
from ..dao.known import refuse_unknown
from ..dto.lexical import fold, is_word
from ..errors import UnknownNameError
from ..sql.definitions import find_identities
from ..sql.dialects.base import Session
from ..sql.dialects.containing import contains, pattern_of
from ..sql.query import Query, first_rows, in_list, in_rows, integer
from ..sql.rows import KB, KIND_TABLES, PROPOSITION, VALUE, VERSION_COLUMNS, table_of
from ..sql.tables import (
    TABLES,
    FunctionValueArgumentRow,
    HeadRow,
    PlanRow,
    PlanStepArgumentRow,
    PlanStepRow,
    PlanStepVersionRow,
    PropositionArgumentRow,
    RevisionRow,
)
from ..store.state import State
from .elements import Applied, Named, Sought, find_owners, refuse_unknown_element, sought
from .involvement import Involvement, read_involvement
from .log import NEWEST_VERSIONS
from .revisions import LARGEST, Revision, read_numbered
from .versions import Version

# A text may name several elements, as a conjunction does; so many are shown.
MOST_OWNERS = 20
# Names and facts that a search looks through, and revisions whose actors it does.
SEARCHED_NAMES, SEARCHED_REVISIONS = 10_000, 100_000
# Steps of plans that are looked through for objects that more of them name.
SEARCHED_STEPS = 5_000
DEFINED = ("action", "predicate", "function", "type")


class StepLine(NamedTuple):
    """A step of a recorded plan.

    Attributes:
        plan: the id of the plan.
        position: its place in the plan.
        text: the action with its arguments, as PDDL.
        status: what became of it; None before it is started.
    """

    plan: int
    position: int
    text: str
    status: str | None


class VersionsPage(NamedTuple):
    """A page of the versions of an element, and of what is related to it.

    Attributes:
        versions: the versions, the newest first.
        before: the revision before which the next page goes on; None after the last.
        latest: the newest version of each kind, on the first page.
        objects: the names of the objects that it applies to.
        head: the name of its predicate or function, if it applies to objects.
        steps: the newest steps of plans that name all of its objects, or that are of this action.
        archived: versions that ended up to this revision are in an archive; 0 if there is none.
    """

    versions: list[Version]
    before: int | None
    latest: list[Version]
    objects: tuple[str, ...]
    head: str | None
    steps: list[StepLine]
    archived: int


_ARCHIVED = Query(select(HeadRow.archived_revision).where(HeadRow.kb_id == KB))


def read_versions_page(
    reader: State,
    element: str,
    kind: str | None = None,
    before: int | None = None,
    limit: int = 50,
) -> VersionsPage:
    """Read a page of the versions of an element.

    Args:
        reader: where.
        element: PDDL or a name, as for `history`; with `kind`, a name.
        kind: the kind of what the name is of.
        before: only versions that began before this revision.
        limit: how many versions a page has, or a few more that began in one revision.

    Raises:
        UnknownNameError: there never was such an element.
        InvalidKnowledgeError: `element` is not valid.
    """
    wanted: list[Sought] = sought(element) if kind is None else [Named((kind,), fold(element))]
    last = LARGEST if reader.at is None else reader.at
    high = last if before is None else min(before - 1, last)

    def work(session: Session, kb_id: int | None) -> VersionsPage | None:
        if kb_id is None:
            return None
        owners = find_owners(session, kb_id, wanted)[:MOST_OWNERS]
        read = {"kb": kb_id, "high": high, "size": limit + 1}
        each = [
            session.rows(NEWEST_VERSIONS[owner.source], **read, id=owner.id) for owner in owners
        ]
        rows, end = _cut([row for rows in each for row in rows], limit)
        newest = {row[0]: row for rows in each for row in rows[:1]} if before is None else {}
        versions = _versions(session, kb_id, [*rows, *newest.values()], last)
        archived = session.first(_ARCHIVED, kb=kb_id)
        applied = next((one for one in wanted if isinstance(one, Applied)), None)
        steps = _steps_of_element(session, kb_id, applied, element if kind == "action" else None)
        return VersionsPage(
            versions[: len(rows)],
            end,
            versions[len(rows) :],
            applied.arguments if applied else (),
            applied.name if applied else None,
            steps,
            archived[0] if archived else 0,
        )

    page = reader.store.query_in_snapshot(work)
    if page is not None and (page.versions or before is not None):
        return page
    if kind is None:
        refuse_unknown_element(reader.store, element)
    else:
        refuse_unknown(reader.store, element, kind)
    raise UnknownNameError(
        f"{shown(element)} never was in knowledge base {reader.store.name!r}"
        + (", or what was of it is in an archive" if page is not None and page.archived else "")
    )


def _cut(rows: list[Any], limit: int) -> tuple[list[Any], int | None]:
    """Cut a page out of versions, with all that began in its last revision."""
    rows = sorted(dict.fromkeys(rows), key=lambda row: (-row[2], row[0], row[1]))
    if len(rows) <= limit:
        return rows, None
    end = rows[limit - 1][2]
    page = [row for row in rows if row[2] >= end]
    return page, end if len(page) < len(rows) else None


def _versions(session: Session, kb_id: int, rows: list[Any], last: int) -> list[Version]:
    ended = [row[3] if row[3] is not None and row[3] <= last else None for row in rows]
    numbers = {row[2] for row in rows} | {number for number in ended if number is not None}
    revisions = read_numbered(session, kb_id, numbers)
    return [
        Version(row[0], row[1], revisions[row[2]], None if until is None else revisions[until])
        for row, until in zip(rows, ended, strict=True)
    ]


# Steps of plans.

_STEPS_SHOWN = 20
_STEP, _ARGUMENT = table_of(PlanStepRow), table_of(PlanStepArgumentRow)


def _named(step: Any, place: int) -> ColumnElement[bool]:
    """Return whether a step names an object."""
    argument = _ARGUMENT.alias(f"argument{place}").c
    own = argument.plan_id == step.plan_id, argument.position == step.position
    # An expression has no index: an object may be in many steps, a step has few arguments.
    is_named = argument.object_id + literal_column("0") == integer(f"object{place}")
    found: Select[Any] = select(literal_column("1")).where(argument.kb_id == KB, *own, is_named)
    return found.exists()


def _shown(places: Any) -> Query:
    """Read the newest of some steps, with what became of them."""
    newest = places.order_by(
        places.selected_columns.plan_id.desc(), places.selected_columns.position.desc()
    )
    page = first_rows(newest, integer("size")).subquery("page").c
    version = table_of(PlanStepVersionRow).c

    def of_page(table: Any, column: Any, *which: Any) -> Any:
        own = table.plan_id == page.plan_id, table.position == page.position
        found = select(column).where(table.kb_id == KB, *own, *which)
        return found.correlate_except(column.table).scalar_subquery()

    text = of_page(_STEP.c, _STEP.c.text)
    status = of_page(version, version.status, version.until.is_(None))
    lines = select(page.plan_id, page.position, text, status)
    return Query(lines.order_by(page.plan_id.desc(), page.position.desc()))


@cache
def _steps_of_action() -> Query:
    steps = select(_STEP.c.plan_id, _STEP.c.position).where(_STEP.c.kb_id == KB)
    return _shown(steps.where(_STEP.c.action_id == integer("action")))


@cache
def _steps_naming(number: int, is_recent: bool) -> Query:
    """Select the steps that name all of some objects, by the first one or among the newest."""
    if is_recent:
        newest = select(_STEP.c.plan_id, _STEP.c.position).where(_STEP.c.kb_id == KB)
        newest = newest.order_by(_STEP.c.plan_id.desc(), _STEP.c.position.desc())
        steps: Any = first_rows(newest, literal_column(str(SEARCHED_STEPS))).subquery("newest").c
        places = select(steps.plan_id, steps.position)
        return _shown(places.where(*(_named(steps, place) for place in range(number))))
    first = _ARGUMENT.alias("first").c
    own = first.kb_id == KB, first.object_id == integer("object0")
    places = select(first.plan_id, first.position).where(*own).distinct()
    return _shown(places.where(*(_named(first, place) for place in range(1, number))))


@cache
def _uses(number: int) -> Query:
    """Count the steps that name each of some objects, up to a bound."""
    counts = []
    for place in range(number):
        named: Select[Any] = select(literal_column("1")).where(
            _ARGUMENT.c.kb_id == KB, _ARGUMENT.c.object_id == integer(f"object{place}")
        )
        some = first_rows(named, literal_column(str(SEARCHED_STEPS + 1))).subquery()
        counts.append(select(func.count()).select_from(some).scalar_subquery())
    return Query(select(*counts))


def _read_steps(session: Session, kb_id: int, objects: Sequence[int]) -> list[StepLine]:
    """Read the newest steps that name all of some objects, in two statements."""
    own = {f"object{place}": id_ for place, id_ in enumerate(objects)}
    counts = session.first(_uses(len(objects)), kb=kb_id, **own) or (0,)
    is_recent = min(counts) > SEARCHED_STEPS
    rarest = sorted(range(len(objects)), key=lambda place: counts[place])
    own = {f"object{place}": objects[which] for place, which in enumerate(rarest)}
    query = _steps_naming(len(objects), is_recent)
    return [StepLine(*row) for row in session.rows(query, kb=kb_id, size=_STEPS_SHOWN, **own)]


def _steps_of_element(
    session: Session, kb_id: int, applied: Applied | None, action: str | None
) -> list[StepLine]:
    """Read steps in three statements at most."""
    if action is not None:
        ids = _ids(session, kb_id, "action", [action])
        own = {"kb": kb_id, "size": _STEPS_SHOWN}
        rows = session.rows(_steps_of_action(), **own, action=ids[0]) if ids else ()
        return [StepLine(*row) for row in rows]
    if applied is None or not applied.arguments:
        return []
    ids = _ids(session, kb_id, "object", [*dict.fromkeys(applied.arguments)])
    return _read_steps(session, kb_id, ids) if ids else []


def _ids(session: Session, kb_id: int, kind: str, names: Sequence[str]) -> list[int] | None:
    """Find the ids of names; None if one never was."""
    keys = [fold(name) for name in names[:5]]
    if not all(map(is_word, keys)):
        return None
    found = find_identities(session, kb_id, kind, set(keys))
    ids = [found[key] for key in keys]
    return None if None in ids else [one[0] for one in ids if one is not None]


# Objects.


class ObjectPage(NamedTuple):
    """What involves an object, besides what holds now.

    Attributes:
        involved: a page of the changes of what names it.
        revisions: the revisions of these changes, by number.
        steps: the newest steps of plans that name it.
        constants: the actions that name it as a constant.
    """

    involved: Involvement
    revisions: dict[int, Revision]
    steps: list[StepLine]
    constants: list[str]


def _constants() -> Query:
    term, action = TABLES["action_term"].c, KIND_TABLES["action"].identity.c
    ids: Select[Any] = select(term.action_id).where(
        term.kb_id == KB, term.object_id == integer("object")
    )
    names = select(action.name).where(action.kb_id == KB, in_rows(action.id, ids))
    return Query(first_rows(names.order_by(action.name), literal_column("100")))


_CONSTANTS = _constants()


def read_object_page(
    reader: State, name: str, before: int | None = None, limit: int = 100
) -> ObjectPage:
    """Read what involves an object, newest first.

    Raises:
        UnknownNameError: there never was such an object.
    """
    high = min((before or LARGEST) - 1, LARGEST if reader.at is None else reader.at)

    def work(session: Session, kb_id: int | None) -> ObjectPage | None:
        ids = None if kb_id is None else _ids(session, kb_id, "object", [name])
        if not ids or kb_id is None:
            return None
        top = session.first(_HEAD, kb=kb_id)
        involved = read_involvement(session, kb_id, ids[0], min(high, top[0] if top else 0), limit)
        numbers = {number for number, _ in involved.changes}
        steps = _read_steps(session, kb_id, ids)
        constants = session.rows(_CONSTANTS, kb=kb_id, object=ids[0])
        return ObjectPage(
            involved,
            read_numbered(session, kb_id, numbers),
            steps,
            [row[0] for row in constants],
        )

    page = reader.store.query_in_snapshot(work)
    if page is None:
        refuse_unknown(reader.store, name, "object")
        raise UnknownNameError(f"there never was an object {shown(name)}")
    return page


_HEAD = Query(select(HeadRow.revision).where(HeadRow.kb_id == KB))


# Plans.


class PlanLine(NamedTuple):
    """A plan in a list.

    Attributes:
        plan: its id.
        recorded: the revision that recorded it.
        revision: the revision of the state that it was planned from.
        planner: the planner's name.
        objective: the metric.
        value: the objective's value, as text.
        status: what the planner said.
        steps: how many steps it has.
        outcomes: how many steps have each status; those without one were not started.
    """

    plan: int
    recorded: Revision
    revision: int
    planner: str | None
    objective: str | None
    value: str | None
    status: str | None
    steps: int
    outcomes: dict[str, int]


def _plans() -> Query:
    plan = table_of(PlanRow).c
    columns: tuple[Any, ...] = plan.id, plan.since, plan.revision, plan.planner, plan.objective
    rows = select(*columns, plan.value, plan.status)
    rows = rows.where(plan.kb_id == KB, plan.id < integer("before")).order_by(plan.id.desc())
    return Query(first_rows(rows, integer("size")))


def _outcomes() -> Query:
    version = table_of(PlanStepVersionRow).c
    among, having = in_list(_STEP.c.plan_id, "plans"), in_list(version.plan_id, "plans")
    all_: Any = literal_column("''")
    steps = select(_STEP.c.plan_id, all_, func.count()).where(_STEP.c.kb_id == KB, among)
    now = select(version.plan_id, version.status, func.count()).where(
        version.kb_id == KB, having, version.until.is_(None)
    )
    by_status = now.group_by(version.plan_id, version.status)
    return Query(union_all(steps.group_by(_STEP.c.plan_id), by_status))


_PLANS, _OUTCOMES = _plans(), _outcomes()


def read_plans_page(
    reader: State, before: int | None = None, limit: int = 50
) -> tuple[list[PlanLine], int | None]:
    """Read a page of the recorded plans, the newest first, and the id before the next page."""

    def work(session: Session, kb_id: int | None) -> tuple[list[PlanLine], int | None]:
        if kb_id is None:
            return [], None
        rows = session.rows(_PLANS, kb=kb_id, before=before or LARGEST, size=limit + 1)
        page = rows[:limit]
        if not page:
            return [], None
        plans = session.list_value([row[0] for row in page])
        counts: dict[int, dict[str, int]] = {}
        for id_, status, number in session.rows(_OUTCOMES, kb=kb_id, plans=plans):
            counts.setdefault(id_, {})[status] = number
        revisions = read_numbered(session, kb_id, {row[1] for row in page})
        lines = []
        for row in page:
            outcomes = counts.get(row[0], {})
            steps = outcomes.pop("", 0)
            id_, since, revision, *said = row
            planner, objective, value, status = said
            own = planner, objective, value, status
            lines.append(PlanLine(id_, revisions[since], revision, *own, steps, outcomes))
        return lines, page[-1][0] if len(rows) > limit else None

    return reader.store.query_in_snapshot(work)


class Stretch(NamedTuple):
    """The revisions from one to another.

    Attributes:
        newest: the last of them, in order.
        total: how many there are.
    """

    newest: list[Revision]
    total: int


def read_stretches(
    reader: State, bounds: Sequence[tuple[int, int | None]], limit: int
) -> list[Stretch]:
    """Read the last revisions of each stretch, in two statements; one without an end is open."""

    def work(session: Session, kb_id: int | None) -> list[Stretch]:
        if kb_id is None or not bounds:
            return []
        top = session.first(_HEAD, kb=kb_id)
        head = top[0] if top else 0
        ends = [(first, head if last is None else last) for first, last in bounds]
        numbers = [range(max(first, last - limit + 1), last + 1) for first, last in ends]
        found = read_numbered(session, kb_id, set().union(*numbers))
        return [
            Stretch([found[number] for number in some if number in found], last - first + 1)
            for some, (first, last) in zip(numbers, ends, strict=True)
        ]

    return reader.store.query_in_snapshot(work)


# Search.


class SearchMatch(NamedTuple):
    """Something whose name or text contains what is looked for.

    Attributes:
        kind: its kind, as in `Change`, or `actor`.
        text: its name, or the text of a fact, a goal or a fluent.
    """

    kind: str
    text: str


# What comes first: the very name, names that begin so, what names the object, what contains it.
_EXACT, _PREFIX, _NAMING, _CONTAINING = range(4)
_ONE_KIND: ColumnElement[int] = literal_column("50")
_OPEN: ColumnElement[str] = literal_column("'('")


def _found(kind: str, text: Any, rank: Any, rows: Select[Any]) -> Select[Any]:
    """Select some rows as matches."""
    ranked = rank if isinstance(rank, ColumnElement) else literal_column(str(rank))
    said: ColumnElement[str] = literal_column(f"'{kind}'")
    return select(
        first_rows(
            rows.with_only_columns(said.label("kind"), text.label("text"), ranked.label("rank")),
            _ONE_KIND,
        ).subquery()
    )


def _newest(rows: Select[Any], number: Any, bound: int) -> Any:
    """Limit what is searched to the newest rows."""
    return first_rows(rows.order_by(number.desc()), literal_column(str(bound))).subquery().c


def _rank_of(text: Any) -> ColumnElement[int]:
    """Rank a text that has no key: of a fact, without its parenthesis."""
    bare = func.ltrim(text, _OPEN)
    return case(
        (contains(bare, "whole"), literal_column(str(_EXACT))),
        (contains(bare, "prefix"), literal_column(str(_PREFIX))),
        else_=literal_column(str(_CONTAINING)),
    )


def _named_matches(kind: str) -> list[Select[Any]]:
    """Select names by their keys, of all there are, and by a part of them, of the newest."""
    identity = KIND_TABLES[kind].identity.c
    folded, beyond = bindparam("folded", type_=Text), bindparam("beyond", type_=Text)
    own = identity.kb_id == KB
    is_name = case((identity.key == folded, literal_column("0")), else_=literal_column("1"))
    begun = select(identity.key).where(own, identity.key >= folded, identity.key < beyond)
    names = select(identity.id, identity.name.label("text")).where(own)
    some = _newest(names, identity.id, SEARCHED_NAMES)
    part = select(some.text).where(contains(some.text)).order_by(some.id.desc())
    return [
        _found(kind, identity.name, is_name, begun.order_by(identity.key)),
        _found(kind, some.text, _CONTAINING, part),
    ]


def _atom_matches(source: str, kind: str, arguments: Any, owner_name: str) -> list[Select[Any]]:
    """Select facts or fluents: the very one, those of an object, and the newest with a text."""
    atom, argument = VERSION_COLUMNS[source].identity, table_of(arguments).c
    owner = argument[owner_name]
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
    """Select what a text may mean, the most probable first."""
    parts = [part for kind in ("object", *DEFINED) for part in _named_matches(kind)]
    parts += _atom_matches(PROPOSITION, "fact", PropositionArgumentRow, "proposition_id")
    parts += _atom_matches(VALUE, "value", FunctionValueArgumentRow, "function_value_id")
    number: Any = RevisionRow.number
    revisions = select(RevisionRow.actor.label("text"), number).where(RevisionRow.kb_id == KB)
    recent = _newest(revisions, number, SEARCHED_REVISIONS)
    actors = select(recent.text).where(contains(recent.text)).group_by(recent.text)
    rank = _rank_of(recent.text)
    parts.append(_found("actor", recent.text, rank, actors.order_by(rank, recent.text)))
    found = union_all(*parts).subquery("found").c
    best = func.min(found.rank)
    rows = select(found.kind, found.text).group_by(found.kind, found.text)
    order = best, func.length(found.text), found.kind.desc(), found.text
    return Query(first_rows(rows.order_by(*order), integer("size")))


_MATCHES = _matches()


def _spelled(session: Session, kb_id: int, words: list[str]) -> str:
    """Return the text of a fact or a fluent, its names spelled as they were first."""
    keys = {fold(word) for word in words[:MOST_OWNERS] if is_word(word)}
    spelled: dict[tuple[str, str], str] = {}
    for kind in ("predicate", "function", "object") if keys else ():
        found = find_identities(session, kb_id, kind, keys)
        spelled.update(((kind, key), one[1]) for key, one in found.items() if one)
    objects = [spelled.get(("object", fold(word)), word) for word in words[1:]]
    heads = (
        spelled.get((kind, fold(word))) for word in words[:1] for kind in ("predicate", "function")
    )
    return f"({' '.join([next(filter(None, heads), words[0] if words else ''), *objects])})"


def read_matches(reader: State, text: str, limit: int = 100) -> list[SearchMatch]:
    """Look for a text in names, in facts and fluents, and in actors, in four statements at most.

    First comes what has this name, then what begins so, then facts of the object of this name, then
    what contains the text. Names and the facts of an object are found among all, other texts among
    the newest.
    """
    bare = text.strip("() ")
    asked = {"folded": fold(bare), "beyond": f"{fold(bare)}\U0010ffff"}

    def work(session: Session, kb_id: int | None) -> list[SearchMatch]:
        if kb_id is None:
            return []
        atom = _spelled(session, kb_id, bare.split())
        patterns = {
            "pattern": pattern_of(session, text),
            "prefix": pattern_of(session, bare, begins=True),
            "whole": pattern_of(session, bare, begins=True, ends=True),
        }
        rows = session.rows(_MATCHES, kb=kb_id, size=limit, atom=atom, **patterns, **asked)
        return [SearchMatch(row[0], row[1]) for row in rows]

    return reader.store.query_in_snapshot(work)

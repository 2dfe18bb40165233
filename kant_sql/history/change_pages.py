"""What a revision changed, what differs between two states, what involves an object: by pages.

A page is found by ids, and only its own texts are read: a revision may change a hundred thousand
facts, and two states may differ in as many.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Select,
    and_,
    case,
    func,
    literal_column,
    or_,
    select,
    union_all,
)

from ..sql.changes import (
    ARCHIVE,
    ASSERTED,
    PLAN,
    PLAN_STEP,
    PROMOTION,
    RETRACTED,
    Change,
    stream_changes_of,
)
from ..sql.dialects.base import Row, Session
from ..sql.intervals import ANY_FUNCTION, ANY_PREDICATE, forks_at
from ..sql.query import Query, first_rows, in_list, in_rows, integer
from ..sql.rows import KB, PROPOSITION, VALUE, VERSION_COLUMNS, VersionColumns, table_of
from ..sql.tables import (
    ArchiveRow,
    FunctionValueArgumentRow,
    HeadRow,
    PlanRow,
    PlanStepVersionRow,
    PromotionRow,
    PropositionArgumentRow,
    PropositionRow,
    RevisionRow,
)
from ..store.snapshot import refuse_archived
from .excerpts import StateReader
from .moments import When, states_at

# Up to this number changes are in the order of their texts, beyond it in that of their ids.
SORTED = 5_000
# Changes of a kind that a revision is counted and shown with.
COUNTED_CHANGES = 50_000
# States so many revisions apart are compared by what began and ended between them.
NARROW = 20_000
# Differences of a kind that are found; the rest is left out.
COMPARED = 20_000
# Versions of what an object is in that are looked at, to find the newest.
INVOLVED = 20_000
# Revisions that are searched for what an object is in, if that is more.
WINDOW = 20_000

_SIZE, _OFFSET = integer("size"), integer("offset")
_LOW, _HIGH = integer("low"), integer("high")
_NO_TEXT: Any = literal_column("CAST(NULL AS text)")
Within = Callable[[Any], ColumnElement[bool]]


class ChangesPage(NamedTuple):
    """A page of changes.

    Attributes:
        changes: each with its revision.
        next: the offset of the next page; None after the last.
    """

    changes: list[tuple[int, Change]]
    next: int | None


def _change(
    columns: VersionColumns, revision: Any, retracted: str, text: Any, *which: Any
) -> Select[Any]:
    return select(
        revision.label("revision"),
        literal_column(retracted).label("retracted"),
        columns.kind.label("kind"),
        columns.owner.label("owner"),
        text.label("text"),
    ).where(columns.version.kb_id == KB, *which)


def _text(name: str) -> Any:
    return _NO_TEXT if name == PROPOSITION else VERSION_COLUMNS[name].version.text


def _ends(within: Within) -> list[Select[Any]]:
    """Return the changes of revisions, without the texts of propositions."""
    parts = []
    for name, columns in VERSION_COLUMNS.items():
        for retracted, end in (("0", columns.version.since), ("1", columns.version.until)):
            parts.append(_change(columns, end, retracted, _text(name), within(end)))
    step, plan, archive, promotion = (
        table_of(mapped).c for mapped in (PlanStepVersionRow, PlanRow, ArchiveRow, PromotionRow)
    )
    records = [
        (PLAN_STEP, step, "0", step.since, step.plan_id),
        (PLAN_STEP, step, "1", step.until, step.plan_id),
        (PLAN, plan, "0", plan.since, plan.id),
        (ARCHIVE, archive, "0", archive.since, archive.id),
        (PROMOTION, promotion, "0", promotion.since, promotion.id),
    ]
    for kind, table, retracted, end, owner in records:
        quoted: Any = literal_column(f"'{kind}'")
        columns = VersionColumns(None, table, owner, quoted, table.text)
        parts.append(_change(columns, end, retracted, table.text, within(end)))
    return parts


def _paged(parts: list[Select[Any]], by_text: bool) -> Query:
    """Cut a page out of changes, the newest first, and add the texts that are missing."""
    some = union_all(*parts).subquery("some").c
    atom = table_of(PropositionRow).c

    def text_of(row: Any) -> ColumnElement[Any]:
        own = select(atom.text).where(atom.kb_id == KB, atom.id == row.owner)
        return func.coalesce(
            row.text, own.correlate_except(table_of(PropositionRow)).scalar_subquery()
        )

    columns: list[Any] = [some.revision, some.retracted, some.kind]
    if by_text:
        page = select(*columns, text_of(some).label("text"))
        return Query(
            page.order_by(some.revision.desc(), some.retracted, some.kind, "text")
            .limit(_SIZE)
            .offset(_OFFSET)
        )
    order = some.revision.desc(), some.retracted, some.kind, some.owner
    cut = select(*columns, some.owner, some.text).order_by(*order).limit(_SIZE).offset(_OFFSET)
    page = cut.subquery("page").c  # type: ignore[assignment]
    made: Any = page
    return Query(
        select(made.revision, made.retracted, made.kind, text_of(made)).order_by(
            made.revision.desc(), made.retracted, made.kind, made.owner
        )
    )


def _page(rows: list[Row], offset: int, limit: int) -> ChangesPage:
    changes = [
        (number, Change(RETRACTED if retracted else ASSERTED, kind, text))
        for number, retracted, kind, text in rows[:limit]
    ]
    return ChangesPage(changes, offset + limit if len(rows) > limit else None)


@cache
def _counts() -> Query:
    """Count what each revision changed: of a kind, up to a bound."""
    revision = table_of(RevisionRow)
    one: Any = literal_column("1")
    bound: Any = literal_column(str(COUNTED_CHANGES))
    numbers: list[Any] = []
    for part in _ends(lambda column: column == revision.c.number):
        some = first_rows(part.with_only_columns(one).correlate(revision), bound).subquery()
        numbers.append(select(func.count()).select_from(some).scalar_subquery())
    total = sum(numbers[1:], start=numbers[0])
    rows = select(revision.c.number, total).where(revision.c.kb_id == KB)
    return Query(rows.where(in_list(revision.c.number, "numbers")))


def count_changes(session: Session, kb_id: int, numbers: Iterable[int]) -> dict[int, int]:
    """Count what some revisions changed, up to `COUNTED_CHANGES` and perhaps more."""
    listed = session.list_value([*numbers])
    return {row[0]: row[1] for row in session.rows(_counts(), kb=kb_id, numbers=listed)}


def changes_of(session: Session, kb_id: int, numbers: list[int]) -> dict[int, tuple[Change, ...]]:
    """Read what some revisions changed, which is not much, in one statement."""
    found: dict[int, list[Change]] = {}
    for number, change in stream_changes_of(session, kb_id, numbers):
        found.setdefault(number, []).append(change)
    return {number: tuple(changes) for number, changes in found.items()}


@cache
def _of_revision(by_text: bool) -> Query:
    bound: Any = literal_column(str(COUNTED_CHANGES))
    parts = _ends(lambda column: column == integer("number"))
    return _paged([select(first_rows(part, bound).subquery()) for part in parts], by_text)


def read_changes_page(
    session: Session, kb_id: int, number: int, total: int, offset: int, limit: int
) -> ChangesPage:
    """Read a page of what a revision changed, in one statement.

    Args:
        session: the session.
        kb_id: the knowledge base.
        number: the revision.
        total: how many changes it has.
        offset: how many come before the page.
        limit: how many a page has.
    """
    query = _of_revision(total <= SORTED)
    rows = session.rows(query, kb=kb_id, number=number, size=limit + 1, offset=offset)
    return _page(rows, offset, limit)


# The difference of two states.

_BEFORE, _AFTER = integer("before"), integer("after")
_ANY = {PROPOSITION: ANY_PREDICATE, VALUE: ANY_FUNCTION}


def _other(name: str, columns: VersionColumns, at: ColumnElement[int]) -> ColumnElement[Any]:
    """Return what the same element says in the other state; NULL if it does not hold there."""
    table = columns.version.kb_id.table
    other = table.alias("other")
    holds = or_(other.c.until.is_(None), other.c.until > at)
    said = literal_column("''") if name == PROPOSITION else other.c.text
    same = other.c[columns.owner.key] == columns.owner
    last = select(case((holds, said))).where(other.c.kb_id == KB, same, other.c.since <= at)
    last = first_rows(last.order_by(other.c.since.desc()), literal_column("1"))
    return last.correlate(table).scalar_subquery()


def _held(name: str, version: Any, at: ColumnElement[int], forks: str) -> ColumnElement[bool]:
    held = and_(version.since <= at, or_(version.until.is_(None), version.until > at))
    if name not in _ANY:
        return held
    return and_(_ANY[name], in_list(version.fork, forks), held)


@cache
def _differences(is_narrow: bool, side: str) -> Query:
    """Select what holds at only one of two revisions; `side` is "1" for the one before."""
    at, other = (_BEFORE, _AFTER) if side == "1" else (_AFTER, _BEFORE)
    parts = []
    for name, columns in VERSION_COLUMNS.items():
        version = columns.version
        if side == "1":
            ends = and_(version.until > _BEFORE, version.until <= _AFTER)
        else:
            ends = and_(version.since > _BEFORE, version.since <= _AFTER)
        # An interval that ends in the range holds at its other side, by either way.
        held = _held(name, version, at, "forks")
        if is_narrow:
            held = and_(version.since <= at, or_(version.until.is_(None), version.until > at))
        elif side == "1":
            ends = version.until + literal_column("0") <= _AFTER
        else:
            ends = version.since + literal_column("0") > _BEFORE
        said = literal_column("''") if name == PROPOSITION else version.text
        differs = func.coalesce(_other(name, columns, other), literal_column("' '")) != said
        part = _change(columns, literal_column("0"), side, _text(name), ends, held, differs)
        parts.append(select(first_rows(part, literal_column(str(COMPARED))).subquery()))
    return _paged(parts, by_text=False)


class Difference(NamedTuple):
    """A page of the difference of two states.

    Attributes:
        a: the revision of the one.
        b: the revision of the other.
        head: the last revision.
        only_a: what only the one has.
        only_b: what only the other has.
        is_cut: whether there are differences that no page has.
    """

    a: int
    b: int
    head: int
    only_a: ChangesPage
    only_b: ChangesPage
    is_cut: bool


def read_difference(
    reader: StateReader, a: When, b: When, offset: int = 0, limit: int = 200
) -> Difference:
    """Read a page of the difference of two states.

    Raises:
        UnknownRevisionError: there is no such revision yet.
        ArchivedError: one of the states was moved to an archive.
    """
    (one, other), head = states_at(reader.store, (a, b), reader.at)
    before, after = sorted((one, other))
    empty = ChangesPage([], None)

    def work(session: Session, kb_id: int | None) -> tuple[ChangesPage, ChangesPage]:
        if kb_id is None or before == after:
            return empty, empty
        row = session.first(_ARCHIVED, kb=kb_id)
        refuse_archived(session, kb_id, before, int(row[0]) if row else 0)
        is_narrow = after - before <= NARROW
        own = {"kb": kb_id, "before": before, "after": after, "size": limit + 1, "offset": offset}
        pages = []
        for side, at in (("1", before), ("0", after)):
            forks = session.list_value(forks_at(at))
            rows = session.rows(_differences(is_narrow, side), **own, forks=forks)
            pages.append(_page(rows, offset, limit))
        return pages[0], pages[1]

    went, came = reader.store.query_in_snapshot(work)
    only_a, only_b = (went, came) if one == before else (came, went)
    last = head.revision if reader.at is None else reader.at
    ends = [offset + len(page.changes) for page in (only_a, only_b) if page.next is None]
    return Difference(one, other, last, only_a, only_b, any(end >= COMPARED for end in ends))


_ARCHIVED = Query(select(HeadRow.archived_revision).where(HeadRow.kb_id == KB))


# What involves an object.

_ATOMS = {
    PROPOSITION: (PropositionArgumentRow, "proposition_id"),
    VALUE: (FunctionValueArgumentRow, "function_value_id"),
}


def _mentions(name: str) -> Select[Any]:
    """Select the ids of the atoms or fluents that name the object, in the order of an index."""
    mapped, id_ = _ATOMS[name]
    arguments = table_of(mapped).c
    ids = select(arguments[id_]).where(
        arguments.kb_id == KB, arguments.object_id == integer("object")
    )
    return ids.order_by(arguments[id_])


@cache
def _versions_of_object() -> Query:
    """Count the versions of what names the object, up to a bound."""
    counts = []
    for name in _ATOMS:
        columns = VERSION_COLUMNS[name]
        which = in_rows(columns.owner, first_rows(_mentions(name), literal_column(str(INVOLVED))))
        some: Select[Any] = select(literal_column("1")).where(columns.version.kb_id == KB, which)
        counts.append(first_rows(some, literal_column(str(INVOLVED))).subquery())
    numbers = [select(func.count()).select_from(one).scalar_subquery() for one in counts]
    return Query(select(numbers[0] + numbers[1]))


@cache
def _involving(is_recent: bool) -> Query:
    """Select the changes of what names the object, newest first."""
    parts = []
    for name, columns in VERSION_COLUMNS.items():
        version = columns.version
        table = version.kb_id.table
        if name in _ATOMS and is_recent:
            mapped, id_ = _ATOMS[name]
            argument = table_of(mapped)
            named: Select[Any] = select(literal_column("1")).where(
                argument.c.kb_id == KB,
                argument.c[id_] == columns.owner,
                argument.c.object_id == integer("object"),
            )
            which: Any = named.correlate(table).exists()
        elif name in _ATOMS:
            which = in_rows(
                columns.owner, first_rows(_mentions(name), literal_column(str(INVOLVED)))
            )
        elif name == "object":
            which = columns.owner == integer("object")
        else:
            continue
        for retracted, end in (("0", version.since), ("1", version.until)):
            # An expression has no index: what is found by ids is not looked for by revision.
            # Nor is it read in the order of that index.
            ends = end if is_recent else end + literal_column("0")
            within = ends.between(_LOW, _HIGH)
            parts.append(_change(columns, ends, retracted, _text(name), which, within))
    return _paged(parts, by_text=False)


class Involvement(NamedTuple):
    """A page of the changes of what names an object, the newest first.

    Attributes:
        changes: each with its revision.
        before: the revision before which the next page goes on; None after the last.
        searched: the first revision that was searched, if it is not the first of all.
    """

    changes: list[tuple[int, Change]]
    before: int | None
    searched: int | None


def read_involvement(
    session: Session, kb_id: int, object_id: int, high: int, limit: int
) -> Involvement:
    """Read a page of what involves an object, up to a revision, in two statements."""
    own = {"kb": kb_id, "object": object_id}
    row = session.first(_versions_of_object(), **own)
    is_recent = row is not None and row[0] >= INVOLVED
    low = max(1, high - WINDOW + 1) if is_recent else 1
    bounds = {"low": low, "high": high, "size": limit + 1, "offset": 0}
    rows = session.rows(_involving(is_recent), **own, **bounds)
    found = _page(rows, 0, limit).changes
    if len(rows) > limit:
        # A revision is shown as a whole; one that alone fills the page has a page of its own.
        last = rows[limit][0]
        whole = [one for one in found if one[0] > last]
        return Involvement(whole or found, last + 1 if whole else last, None)
    return Involvement(found, low if low > 1 else None, low if low > 1 else None)

"""What a revision changed, and what differs between two states: by pages.

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

from ..moment_text import When
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
from ..sql.intervals import ANY_FUNCTION, ANY_PREDICATE, forks_at, held_then
from ..sql.query import Query, first_rows, in_list, integer
from ..sql.rows import (
    KB,
    PROPOSITION,
    VALUE,
    VERSION_COLUMNS,
    VersionColumns,
    held_at,
    table_of,
)
from ..sql.tables import (
    ArchiveRow,
    HeadRow,
    PlanRow,
    PlanStepVersionRow,
    PromotionRow,
    PropositionRow,
    RevisionRow,
)
from ..store.snapshot import refuse_archived
from ..store.state import State
from .moments import states_at

# Up to this number changes are in the order of their texts, beyond it in that of their ids.
SORTED = 5_000
# Changes of a kind that a revision is counted and shown with.
COUNTED_CHANGES = 50_000
# States so many revisions apart are compared by what began and ended between them.
NARROW = 20_000
# Differences of a kind that are found; the rest is left out.
COMPARED = 20_000

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


def change_lines(
    columns: VersionColumns, revision: Any, retracted: str, text: Any, *which: Any
) -> Select[Any]:
    """Select changes as `paged` reads them."""
    return select(
        revision.label("revision"),
        literal_column(retracted).label("retracted"),
        columns.kind.label("kind"),
        columns.owner.label("owner"),
        text.label("text"),
    ).where(columns.version.kb_id == KB, *which)


def own_text(columns: VersionColumns) -> Any:
    """Return the text of a version's own row; NULL for a proposition, which has none."""
    return _NO_TEXT if columns is VERSION_COLUMNS[PROPOSITION] else columns.text


def _ends(within: Within) -> list[Select[Any]]:
    """Return the changes of revisions, without the texts of propositions."""
    parts = []
    for columns in VERSION_COLUMNS.values():
        for retracted, end in (("0", columns.version.since), ("1", columns.version.until)):
            parts.append(change_lines(columns, end, retracted, own_text(columns), within(end)))
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
        parts.append(change_lines(columns, end, retracted, table.text, within(end)))
    return parts


def paged(parts: list[Select[Any]], by_text: bool) -> Query:
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


def page_of(rows: list[Row], offset: int, limit: int) -> ChangesPage:
    """Make a page of rows, of which there is one more if another page follows."""
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
    return paged([select(first_rows(part, bound).subquery()) for part in parts], by_text)


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
    return page_of(rows, offset, limit)


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


def _held(name: str, version: Any, at: ColumnElement[int]) -> ColumnElement[bool]:
    return and_(_ANY[name], held_then(version, at)) if name in _ANY else held_at(version, at)


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
        held = _held(name, version, at)
        if is_narrow:
            held = held_at(version, at)
        elif side == "1":
            ends = version.until + literal_column("0") <= _AFTER
        else:
            ends = version.since + literal_column("0") > _BEFORE
        said = literal_column("''") if name == PROPOSITION else version.text
        differs = func.coalesce(_other(name, columns, other), literal_column("' '")) != said
        part = change_lines(
            columns, literal_column("0"), side, own_text(columns), ends, held, differs
        )
        parts.append(select(first_rows(part, literal_column(str(COMPARED))).subquery()))
    return paged(parts, by_text=False)


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
    reader: State, a: When, b: When, offset: int = 0, limit: int = 200
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
            pages.append(page_of(rows, offset, limit))
        return pages[0], pages[1]

    went, came = reader.store.query_in_snapshot(work)
    only_a, only_b = (went, came) if one == before else (came, went)
    last = head.revision if reader.at is None else reader.at
    ends = [offset + len(page.changes) for page in (only_a, only_b) if page.next is None]
    return Difference(one, other, last, only_a, only_b, any(end >= COMPARED for end in ends))


_ARCHIVED = Query(select(HeadRow.archived_revision).where(HeadRow.kb_id == KB))

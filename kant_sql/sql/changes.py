"""Revisions, and what they changed: one line for each element that was asserted or retracted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    Text,
    and_,
    bindparam,
    cast,
    desc,
    func,
    literal_column,
    or_,
    select,
    union_all,
)

from .. import html
from ..errors import StoreIntegrityError, unreadable
from .dialects.base import Row, Session
from .query import InRange, Query, first_rows, in_list
from .rows import KB, KIND_TABLES, PROPOSITION, VALUE, VERSION_COLUMNS, table_of
from .tables import (
    ArchiveRow,
    PlanRow,
    PlanStepVersionRow,
    PromotionRow,
    RevisionPlanStepRow,
    RevisionRow,
)

OWN_COLUMNS: tuple[Any, ...] = (
    RevisionRow.number,
    RevisionRow.committed_at,
    RevisionRow.actor,
    RevisionRow.reason,
    # As text: a driver decodes a JSON string, and the result is no longer JSON.
    cast(RevisionRow.source, Text),
    RevisionRow.hash,
    RevisionRow.observed_at,
)
STEP_COLUMNS: tuple[Any, ...] = RevisionPlanStepRow.plan_id, RevisionPlanStepRow.position
REVISIONS = (
    select(*OWN_COLUMNS, *STEP_COLUMNS)
    .outerjoin(
        RevisionPlanStepRow,
        and_(
            RevisionPlanStepRow.kb_id == RevisionRow.kb_id,
            RevisionPlanStepRow.number == RevisionRow.number,
        ),
    )
    .where(RevisionRow.kb_id == KB)
)

ASSERTED, RETRACTED = "+", "-"
PLAN, PLAN_STEP, ARCHIVE, PROMOTION = "plan", "plan step", "archive", "promotion"
# What is read at once, and sorted in memory.
FEW = 5_000
LOW: ColumnElement[int] = bindparam("low", type_=BigInteger)
HIGH: ColumnElement[int] = bindparam("high", type_=BigInteger)


class Change(NamedTuple):
    """A line of what a revision changed. They sort in the order of the hash.

    Attributes:
        sign: `+` asserted, `-` retracted.
        kind: one of `KINDS`, for a formula its section; `fact`, `goal` or `value`; `plan`,
            `plan step`, `archive` or `promotion`.
        text: the element's canonical PDDL text.
    """

    sign: str
    kind: str
    text: str

    def _html_row_(self) -> html.Row:
        return self._asdict()

    def _repr_html_(self) -> str:
        return html.fields(self._html_row_())


def in_range(column: Any) -> ColumnElement[bool]:
    """Return whether a column is a revision of the range from `low` to `high`."""
    return InRange(column, LOW, HIGH)


def _end(table: Any, column: Any, retracted: str, kind: Any, text: Any, within: Any) -> Select[Any]:
    return select(
        column.label("revision"),
        literal_column(retracted).label("retracted"),
        kind.label("kind"),
        text.label("text"),
    ).where(table.kb_id == KB, within(column))


def _both_ends(version: Any, kind: Any, text: Any, within: Any) -> list[Select[Any]]:
    return [
        _end(version, version.since, "0", kind, text, within),
        _end(version, version.until, "1", kind, text, within),
    ]


def _not_ended(version: Any, kind: Any, text: Any, within: Any) -> list[Select[Any]]:
    """Return what was asserted in the range, and retracted in no revision of it."""
    asserted = _end(version, version.since, "0", kind, text, within)
    return [asserted.where(or_(version.until.is_(None), version.until > HIGH))]


def _of_sources(names: Iterable[str], within: Any, ends: Any) -> list[Select[Any]]:
    sources = (VERSION_COLUMNS[name] for name in names)
    return [part for each in sources for part in ends(each.version, each.kind, each.text, within)]


def _others(within: Any, ends: Any = _both_ends) -> list[Select[Any]]:
    """Return the changes of all but definitions."""
    selects = _of_sources((VALUE, PROPOSITION), within, ends)
    step = table_of(PlanStepVersionRow).c
    selects += ends(step, literal_column(f"'{PLAN_STEP}'"), step.text, within)
    for mapped, kind in ((PlanRow, PLAN), (ArchiveRow, ARCHIVE), (PromotionRow, PROMOTION)):
        record = table_of(mapped).c
        name: ColumnElement[str] = literal_column(f"'{kind}'")
        selects.append(_end(record, record.since, "0", name, record.text, within))
    return selects


def _selects(within: Any, ends: Any = _both_ends) -> list[Select[Any]]:
    """Return the changes of the revisions for which `within(column)` is true."""
    return [*_of_sources(KIND_TABLES, within, ends), *_others(within, ends)]


def _among(column: Any) -> ColumnElement[bool]:
    return in_list(column, "numbers")


_ORDER = ("retracted", "kind", "text")
_CHANGES = Query(union_all(*_selects(in_range)).order_by("revision", *_ORDER))
_NEWEST_FIRST = Query(union_all(*_selects(in_range)).order_by(desc("revision"), *_ORDER))
_LEFT = Query(union_all(*_selects(in_range, _not_ended)).order_by("revision", *_ORDER))
# Unsorted: SQLite would merge its parts pair by pair, which takes longer than all else.
_SIZE: ColumnElement[int] = literal_column(str(FEW + 1))
_FEW = {
    redefined: Query(first_rows(union_all(*selects), _SIZE))
    for redefined, selects in ((True, _selects(in_range)), (False, _others(in_range)))
}
_KINDS = union_all(*_selects(in_range)).subquery("changed")
_COUNTED = Query(
    select(_KINDS.c.retracted, _KINDS.c.kind, func.count()).group_by(
        _KINDS.c.retracted, _KINDS.c.kind
    )
)
_OF_NUMBERS = Query(union_all(*_selects(_among)).order_by(desc("revision"), *_ORDER))


def stream_changes(
    session: Session, kb_id: int, low: int, high: int
) -> Iterator[tuple[int, Change]]:
    """Read what a range of revisions changed, in one statement and in constant memory."""
    return _lines(stream_change_rows(session, kb_id, low, high))


def stream_change_rows(session: Session, kb_id: int, low: int, high: int) -> Iterator[Row]:
    """Read what a range of revisions changed, as plain rows."""
    return session.stream(_CHANGES, kb=kb_id, low=low, high=high)


def stream_rows_left(session: Session, kb_id: int, upto: int) -> Iterator[Row]:
    """Read the changes of the first revisions that remain after an archive, as plain rows."""
    return session.stream(_LEFT, kb=kb_id, low=1, high=upto)


def stream_latest(
    session: Session, kb_id: int, low: int, high: int
) -> Iterator[tuple[int, Change]]:
    """Read what a range of revisions changed, the last revision first."""
    return _lines(session.stream(_NEWEST_FIRST, kb=kb_id, low=low, high=high))


def few_change_rows(
    session: Session, kb_id: int, low: int, high: int, redefined: bool
) -> list[Row] | None:
    """Read the changes of a range of revisions in one statement, as `stream_change_rows` does.

    None if there are too many.
    """
    rows = session.rows(_FEW[redefined], kb=kb_id, low=low, high=high)
    if len(rows) > FEW:
        return None
    try:
        rows.sort()
    except TypeError as error:
        said = ((row[2], row[3]) for row in rows)
        raise unsortable(said, f"revisions {low} to {high}", error) from error
    return rows


def few_changes(
    session: Session, kb_id: int, low: int, high: int, redefined: bool
) -> dict[int, tuple[Change, ...]] | None:
    """Read the changes of a range of revisions in one statement; None if there are too many."""
    rows = few_change_rows(session, kb_id, low, high, redefined)
    if rows is None:
        return None
    changes: dict[int, list[Change]] = {}
    last, of_last = 0, list[Change]()
    for number, retracted, kind, text in rows:
        if number != last:
            last, of_last = number, []
            changes[number] = of_last
        of_last.append(Change(RETRACTED if retracted else ASSERTED, kind, text))
    return {number: tuple(of_number) for number, of_number in changes.items()}


def unsortable(said: Iterable[tuple[Any, Any]], key: str, error: TypeError) -> StoreIntegrityError:
    """Return the error for changes one of which has no text or no kind."""
    wrong = sorted(
        {f"{kind}" for kind, text in said if not (isinstance(kind, str) and isinstance(text, str))}
    )
    return unreadable(f"of the versions of each {' or '.join(wrong)}", key, error)


def count_changes(session: Session, kb_id: int, low: int, high: int) -> list[tuple[str, str, int]]:
    """Count what a range of revisions changed, by kind and sign."""
    rows = session.rows(_COUNTED, kb=kb_id, low=low, high=high)
    signs = ASSERTED, RETRACTED
    return sorted((str(kind), signs[sign], count) for sign, kind, count in rows)


def stream_changes_of(
    session: Session, kb_id: int, numbers: list[int]
) -> Iterator[tuple[int, Change]]:
    """Read what some revisions changed, the last revision first."""
    return _lines(session.stream(_OF_NUMBERS, kb=kb_id, numbers=session.list_value(numbers)))


def _lines(rows: Iterator[Row]) -> Iterator[tuple[int, Change]]:
    signs = ASSERTED, RETRACTED
    return ((number, Change(signs[sign], kind, text)) for number, sign, kind, text in rows)

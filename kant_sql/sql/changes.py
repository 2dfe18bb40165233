"""Revisions and their changes: one line for each asserted or retracted element."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    FromClause,
    ScalarSelect,
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
from . import tables as t
from .dialects.base import Row, Session
from .executions import EXECUTION
from .places import Place, from_place
from .query import InRange, Query, constant, first_rows, in_list, integer
from .rows import KB, KIND_TABLES, PROPOSITION, VERSION_COLUMNS, VersionColumns, looked_up, table_of

OWN_COLUMNS: tuple[Any, ...] = (
    t.RevisionRow.number,
    t.RevisionRow.committed_at,
    t.RevisionRow.actor,
    t.RevisionRow.reason,
    # As text: a driver would decode a JSON string, and the result is not JSON.
    cast(t.RevisionRow.source, Text).label("source"),
    t.RevisionRow.hash,
    t.RevisionRow.observed_at,
)
STEP_COLUMNS: tuple[Any, ...] = t.RevisionExecutionRow.plan_id, t.RevisionExecutionRow.position
REVISIONS = (
    select(*OWN_COLUMNS, *STEP_COLUMNS)
    .outerjoin(
        t.RevisionExecutionRow,
        and_(
            t.RevisionExecutionRow.kb_id == t.RevisionRow.kb_id,
            t.RevisionExecutionRow.number == t.RevisionRow.number,
        ),
    )
    .where(t.RevisionRow.kb_id == KB)
)

_NO_TEXT: Any = literal_column("CAST(NULL AS text)")
ASSERTED, RETRACTED = SIGNS = "+", "-"
PLAN, ARCHIVE, PROMOTION, ERASURE = "plan", "archive", "promotion", "erasure"
CONFIRMATION, SAYING = "confirmation", "saying"
# Changes to read at once, and sort in memory.
FEW = 5_000
LOW: ColumnElement[int] = bindparam("low", type_=BigInteger)
HIGH: ColumnElement[int] = bindparam("high", type_=BigInteger)


def last_until(moment: ColumnElement[Any], *of: FromClause) -> ScalarSelect[Any]:
    """Select the last revision up to a time: a parameter, or a column of a table."""
    # Times never go back, and only their index is fast in a long history. PostgreSQL 15 would sort
    # all earlier revisions to find the largest number at one time.
    earlier = table_of(t.RevisionRow).alias().c
    times = (
        select(earlier.committed_at)
        .where(earlier.kb_id == KB, earlier.committed_at <= moment)
        .order_by(earlier.committed_at.desc())
    )
    time = first_rows(times, 1).correlate(*of).scalar_subquery()
    # Unlike `number`, a sum does not use the index of numbers.
    largest = func.max(t.RevisionRow.number + constant(0))
    rows = t.RevisionRow.kb_id == KB, t.RevisionRow.committed_at == time
    return select(largest).where(*rows).correlate(*of).scalar_subquery()


class Change(NamedTuple):
    """A change of a revision. Changes sort in the order of the hash.

    Attributes:
        sign: `+` asserted, `-` retracted.
        kind: one of `KINDS`, for a formula its section; `fact`, `goal` or `value`; `saying`;
            `plan`, `execution`, `plan step`, `confirmation`, `archive`, `promotion` or `erasure`.
        text: the element's canonical PDDL text; for a confirmation, that of the fact.
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


class ChangeEnd(NamedTuple):
    """The beginnings, or ends (`retracted` is 1), of versions: changes of a revision."""

    source: VersionColumns
    revision: Any
    retracted: int

    def line(self, *conditions: Any, joined: bool = False) -> Select[Any]:
        """Select the changes that fulfil all conditions; `joined` for a whole history."""
        if not joined or not self._is_atom:
            return self._line(self.revision, self.source.text, *conditions)
        # PostgreSQL takes six times as long to look texts up one by one.
        atom = table_of(t.PropositionRow)
        own = and_(atom.c.kb_id == KB, atom.c.id == self.source.owner)
        line = self._line(self.revision, atom.c.text, *conditions)
        return line.select_from(self.source.owner.table.outerjoin(atom, own))

    def short_line(self, revision: Any, *conditions: Any) -> Select[Any]:
        """Select them for `paged`: propositions without texts, all with ids."""
        text = _NO_TEXT if self._is_atom else self.source.text
        line = self._line(revision, text, *conditions)
        return line.add_columns(self.source.owner.label("owner"))

    def keyed_line(self, *conditions: Any, joined: bool = False) -> Select[Any]:
        """Select them with the ids that rows of `commitment` use."""
        # An outcome belongs to a plan's step, or to an execution without a plan.
        place = self.source.version.position if self.source is EXECUTIONS else constant(0)
        owner = self.source.owner.label("owner")
        return self.line(*conditions, joined=joined).add_columns(owner, place.label("place"))

    @property
    def is_archived(self) -> bool:
        """Whether ended versions move to an archive."""
        # Outcomes stay: an act began with its first one.
        return "until" in self.source.version and self.source is not EXECUTIONS

    @property
    def _is_atom(self) -> bool:
        return self.source is VERSION_COLUMNS[PROPOSITION]

    def _line(self, revision: Any, text: Any, *conditions: Any) -> Select[Any]:
        return select(
            revision.label("revision"),
            constant(self.retracted).label("retracted"),
            self.source.kind.label("kind"),
            text.label("text"),
        ).where(self.source.version.kb_id == KB, *conditions)


def _record(mapped: Any, kind: str) -> VersionColumns:
    table = table_of(mapped).c
    return VersionColumns(None, table, table.id, constant(kind), table.text)


def _confirmations() -> VersionColumns:
    table, atom = table_of(t.ConfirmationRow).c, table_of(t.PropositionRow).c
    text = looked_up(atom.text, atom.id, table.proposition_id)
    return VersionColumns(None, table, table.proposition_id, constant(CONFIRMATION), text)


# Changes by kind: elements, executions, and records, which are never retracted.
_RECORDS = {
    kind: _record(mapped, kind)
    for mapped, kind in (
        (t.PlanRow, PLAN),
        (t.ArchiveRow, ARCHIVE),
        (t.PromotionRow, PROMOTION),
        (t.ErasureRow, ERASURE),
    )
}
_OUTCOME = table_of(t.ExecutionVersionRow).c
EXECUTIONS = VersionColumns(None, _OUTCOME, _OUTCOME.plan_id, _OUTCOME.kind, _OUTCOME.text)
CONFIRMATIONS = _confirmations()
SAYINGS = [
    VersionColumns(None, table.c, table.c[owner], constant(SAYING), table.c.text)
    for table, owner in (
        (table_of(t.PropositionSayingRow), "proposition_id"),
        (table_of(t.FunctionValueSayingRow), "function_value_id"),
    )
]
_SOURCES = {
    **VERSION_COLUMNS,
    EXECUTION: EXECUTIONS,
    CONFIRMATION: CONFIRMATIONS,
    **{f"{SAYING} {n}": source for n, source in enumerate(SAYINGS)},
    **_RECORDS,
}


def ends_of(source: VersionColumns) -> list[ChangeEnd]:
    """Return the beginning and the end of versions."""
    names = ("since", "until") if "until" in source.version else ("since",)
    return [ChangeEnd(source, source.version[name], n) for n, name in enumerate(names)]


def _ends_without(*kinds: str) -> list[ChangeEnd]:
    """Return the ends of versions of all kinds but some."""
    sources = (source for kind, source in _SOURCES.items() if kind not in kinds)
    return [end for source in sources for end in ends_of(source)]


_ENDS = _ends_without()
# Of all but definitions.
_OTHER_ENDS = _ends_without(*KIND_TABLES)
# The kinds to search for a text; archives and promotions name folders of the server.
SEARCHED_ENDS = _ends_without(ARCHIVE, PROMOTION)


def _lines(within: Any, ends: Iterable[ChangeEnd] = _ENDS) -> list[Select[Any]]:
    """Return the changes of the revisions for which `within(column)` is true."""
    return [end.line(within(end.revision)) for end in ends]


def _held(end: ChangeEnd, left: bool) -> tuple[ColumnElement[bool], ...]:
    """Return the condition of the changes of a range, or of those that an archive leaves."""
    until = end.source.version.until if left and end.is_archived else None
    rest = () if until is None else (or_(until.is_(None), until > HIGH),)
    return in_range(end.revision), *rest


@cache
def _streamed(left: bool, keyed: bool, joined: bool) -> Query:
    """Build the statement of all changes of a range, or of those that an archive leaves."""
    line = ChangeEnd.keyed_line if keyed else ChangeEnd.line
    ends = [end for end in _ENDS if not (left and end.retracted and end.is_archived)]
    lines = (line(end, *_held(end, left), joined=joined) for end in ends)
    # Sorted at once: SQLite would merge the parts of a union pair by pair if the order were plain
    # columns; a sum is not.
    changed = union_all(*lines).subquery("changed").c
    order = (changed.revision + constant(0), *(changed[name] for name in _ORDER))
    return Query(select(*changed).order_by(*order))


def _among(column: Any) -> ColumnElement[bool]:
    return in_list(column, "numbers")


_ORDER = ("retracted", "kind", "text")
# Unsorted: SQLite would merge the parts pair by pair, which takes longer than all the rest.
_FEW = {
    redefined: Query(first_rows(union_all(*_lines(in_range, ends)), FEW + 1))
    for redefined, ends in ((True, _ENDS), (False, _OTHER_ENDS))
}
_KINDS = union_all(*_lines(in_range)).subquery("changed")
_COUNTED = Query(
    select(_KINDS.c.retracted, _KINDS.c.kind, func.count()).group_by(
        _KINDS.c.retracted, _KINDS.c.kind
    )
)
_OF_NUMBERS = Query(union_all(*_lines(_among)).order_by(desc("revision"), *_ORDER))


def stream_changes(
    session: Session, kb_id: int, low: int, high: int
) -> Iterator[tuple[int, Change]]:
    """Read the changes of a range of revisions, in one statement and in constant memory."""
    return _made(stream_change_rows(session, kb_id, low, high))


def stream_change_rows(
    session: Session, kb_id: int, low: int, high: int, left: bool = False, keyed: bool = False
) -> Iterator[Row]:
    """Read the changes of a range of revisions, as plain rows.

    Args:
        left: only changes that remain after an archive of these revisions.
        keyed: with the ids that rows of `commitment` use.
    """
    return session.stream(_streamed(left, keyed, low < 1), kb=kb_id, low=low, high=high)


_KEYED_OF = Query(
    lambda: union_all(*(end.keyed_line(_among(end.revision)) for end in _ENDS)).order_by("revision")
)


def keyed_changes_of(session: Session, kb_id: int, numbers: Sequence[int]) -> list[Row]:
    """Read the changes of some revisions, with the ids that rows of `commitment` use."""
    return session.rows(_KEYED_OF, kb=kb_id, numbers=session.list_value([*numbers]))


def lines_by_revision(rows: Iterable[Row]) -> defaultdict[int, list[Row]]:
    """Group keyed changes by revision: each with its sign, and without the number."""
    lines: defaultdict[int, list[Row]] = defaultdict(list)
    for number, sign, *line in rows:
        lines[number].append((SIGNS[sign], *line))
    return lines


def few_change_rows(
    session: Session, kb_id: int, low: int, high: int, redefined: bool
) -> list[Row] | None:
    """Read the changes of a range of revisions in one statement, like `stream_change_rows`.

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
        of_last.append(Change(SIGNS[retracted], kind, text))
    return {number: tuple(of_number) for number, of_number in changes.items()}


def unsortable(said: Iterable[tuple[Any, Any]], key: str, error: TypeError) -> StoreIntegrityError:
    """Return the error for a change without text or kind."""
    wrong = sorted(
        {f"{kind}" for kind, text in said if not (isinstance(kind, str) and isinstance(text, str))}
    )
    return unreadable(f"of the versions of each {' or '.join(wrong)}", key, error)


def count_changes(session: Session, kb_id: int, low: int, high: int) -> list[tuple[str, str, int]]:
    """Count the changes of a range of revisions, by kind and sign."""
    rows = session.rows(_COUNTED, kb=kb_id, low=low, high=high)
    return sorted((str(kind), SIGNS[sign], count) for sign, kind, count in rows)


def stream_changes_of(
    session: Session, kb_id: int, numbers: list[int]
) -> Iterator[tuple[int, Change]]:
    """Read the changes of some revisions, the last revision first."""
    return _made(session.stream(_OF_NUMBERS, kb=kb_id, numbers=session.list_value(numbers)))


def _made(rows: Iterable[Row]) -> Iterator[tuple[int, Change]]:
    return ((number, Change(SIGNS[sign], kind, text)) for number, sign, kind, text in rows)


# Find a page by ids, and read only its own texts: a revision may change a hundred thousand facts,
# and two states may differ in as many.

# Up to this number, changes are in the order of their texts; beyond it, of their ids.
SORTED = 5_000
# The maximum number of counted and shown changes of a kind.
COUNTED_CHANGES = 50_000


# The types of positions: sign, kind, and an id or a text.
BY_OWNER, BY_TEXT = (int, str, int), (int, str, str)


class ChangesPage(NamedTuple):
    """A page of changes, each with its revision, and the position of the next page."""

    changes: list[tuple[int, Change]]
    next: Place | None


def paged(parts: Iterable[Select[Any]], key: Sequence[type] = (), by_text: bool = False) -> Query:
    """Cut a page out of short lines, newest first, and add the missing texts.

    Args:
        key: the types of the page's position, for lines of one revision.
        by_text: lines are in the order of their texts, so all texts are read.
    """
    some, atom = union_all(*parts).subquery("some").c, table_of(t.PropositionRow)

    def text_of(row: Any) -> ColumnElement[Any]:
        own = select(atom.c.text).where(atom.c.kb_id == KB, atom.c.id == row.owner)
        return func.coalesce(row.text, own.correlate_except(atom).scalar_subquery()).label("text")

    def cut(lines: Any, last: Any) -> Select[Any]:
        rows, order = select(*lines), (lines.retracted, lines.kind, last)
        if key:
            rows = rows.where(from_place(order, key))
        # Steps of a plan share an owner, and so do executions without a plan.
        rows = rows.order_by(lines.revision.desc(), *order, lines.text)
        return rows.limit(integer("size")).offset(integer("skip"))

    if by_text:
        read = select(some.revision, some.retracted, some.kind, text_of(some), some.owner)
        lines = read.subquery("lines").c
        return Query(cut(lines, lines.text))
    of_page = cut(some, some.owner).subquery("page").c
    own = of_page.revision, of_page.retracted, of_page.kind, text_of(of_page), of_page.owner
    order = of_page.retracted, of_page.kind, of_page.owner, of_page.text
    return Query(select(*own).order_by(of_page.revision.desc(), *order))


def newest_of(session: Session, query: Query, limit: int, **own: Any) -> list[tuple[int, Change]]:
    """Read the first changes, in one statement."""
    return [*_made(row[:4] for row in session.rows(query, size=limit, skip=0, **own))]


def page_of(
    session: Session, query: Query, place: Place, limit: int, by_text: bool = False, **own: Any
) -> ChangesPage:
    """Read a page of changes of one revision, in one statement."""
    rows = session.rows(query, size=limit + 1, **place.of(), **own)
    page = rows[:limit]
    keys = [(row[1], row[2], row[3 if by_text else 4]) for row in page]
    return ChangesPage(
        [*_made(row[:4] for row in page)], place.behind(keys) if len(rows) > limit else None
    )


def _counts() -> Select[Any]:
    """Count the changes of each revision: of a kind, up to a bound."""
    revision = table_of(t.RevisionRow)
    numbers: list[Any] = []
    for end in _ENDS:
        line = end.line(end.revision == revision.c.number)
        some = first_rows(line.with_only_columns(constant(1)).correlate(revision), COUNTED_CHANGES)
        numbers.append(select(func.count()).select_from(some.subquery()).scalar_subquery())
    total = sum(numbers[1:], start=numbers[0])
    rows = select(revision.c.number, total).where(revision.c.kb_id == KB)
    return rows.where(_among(revision.c.number))


_COUNTS = Query(_counts)


def count_each(session: Session, kb_id: int, numbers: Iterable[int]) -> dict[int, int]:
    """Count the changes of some revisions, up to `COUNTED_CHANGES` and perhaps more."""
    return dict(session.rows(_COUNTS, kb=kb_id, numbers=session.list_value([*numbers])))


@cache
def _of_revision(key: tuple[type, ...], by_text: bool) -> Query:
    parts = (end.short_line(end.revision, end.revision == integer("number")) for end in _ENDS)
    bounded = (select(first_rows(part, COUNTED_CHANGES).subquery()) for part in parts)
    return paged(bounded, key, by_text)


def read_changes_page(
    session: Session, kb_id: int, number: int, total: int, place: Place, limit: int
) -> ChangesPage:
    """Read a page of the changes of a large revision, in one statement."""
    by_text = place.types == BY_TEXT if place.key else total <= SORTED
    query = _of_revision(place.types, by_text)
    return page_of(session, query, place, limit, by_text, kb=kb_id, number=number)

"""The audit's views: their columns and types, and their rows, also as Arrow, batch by batch.

`docs/audit.md` describes what they mean. On SQLite, a time is a text and a truth is 0 or 1.
pyarrow, of the extra `data`, is imported on first use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from enum import Enum
from functools import cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from sqlalchemy import BigInteger, bindparam, column, select, table, text

from ..arguments import expect, shown
from ..errors import ExtraMissingError, InvalidArgumentError, printable, reading_rows
from .dialects.base import Row, Session
from .query import Query
from .rows import KB

if TYPE_CHECKING:
    import pyarrow

PREFIX = "audit_"


class ColumnType(Enum):
    """What the values of a column are; any may be NULL."""

    TEXT = "text"
    INTEGER = "integer"
    DOUBLE = "double"
    BOOLEAN = "boolean"
    TIME = "time"


class AuditView(NamedTuple):
    """A view for auditors.

    Attributes:
        columns: its columns in their order, with their types.
        order: the columns that sort its rows; no two rows have the same values in all of them.
        window: the condition that a row is of the revisions from `:low` to `:high`; None where
            rows are of no revision.
    """

    name: str
    columns: Mapping[str, ColumnType]
    order: tuple[str, ...]
    window: str | None


_TEXT, _INTEGER, _DOUBLE = ColumnType.TEXT, ColumnType.INTEGER, ColumnType.DOUBLE
_BOOLEAN, _TIME = ColumnType.BOOLEAN, ColumnType.TIME

_KNOWLEDGE_BASE = {"knowledge_base": _TEXT}
# Last: one shard has all rows of a knowledge base, which its name does not find.
_KB_ID = {"kb_id": _INTEGER}
_REVISION = {
    "committed_at": _TIME,
    "committed_epoch": _DOUBLE,
    "committed_hour": _TEXT,
    "observed_at": _TIME,
    "observed_epoch": _DOUBLE,
    "delay": _DOUBLE,
    "actor": _TEXT,
    "reason": _TEXT,
    "source": _TEXT,
    "plan_id": _INTEGER,
    "plan_step": _INTEGER,
}
_BEGINNING = {
    "since": _INTEGER,
    "since_at": _TIME,
    "since_epoch": _DOUBLE,
    "since_observed_at": _TIME,
    "asserted_by": _TEXT,
    "asserted_reason": _TEXT,
}
_INTERVAL = {
    **_BEGINNING,
    "until": _INTEGER,
    "until_at": _TIME,
    "until_epoch": _DOUBLE,
    "until_observed_at": _TIME,
    "retracted_by": _TEXT,
    "retracted_reason": _TEXT,
    "duration": _DOUBLE,
}
_FACT = {"kind": _TEXT, "proposition_id": _INTEGER, "predicate": _TEXT}
_ARGUMENT = {"position": _INTEGER, "parameter": _TEXT, "object": _TEXT, "object_id": _INTEGER}
_VALUE = {"function_value_id": _INTEGER, "function": _TEXT}
_ACTION = {"action": _TEXT, "action_id": _INTEGER, "kind": _TEXT}
_STEP = {"plan_id": _INTEGER, "position": _INTEGER}

# An interval is in a window in which it began, held or ended.
_HELD = "since <= :high AND COALESCE(until >= :low, TRUE)"
_BEGAN = "since BETWEEN :low AND :high"
_PLANNED = (
    "plan_id IN (SELECT p.plan_id FROM audit_plan AS p WHERE p.kb_id = :kb"
    " AND p.since BETWEEN :low AND :high)"
)


def _view(
    name: str, order: str, window: str | None, *columns: Mapping[str, ColumnType]
) -> AuditView:
    parts = (_KNOWLEDGE_BASE, *columns, _KB_ID)
    together = {key: type_ for part in parts for key, type_ in part.items()}
    return AuditView(f"{PREFIX}{name}", together, tuple(order.split()), window)


# What was true of a time, and as it was known.
_VALID = {
    **{
        f"valid_{end}{unit}": type_
        for end in ("from", "until")
        for unit, type_ in (("", _TIME), ("_epoch", _DOUBLE))
    },
    "known_since": _INTEGER,
    "known_since_at": _TIME,
    "known_since_epoch": _DOUBLE,
    "known_by": _TEXT,
    "known_reason": _TEXT,
    "known_until": _INTEGER,
    "known_until_at": _TIME,
    "known_until_epoch": _DOUBLE,
    "corrected_by": _TEXT,
    "corrected_reason": _TEXT,
}
_KNOWN = "known_since <= :high AND COALESCE(known_until >= :low, TRUE)"
_FACTS = {**_FACT, "arguments": _TEXT, "text": _TEXT}, _INTERVAL
AUDIT_VIEWS = {
    view.name: view
    for view in (
        _view(
            "knowledge_base",
            "revision",
            None,
            {"revision": _INTEGER, "committed_at": _TIME, "committed_epoch": _DOUBLE},
            {"origin": _TEXT, "verified_revision": _INTEGER, "verified_at": _TIME},
        ),
        _view(
            "revision",
            "revision",
            "revision BETWEEN :low AND :high",
            {"revision": _INTEGER, **_REVISION, "form": _INTEGER, "hash": _TEXT},
        ),
        _view(
            "change",
            "revision sign kind text element_id",
            "revision BETWEEN :low AND :high",
            {"revision": _INTEGER, "sign": _TEXT, "kind": _TEXT, "text": _TEXT},
            {"element_id": _INTEGER, **_REVISION},
        ),
        _view("fact", "since kind proposition_id", _HELD, *_FACTS),
        _view("goal", "since proposition_id", _HELD, *_FACTS),
        _view(
            "fact_argument",
            "since kind proposition_id position",
            _HELD,
            {**_FACT, "text": _TEXT, **_ARGUMENT},
            _INTERVAL,
        ),
        _view(
            "value",
            "since function_value_id",
            _HELD,
            {**_VALUE, "arguments": _TEXT, "fluent": _TEXT, "value": _TEXT, "number": _DOUBLE},
            {"text": _TEXT, **_INTERVAL},
        ),
        _view(
            "fact_valid",
            "known_since proposition_id valid_from",
            _KNOWN,
            {"proposition_id": _INTEGER, "predicate": _TEXT, "arguments": _TEXT, "text": _TEXT},
            _VALID,
        ),
        _view(
            "value_valid",
            "known_since function_value_id valid_from",
            _KNOWN,
            {**_VALUE, "arguments": _TEXT, "fluent": _TEXT, "value": _TEXT, "number": _DOUBLE},
            _VALID,
        ),
        _view(
            "value_argument",
            "since function_value_id position",
            _HELD,
            {**_VALUE, "text": _TEXT, **_ARGUMENT},
            _INTERVAL,
        ),
        _view(
            "object",
            "since object_id",
            _HELD,
            {"object": _TEXT, "object_id": _INTEGER, "type": _TEXT, "is_constant": _BOOLEAN},
            {"text": _TEXT, **_INTERVAL},
        ),
        _view(
            "definition",
            "since kind element_id",
            _HELD,
            {"kind": _TEXT, "name": _TEXT, "element_id": _INTEGER, "text": _TEXT},
            _INTERVAL,
        ),
        _view("action", "since action_id", _HELD, {**_ACTION, "text": _TEXT}, _INTERVAL),
        _view(
            "action_literal",
            "since action_id section position",
            _HELD,
            {**_ACTION, "section": _TEXT, "position": _INTEGER, "role": _TEXT},
            {"predicate": _TEXT, "literal": _TEXT, "time": _TEXT, "is_conditional": _BOOLEAN},
            _INTERVAL,
        ),
        _view(
            "plan",
            "plan_id",
            _BEGAN,
            {"plan_id": _INTEGER, "revision": _INTEGER, "revision_at": _TIME},
            {"revision_epoch": _DOUBLE, "problem_hash": _TEXT, "planner": _TEXT},
            {"planner_version": _TEXT, "objective": _TEXT, "value": _TEXT, "number": _DOUBLE},
            {"status": _TEXT, "steps": _INTEGER, "steps_running": _INTEGER},
            {"steps_succeeded": _INTEGER, "steps_failed": _INTEGER, "steps_aborted": _INTEGER},
            {**_BEGINNING, "text": _TEXT, "domain_pddl": _TEXT, "problem_pddl": _TEXT},
        ),
        _view(
            "plan_step",
            "plan_id position",
            _PLANNED,
            {**_STEP, "action": _TEXT, "arguments": _TEXT, "text": _TEXT},
            {"planned_start": _DOUBLE, "planned_duration": _DOUBLE, "status": _TEXT},
            {"started": _INTEGER, "started_at": _TIME, "started_epoch": _DOUBLE},
            {"started_by": _TEXT, "ended": _INTEGER, "ended_at": _TIME, "ended_epoch": _DOUBLE},
            {"ended_by": _TEXT, "ended_reason": _TEXT, "duration": _DOUBLE},
            {"revisions": _INTEGER},
        ),
        _view(
            "plan_step_status",
            "since plan_id position",
            _HELD,
            {**_STEP, "status": _TEXT, "text": _TEXT},
            _INTERVAL,
        ),
        _view(
            "plan_step_argument",
            "plan_id position argument",
            _PLANNED,
            {**_STEP, "text": _TEXT, "argument": _INTEGER, "object": _TEXT},
            {"object_id": _INTEGER},
        ),
        _view(
            "execution",
            "plan_id position",
            "started <= :high AND COALESCE(ended >= :low, TRUE)",
            {"execution": _TEXT, **_STEP, "action": _TEXT, "arguments": _TEXT, "text": _TEXT},
            {"outcome": _TEXT, "code": _TEXT, "message": _TEXT},
            {"started": _INTEGER, "started_at": _TIME, "started_epoch": _DOUBLE},
            {"started_by": _TEXT, "started_reason": _TEXT, "started_source": _TEXT},
            {"ended": _INTEGER, "ended_at": _TIME, "ended_epoch": _DOUBLE},
            {"ended_by": _TEXT, "ended_reason": _TEXT, "duration": _DOUBLE},
            {"planned_duration": _DOUBLE},
        ),
        _view(
            "statistics",
            "action arguments",
            None,
            {"action": _TEXT, "arguments": _TEXT, "executions": _INTEGER, "running": _INTEGER},
            {"succeeded": _INTEGER, "failed": _INTEGER, "aborted": _INTEGER, "refused": _INTEGER},
            {"success_rate": _DOUBLE, "success_low": _DOUBLE, "success_high": _DOUBLE},
            {"mean": _DOUBLE, "median": _DOUBLE, "percentile_95": _DOUBLE, "codes": _TEXT},
            # It was added to the view later.
            {**_KB_ID, "unconfirmed": _INTEGER},
        ),
        _view(
            "effect",
            "since execution proposition_id",
            _HELD,
            {"execution": _TEXT, **_STEP, "proposition_id": _INTEGER, "text": _TEXT},
            {"since": _INTEGER, "since_at": _TIME, "since_epoch": _DOUBLE, "asserted_by": _TEXT},
            {"until": _INTEGER, "until_at": _TIME, "until_epoch": _DOUBLE, "retracted_by": _TEXT},
            {"confirmed": _INTEGER, "confirmed_at": _TIME, "confirmed_epoch": _DOUBLE},
            {"confirmed_by": _TEXT},
        ),
        _view(
            "confirmation",
            "revision proposition_id",
            "revision BETWEEN :low AND :high",
            {"revision": _INTEGER, "text": _TEXT, "proposition_id": _INTEGER, **_REVISION},
        ),
        _view(
            "archive",
            "archive_id",
            None,
            {"archive_id": _INTEGER, "revision": _INTEGER, "revision_at": _TIME},
            {"revision_epoch": _DOUBLE, "target": _TEXT, "versions": _INTEGER, "rest": _TEXT},
            {**_BEGINNING, "text": _TEXT},
        ),
        _view(
            "promotion",
            "promotion_id",
            None,
            {"promotion_id": _INTEGER, "revision": _INTEGER, "revision_at": _TIME},
            {"revision_epoch": _DOUBLE, "origin": _TEXT, **_BEGINNING, "text": _TEXT},
        ),
    )
}

BOUNDS = [bindparam(bound, type_=BigInteger) for bound in ("low", "high")]


def find_audit_view(name: object) -> AuditView:
    """Find a view by its name, with or without its prefix."""
    given: str = expect(name, str, "the view", InvalidArgumentError)
    found = AUDIT_VIEWS.get(given) or AUDIT_VIEWS.get(f"{PREFIX}{given}")
    if found is not None:
        return found
    names = [known.removeprefix(PREFIX) for known in AUDIT_VIEWS]
    raise InvalidArgumentError(
        f"there is no view {shown(printable(given))} for auditors; choose one of: "
        f"{', '.join(names)}"
    )


@cache
def rows_of_view(name: str, windowed: bool = False) -> Query:
    """Read the rows of a view that are of one knowledge base."""
    return _rows_of(AUDIT_VIEWS[name], table(name), windowed)


def stream_rows(
    session: Session, view: AuditView, kb_id: int, bounds: tuple[int, int] | None = None
) -> Iterator[Row]:
    """Read the rows of a view that are of one knowledge base, and of some revisions if bounded."""
    given: dict[str, Any] = {"kb": kb_id}
    windowed = bounds is not None and view.window is not None
    if bounds is not None and windowed:
        given |= {"low": bounds[0], "high": bounds[1]}
    source = session.query_of_view(view.name, kb_id)
    if source is None:
        query = rows_of_view(view.name, windowed)
    else:
        # A colon begins the name of a parameter.
        rows = text(f"({source}) AS shown".replace(":", r"\:"))
        query = _rows_of(view, rows, windowed)
    session.plan_for_all()
    return session.stream(query, **given)


def _rows_of(view: AuditView, source: Any, windowed: bool) -> Query:
    columns: list[Any] = [column(each) for each in view.columns]
    rows = select(*columns).select_from(source).where(column("kb_id") == KB)
    if windowed and view.window is not None:
        rows = rows.where(text(f"({view.window})").bindparams(*BOUNDS))
    # Databases differ in where NULL is sorted; numbers are never NULL here, and use an index.
    order: list[Any] = [*map(column, view.order)]
    sorted_by = [one.nulls_first() if view.columns[one.name] is _TEXT else one for one in order]
    return Query(rows.order_by(*sorted_by))


def _last_revision(comparison: str) -> Query:
    """Find the last revision up to a time, by the index of times."""
    sql = (
        "SELECT max(revision) FROM audit_revision"
        f" WHERE kb_id = :kb AND committed_at {comparison} :moment"
    )
    return Query(text(sql))


_BEFORE, _UP_TO = _last_revision("<"), _last_revision("<=")


def last_revision_before(
    session: Session, kb_id: int, moment: datetime, *, inclusive: bool = False
) -> int:
    """Return the last revision of a knowledge base before a time, or up to it; 0 without one."""
    query = _UP_TO if inclusive else _BEFORE
    row = session.first(query, kb=kb_id, moment=session.from_time(moment.astimezone(UTC)))
    return 0 if row is None or row[0] is None else int(row[0])


# A batch ends with the first of these: so many rows, or characters.
BATCH_ROWS = 16_384
BATCH_CHARACTERS = 16_000_000


def import_arrow() -> Any:
    """Import pyarrow, or say how to install it."""
    try:
        import pyarrow
    except ImportError:
        raise ExtraMissingError(
            "this needs pyarrow, which is not installed; run: pip install 'kant-sql[data]'"
        ) from None
    return pyarrow


def arrow_schema(view: AuditView) -> pyarrow.Schema:
    """Return the columns of a view with their Arrow types."""
    arrow = import_arrow()
    types = {
        ColumnType.TEXT: arrow.string(),
        ColumnType.INTEGER: arrow.int64(),
        ColumnType.DOUBLE: arrow.float64(),
        ColumnType.BOOLEAN: arrow.bool_(),
        ColumnType.TIME: arrow.timestamp("us", "UTC"),
    }
    return arrow.schema([(name, types[type_]) for name, type_ in view.columns.items()])


def stream_view(
    session: Session, view: AuditView, kb_id: int, bounds: tuple[int, int] | None = None
) -> Iterator[pyarrow.RecordBatch]:
    """Read the rows of a view that are of one knowledge base, and of some revisions if bounded."""
    schema = arrow_schema(view)
    batches = _batched(stream_rows(session, view, kb_id, bounds), _texts_of(view))
    while True:
        with reading_rows(view.name, f"knowledge base {kb_id}"):
            batch = next(batches, None)
            made = None if batch is None else _record_batch(schema, view, batch)
        if made is None:
            return
        yield made


def _texts_of(view: AuditView) -> Callable[[Row], Iterable[str | None]]:
    """Return what gives the texts of a row: they alone can be long."""
    types = enumerate(view.columns.values())
    return itemgetter(*(number for number, type_ in types if type_ is ColumnType.TEXT))


def read_view(session: Session, view: AuditView, kb_id: int) -> pyarrow.Table:
    """Read all rows of a view that are of one knowledge base."""
    batches = [*stream_view(session, view, kb_id)]
    return import_arrow().Table.from_batches(batches, arrow_schema(view))


def text_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> pyarrow.Table:
    """Make a table of texts; without columns it still has its number of rows."""
    arrow = import_arrow()
    # Two variables may have one name but for their case, and no column at all has no length.
    arrays = [arrow.nulls(len(rows))]
    arrays += [
        arrow.array([row[number] for row in rows], arrow.string()) for number in range(len(columns))
    ]
    table = arrow.Table.from_arrays(arrays, ["", *columns])
    return table.select([*range(1, len(arrays))])


def _batched(
    rows: Iterator[Row], texts_of: Callable[[Row], Iterable[str | None]]
) -> Iterator[list[Row]]:
    batch: list[Row] = []
    size = 0
    for row in rows:
        batch.append(row)
        size += sum(map(len, filter(None, texts_of(row))))
        if len(batch) == BATCH_ROWS or size > BATCH_CHARACTERS:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


def _record_batch(schema: Any, view: AuditView, rows: Sequence[Row]) -> pyarrow.RecordBatch:
    columns = zip(*rows, strict=True)
    arrays = [
        _ARRAYS[type_](values, field.type)
        for values, type_, field in zip(columns, view.columns.values(), schema, strict=True)
    ]
    return import_arrow().RecordBatch.from_arrays(arrays, schema=schema)


def _array(values: Sequence[Any], type_: Any) -> Any:
    return import_arrow().array(values, type_)


def _truths(values: Sequence[Any], type_: Any) -> Any:
    """Convert what SQLite has as 0 and 1, too."""
    return _array([None if value is None else bool(value) for value in values], type_)


def _times(values: Sequence[Any], type_: Any) -> Any:
    """Convert what SQLite has as text, too."""
    if any(isinstance(value, str) for value in values):
        return _array(values, import_arrow().string()).cast(type_)
    return _array(values, type_)


_ARRAYS: dict[ColumnType, Callable[[Sequence[Any], Any], Any]] = {
    ColumnType.TEXT: _array,
    ColumnType.INTEGER: _array,
    ColumnType.DOUBLE: _array,
    ColumnType.BOOLEAN: _truths,
    ColumnType.TIME: _times,
}

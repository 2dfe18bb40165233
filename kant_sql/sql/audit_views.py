"""The audit's views: their columns and types, and their rows, also as Arrow, batch by batch.

`docs/audit.md` describes what they mean. On SQLite, a time is a text and a truth is 0 or 1.
pyarrow, of the extra `data`, is imported on first use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from sqlalchemy import BigInteger, bindparam, column, select, table, text

from ..arguments import expect, shown
from ..errors import InvalidArgumentError, needing, printable, reading_rows
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


# A column has one type in all views: by its name, by the last word of that, or text.
_NAMED = {
    ColumnType.TIME: "valid_from valid_until",
    ColumnType.BOOLEAN: "is_constant is_conditional",
    ColumnType.INTEGER: (
        "revision form plan_step position argument since until known_since known_until started "
        "ended confirmed verified_revision executions running succeeded failed aborted refused "
        "steps steps_running steps_succeeded steps_failed steps_aborted revisions versions "
        "unconfirmed parts"
    ),
    ColumnType.DOUBLE: (
        "delay duration number planned_start planned_duration success_rate success_low "
        "success_high mean median percentile_95"
    ),
}
_TYPES = {name: type_ for type_, names in _NAMED.items() for name in names.split()}
_LAST_WORDS = {"at": ColumnType.TIME, "epoch": ColumnType.DOUBLE, "id": ColumnType.INTEGER}


_REVISION = (
    "committed_at committed_epoch committed_hour observed_at observed_epoch delay actor reason "
    "source plan_id plan_step"
)
_BEGINNING = "since since_at since_epoch since_observed_at asserted_by asserted_reason"
_INTERVAL = (
    f"{_BEGINNING} until until_at until_epoch until_observed_at retracted_by retracted_reason "
    "duration"
)
_FACT = "kind proposition_id predicate"
_FACTS = f"{_FACT} arguments text {_INTERVAL}"
_ARGUMENT = "position parameter object object_id"
_VALUE = "function_value_id function"
_VALUES = f"{_VALUE} arguments fluent value number"
_ACTION = "action action_id kind"
_STEP = "plan_id position"
_BEGUN = "started started_at started_epoch started_by"
_ENDED = "ended ended_at ended_epoch ended_by ended_reason duration"
# What was true of a time, and as it was known.
_VALID = (
    "valid_from valid_from_epoch valid_until valid_until_epoch known_since known_since_at "
    "known_since_epoch known_by known_reason known_until known_until_at known_until_epoch "
    "corrected_by corrected_reason"
)

# An interval is in a window in which it began, held or ended.
_HELD = "since <= :high AND COALESCE(until >= :low, TRUE)"
_KNOWN = "known_since <= :high AND COALESCE(known_until >= :low, TRUE)"
_BEGAN = "since BETWEEN :low AND :high"
_MADE = "revision BETWEEN :low AND :high"
_PLANNED = (
    "plan_id IN (SELECT p.plan_id FROM audit_plan AS p WHERE p.kb_id = :kb"
    " AND p.since BETWEEN :low AND :high)"
)


def _view(name: str, order: str, window: str | None, columns: str) -> AuditView:
    # The id comes last, but for what was added later: one shard has all rows of a knowledge base,
    # which its name does not find.
    names = ("knowledge_base", *columns.split(), "kb_id")
    types = {
        column: _TYPES.get(column) or _LAST_WORDS.get(column.rpartition("_")[2], ColumnType.TEXT)
        for column in names
    }
    return AuditView(f"{PREFIX}{name}", types, tuple(order.split()), window)


_VIEWS = (
    _view(
        "knowledge_base",
        "revision",
        None,
        "revision committed_at committed_epoch origin verified_revision verified_at",
    ),
    _view("revision", "revision", _MADE, f"revision {_REVISION} form hash"),
    _view(
        "change",
        "revision sign kind text element_id",
        _MADE,
        f"revision sign kind text element_id {_REVISION}",
    ),
    _view("fact", "since kind proposition_id", _HELD, _FACTS),
    _view("goal", "since proposition_id", _HELD, _FACTS),
    _view(
        "fact_argument",
        "since kind proposition_id position",
        _HELD,
        f"{_FACT} text {_ARGUMENT} {_INTERVAL}",
    ),
    _view("value", "since function_value_id", _HELD, f"{_VALUES} text {_INTERVAL}"),
    _view(
        "fact_valid",
        "known_since proposition_id valid_from",
        _KNOWN,
        f"proposition_id predicate arguments text {_VALID}",
    ),
    _view("value_valid", "known_since function_value_id valid_from", _KNOWN, f"{_VALUES} {_VALID}"),
    _view(
        "value_argument",
        "since function_value_id position",
        _HELD,
        f"{_VALUE} text {_ARGUMENT} {_INTERVAL}",
    ),
    _view(
        "object", "since object_id", _HELD, f"object object_id type is_constant text {_INTERVAL}"
    ),
    _view("definition", "since kind element_id", _HELD, f"kind name element_id text {_INTERVAL}"),
    _view("action", "since action_id", _HELD, f"{_ACTION} text {_INTERVAL}"),
    _view(
        "action_literal",
        "since action_id section position",
        _HELD,
        f"{_ACTION} section position role predicate literal time is_conditional {_INTERVAL}",
    ),
    _view(
        "plan",
        "plan_id",
        _BEGAN,
        "plan_id revision revision_at revision_epoch problem_hash planner planner_version "
        "objective value number status steps steps_running steps_succeeded steps_failed "
        f"steps_aborted {_BEGINNING} text domain_pddl problem_pddl",
    ),
    _view(
        "plan_step",
        "plan_id position",
        _PLANNED,
        f"{_STEP} action arguments text planned_start planned_duration status {_BEGUN} "
        f"{_ENDED} revisions",
    ),
    _view("plan_step_status", "since plan_id position", _HELD, f"{_STEP} status text {_INTERVAL}"),
    _view(
        "plan_step_argument",
        "plan_id position argument",
        _PLANNED,
        f"{_STEP} text argument object object_id",
    ),
    _view(
        "execution",
        "plan_id position",
        "started <= :high AND COALESCE(ended >= :low, TRUE)",
        f"execution {_STEP} action arguments text outcome code message {_BEGUN} "
        f"started_reason started_source {_ENDED} planned_duration",
    ),
    _view(
        "statistics",
        "action arguments",
        None,
        "action arguments executions running succeeded failed aborted refused success_rate "
        "success_low success_high mean median percentile_95 codes kb_id unconfirmed",
    ),
    _view(
        "effect",
        "since execution proposition_id",
        _HELD,
        f"execution {_STEP} proposition_id text since since_at since_epoch asserted_by until "
        "until_at until_epoch retracted_by confirmed confirmed_at confirmed_epoch confirmed_by",
    ),
    _view(
        "confirmation",
        "revision proposition_id",
        _MADE,
        f"revision text proposition_id {_REVISION}",
    ),
    _view(
        "archive",
        "archive_id",
        None,
        f"archive_id revision revision_at revision_epoch target versions rest {_BEGINNING} text",
    ),
    _view(
        "promotion",
        "promotion_id",
        None,
        f"promotion_id revision revision_at revision_epoch origin {_BEGINNING} text",
    ),
    _view(
        "erasure",
        "erasure_id",
        None,
        "erasure_id revision revision_at revision_epoch kind element_id pseudonym parts digest "
        f"{_BEGINNING} text",
    ),
)
AUDIT_VIEWS = {view.name: view for view in _VIEWS}

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
    sorted_by = [
        one.nulls_first() if view.columns[one.name] is ColumnType.TEXT else one for one in order
    ]
    return Query(rows.order_by(*sorted_by))


# A batch ends with the first of these: so many rows, or characters.
BATCH_ROWS = 16_384
BATCH_CHARACTERS = 16_000_000


def import_arrow() -> Any:
    """Import pyarrow, or say how to install it."""
    with needing("this needs pyarrow, which is not installed; run: pip install 'kant-sql[data]'"):
        import pyarrow
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
    # The texts of a row: they alone can be long.
    types = enumerate(view.columns.values())
    texts_of = itemgetter(*(number for number, type_ in types if type_ is ColumnType.TEXT))
    batches = _batched(stream_rows(session, view, kb_id, bounds), texts_of)
    while True:
        with reading_rows(view.name, f"knowledge base {kb_id}"):
            batch = next(batches, None)
            made = None if batch is None else _record_batch(schema, view, batch)
        if made is None:
            return
        yield made


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

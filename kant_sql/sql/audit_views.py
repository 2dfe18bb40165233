"""The audit views: their columns and types, and their rows, also as Arrow, in batches.

`docs/audit.md` describes them. On SQLite, a time is a text and a truth value is 0 or 1.
pyarrow, of the extra `data`, is imported on first use.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from sqlalchemy import BigInteger, bindparam, column, select, table, text

from ..arguments import expect, shown
from ..errors import InvalidArgumentError, needing, printable, reading_rows
from .dialects.base import Row, Session
from .dialects.structure import TYPED
from .query import Query
from .rows import KB
from .schema import recorded

if TYPE_CHECKING:
    import pyarrow

PREFIX = "audit_"


class ColumnType(Enum):
    """The types of columns; any value may be NULL."""

    TEXT = "text"
    INTEGER = "integer"
    DOUBLE = "double"
    BOOLEAN = "boolean"
    TIME = "time"


class AuditView(NamedTuple):
    """A view for auditors.

    Attributes:
        order: the columns that sort its rows; no two rows have the same values in all of them.
        window: the condition that a row belongs to the revisions from `:low` to `:high`; None if
            rows belong to no revision.
    """

    name: str
    order: tuple[str, ...]
    window: str | None

    @property
    def columns(self) -> Mapping[str, ColumnType]:
        """Its columns in their order, with their types."""
        return _columns()[self.name]


_HEAD = re.compile(rf"CREATE VIEW ({PREFIX}\w+) \(\n(.*?)\n\)", re.DOTALL)
_COLUMN = re.compile(r'^    "?(\w+)"? ([a-z ]+)', re.MULTILINE)
_TYPES = {
    "boolean": ColumnType.BOOLEAN,
    "double precision": ColumnType.DOUBLE,
    **dict.fromkeys(("bigint", "integer"), ColumnType.INTEGER),
    "timestamp with time zone": ColumnType.TIME,
}


@cache
def _columns() -> dict[str, dict[str, ColumnType]]:
    """Read the columns of each view from the recorded schema of the migrations."""
    heads = (_HEAD.match(statement.text) for statement in recorded(TYPED))
    return {
        head[1]: {
            name: _TYPES.get(type_.strip(), ColumnType.TEXT)
            for name, type_ in _COLUMN.findall(head[2])
        }
        for head in heads
        if head is not None
    }


# A window includes intervals that began, held or ended in it.
_HELD = "since <= :high AND COALESCE(until >= :low, TRUE)"
_KNOWN = "known_since <= :high AND COALESCE(known_until >= :low, TRUE)"
_MADE = "revision BETWEEN :low AND :high"
_PLANNED = (
    "plan_id IN (SELECT p.plan_id FROM audit_plan AS p WHERE p.kb_id = :kb"
    " AND p.since BETWEEN :low AND :high)"
)
_ORDERS_AND_WINDOWS = {
    "knowledge_base": ("revision", None),
    "revision": ("revision", _MADE),
    "change": ("revision sign kind text element_id", _MADE),
    "fact": ("since kind proposition_id", _HELD),
    "goal": ("since proposition_id", _HELD),
    "fact_argument": ("since kind proposition_id position", _HELD),
    "value": ("since function_value_id", _HELD),
    "fact_valid": ("known_since proposition_id valid_from", _KNOWN),
    "value_valid": ("known_since function_value_id valid_from", _KNOWN),
    "value_argument": ("since function_value_id position", _HELD),
    "object": ("since object_id", _HELD),
    "definition": ("since kind element_id", _HELD),
    "action": ("since action_id", _HELD),
    "action_literal": ("since action_id section position", _HELD),
    "plan": ("plan_id", "since BETWEEN :low AND :high"),
    "plan_step": ("plan_id position", _PLANNED),
    "plan_step_status": ("since plan_id position", _HELD),
    "plan_step_argument": ("plan_id position argument", _PLANNED),
    "execution": ("plan_id position", "started <= :high AND COALESCE(ended >= :low, TRUE)"),
    "statistics": ("action arguments", None),
    "effect": ("since execution proposition_id", _HELD),
    "confirmation": ("revision proposition_id", _MADE),
    "archive": ("archive_id", None),
    "promotion": ("promotion_id", None),
    "erasure": ("erasure_id", None),
}
AUDIT_VIEWS = {
    f"{PREFIX}{name}": AuditView(f"{PREFIX}{name}", tuple(order.split()), window)
    for name, (order, window) in _ORDERS_AND_WINDOWS.items()
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
    """Read the rows of a view for one knowledge base."""
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
    """Import pyarrow; the error says how to install it."""
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
    # The texts of a row: only they can be long.
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
    """Read all rows of a view for one knowledge base."""
    batches = [*stream_view(session, view, kb_id)]
    return import_arrow().Table.from_batches(batches, arrow_schema(view))


def text_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> pyarrow.Table:
    """Make a table of texts; without columns it still has the number of rows."""
    arrow = import_arrow()
    # Two variables may differ only in case, and a table without columns has no length.
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
        _ARRAYS.get(type_, _array)(values, field.type)
        for values, type_, field in zip(columns, view.columns.values(), schema, strict=True)
    ]
    return import_arrow().RecordBatch.from_arrays(arrays, schema=schema)


def _array(values: Sequence[Any], type_: Any) -> Any:
    return import_arrow().array(values, type_)


def _truths(values: Sequence[Any], type_: Any) -> Any:
    """Convert truth values, which SQLite stores as 0 and 1."""
    return _array([None if value is None else bool(value) for value in values], type_)


def _times(values: Sequence[Any], type_: Any) -> Any:
    """Convert times, which SQLite stores as text."""
    if any(isinstance(value, str) for value in values):
        return _array(values, import_arrow().string()).cast(type_)
    return _array(values, type_)


_ARRAYS = {ColumnType.BOOLEAN: _truths, ColumnType.TIME: _times}

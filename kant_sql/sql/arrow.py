"""The rows of the audit's views as Arrow: columns with types, batch by batch.

pyarrow, of the extra `data`, is imported on first use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ..errors import ExtraMissingError, reading_rows
from .audit_views import AuditView, ColumnType, stream_rows
from .dialects.base import Row, Session

if TYPE_CHECKING:
    import pyarrow

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

"""Exports the views for auditors: a folder with all files or none, and their formats."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from hashlib import file_digest, sha256
from itertools import accumulate, product
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, Protocol
from urllib.parse import quote

from ..arguments import (
    Progress,
    expect,
    expect_list,
    flag,
    one_of,
    optional_call,
    optional_text,
    shown,
)
from ..errors import InvalidArgumentError, printable
from ..history.moments import is_valid_clock
from ..json_values import json_value
from ..knowledge.canonical import time_text
from ..knowledge.sayings import COMMITTED
from ..moment_text import When
from ..plugins import Plugins
from ..sql.audit_views import AUDIT_VIEWS, AuditView, arrow_schema, find_audit_view, import_arrow
from .snapshot import KnowledgeBaseState, StoreSnapshot, Window, check_window, open_snapshot

if TYPE_CHECKING:
    import pyarrow

FORMATS = ("parquet", "csv", "jsonl")
# Written last: the contents of the export. Readers of partitions skip names that begin with `_`.
MANIFEST = "_export.json"
PARTITION = "knowledge_base="
# The longest name of a file in bytes, and the digits of the hash that replaces the excess.
_LONGEST, _DIGITS = 255, 16
# Hive reads these values as NULL.
_NOTHING = frozenset({"null", "__hive_default_partition__"})


class ExportedFile(NamedTuple):
    """A file of an export.

    Attributes:
        path: its path in the folder, with slashes.
        knowledge_base: the name of its knowledge base.
        content: the view whose rows it contains, or a plugin's name for its content.
        rows: the number of its rows or messages.
        bytes: its size.
        sha256: the hash of its bytes.
    """

    path: str
    knowledge_base: str
    content: str
    rows: int
    bytes: int
    sha256: str


class Exported(NamedTuple):
    """The result of an export.

    Attributes:
        folder: its folder.
        format: the format of the files.
        store: the URL of the store, without its password.
        since: the given first revision or time; None for all.
        until: the given last revision or time; None for all.
        knowledge_bases: the state of the knowledge bases at that moment.
        files: the files.
        clock: `committed`, or `valid` for valid times.
    """

    folder: str
    format: str
    store: str
    since: int | str | None
    until: int | str | None
    knowledge_bases: tuple[KnowledgeBaseState, ...]
    files: tuple[ExportedFile, ...]
    clock: str = COMMITTED


class PluggedFormat(Protocol):
    """A format of a plugin in the group `kant_sql.export_formats`: facts and values over time."""

    def __call__(
        self,
        url: str,
        *,
        to: str | PathLike[str],
        knowledge_base: str | None = None,
        names: Sequence[str] | None = None,
        elements: Sequence[str] | None = None,
        since: When | None = None,
        until: When | None = None,
        replace: bool = False,
        progress: Progress | None = None,
        clock: str = COMMITTED,
    ) -> Exported:
        """Write a folder, as `export_store` does, of some predicates and functions, or elements.

        A format that has no meaning on valid time refuses the clock `valid`, by
        `refuse_valid_clock`.
        """


PLUGGED_FORMATS: Plugins[PluggedFormat] = Plugins("kant_sql.export_formats")


def refuse_valid_clock(clock: str, what: str) -> None:
    """Refuse the clock `valid` for a format that has no meaning on it."""
    if is_valid_clock(clock):
        raise InvalidArgumentError(
            f"{what} by revisions, not by valid times: leave out clock='valid' (--clock); "
            "mcap and trajectory take it, and the views fact_valid and value_valid have both clocks"
        )


def bound(given: int | datetime | None) -> int | str | None:
    """Write a given bound of an export."""
    return time_text(given.astimezone(UTC)) if isinstance(given, datetime) else given


def folder_name(name: str) -> str:
    """Name the folder of a knowledge base's files, as Hive names partitions."""
    # Percent-encode all but ASCII letters, digits and `-_.`, so that no name leaves the folder. A
    # name that is too long for a folder ends with its hash.
    part = encoded(name)
    if name.lower() in _NOTHING or set(name) <= {"."}:
        part = f"%{ord(name[0]):02X}{part[1:]}"
    room = _LONGEST - len(PARTITION)
    if len(part) > room:
        # Cut between characters: a partial one cannot be decoded.
        digest = sha256(name.encode()).hexdigest()[:_DIGITS]
        sizes = accumulate(len(encoded(character)) for character in name)
        kept = sum(size <= room - _DIGITS - 1 for size in sizes)
        part = f"{encoded(name[:kept])}~{digest}"
    return f"{PARTITION}{part}"


def encoded(name: str) -> str:
    """Percent-encode all characters but ASCII letters, digits and `-_.`."""
    return quote(name, safe="").replace("~", "%7E")


Write = Callable[["pyarrow.RecordBatch"], None]


@contextmanager
def _parquet(file: BinaryIO, schema: pyarrow.Schema) -> Iterator[Write]:
    arrow = import_arrow()
    from pyarrow import parquet

    # Readers of partitions read the name as a dictionary, and refuse to mix both.
    names = arrow.dictionary(arrow.int32(), arrow.string())
    schema = schema.set(0, arrow.field(schema.field(0).name, names))
    with parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        yield lambda batch: writer.write_batch(batch.cast(schema))


@contextmanager
def _csv(file: BinaryIO, schema: pyarrow.Schema) -> Iterator[Write]:
    """Write texts in quotes, NULL as an empty field, and times as in the audit views."""
    from pyarrow import csv

    with csv.CSVWriter(file, _with_text_times(schema)) as writer:
        yield lambda batch: writer.write_batch(_text_times(batch))


@contextmanager
def _json_lines(file: BinaryIO, _: pyarrow.Schema) -> Iterator[Write]:
    """Write a JSON document per row, with every column."""
    encode = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode

    def write(batch: pyarrow.RecordBatch) -> None:
        columns = [_finite(column).to_pylist() for column in _text_times(batch).columns]
        for row in zip(*columns, strict=True):
            file.write(f"{encode(dict(zip(batch.schema.names, row, strict=True)))}\n".encode())

    yield write


WRITERS = {"parquet": _parquet, "csv": _csv, "jsonl": _json_lines}


def _with_text_times(schema: Any) -> Any:
    arrow = import_arrow()
    return arrow.schema(
        [
            field.with_type(arrow.string()) if arrow.types.is_timestamp(field.type) else field
            for field in schema
        ]
    )


def _text_times(batch: Any) -> Any:
    """Write times as in the audit views on SQLite."""
    arrow = import_arrow()
    from pyarrow import compute

    columns = [
        compute.strftime(column, format="%Y-%m-%dT%H:%M:%SZ")
        if arrow.types.is_timestamp(column.type)
        else column
        for column in batch.columns
    ]
    return arrow.RecordBatch.from_arrays(columns, schema=_with_text_times(batch.schema))


def _finite(column: Any) -> Any:
    """Omit numbers that JSON cannot express: those too large for a double."""
    arrow = import_arrow()
    from pyarrow import compute

    if not arrow.types.is_floating(column.type):
        return column
    return compute.if_else(compute.is_finite(column), column, None)


class Folder:
    """The folder of an export in progress: beside the present files until all is written."""

    def __init__(self, target: Path, part: Path) -> None:
        self.target = target
        self._part = part
        self.files: list[ExportedFile] = []

    @contextmanager
    def new_file(self, path: str, state: KnowledgeBaseState, content: str) -> Iterator[NewFile]:
        """Create a file, and record it if the block ends without an error."""
        place = self._part / path
        place.parent.mkdir(parents=True, exist_ok=True)
        with place.open("xb") as file:
            made = NewFile(file)
            yield made
        with place.open("rb") as file:
            digest = file_digest(file, "sha256").hexdigest()
        size = place.stat().st_size
        self.files.append(ExportedFile(path, state.name, content, made.rows, size, digest))

    def finish(self, exported: Exported, old: Sequence[str]) -> None:
        """Move the files to their place, and replace those of an earlier export."""
        text = json.dumps(json_value(exported), ensure_ascii=False, indent=1)
        # Names of folders may not be UTF-8; JSON contains escapes then.
        manifest = f"{text}\n".encode(errors="backslashreplace")
        (self._part / MANIFEST).write_bytes(manifest)
        if old:
            # First: without it, the rest is not a complete export.
            (self.target / MANIFEST).unlink()
        for path in old:
            (self.target / path).unlink(missing_ok=True)
            _remove_empty((self.target / path).parent, self.target)
        for path in [*(file.path for file in self.files), MANIFEST]:
            place = self.target / path
            place.parent.mkdir(parents=True, exist_ok=True)
            (self._part / path).replace(place)


class NewFile:
    """A file in progress."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file  # where its bytes go
        self.rows = 0  # the number of its rows, counted by the writer


def _remove_empty(folder: Path, top: Path) -> None:
    while folder != top:
        with suppress(OSError):
            folder.rmdir()
        folder = folder.parent


def files_of_export(target: Path) -> list[str]:
    """List the files of an earlier export, if the folder has no others."""
    if not target.exists():
        return []
    present = {
        path.relative_to(target).as_posix() for path in target.rglob("*") if not path.is_dir()
    }
    try:
        document = json.loads((target / MANIFEST).read_bytes())
        known = [str(file["path"]) for file in document["files"]]
    except (OSError, ValueError, LookupError, TypeError):
        known = []
    foreign = sorted(present - {*known, MANIFEST})
    if present and (foreign or MANIFEST not in present):
        raise InvalidArgumentError(
            f"{printable(str(target))} has files that no export wrote, as "
            f"{shown(printable((foreign or [MANIFEST])[0]))}; name another folder"
        )
    return [path for path in known if path in present]


@contextmanager
def new_folder(target: Path, replace: bool) -> Iterator[tuple[Folder, list[str]]]:
    """Prepare a folder for files; yield it, and the files that they replace."""
    # A failure in the block leaves the folder unchanged.
    if not replace and target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise InvalidArgumentError(
            f"{printable(str(target))} is not an empty folder; name another one, or replace the "
            "export in it (--replace)"
        )
    old = files_of_export(target)
    is_new = not target.exists()
    target.mkdir(parents=True, exist_ok=True)
    # In the folder, not beside it: it may be a mounted volume.
    part = Path(tempfile.mkdtemp(prefix=".part-", dir=target))
    try:
        yield Folder(target, part), old
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        if is_new:
            with suppress(OSError):
                os.rmdir(target)
        raise
    shutil.rmtree(part, ignore_errors=True)


def export_store(
    url: str,
    *,
    to: str | PathLike[str],
    format: str = "parquet",
    knowledge_base: str | None = None,
    views: Sequence[str] | None = None,
    since: When | None = None,
    until: When | None = None,
    replace: bool = False,
    progress: Progress | None = None,
) -> Exported:
    """Write the views for auditors to files, from one consistent state, in constant memory.

    Each view has a folder, with a folder for each knowledge base:
    `audit_fact/knowledge_base=tiago/audit_fact.parquet`. The folder gets all files or none.

    Args:
        url: the database URL.
        to: the folder; it is created if it is missing.
        format: `parquet`, `csv` or `jsonl`.
        knowledge_base: only rows of this one; None for all of the store.
        views: the names of views, such as `fact` or `audit_fact`; None for all.
        since: omit rows that ended before this revision or aware time. With a revision, you must
            name the knowledge base.
        until: omit rows that began after this revision or aware time.
        replace: whether to replace an earlier export in the folder.
        progress: called with the amount of work done, and the total.

    Returns:
        The written files.

    Raises:
        InvalidArgumentError: the folder has other files, there is no such view or format, or the
            range ends before it begins.
        KantSqlError: there is no such knowledge base.
        UnknownRevisionError: there is no such revision, or a time has no zone.
        ExtraMissingError: pyarrow is not installed; it comes with the extra `data`.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be read.
        OSError: the files cannot be written.
    """
    one_of(format, FORMATS, "the format", InvalidArgumentError)
    chosen = _chosen_views(views)
    import_arrow()
    with new_export(url, format, to, knowledge_base, since, until, replace, progress) as export:
        for done in _write_views(export, format, chosen):
            export.tell(done, len(chosen))
    return export.exported


@dataclass
class Export:
    """An export in progress."""

    snapshot: StoreSnapshot  # the snapshot of the store
    folder: Folder  # where the files go
    # The knowledge bases, each with the range of wanted revisions.
    windows: list[tuple[KnowledgeBaseState, Window | None]]
    _progress: Progress | None
    exported: Exported = field(init=False)  # the result, once all is written

    def each(self) -> Iterator[tuple[KnowledgeBaseState, Window]]:
        """Yield the knowledge bases one by one, and report when each is done."""
        done = 0
        for state, window in self.windows:
            yield state, window or (1, state.revision)
            done += state.revision
            self.tell(done)

    def tell(self, done: int, times: int = 1) -> None:
        """Report how many revisions are done, of all, so many times."""
        if self._progress is not None:
            whole = times * sum(state.revision for state, _ in self.windows)
            self._progress(min(done, whole), whole)


@contextmanager
def new_export(
    url: str,
    format: str,
    to: object,
    knowledge_base: str | None,
    since: When | None,
    until: When | None,
    replace: bool,
    progress: Progress | None,
    clock: str = COMMITTED,
) -> Iterator[Export]:
    """Prepare an export of one snapshot of a store; the end of the block completes it."""
    target = check_target(to, knowledge_base, replace, progress)
    bounds = check_window(since, until, knowledge_base)
    with open_snapshot(url) as snapshot, new_folder(target, replace) as (folder, old):
        states = snapshot.chosen(knowledge_base)
        windows = [(state, snapshot.window(state, *bounds)) for state in states]
        export = Export(snapshot, folder, windows, progress)
        yield export
        first, last = map(bound, bounds)
        said = tuple(states), tuple(folder.files)
        export.exported = Exported(str(target), format, snapshot.label, first, last, *said, clock)
        folder.finish(export.exported, old)


def check_target(to: object, knowledge_base: object, replace: object, progress: object) -> Path:
    """Check the arguments that all exports share."""
    kinds: tuple[type[Any], ...] = (str, PathLike)
    path = fspath(expect(to, kinds, "the folder", InvalidArgumentError))
    if not isinstance(path, str) or not path or "\0" in path:
        raise InvalidArgumentError("the folder of an export is a path; name one")
    optional_text(knowledge_base, "knowledge_base")
    flag(replace, "replace", InvalidArgumentError)
    optional_call(progress, "progress")
    return Path(path)


def _chosen_views(names: Sequence[str] | None) -> list[AuditView]:
    if names is None:
        return [*AUDIT_VIEWS.values()]
    found = [find_audit_view(name) for name in expect_list(names, str, "the views")]
    return [*{view.name: view for view in found}.values()]


def _write_views(export: Export, format: str, views: Iterable[AuditView]) -> Iterator[int]:
    """Write views to files; yield the progress: revisions, once for each view."""
    done = 0
    for (state, window), view in product(export.windows, views):
        path = f"{view.name}/{folder_name(state.name)}/{view.name}.{format}"
        with (
            export.folder.new_file(path, state, view.name) as made,
            WRITERS[format](made.file, arrow_schema(view)) as write,
        ):
            for batch in export.snapshot.batches(view, state, window):
                write(batch)
                made.rows += batch.num_rows
                yield done + _revision_of(view, batch)
        done += state.revision
        yield done


def _revision_of(view: AuditView, batch: pyarrow.RecordBatch) -> int:
    """Return the last revision of a batch, if rows are in the order of revisions."""
    if view.order[0] not in ("since", "revision"):
        return 0
    last: int = batch.column(view.order[0])[-1].as_py()
    return last

"""Exporting the views for auditors."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..arguments import expect, expect_list, flag, one_of, optional_call, optional_text
from ..dao.interfaces import Progress
from ..errors import InvalidArgumentError
from ..moment_text import When
from ..sql.audit_views import AUDIT_VIEWS, AuditView, arrow_schema, find_audit_view, import_arrow
from .files import FORMATS, SINKS, Exported, Folder, Sink, bound, folder_name, new_folder
from .snapshot import KnowledgeBaseState, StoreSnapshot, Window, check_window, open_snapshot

if TYPE_CHECKING:
    import pyarrow


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
    `audit_fact/knowledge_base=tiago/audit_fact.parquet`. All files are there in the end, or none.

    Args:
        url: the database URL.
        to: the folder; it is created if it is missing.
        format: `parquet`, `csv` or `jsonl`.
        knowledge_base: the one whose rows they are; None for all of the store.
        views: the names of views, as `fact` or `audit_fact`; None for all.
        since: leave out what ended before this revision or aware time. A revision is of one
            knowledge base, which must be named.
        until: leave out what began after this revision or aware time.
        replace: whether to replace an earlier export in the folder.
        progress: called with the amount of work done, and the amount in total.

    Returns:
        What was written.

    Raises:
        InvalidArgumentError: the folder has other files, or there is no such view or format.
        KantSqlError: there is no such knowledge base.
        UnknownRevisionError: there is no such revision, or a time has no zone.
        ExtraMissingError: pyarrow is not installed; the extra `data` has it.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be read.
        OSError: the files cannot be written.
    """
    target = check_target(to, knowledge_base, replace, progress)
    one_of(format, FORMATS, "the format", InvalidArgumentError)
    chosen = _chosen_views(views)
    first, last = check_window(since, until, knowledge_base)
    import_arrow()
    with open_snapshot(url) as snapshot, new_folder(target, replace) as (folder, old):
        states = snapshot.chosen(knowledge_base)
        windows = [snapshot.window(state, first, last) for state in states]
        work = _Work(snapshot, folder, format, progress, sum(s.revision for s in states))
        for state, window in zip(states, windows, strict=True):
            for view in chosen:
                work.write(view, state, window, len(chosen))
        files = tuple(folder.files)
        exported = Exported(
            str(target), format, snapshot.label, bound(first), bound(last), tuple(states), files
        )
        folder.finish(exported, old)
    return exported


def check_target(to: object, knowledge_base: object, replace: object, progress: object) -> Path:
    """Check what all exports are given."""
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


class _Work:
    """Writes views, and tells how much of all is done: revisions, once for each view."""

    def __init__(
        self,
        snapshot: StoreSnapshot,
        folder: Folder,
        format: str,
        progress: Progress | None,
        revisions: int,
    ) -> None:
        self._snapshot = snapshot
        self._folder = folder
        self._format = format
        self._progress = progress
        self._revisions = revisions
        self._done = 0

    def write(
        self, view: AuditView, state: KnowledgeBaseState, window: Window | None, views: int
    ) -> None:
        """Write what a view has of a knowledge base to a file."""
        path = f"{view.name}/{folder_name(state.name)}/{view.name}.{self._format}"
        whole = self._revisions * views
        with self._folder.new_file(path, state, view.name) as made:
            sink: Sink = SINKS[self._format](made.file, arrow_schema(view))
            with closing(sink):
                for batch in self._snapshot.batches(view, state, window):
                    sink.write(batch)
                    made.rows += batch.num_rows
                    self._tell(self._done + _revision_of(view, batch), whole)
        self._done += state.revision
        self._tell(self._done, whole)

    def _tell(self, done: int, whole: int) -> None:
        if self._progress is not None:
            self._progress(done, whole)


def _revision_of(view: AuditView, batch: pyarrow.RecordBatch) -> int:
    """Return how far a batch goes, where rows are in the order of revisions."""
    if view.order[0] not in ("since", "revision"):
        return 0
    last: int = batch.column(view.order[0])[-1].as_py()
    return last

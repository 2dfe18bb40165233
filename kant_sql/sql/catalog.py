"""A whole store: the names and heads of its knowledge bases, and backups."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import select

from ..arguments import expect, optional_call
from ..errors import UNREADABLE, InvalidArgumentError, StoreError, printable
from .dialects import create_backend
from .dialects.base import Session
from .query import Query, constant
from .schema import check, current
from .tables import HeadRow, KnowledgeBaseRow, VerificationRow


def of_written(*columns: Any) -> Query:
    """Read columns of the knowledge bases that have a revision, and of their heads."""
    return Query(
        select(*columns)
        .join_from(KnowledgeBaseRow, HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
        .where(HeadRow.revision > constant(0))
        .order_by(KnowledgeBaseRow.id)
    )


_EVERY_NAME = Query(select(KnowledgeBaseRow.name).order_by(KnowledgeBaseRow.id))
# Columns that exist in every schema version: a downgrade reads them first.
_REVISIONS = of_written(KnowledgeBaseRow.name, HeadRow.revision)

_STATES = of_written(
    *(KnowledgeBaseRow.id, KnowledgeBaseRow.name, HeadRow.revision, HeadRow.hash),
    *(HeadRow.committed_at, HeadRow.archived_revision),
)


def read_heads(session: Session) -> list[tuple[int, str, int, str, datetime, int]]:
    """Read id, name, last revision with hash and time, and archived revision, of written ones."""
    return [
        (id_, name, revision, digest, session.to_time(committed_at), archived)
        for id_, name, revision, digest, committed_at, archived in session.rows(_STATES)
    ]


_COMPLETE = Query(
    select(KnowledgeBaseRow.name, VerificationRow.complete_at)
    .join(VerificationRow, VerificationRow.kb_id == KnowledgeBaseRow.id)
    .where(VerificationRow.complete_at.is_not(None))
)


@contextmanager
def _opened(url: str) -> Iterator[Session]:
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        yield session


def complete_verifications(url: str) -> dict[str, datetime]:
    """Read when each knowledge base was last verified from revision 1 on."""
    with _opened(url) as session:
        found = {}
        for name, raw in session.rows(_COMPLETE):
            # A table that cannot be read has no kept verification.
            with suppress(*UNREADABLE):
                found[name] = session.to_time(raw)
        return found


def revision_counts(url: str) -> dict[str, int]:
    """Count the revisions of each knowledge base, whatever the version of the tables."""
    with _opened(url) as session:
        return dict(session.rows(_REVISIONS))


@contextmanager
def removed_on_failure(url: str) -> Iterator[None]:
    """Remove the SQLite file that the block creates if the block fails.

    A file that is in use, or has a revision, stays.
    """
    with closing(create_backend(url)) as backend:
        is_new = not backend.exists()
        try:
            yield
        except BaseException as error:
            if is_new:
                # A cursor that a signal interrupted keeps the file in use.
                traceback.clear_frames(error.__traceback__)
                backend.remove()
            raise


def written_names(url: str) -> list[str]:
    """List the names of the knowledge bases of a store that have a revision; create nothing."""
    check(url)
    return [*revision_counts(url)]


def every_name(url: str) -> list[str]:
    """List the knowledge bases of a store, including those without a revision or a head."""
    check(url)
    with _opened(url) as session:
        return [name for (name,) in session.rows(_EVERY_NAME)]


class Backup(NamedTuple):
    """A backup.

    Attributes:
        file: the absolute path of the file.
        bytes: its size.
        revisions: the last revision of each knowledge base in it.
    """

    file: Path
    bytes: int
    revisions: dict[str, int]


def backup(
    url: str,
    file: str | PathLike[str],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Backup:
    """Copy an SQLite store into a new file while others read and write it.

    The copy has the state at one moment, with whole revisions, for tables of any version. The file
    appears when it is complete and on the disk; a failed backup leaves none.

    Args:
        url: the database URL.
        file: the new file; an existing one is never overwritten.
        progress: called with the number of copied pages, and their total.

    Returns:
        The file, and its knowledge bases.

    Raises:
        InvalidArgumentError: the file exists; the store is on a server, whose own program the
            message names; or it is in memory.
        SchemaMissingError: there is no such store.
        StoreError: the store cannot be read, or the file cannot be written.

    Examples:
        >>> import kant_sql
        >>> with kant_sql.connect("sqlite:///robot.db") as kb:
        ...     _ = kb.types.save(PddlTypeDto("robot"))
        >>> kant_sql.operations.backup("sqlite:///robot.db", "monday.db").revisions
        {'default': 1}
    """
    expect(file, (str, PathLike), "the file of a backup", InvalidArgumentError)
    optional_call(progress, "progress")
    path = Path(file).absolute()
    with closing(create_backend(url)) as backend:
        is_file = not (backend.is_server or backend.has_one_connection)
        if is_file and current(url) is None:
            # Raises the error that names the remedy.
            check(url)
        try:
            _refuse_existing(path)
            part = _begin(path)
            try:
                backend.copy_to(part, progress)
                revisions = revision_counts(str(part))
                size = _complete(part, path)
            finally:
                for suffix in ("", "-journal", "-wal", "-shm"):
                    Path(f"{part}{suffix}").unlink(missing_ok=True)
        except OSError as error:
            raise StoreError(
                f"{printable(str(path))}: {error.strerror or error}; no backup was written: name a "
                "file in a folder that exists, may be written and has room"
            ) from error
    return Backup(path, size, revisions)


def _refuse_existing(path: Path) -> None:
    if os.path.lexists(path):
        raise InvalidArgumentError(
            f"{printable(str(path))} exists, and a backup never overwrites a file: name another one"
        )


def _begin(path: Path) -> Path:
    """Create a temporary file beside the final one."""
    import tempfile

    try:
        handle, name = tempfile.mkstemp(".part", f".{path.name}.", path.parent)
    except ValueError as error:
        raise InvalidArgumentError(f"{printable(str(path))} cannot name a file: {error}") from error
    os.close(handle)
    return Path(name)


def _complete(part: Path, path: Path) -> int:
    """Rename a complete copy durably, and return its size."""
    with part.open("rb+") as file:
        os.fsync(file.fileno())
        size = os.fstat(file.fileno()).st_size
    try:
        # Unlike a rename, this never replaces a file.
        os.link(part, path)
    except OSError:
        # Some file systems have no links.
        _refuse_existing(path)
        part.rename(path)
    # Windows cannot open a folder.
    with suppress(PermissionError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    return size

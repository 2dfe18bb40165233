"""A copy of the whole store in a file, as it is at one moment, while others write."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import closing, suppress
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from ..arguments import expect, optional_call
from ..errors import InvalidArgumentError, StoreError, printable
from .catalog import revision_counts
from .dialects import create_backend
from .schema import check, current


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
    """Copy an SQLite store into a new file, while others read and write it.

    The copy is the store as it is at one moment, with each revision whole, whatever version its
    tables have. The file appears when it is complete and on the disk; otherwise there is none.

    Args:
        url: the database URL.
        file: the new file; an existing one is never overwritten.
        progress: called with the pages that are copied and their number.

    Returns:
        The file, and what is in it.

    Raises:
        InvalidArgumentError: the file exists; the store is a server, whose own program the message
            names; or it is in memory.
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
            handle, name = tempfile.mkstemp(".part", f".{path.name}.", path.parent)
            os.close(handle)
            part = Path(name)
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


def _complete(part: Path, path: Path) -> int:
    """Give a complete copy its name, durably, and return its size."""
    with part.open("rb+") as file:
        os.fsync(file.fileno())
        size = os.fstat(file.fileno()).st_size
    try:
        # Unlike a rename, this never replaces a file.
        os.link(part, path)
    except OSError:
        # Not each file system has links.
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

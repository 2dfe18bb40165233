"""The file of an SQLite store: detects that it was replaced, and bounds its write-ahead log.

SQLite opens a file by name once. If the file is deleted, renamed or replaced afterwards, SQLite
continues to write to the open file, which no other process can find.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import struct
import time
from collections.abc import Callable
from contextlib import closing, suppress
from typing import NamedTuple, NoReturn
from urllib.parse import quote
from weakref import WeakValueDictionary

from ...errors import StoreReplacedError
from .base import NO_FORK

logger = logging.getLogger("kant_sql.sqlite")

# The write-ahead log is truncated above this size in bytes. SQLite checkpoints it at 4 MB; a large
# transaction or a long read makes it grow.
WAL_LIMIT = 32 << 20
# Seconds between attempts to truncate it while a reader holds it.
WAL_PATIENCE = 1.0
# Seconds without a change after which a file counts as overwritten: a checkpoint of another process
# copies parts of tables one by one.
STILL = 0.25
# Seconds from a checkpoint of its own until a process compares the file. A comparison takes 4 ms,
# and a busy writer checkpoints every 20 ms.
COMPARE_AFTER = 1.0
ATTEMPTS = 10

_HEAD = "SELECT kb_id, revision, hash FROM head WHERE revision > 0 ORDER BY revision DESC LIMIT 1"
_HASH = "SELECT hash FROM revision WHERE kb_id = ? AND number = ?"


# A write-ahead log begins with a magic number, and a salt that changes whenever the log restarts.
WAL_MAGIC = (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")
WAL_HEADER, WAL_SALT = 32, slice(16, 24)
# Each of its frames is a page after a header, which has the salt that the log had then. The header
# of the log's index has the page size, the number of frames that are committed, and the salt.
FRAME_HEADER, FRAME_SALT = 24, slice(8, 16)
INDEX_HEADER, INDEX_SALT = 48, slice(32, 40)
INDEX_STATE, INDEX_STATE_AT = struct.Struct("=HI"), 14


class Landmark(NamedTuple):
    """A revision in the file itself, without the log: the file must have it from then on."""

    kb_id: int
    revision: int
    hash: str


class Contents:
    """The content of a file, without its log, at this process's last comparison.

    All backends of the process share it: each checkpoint requires a comparison, for which SQLite
    parses the whole schema, about 4 ms. `due` is the latest time of the next comparison, on the
    monotonic clock; None if the file has not changed since the last.
    """

    def __init__(self) -> None:
        self._landmark: Landmark | None = None
        self.changed = self.size = 0
        self.due: float | None = None

    def is_at(self, found: os.stat_result) -> bool:
        """Return whether the file has not changed since."""
        return (found.st_mtime_ns, found.st_size) == (self.changed, self.size)

    def confirm(self, found: os.stat_result) -> None:
        """Note that the present file was compared."""
        self.changed, self.size = found.st_mtime_ns, found.st_size
        self.due = None

    def trust(self, found: os.stat_result) -> bool:
        """Attribute a change during a commit of this process to its checkpoint, until `due`."""
        now = time.monotonic()
        due = self.due or now + COMPARE_AFTER
        if found.st_size < self.size or now >= due:
            return False
        self.confirm(found)
        self.due = due
        return True

    def compare(self, path: str) -> bool | None:
        """Return whether the file still holds the landmark; None if that is unknown now.

        A copy written over the file changes neither its inode nor SQLite's index of the log.
        """
        mark = self._landmark
        try:
            # With `immutable`, SQLite reads the file alone and takes no lock.
            name = f"file:{quote(path)}?immutable=1"
            with NO_FORK, closing(sqlite3.connect(name, uri=True)) as connection:
                if mark is not None:
                    row = connection.execute(_HASH, (mark.kb_id, mark.revision)).fetchone()
                    if row is None or row[0] != mark.hash:
                        return False
                last = connection.execute(_HEAD).fetchone()
        except sqlite3.OperationalError:
            # There are no tables yet.
            return mark is None
        except sqlite3.Error:
            # A checkpoint of another process is under way.
            return None
        if last is not None:
            self._landmark = Landmark(*last)
        return True


# By device and inode, while a backend has the file open.
_CONTENTS: WeakValueDictionary[tuple[int, int], Contents] = WeakValueDictionary()


def contents_of(path: str, found: os.stat_result) -> Contents:
    """Return the content of a file, shared with its other users unless it was overwritten since."""
    key = found.st_dev, found.st_ino
    contents = _CONTENTS.get(key)
    if contents is None or not (contents.is_at(found) or contents.compare(path)):
        # Its other users detect by themselves that it was overwritten.
        contents = _CONTENTS[key] = Contents()
        if found.st_size:
            contents.compare(path)
    contents.confirm(found)
    return contents


def _read(path: str, start: int, size: int) -> bytes:
    """Read a part of a file, or as much as there is."""
    try:
        handle = os.open(path, os.O_RDONLY)
        try:
            if start:
                os.lseek(handle, start, os.SEEK_SET)
            return os.read(handle, size)
        finally:
            os.close(handle)
    except OSError:
        return b""


class StoreFile:
    """The file that the connections of one backend have open. Threads share it."""

    def __init__(self, path: str, label: str) -> None:
        self.path = os.path.abspath(path)
        self.is_long = False
        self._label = label
        self._is_open = False
        self._device = self._inode = 0
        self._contents = Contents()
        self._companions: dict[str, tuple[int, int]] = {}
        self._wal = self._shm = ""
        # The log after the last commit: its salt, and its size, up to the limit.
        self._salt, self._logged = b"", 0
        self._why: str | None = None
        self._warned_at, self._tried_at = 0, -WAL_PATIENCE

    def open(self, connect: Callable[[], sqlite3.Connection]) -> sqlite3.Connection:
        """Open a connection, and check which file it has open."""
        before = self._find()
        for _ in range(ATTEMPTS):
            connection = connect()
            after = self._find()
            if before is not None and after is not None and os.path.samestat(before, after):
                break
            # The file was created or replaced meanwhile.
            connection.close()
            before = after
        else:
            self._refuse("the file is replaced again and again")
        if not self._is_open:
            self._remember(after)
        elif not self._is_same(after):
            connection.close()
            self._refuse("another file has taken its place")
        return connection

    def check(self, is_committed: bool = False) -> None:
        """Check that the file is still in its place and whole, with one system call.

        After a commit, a change of the file in its place is a checkpoint of this process.
        """
        try:
            found = os.stat(self.path)
        except OSError as error:
            self._miss(error, "the file is gone")
            return
        contents = self._contents
        is_moved = found.st_ino != self._inode or found.st_dev != self._device
        if is_moved or self._why is not None:
            self._look(found)
        elif found.st_mtime_ns != contents.changed:
            if not (is_committed and contents.trust(found)):
                self._look(found)
        elif contents.due is not None and time.monotonic() >= contents.due:
            self._look(found)

    def check_committed(self) -> None:
        """Check the file and its log after a commit: the data may be in no file.

        Call `check` just before the commit: a change since then is this process's checkpoint.
        """
        try:
            self.check(is_committed=True)
            # SQLite has no locks on this file, which closing it would release.
            header = _read(self._wal, 0, WAL_HEADER)
            size = self._companion(self._wal)
            if size and len(header) == WAL_HEADER and header[:4] not in WAL_MAGIC:
                # SQLite has appended where the last commit ended; no reader finds that.
                self._refuse(f"{os.path.basename(self._wal)} was emptied")
            # SQLite itself truncates a restarted log to the limit.
            self._salt, self._logged = header[WAL_SALT], min(size, WAL_LIMIT)
            self.is_long = size > WAL_LIMIT
            self._companion(self._shm)
        except StoreReplacedError as error:
            raise StoreReplacedError(
                f"{error}. The last commit went to the former file and is lost with it"
            ) from error

    def check_log(self) -> None:
        """Check before a write that the log was not truncated, unless it has restarted since."""
        if not self._logged:
            return
        try:
            size = os.stat(self._wal).st_size
        except OSError:
            # `check_committed` looks for it.
            return
        # A checkpoint may leave an empty log; the next write shows whether it did.
        if 0 < size < self._logged and _read(self._wal, 0, WAL_HEADER)[WAL_SALT] == self._salt:
            self._refuse(f"{os.path.basename(self._wal)} was cut off")

    def forget(self) -> None:
        """Forget the log after all connections were closed: SQLite removes it with the last."""
        self._companions = {}
        self._salt, self._logged = b"", 0
        self.is_long = False

    def shorten(self, connection: sqlite3.Connection) -> None:
        """Try to truncate the log without waiting; log a warning if a reader holds it."""
        now = time.monotonic()
        if now < self._tried_at + WAL_PATIENCE:
            return
        self._tried_at = now
        with suppress(sqlite3.Error):
            timeout = connection.execute("PRAGMA busy_timeout").fetchone()[0]
            connection.execute("PRAGMA busy_timeout=0")
            try:
                held = connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
            finally:
                connection.execute(f"PRAGMA busy_timeout={timeout}")
            self._report(bool(held))

    def _report(self, is_held: bool) -> None:
        if not is_held:
            self.is_long = False
            if self._warned_at:
                logger.info("%s: the write-ahead log was cut back", self._label)
                self._warned_at = 0
            return
        size = os.stat(self._wal).st_size
        if size >= 2 * self._warned_at:
            self._warned_at = size
            logger.warning(
                "%s: the write-ahead log is %d MB long and cannot be cut back, because a reader's "
                "transaction is open; end it",
                self._label,
                size >> 20,
            )

    def _find(self) -> os.stat_result | None:
        try:
            return os.stat(self.path)
        except OSError:
            return None

    def _is_same(self, found: os.stat_result) -> bool:
        return (found.st_dev, found.st_ino) == (self._device, self._inode)

    def _remember(self, found: os.stat_result) -> None:
        self._device, self._inode = found.st_dev, found.st_ino
        # SQLite follows links, and keeps its log beside the file itself.
        real = os.path.realpath(self.path)
        self._wal, self._shm = f"{real}-wal", f"{real}-shm"
        self._contents = contents_of(self.path, found)
        self._is_open = True

    def _look(self, found: os.stat_result) -> None:
        """Examine a changed file; most changes are checkpoints."""
        if self._why is not None:
            self._refuse(self._why)
        if not self._is_open:
            return
        if not self._is_same(found):
            self._refuse("another file has taken its place")
        if found.st_size < self._contents.size:
            if not found.st_size:
                self._refuse("the file was emptied")
            if not self._is_whole(found.st_size):
                self._refuse("the file was cut off")
        verdict = self._contents.compare(self.path)
        if verdict is False and self._is_still(found):
            verdict = self._contents.compare(self.path)
            if verdict is False:
                self._refuse("the file was overwritten with another state")
        if verdict is True:
            self._contents.confirm(found)

    def _is_still(self, found: os.stat_result) -> bool:
        time.sleep(STILL)
        now = self._find()
        return now is not None and (now.st_mtime_ns, now.st_size) == (
            found.st_mtime_ns,
            found.st_size,
        )

    def _is_whole(self, size: int) -> bool:
        """Return whether SQLite itself shortened the file, as VACUUM does."""
        with NO_FORK, closing(sqlite3.connect(self.path, isolation_level=None)) as connection:
            try:
                pages, page = (
                    connection.execute(f"PRAGMA {name}").fetchone()[0]
                    for name in ("page_count", "page_size")
                )
                if int(pages) * int(page) <= size:
                    return True
                return bool(connection.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok")
            except sqlite3.OperationalError:
                # Another process holds the store: decided at the next check.
                return True
            except sqlite3.DatabaseError:
                return False

    def has_spilled(self) -> bool:
        """Return whether the log has pages of an open transaction, because its cache was full.

        Only for a forked child: this closes a file on which its parent has locks.
        """
        index = _read(self._shm, 0, INDEX_HEADER)
        if len(index) < INDEX_HEADER:
            return False
        page, committed = INDEX_STATE.unpack_from(index, INDEX_STATE_AT)
        frame = FRAME_HEADER + (page if page > 1 else 1 << 16)
        header = _read(self._wal, WAL_HEADER + committed * frame, FRAME_HEADER)
        return header[FRAME_SALT] == index[INDEX_SALT]

    def _companion(self, path: str) -> int:
        """Check a file that SQLite keeps beside the store's; return its size, 0 without one."""
        try:
            found = os.stat(path)
        except OSError as error:
            if path in self._companions:
                self._miss(error, f"{os.path.basename(path)} is gone")
            return 0
        identity = found.st_dev, found.st_ino
        if self._companions.setdefault(path, identity) != identity:
            self._refuse(f"another {os.path.basename(path)} has taken the place of the one in use")
        return found.st_size

    def _miss(self, error: OSError, why: str) -> None:
        # Without the right to read the folder it is unknown.
        if self._is_open and not isinstance(error, PermissionError):
            self._refuse(why)

    def _refuse(self, why: str) -> NoReturn:
        self._why = why
        raise StoreReplacedError(
            f"{self._label}: {why} since the store was opened; these connections no longer read or "
            "write: close the knowledge base and connect again"
        )

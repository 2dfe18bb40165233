"""The file of an SQLite store: whether it is still the one that is open, and how long its log is.

SQLite finds a file by its name once. When the file is deleted, renamed or replaced afterwards,
SQLite goes on in the file that it has open, which nobody else finds any more.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing, suppress
from typing import NamedTuple, NoReturn
from urllib.parse import quote
from weakref import WeakValueDictionary

from ...errors import StoreReplacedError

logger = logging.getLogger("kant_sql.sqlite")

# Beyond so many bytes the write-ahead log is cut back. SQLite moves it into the file at 4 MB; a
# large transaction, or a reader who stays, lets it grow.
WAL_LIMIT = 32 << 20
# How often to cut it back is tried while somebody reads from it, in seconds.
WAL_PATIENCE = 1.0
# How long a file must lie still before it counts as overwritten, in seconds: a checkpoint of
# another process moves parts of tables one after the other.
STILL = 0.25
# How long after a checkpoint of its own a process compares the file, in seconds. A comparison takes
# 4 ms, and a busy writer moves its log into the file every 20 ms.
COMPARE_AFTER = 1.0
ATTEMPTS = 10

_HEAD = "SELECT kb_id, revision, hash FROM head WHERE revision > 0 ORDER BY revision DESC LIMIT 1"
_HASH = "SELECT hash FROM revision WHERE kb_id = ? AND number = ?"


# A write-ahead log begins with a number, and a checksum's salt that each new beginning changes.
WAL_MAGIC = (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")
WAL_HEADER, WAL_SALT = 32, slice(16, 24)


class Landmark(NamedTuple):
    """A revision that the file holds apart from its log, and so will hold from then on."""

    kb_id: int
    revision: int
    hash: str


class Contents:
    """What a file held, apart from its log, when this process last compared it.

    All backends of the process share it: to read a file without its log, SQLite parses the whole
    schema again, which takes about 4 ms, and every checkpoint asks for it.

    Attributes:
        changed: the file's time of change then, in nanoseconds.
        size: its size then, in bytes.
        due: when the next comparison is due at the latest, on the monotonic clock; None when
            nothing has changed the file since the last.
    """

    def __init__(self) -> None:
        self._landmark: Landmark | None = None
        self.changed = self.size = 0
        self.due: float | None = None

    def is_at(self, found: os.stat_result) -> bool:
        """Return whether the file has not changed since."""
        return (found.st_mtime_ns, found.st_size) == (self.changed, self.size)

    def confirm(self, found: os.stat_result) -> None:
        """Take the file as it is now for the one that was compared."""
        self.changed, self.size = found.st_mtime_ns, found.st_size
        self.due = None

    def trust(self, found: os.stat_result) -> bool:
        """Take a change during a commit of this process for its checkpoint, until `due`."""
        now = time.monotonic()
        if found.st_size < self.size or now >= (self.due or now + 1):
            return False
        due = self.due or now + COMPARE_AFTER
        self.confirm(found)
        self.due = due
        return True

    def compare(self, path: str) -> bool | None:
        """Return whether the file still holds the landmark; None if that cannot be told now.

        A copy that is written over the file from outside changes neither its identity nor SQLite's
        book of what is in the log.
        """
        mark = self._landmark
        try:
            # As `immutable`, SQLite reads the file alone, and takes no lock.
            name = f"file:{quote(path)}?immutable=1"
            with closing(sqlite3.connect(name, uri=True)) as connection:
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
    """Return what a file holds, shared with who has it open, unless it was overwritten since."""
    key = found.st_dev, found.st_ino
    contents = _CONTENTS.get(key)
    if contents is None or not (contents.is_at(found) or contents.compare(path)):
        # Who has it open finds out by itself that it was overwritten.
        contents = _CONTENTS[key] = Contents()
        if found.st_size:
            contents.compare(path)
    contents.confirm(found)
    return contents


class StoreFile:
    """The file that the connections of one backend have open. Threads share it.

    Attributes:
        path: the file's absolute path: a change of folder does not matter.
        is_long: whether the log was beyond its limit after the last commit.
    """

    def __init__(self, path: str, label: str) -> None:
        self.path = os.path.abspath(path)
        self.is_long = False
        self._label = label
        self._is_open = False
        self._device = self._inode = 0
        self._contents = Contents()
        self._companions: dict[str, tuple[int, int]] = {}
        self._wal = self._shm = ""
        # The log after the last commit: since when it grows, and how long it was, up to the limit.
        self._salt, self._logged = b"", 0
        self._why: str | None = None
        self._warned_at, self._tried_at = 0, -WAL_PATIENCE

    def open(self, connect: Callable[[], sqlite3.Connection]) -> sqlite3.Connection:
        """Make a connection, and be sure which file it has open."""
        before = self._find()
        for _ in range(ATTEMPTS):
            connection = connect()
            after = self._find()
            if before is not None and after is not None and os.path.samestat(before, after):
                break
            # The file was created, or replaced just now.
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

    def check(self) -> None:
        """See that the file is still in its place, and whole, with one call of the system."""
        try:
            found = os.stat(self.path)
        except OSError as error:
            self._miss(error, "the file is gone")
            return
        if (
            found.st_mtime_ns != self._contents.changed
            or found.st_ino != self._inode
            or found.st_dev != self._device
            or self._why is not None
            or (self._contents.due is not None and time.monotonic() >= self._contents.due)
        ):
            self._look(found)

    def check_committed(self) -> None:
        """Do so after a commit, for the log, too: what was committed may be in no file any more.

        Call `check` just before the commit: what has changed since then is its own checkpoint.
        """
        try:
            self._check_own_change()
            self.is_long = self._check_log() > WAL_LIMIT
            self._companion(self._shm)
        except StoreReplacedError as error:
            raise StoreReplacedError(
                f"{error}. What was just committed went to the file that was there before, and is "
                "lost with it"
            ) from error

    def _check_own_change(self) -> None:
        found = self._find()
        is_mine = found is not None and self._why is None and self._is_same(found)
        if not is_mine or found is None:
            self.check()
        elif found.st_mtime_ns != self._contents.changed and not self._contents.trust(found):
            self._look(found)

    def check_log(self) -> None:
        """See, before a write, that the log is as long as it was, or has begun again since."""
        if not self._logged:
            return
        try:
            size = os.stat(self._wal).st_size
        except OSError:
            # After the commit it is looked for.
            return
        # An empty one may be what a checkpoint leaves: what is written to it next will say.
        if 0 < size < self._logged and self._read_header()[WAL_SALT] == self._salt:
            self._refuse(f"{os.path.basename(self._wal)} was cut off")

    def forget(self) -> None:
        """Forget the log, after all connections were closed: SQLite removes it with the last."""
        self._companions = {}
        self._salt, self._logged = b"", 0
        self.is_long = False

    def shorten(self, connection: sqlite3.Connection) -> None:
        """Try to cut the log back, without waiting; who still reads from it is warned of."""
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
        # SQLite follows links, too, and keeps its log beside the file itself.
        real = os.path.realpath(self.path)
        self._wal, self._shm = f"{real}-wal", f"{real}-shm"
        self._contents = contents_of(self.path, found)
        self._is_open = True

    def _look(self, found: os.stat_result) -> None:
        """Find out what has changed the file; most often a part of the log was moved there."""
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
        """Return whether a file that has become shorter was made so by SQLite, as VACUUM does."""
        with closing(sqlite3.connect(self.path, isolation_level=None)) as connection:
            try:
                pages, page = (
                    connection.execute(f"PRAGMA {name}").fetchone()[0]
                    for name in ("page_count", "page_size")
                )
                if int(pages) * int(page) <= size:
                    return True
                return bool(connection.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok")
            except sqlite3.OperationalError:
                # Somebody holds the store. The next look will say.
                return True
            except sqlite3.DatabaseError:
                return False

    def _check_log(self) -> int:
        """Check the log after a commit; give its size, 0 without one."""
        header = self._read_header()
        size = self._companion(self._wal)
        if size and len(header) == WAL_HEADER and header[:4] not in WAL_MAGIC:
            # SQLite has written on where the last commit ended, and nobody will read it.
            self._refuse(f"{os.path.basename(self._wal)} was emptied")
        # Beyond the limit, SQLite itself cuts a log off that has begun again.
        self._salt, self._logged = header[WAL_SALT], min(size, WAL_LIMIT)
        return size

    def _read_header(self) -> bytes:
        # SQLite has no locks on this file that closing it here could end.
        with suppress(OSError):
            handle = os.open(self._wal, os.O_RDONLY | getattr(os, "O_CLOEXEC", 0))
            try:
                return os.read(handle, WAL_HEADER)
            finally:
                os.close(handle)
        return b""

    def _companion(self, path: str) -> int:
        """Check a file that SQLite keeps beside the store's; give its size, 0 without one."""
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
        # Without a right to the folder it cannot be told.
        if self._is_open and not isinstance(error, PermissionError):
            self._refuse(why)

    def _refuse(self, why: str) -> NoReturn:
        self._why = why
        raise StoreReplacedError(
            f"{self._label}: {why} since the store was opened; nothing is read or written by these "
            "connections any more: close the knowledge base and connect again"
        )

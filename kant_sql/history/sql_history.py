"""The past of a knowledge base in an SQL store."""

from __future__ import annotations

import logging
from collections.abc import Iterator

from ..dao.base import SqlDao
from ..knowledge.changes import Change
from .anchors import Anchor, read_anchor
from .archiving import Archived, archive
from .diffing import diff
from .following import read_changes
from .interfaces import Element, History, When
from .log import read_log, read_revisions
from .moments import state_at
from .restoring import restore
from .revisions import LogEntry, Revision
from .verifying import Progress, Verification, verify
from .versions import Version, blame, read_versions
from .watching import watch

logger = logging.getLogger("kant_sql.history")


class SqlHistory(SqlDao, History):
    """The past of a knowledge base in an SQL store, up to now or up to one revision."""

    def revisions(self, after: int = 0, *, limit: int | None = None) -> list[Revision]:
        """Read revisions, oldest first."""
        return read_revisions(self._store, after, limit, self._at)

    def log(
        self,
        since: When | None = None,
        *,
        until: When | None = None,
        actor: str | None = None,
        element: Element | None = None,
        limit: int | None = None,
    ) -> Iterator[LogEntry]:
        """Read revisions with what they changed, newest first, in constant memory."""
        return self._while_open(
            read_log(self._store, since, until, actor, element, limit, self._at)
        )

    def changes(self, after: int = 0, *, limit: int | None = None) -> Iterator[LogEntry]:
        """Follow what changes, oldest first: a feed that can be resumed."""
        return self._while_open(read_changes(self._store, after, limit, self._at))

    def _while_open(self, entries: Iterator[LogEntry]) -> Iterator[LogEntry]:
        for entry in entries:
            self._store.backend.refuse_closed()
            yield entry

    def watch(self, after: int | None = None, *, timeout: float | None = None) -> int | None:
        """Wait until there is a revision that the caller does not know."""
        return watch(self._store, after, timeout, self._at)

    def diff(self, a: When, b: When) -> list[Change]:
        """Tell what is different between two states."""
        return diff(self._store, a, b, self._at)

    def history(self, element: Element) -> list[Version]:
        """Tell when an element held, and who asserted and retracted it."""
        return read_versions(self._store, element, self._at)

    def blame(self, element: Element) -> Version | None:
        """Tell who asserted what holds now, why, and since when."""
        return blame(self._store, element, self._at)

    def restore(
        self, when: When, *, reason: str | None = None, actor: str | None = None
    ) -> int | None:
        """Make the state equal to a past one, as a new revision."""
        self._check_writable()
        past = state_at(self._store, when)
        made = restore(self._store, past, reason, actor)
        logger.info(
            "knowledge base %r: revision %d restored, by revision %s", self._store.name, past, made
        )
        return made

    def verify(
        self,
        anchor: Anchor | None = None,
        *,
        progress: Progress | None = None,
        structure: bool = True,
    ) -> Verification:
        """Recompute every hash from the tables, and compare what is said twice."""
        return verify(self._store, anchor, progress, structure)

    def anchor(self) -> Anchor:
        """Give the heads of all knowledge bases of the store, to keep elsewhere."""
        return read_anchor(self._store)

    def archive(
        self,
        before: When,
        *,
        to: str,
        dry_run: bool = False,
        reason: str | None = None,
        actor: str | None = None,
        progress: Progress | None = None,
    ) -> Archived:
        """Move versions that ended before a time into another store."""
        self._check_writable()
        moved = archive(self._store, before, to, dry_run, actor, reason, progress)
        logger.info(
            "knowledge base %r: %d versions that ended up to revision %d %s %s",
            self._store.name,
            sum(moved.versions.values()),
            moved.upto,
            "would be moved to" if dry_run else "were moved to",
            moved.target,
        )
        return moved

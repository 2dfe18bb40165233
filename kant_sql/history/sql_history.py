"""The past of a knowledge base in an SQL store."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from typing_extensions import override

from .. import html
from ..arguments import expect
from ..dao.base import SqlDao
from ..dao.interfaces import Progress
from ..errors import InvalidArgumentError
from ..moment_text import When
from ..sql.changes import Change
from .anchors import Anchor, read_anchor
from .archive.archive import Archived, archive
from .audit import read_audit
from .diff import diff, diff_lines, state_lines
from .excerpts import StateReader
from .follow import read_changes, watch
from .interfaces import Element, History
from .log import read_log, read_revisions
from .moments import state_at
from .overview import Overview, Tally, read_overview, read_tally
from .replication.calls import push_from
from .replication.promote import promote
from .replication.push import Pushed
from .restore import restore
from .revisions import LogEntry, Revision
from .timeline import Timeline, read_timeline
from .verify.verify import Verification, verify
from .versions import Version, blame, read_versions
from .window import TIMELINE_KINDS, check_question

if TYPE_CHECKING:
    import pyarrow

logger = logging.getLogger("kant_sql.history")


class SqlHistory(SqlDao, History):
    """The past of a knowledge base in an SQL store, up to now or up to one revision."""

    @override
    def revisions(self, after: int = 0, *, limit: int | None = None) -> list[Revision]:
        return read_revisions(self._store, after, limit, self._at)

    @override
    def log(
        self,
        since: When | None = None,
        *,
        until: When | None = None,
        actor: str | None = None,
        element: Element | None = None,
        limit: int | None = None,
    ) -> Iterator[LogEntry]:
        def read(most: int | None) -> Iterator[LogEntry]:
            return read_log(self._store, since, until, actor, element, most, self._at)

        return self._feed(read, limit)

    @override
    def changes(self, after: int = 0, *, limit: int | None = None) -> Iterator[LogEntry]:
        return self._feed(lambda most: read_changes(self._store, after, most, self._at), limit)

    def _feed(
        self, read: Callable[[int | None], Iterator[LogEntry]], limit: int | None
    ) -> Iterator[LogEntry]:
        def again(most: int) -> Iterator[LogEntry]:
            return read(most if limit is None else min(most, limit))

        return html.Feed(self._while_open(read(limit)), again=again, noun="revision")

    def _while_open(self, entries: Iterator[LogEntry]) -> Iterator[LogEntry]:
        for entry in entries:
            self._store.refuse_closed()
            yield entry

    @override
    def watch(self, after: int | None = None, *, timeout: float | None = None) -> int | None:
        return watch(self._store, after, timeout, self._at)

    @override
    def _watch(
        self, after: int | None, timeout: float | None, is_ended: Callable[[], bool]
    ) -> int | None:
        return watch(self._store, after, timeout, self._at, is_ended)

    @override
    def diff(self, a: When, b: When) -> list[Change]:
        return diff(self._store, a, b, self._at)

    @override
    def diff_with(self, other: History) -> list[Change]:
        expect(other, History, "what it is compared with", InvalidArgumentError)
        return diff_lines(self._state_lines(), other._state_lines())

    @override
    def _state_lines(self) -> list[tuple[str, str]]:
        return state_lines(self._store, self._at)

    @override
    def _overview(self) -> Overview:
        return read_overview(self._store, self._at)

    @override
    def _reader(self) -> StateReader:
        return StateReader(self._store, self._at)

    @override
    def _tally(self, since: When | None, until: When | None, most: int) -> Tally:
        return read_tally(self._store, since, until, self._at, most)

    @override
    def history(self, element: Element) -> list[Version]:
        return read_versions(self._store, element, self._at)

    @override
    def blame(self, element: Element) -> Version | None:
        return blame(self._store, element, self._at)

    @override
    def timeline(
        self,
        since: When | None = None,
        *,
        until: When | None = None,
        predicate: str | None = None,
        object: str | None = None,
        text: str | None = None,
        kinds: Iterable[str] = TIMELINE_KINDS,
        lanes: int = 50,
        after: str | None = None,
        slices: int = 600,
    ) -> Timeline:
        question = check_question(kinds, predicate, object, text, lanes, slices, after)
        return read_timeline(self._store, since, until, question, self._at)

    @override
    def to_arrow(self, view: str) -> pyarrow.Table:
        return read_audit(self._store, view, self._at)

    @override
    def restore(
        self, when: When, *, reason: str | None = None, actor: str | None = None
    ) -> int | None:
        self._check_writable()
        past = state_at(self._store, when)
        made = restore(self._store, past, reason, actor)
        logger.info(
            "knowledge base %r: revision %d restored, by revision %s", self._store.name, past, made
        )
        return made

    @override
    def verify(
        self,
        anchor: Anchor | None = None,
        *,
        progress: Progress | None = None,
        structure: bool = True,
        resume: bool = False,
        keep: bool = False,
    ) -> Verification:
        return verify(self._store, anchor, progress, structure, resume, keep)

    @override
    def anchor(self) -> Anchor:
        return read_anchor(self._store)

    @override
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

    @override
    def push(
        self,
        url: str,
        *,
        archive: str | None = None,
        adopt: bool = False,
        progress: Progress | None = None,
    ) -> Pushed:
        self._check_writable()
        sent = push_from(self._store, url, archive, adopt, progress)
        if sent.revisions:
            logger.info(
                "knowledge base %r: revisions %d to %d were sent to %s",
                self._store.name,
                sent.before + 1,
                sent.revision,
                sent.target,
            )
        return sent

    @override
    def promote(self, *, reason: str | None = None, actor: str | None = None) -> int | None:
        self._check_writable()
        made = promote(self._store, actor, reason)
        if made is not None:
            logger.info("knowledge base %r: revision %d promoted it", self._store.name, made)
        return made

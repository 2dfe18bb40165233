"""One consistent state of a store, read batch by batch."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import datetime
from typing import TYPE_CHECKING, NamedTuple

from ..arguments import optional_text, shown
from ..errors import InvalidArgumentError, KantSqlError
from ..history.moments import (
    MICROSECOND,
    check_number,
    check_zone,
    clamped,
    just_before,
    refuse_reversed,
)
from ..history.revisions import FIRST_MOMENT, LAST_MOMENT, read_numbered
from ..knowledge.canonical import time_text
from ..moment_text import Moment, When, read_when
from ..sql.audit_views import AuditView, arrow_schema, find_audit_view, import_arrow, stream_view
from ..sql.catalog import read_heads
from ..sql.dialects import create_backend
from ..sql.dialects.base import Session
from ..sql.lanes import revisions_at
from ..sql.schema import check
from ..sql.valid_periods import ValidRange

if TYPE_CHECKING:
    import pyarrow

# The first and the last revision to read.
Window = tuple[int, int]


class KnowledgeBaseState(NamedTuple):
    """The state of a knowledge base in an export.

    Attributes:
        name: its name.
        revision: the number of its last revision.
        hash: the hash of that revision, which covers all earlier ones.
        committed_at: when that was committed, as 2026-03-02T14:03:00.000000Z.
        archived: versions that ended up to this revision are in an archive; 0 without one.
    """

    name: str
    revision: int
    hash: str
    committed_at: str
    archived: int


class StoreSnapshot:
    """A read transaction on a store."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.label = session.backend.label  # the URL for messages, without passwords
        self.ids: dict[str, int] = {}  # ids by name
        self.states = []  # the knowledge bases that have a revision, oldest first
        for kb_id, name, revision, digest, committed_at, archived in read_heads(session):
            self.ids[name] = kb_id
            at = time_text(committed_at)
            self.states.append(KnowledgeBaseState(name, revision, digest, at, archived))

    def chosen(self, name: str | None) -> list[KnowledgeBaseState]:
        """Return the knowledge base of a name, or all."""
        found = [state for state in self.states if name in (None, state.name)]
        if name is None or found:
            return found
        listed = ", ".join(repr(state.name) for state in self.states[:20]) or "none yet"
        raise KantSqlError(
            f"there is no knowledge base {shown(name)} in this store; choose one of: {listed}"
        )

    def window(
        self, state: KnowledgeBaseState, since: Moment | None, until: Moment | None
    ) -> Window | None:
        """Return the revisions from `since` to `until`, both inclusive; None for all."""
        if since is None and until is None:
            return None
        low, high = self._revisions(state, since, until)
        refuse_reversed(since, until, low, high)
        return low, high

    def _revisions(
        self, state: KnowledgeBaseState, since: Moment | None, until: Moment | None
    ) -> Window:
        low, high, kb_id = 1, state.revision, self.ids[state.name]
        if isinstance(since, datetime):
            low = self._revision_at(kb_id, just_before(since)) + 1
        elif since is not None:
            low = max(1, check_number(state.name, since, state.revision))
        if isinstance(until, datetime):
            high = self._revision_at(kb_id, clamped(until))
        elif until is not None:
            high = max(1, check_number(state.name, until, state.revision))
        return low, high

    def _revision_at(self, kb_id: int, moment: datetime) -> int:
        return revisions_at(self.session, kb_id, [moment])[0]

    def valid_range(
        self, state: KnowledgeBaseState, since: When | None, until: When | None
    ) -> ValidRange:
        """Return a range of valid times; earlier ones may be in the archive."""
        bounds = check_window(since, until, state.name)
        numbers = {number for number in (*bounds, state.archived) if isinstance(number, int)}
        told = read_numbered(self.session, self.ids[state.name], numbers)
        times = {0: FIRST_MOMENT, **{number: one.committed_at for number, one in told.items()}}
        begin, end = (times[one] if isinstance(one, int) else one for one in bounds)
        begin = clamped(begin or FIRST_MOMENT)
        if state.archived:
            begin = max(begin, times[state.archived] + MICROSECOND)
        end = clamped(end or LAST_MOMENT)
        low, high = self._revisions(state, begin, end)
        return ValidRange(begin, end, low - 1, high, state.revision)

    def batches(
        self, view: AuditView, state: KnowledgeBaseState, window: Window | None = None
    ) -> Iterator[pyarrow.RecordBatch]:
        """Read a view's rows of a knowledge base."""
        return stream_view(self.session, view, self.ids[state.name], window)


def check_window(
    since: When | None, until: When | None, knowledge_base: str | None
) -> tuple[Moment | None, Moment | None]:
    """Read bounds; refuse impossible ones, and numbers for many knowledge bases."""
    bounds = read_when(since), read_when(until)
    for bound in bounds:
        if isinstance(bound, datetime):
            check_zone(bound)
        elif bound is not None and knowledge_base is None:
            raise InvalidArgumentError(
                f"revision {shown(bound)} is of one knowledge base: choose that, or give a time"
            )
    return bounds


@contextmanager
def open_snapshot(url: str) -> Iterator[StoreSnapshot]:
    """Open a store to read one consistent state; create nothing."""
    check(url)
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        session.begin(write=False)
        try:
            yield StoreSnapshot(session)
        finally:
            session.rollback()


@contextmanager
def open_reader(
    url: str, *, view: str, knowledge_base: str | None = None
) -> Iterator[pyarrow.RecordBatchReader]:
    """Read a view for auditors in batches, in constant memory, from one consistent state.

    Args:
        url: the database URL.
        view: the view's name, such as `fact` or `audit_fact`.
        knowledge_base: the one whose rows they are; None for all of the store.

    Returns:
        A context manager with a `pyarrow.RecordBatchReader`, to read within its block, also by
        DuckDB and polars.

    Raises:
        InvalidArgumentError: there is no such view.
        KantSqlError: there is no such knowledge base.
        ExtraMissingError: pyarrow is not installed; the extra `data` has it.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be read.
    """
    found = find_audit_view(view)
    optional_text(knowledge_base, "knowledge_base")
    arrow = import_arrow()
    with open_snapshot(url) as snapshot:
        states = snapshot.chosen(knowledge_base)
        batches = (batch for state in states for batch in snapshot.batches(found, state))
        with (
            closing(batches),
            arrow.RecordBatchReader.from_batches(arrow_schema(found), batches) as reader,
        ):
            yield reader

"""Making the target what the knowledge base was at a revision."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from sqlalchemy import bindparam, select

from ..backends import Backend, Query, Session
from ..errors import ConflictError
from ..head import Committed, Head, move_head
from ..knowledge.loading import KB
from ..reader import end_session
from ..retry import retrying
from ..tables import RevisionRow
from .copying import Copied, Copy
from .identities import Stores
from .target import Target, check_same, read_archived_revision

# So many versions are to be in one transaction on the target, as far as whole revisions allow.
ROWS = 20_000
FIRST_REVISIONS = 50

_LAST = Query(
    select(RevisionRow.hash, RevisionRow.committed_at).where(
        RevisionRow.kb_id == KB, RevisionRow.number == bindparam("at")
    )
)


def replicate(
    source: Backend,
    kb_id: int,
    target: Target,
    upto: int,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Make the target what the knowledge base was at a revision, or go on with that.

    It takes several transactions; each ends with the target at some revision, all of it there.

    Args:
        source: the store that is archived.
        kb_id: the knowledge base there.
        target: the same knowledge base in the target.
        upto: the revision.
        progress: called with the number of revisions that the target has, and is to have.

    Raises:
        ConflictError: the target has something else, or lacks what was moved before.
    """
    revisions = FIRST_REVISIONS
    at = -1
    while at < upto:
        advance = partial(_advance, source, kb_id, target, upto, revisions)
        at, rows = retrying(target.backend, advance)
        if progress is not None:
            progress(min(at, upto), upto)
        if rows < ROWS // 2:
            revisions *= 2
        elif rows > ROWS:
            revisions = max(1, revisions * ROWS // rows)


def _advance(
    source: Backend, kb_id: int, target: Target, upto: int, revisions: int
) -> tuple[int, int]:
    """Copy some revisions; give the last one that is there, and how many versions were copied."""
    with target.locked() as (session, target_kb, head), _reading(source) as reader:
        check_same(reader, kb_id, session, target_kb, head.revision)
        if head.revision >= upto:
            return head.revision, 0
        high = min(upto, head.revision + revisions)
        stores = Stores(reader, kb_id, session, target_kb)
        may_return = read_archived_revision(reader, kb_id) > 0
        copied = Copy(stores, head.revision + 1, high, may_return).run()
        _move(stores, head, high, copied)
        return high, copied.rows


def _move(stores: Stores, head: Head, number: int, copied: Copied) -> None:
    source, source_kb, target, target_kb = stores
    row = source.first(_LAST, kb=source_kb, at=number)
    if row is None:
        raise ConflictError(f"{source.backend.label}: revision {number} is gone; verify the store")
    made = Committed(number, row[0], target.from_time(source.to_time(row[1])))
    definitions = max(head.definition_revision, copied.definition_revision)
    move_head(target, target_kb, made, definitions, max(head.next_id, copied.largest_id + 1))
    target.commit(target_kb)


@contextmanager
def _reading(backend: Backend) -> Iterator[Session]:
    """Read one state."""
    session = backend.session()
    try:
        session.begin(write=False)
        yield session
    finally:
        end_session(session)

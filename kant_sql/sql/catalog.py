"""The names and the heads of the knowledge bases of a store."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import datetime

from sqlalchemy import literal_column, select

from ..errors import UNREADABLE
from .dialects import create_backend
from .dialects.base import Session
from .query import Query, first_rows
from .schema import check
from .tables import HeadRow, KnowledgeBaseRow, RevisionRow, VerificationRow

_EVERY_NAME = Query(select(KnowledgeBaseRow.name).order_by(KnowledgeBaseRow.id))
# Columns that exist in every schema version: a downgrade reads them first.
_REVISIONS = Query(
    select(KnowledgeBaseRow.name, HeadRow.revision)
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .where(HeadRow.revision > literal_column("0"))
    .order_by(KnowledgeBaseRow.id)
)
ANY_REVISION = Query(first_rows(select(RevisionRow.number), literal_column("1")))

_STATES = Query(
    select(
        KnowledgeBaseRow.id,
        KnowledgeBaseRow.name,
        HeadRow.revision,
        HeadRow.hash,
        HeadRow.committed_at,
        HeadRow.archived_revision,
    )
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .where(HeadRow.revision > literal_column("0"))
    .order_by(KnowledgeBaseRow.id)
)


def read_heads(session: Session) -> list[tuple[int, str, int, str, datetime, int]]:
    """Read id, name, last revision, its hash and time, what is archived, of each that has one."""
    return [
        (id_, name, revision, digest, session.to_time(committed_at), archived)
        for id_, name, revision, digest, committed_at, archived in session.rows(_STATES)
    ]


_COMPLETE = Query(
    select(KnowledgeBaseRow.name, VerificationRow.complete_at)
    .join(VerificationRow, VerificationRow.kb_id == KnowledgeBaseRow.id)
    .where(VerificationRow.complete_at.is_not(None))
)


def complete_verifications(url: str) -> dict[str, datetime]:
    """Read when each knowledge base was last verified from revision 1 on."""
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        found = {}
        for name, raw in session.rows(_COMPLETE):
            # What cannot be read cannot have been kept.
            with suppress(*UNREADABLE):
                found[name] = session.to_time(raw)
        return found


def revision_counts(url: str) -> dict[str, int]:
    """Count the revisions of each knowledge base, whatever the version of the tables."""
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        return dict(session.rows(_REVISIONS))


@contextmanager
def removed_on_failure(url: str) -> Iterator[None]:
    """Remove the SQLite file that the block creates, when the block fails.

    A file that is in use, or holds a revision, stays.
    """
    with closing(create_backend(url)) as backend:
        is_new = not backend.exists()
        try:
            yield
        except BaseException:
            if is_new:
                backend.remove(ANY_REVISION)
            raise


def written_names(url: str) -> list[str]:
    """List the names of the knowledge bases of a store that have a revision. Nothing is created."""
    check(url)
    return [*revision_counts(url)]


def every_name(url: str) -> list[str]:
    """List the knowledge bases of a store, those without a revision or a head, too."""
    check(url)
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        return [name for (name,) in session.rows(_EVERY_NAME)]

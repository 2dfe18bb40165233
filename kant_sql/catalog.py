"""Which knowledge bases a store holds, and how far they have come."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import datetime
from typing import NamedTuple

from sqlalchemy import and_, literal_column, select

from .backends import Query, create_backend, first_rows
from .schema import check
from .tables import HeadRow, KnowledgeBaseRow, RevisionRow

_NAMES = Query(
    select(KnowledgeBaseRow.name)
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .where(HeadRow.revision > literal_column("0"))
    .order_by(KnowledgeBaseRow.id)
)
_EVERY_NAME = Query(select(KnowledgeBaseRow.name).order_by(KnowledgeBaseRow.id))
# What every version of the tables has: it is read before they are brought back to an earlier one.
_REVISIONS = Query(
    select(KnowledgeBaseRow.name, HeadRow.revision)
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .where(HeadRow.revision > literal_column("0"))
    .order_by(KnowledgeBaseRow.id)
)
_HEADS = Query(
    select(
        KnowledgeBaseRow.name,
        HeadRow.revision,
        RevisionRow.committed_at,
        RevisionRow.actor,
        RevisionRow.reason,
    )
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .join(
        RevisionRow,
        and_(RevisionRow.kb_id == HeadRow.kb_id, RevisionRow.number == HeadRow.revision),
    )
    .order_by(KnowledgeBaseRow.id)
)
_ANY_REVISION = Query(first_rows(select(RevisionRow.number), literal_column("1")))


class Standing(NamedTuple):
    """A knowledge base and its last revision.

    Attributes:
        name: its name.
        revision: the number of its last revision.
        committed_at: when that was made, in UTC.
        actor: who made it.
        reason: why.
    """

    name: str
    revision: int
    committed_at: datetime
    actor: str | None
    reason: str | None


def standings(url: str) -> list[Standing]:
    """List the knowledge bases of a store with their last revisions. Nothing is created.

    Args:
        url: the database URL.

    Returns:
        The knowledge bases, the oldest first; one that was never written to is not among them.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be opened.
    """
    check(url)
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        return [
            Standing(name, revision, session.to_time(committed_at), actor, reason)
            for name, revision, committed_at, actor, reason in session.rows(_HEADS)
        ]


def revision_counts(url: str) -> dict[str, int]:
    """Count the revisions of a store with tables, of whichever version these are.

    Args:
        url: the database URL.

    Returns:
        How many revisions each knowledge base has that was ever written to, by its name.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
        StoreError: the database cannot be opened, or has no tables.
    """
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        return dict(session.rows(_REVISIONS))


@contextmanager
def removed_on_failure(url: str) -> Iterator[None]:
    """Remove the SQLite file that the `with` block creates, when the block fails.

    A file that somebody else has open, or in which there is a revision, stays.

    Args:
        url: the database URL.

    Yields:
        Nothing.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
    """
    with closing(create_backend(url)) as backend:
        is_new = not backend.exists()
        try:
            yield
        except BaseException:
            if is_new:
                backend.remove(_ANY_REVISION)
            raise


def knowledge_bases(url: str) -> list[str]:
    """List the knowledge bases of a store. Nothing is created.

    Args:
        url: the database URL.

    Returns:
        Their names, the oldest first; one that was never written to is not among them.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be opened.
    """
    return _read_names(url, _NAMES)


def every_name(url: str) -> list[str]:
    """List the knowledge bases of a store by their rows alone, whatever else there is of them.

    Args:
        url: the database URL.

    Returns:
        Their names, the oldest first.

    Raises:
        InvalidUrlError: the URL cannot be read, or is of a dialect without a backend.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database cannot be opened.
    """
    return _read_names(url, _EVERY_NAME)


def _read_names(url: str, query: Query) -> list[str]:
    check(url)
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        return [row[0] for row in session.rows(query)]

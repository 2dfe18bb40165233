"""Which knowledge bases a store holds."""

from __future__ import annotations

from contextlib import closing

from sqlalchemy import literal_column, select

from .backends import Query, create_backend
from .schema import check
from .tables import HeadRow, KnowledgeBaseRow

_NAMES = Query(
    select(KnowledgeBaseRow.name)
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .where(HeadRow.revision > literal_column("0"))
    .order_by(KnowledgeBaseRow.id)
)
_EVERY_NAME = Query(select(KnowledgeBaseRow.name).order_by(KnowledgeBaseRow.id))


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

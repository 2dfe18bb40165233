"""Repeatable requests: a written one is found by the client's key."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import bindparam, delete, func, select

from ..sql.dialects.base import Session
from ..sql.query import Query
from ..sql.rows import KB
from ..sql.tables import RequestRow, RevisionRow
from .head import find_knowledge_base
from .store import Store
from .transaction import Transaction

_FIND = Query(
    select(RequestRow.number, RequestRow.digest, RequestRow.results).where(
        RequestRow.kb_id == KB, RequestRow.key == bindparam("key")
    )
)
_OLD = (
    select(func.max(RevisionRow.number))
    .where(RevisionRow.kb_id == KB, RevisionRow.committed_at < bindparam("before"))
    .scalar_subquery()
)
_FORGET = Query(delete(RequestRow).where(RequestRow.kb_id == KB, RequestRow.number <= _OLD))


class WrittenRequest(NamedTuple):
    """A written request, from which its answer is made again."""

    number: int  # the revision that it made
    digest: str  # the digest of the request
    results: list[Any]  # the results of its changes


def find_request(transaction: Transaction, key: str) -> WrittenRequest | None:
    """Find a written request, under the lock of the head."""
    row = transaction.session.first(_FIND, kb=transaction.kb_id, key=key)
    return None if row is None else WrittenRequest(row[0], row[1], json.loads(row[2]))


def keep_request(transaction: Transaction, key: str, digest: str, results: Sequence[Any]) -> None:
    """Keep a request with the revision, if there is one."""
    transaction.request = key, digest, json.dumps([*results])


def forget_requests(store: Store, age: timedelta) -> None:
    """Remove the requests of older revisions; this makes no revision."""

    def work(session: Session) -> None:
        before = session.from_time(datetime.now(UTC) - age)
        kb_id = find_knowledge_base(session, store.name)
        if kb_id is not None:
            session.run(_FORGET, kb=kb_id, before=before)

    store.write_beside(work)

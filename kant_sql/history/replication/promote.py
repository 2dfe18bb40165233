"""Makes a knowledge base of its own of a replica."""

from __future__ import annotations

import logging

from sqlalchemy import bindparam, null, update

from ...knowledge.canonical import promotion_text
from ...sql.changes import ASSERTED, PROMOTION, Change
from ...sql.query import Insert, Query
from ...sql.rows import table_of
from ...sql.tables import HeadRow, PromotionRow
from ...store.head import check_last
from ...store.state import State

logger = logging.getLogger("kant_sql.history")

_NEW_PROMOTION = Insert(
    table_of(PromotionRow), "kb_id", "id", "since", "revision", "origin", "text"
)
_FORGET_ORIGIN = Query(
    update(HeadRow)
    .where(HeadRow.kb_id == bindparam("kb"))
    .values(origin=null(), origin_revision=null(), origin_committed_at=null(), heard_at=null())
)


def promote(state: State, *, reason: str | None = None, actor: str | None = None) -> int | None:
    """Make a knowledge base of its own of a replica: from now on it is written to here.

    That is a revision; the origin's later revisions are refused.

    Args:
        reason: why.
        actor: who promotes; by default the knowledge base's actor.

    Returns:
        The revision; None when this is not a replica.

    Raises:
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.store.promote() is None
        True
    """
    store = state.store
    with store.transaction(actor, reason, promotes=True) as transaction:
        head, number = transaction.head, transaction.number
        if head.origin is None:
            return None
        check_last(transaction.session, transaction.kb_id, head)
        id_ = transaction.allocate()
        text = promotion_text(id_, head.revision, head.origin)
        row = (transaction.kb_id, id_, number, head.revision, head.origin, text)
        transaction.records.add(Change(ASSERTED, PROMOTION, text), [(_NEW_PROMOTION, row)])
        transaction.session.run(_FORGET_ORIGIN, kb=transaction.kb_id)
    logger.info("knowledge base %r: revision %d promoted it", store.name, number)
    return number

"""The statements that find propositions, and let them hold or hold no more."""

from __future__ import annotations

from sqlalchemy import bindparam, select

from ..backends import Query, in_list
from ..tables import PropositionRow, PropositionVersionRow
from .loading import KB
from .past import IntervalTable

_SINCE = (
    select(PropositionVersionRow.since)
    .where(PropositionVersionRow.kb_id == PropositionRow.kb_id)
    .where(PropositionVersionRow.proposition_id == PropositionRow.id)
    .where(PropositionVersionRow.until.is_(None))
)
FIND = Query(
    select(
        PropositionRow.id, PropositionRow.arguments, PropositionRow.text, _SINCE.scalar_subquery()
    ).where(
        PropositionRow.kb_id == KB,
        PropositionRow.is_goal == bindparam("is_goal"),
        PropositionRow.predicate_id == bindparam("predicate"),
        in_list(PropositionRow.arguments, "arguments"),
    )
)
VERSIONS = IntervalTable(PropositionVersionRow, "proposition_id")
# Each id by itself, for SQLite would rather walk all versions there ever were than sort a list.
OPEN = Query(
    select(PropositionRow.id, _SINCE.scalar_subquery()).where(
        PropositionRow.kb_id == KB, in_list(PropositionRow.id, "ids")
    )
)
CLOSED_HERE = Query(
    select(
        PropositionRow.id,
        select(PropositionVersionRow.since)
        .where(PropositionVersionRow.kb_id == PropositionRow.kb_id)
        .where(PropositionVersionRow.proposition_id == PropositionRow.id)
        .where(PropositionVersionRow.since < bindparam("at"))
        .where(PropositionVersionRow.until == bindparam("at"))
        .scalar_subquery(),
    ).where(PropositionRow.kb_id == KB, in_list(PropositionRow.id, "ids"))
)

"""The statements that find propositions, and let them hold or hold no more."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    bindparam,
    delete,
    literal_column,
    null,
    select,
    update,
)

from ..backends import Query, in_list
from ..tables import PropositionRow, PropositionVersionRow
from .loading import KB
from .past import HOLDS_NOW, Fork
from .rows import table_of

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
VERSIONS = table_of(PropositionVersionRow)
# By the index of what is open, which has one row of each id. The number of a revision finds as many
# rows as the revision made, and PostgreSQL, before it has statistics, takes those to be few.
_OPEN_VERSION = (
    VERSIONS.c.kb_id == bindparam("kb"),
    VERSIONS.c.proposition_id == bindparam("id"),
    VERSIONS.c.until.is_(None),
)
_AT: ColumnElement[int] = bindparam("at", type_=BigInteger)
CLOSE = Query(
    update(VERSIONS).where(*_OPEN_VERSION).values(until=_AT, fork=Fork(VERSIONS.c.since, _AT))
)
UNMAKE = Query(delete(VERSIONS).where(*_OPEN_VERSION))
REOPEN = Query(
    update(VERSIONS)
    .where(VERSIONS.c.kb_id == bindparam("kb"))
    .where(VERSIONS.c.until == bindparam("at"), in_list(VERSIONS.c.proposition_id, "ids"))
    .values(until=null(), fork=literal_column(str(HOLDS_NOW)))
)
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

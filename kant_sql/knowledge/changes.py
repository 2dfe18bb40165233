"""What revisions changed: one line for each element that was asserted or retracted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    bindparam,
    case,
    literal_column,
    select,
    union_all,
)

from ..backends import Query, Session
from ..tables import FunctionValueVersionRow, PropositionRow, PropositionVersionRow
from .loading import KB
from .rows import KIND_TABLES, table_of

ASSERTED, RETRACTED = "+", "-"
FACT, GOAL, VALUE = "fact", "goal", "value"


class Change(NamedTuple):
    """A line of what a revision changed. Lines sort as the hash of a revision wants them.

    Attributes:
        sign: `+` asserted, `-` retracted.
        kind: one of `KINDS`, `fact`, `goal` or `value`.
        text: the element's canonical PDDL text.
    """

    sign: str
    kind: str
    text: str


def _in_range(column: Any) -> ColumnElement[bool]:
    low: Any = bindparam("low", type_=BigInteger)
    high: Any = bindparam("high", type_=BigInteger)
    return column.between(low, high)  # type: ignore[no-any-return]


def _both_ends(version: Any, kind: Any, text: Any) -> list[Select[Any]]:
    """Give what was asserted and what was retracted in the range, of one version table."""
    return [
        select(
            column.label("revision"),
            literal_column(sign).label("retracted"),
            kind.label("kind"),
            text.label("text"),
        ).where(version.kb_id == KB, _in_range(column))
        for column, sign in ((version.since, "0"), (version.until, "1"))
    ]


def _selects() -> list[Select[Any]]:
    selects = []
    for kind, tables in KIND_TABLES.items():
        version = tables.version.table.c
        # A formula is of the kind that its section says.
        name = version.section if kind == "formula" else literal_column(f"'{kind}'")
        selects += _both_ends(version, name, version.text)
    value = table_of(FunctionValueVersionRow).c
    selects += _both_ends(value, literal_column("'value'"), value.text)
    version, atom = table_of(PropositionVersionRow).c, table_of(PropositionRow).c
    kind_of = case((atom.is_goal, literal_column("'goal'")), else_=literal_column("'fact'"))
    kind_of_atom, text_of_atom = (
        select(column)
        .where(atom.kb_id == version.kb_id, atom.id == version.proposition_id)
        .scalar_subquery()
        for column in (kind_of, atom.text)
    )
    return selects + _both_ends(version, kind_of_atom, text_of_atom)


_CHANGES = Query(union_all(*_selects()).order_by("revision", "retracted", "kind", "text"))


def stream_changes(
    session: Session, kb_id: int, low: int, high: int
) -> Iterator[tuple[int, Change]]:
    """Read what a range of revisions changed, in one statement and in constant memory.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        low: the first revision.
        high: the last revision.

    Returns:
        The revision's number and the change, by revision and then in the order of the hash.
    """
    rows = session.stream(_CHANGES, kb=kb_id, low=low, high=high)
    signs = ASSERTED, RETRACTED
    return ((number, Change(signs[sign], kind, text)) for number, sign, kind, text in rows)

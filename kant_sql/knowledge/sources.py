"""Where the versions of each kind of knowledge are, and what the change lines call them."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, case, literal_column, select

from ..tables import (
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionRow,
    PropositionVersionRow,
)
from .rows import KIND_TABLES, table_of

FACT, GOAL, VALUE = "fact", "goal", "value"
PROPOSITION = "proposition"


class Source(NamedTuple):
    """The versions of one kind of knowledge.

    Attributes:
        identity: the columns of the identity table.
        version: the columns of the version table.
        owner: the column of the version table that names the identity.
        kind: what a change line calls the kind, of a row of the version table.
        text: the canonical PDDL text, of a row of the version table.
    """

    identity: Any
    version: Any
    owner: ColumnElement[int]
    kind: ColumnElement[str]
    text: ColumnElement[str]


def _definition(kind: str) -> Source:
    tables = KIND_TABLES[kind]
    version = tables.version.table.c
    # A formula is of the kind that its section says.
    name: Any = version.section if kind == "formula" else literal_column(f"'{kind}'")
    return Source(tables.identity.c, version, tables.version.owner, name, version.text)


def _value() -> Source:
    version = table_of(FunctionValueVersionRow).c
    kind: Any = literal_column(f"'{VALUE}'")
    identity = table_of(FunctionValueRow).c
    return Source(identity, version, version.function_value_id, kind, version.text)


def _proposition() -> Source:
    version, atom = table_of(PropositionVersionRow).c, table_of(PropositionRow).c
    # By the version's own copy: each text that is looked up in another table takes its time.
    kind: Any = case(
        (version.is_goal, literal_column(f"'{GOAL}'")), else_=literal_column(f"'{FACT}'")
    )
    text = (
        select(atom.text)
        .where(atom.kb_id == version.kb_id, atom.id == version.proposition_id)
        .correlate(table_of(PropositionVersionRow))
        .scalar_subquery()
    )
    return Source(atom, version, version.proposition_id, kind, text)


SOURCES: dict[str, Source] = {
    **{kind: _definition(kind) for kind in KIND_TABLES},
    VALUE: _value(),
    PROPOSITION: _proposition(),
}

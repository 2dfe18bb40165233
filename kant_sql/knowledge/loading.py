"""Reading definitions: all of them in one statement, however many there are."""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    Text,
    and_,
    bindparam,
    cast,
    literal_column,
    null,
    or_,
    select,
    true,
    union_all,
)

from ..backends import Query, Session, in_rows
from ..tables import (
    ActionExpressionRow,
    ActionExpressionTermRow,
    ActionParameterRow,
    ActionParameterTypeRow,
    Base,
    HeadRow,
    PredicateParameterRow,
    PredicateParameterTypeRow,
)
from .assembling import GONE, evolve
from .definitions import Definitions
from .rows import KIND_TABLES, VersionTable, table_of

KB: ColumnElement[int] = bindparam("kb", type_=BigInteger)
_AFTER: ColumnElement[int] = bindparam("after", type_=BigInteger)
_NUMBER = cast(null(), BigInteger)
_TEXT = cast(null(), Text)


def held_at(table: Any) -> ColumnElement[bool]:
    """Tell whether a version held at the revision `at`.

    Args:
        table: the version table, or a class that is mapped to it.

    Returns:
        The condition.
    """
    at: ColumnElement[int] = bindparam("at", type_=BigInteger)
    return and_(table.since <= at, or_(table.until.is_(None), table.until > at))


def _part(part: str, owner: Any, /, **columns: Any) -> Select[Any]:
    """Give a SELECT of the one shape that all parts of the statement share."""
    return select(
        literal_column(f"'{part}'").label("part"),
        owner.label("owner"),
        columns.get("section", _TEXT).label("section"),
        columns.get("position", _NUMBER).label("position"),
        *(columns.get(letter, _NUMBER).label(letter) for letter in "abc"),
        columns.get("name", _TEXT).label("name"),
        columns.get("text", _TEXT).label("text"),
    )


def _definition_part(kind: str, held: Any, **columns: Any) -> Select[Any]:
    """Give the part that reads the versions of one kind for which `held(version)` is true."""
    tables = KIND_TABLES[kind]
    identity, version = tables.identity.c, tables.version.table.c
    owner = version[f"{kind}_id"]
    name = (
        select(identity.name)
        .where(identity.kb_id == version.kb_id, identity.id == owner)
        .scalar_subquery()
    )
    return _part(kind, owner, name=name, text=version.text, **columns).where(
        version.kb_id == KB, held(version)
    )


def _child_part(part: str, kind: str, held: Any, mapped: type[Base], **columns: str) -> Select[Any]:
    """Give the part that reads what belongs to those versions in a table below theirs."""
    version, child = KIND_TABLES[kind].version.table.c, table_of(mapped).c
    owner = f"{kind}_id"
    owners = select(version[owner]).where(version.kb_id == KB, held(version))
    version_of_child = (
        select(version.since)
        .where(version.kb_id == child.kb_id, version[owner] == child[owner])
        .where(version.since == child.since, held(version))
        .correlate(table_of(mapped))
        .scalar_subquery()
    )
    chosen = {label: child[column] for label, column in columns.items()}
    return _part(part, child[owner], position=child.position, **chosen).where(
        child.kb_id == KB,
        in_rows(child[owner], owners),
        # Implied by the next, but this is what spares the index the rows of older versions.
        child.since > _AFTER if held is _newer else true(),
        version_of_child.is_not(None),
    )


def _newer(version: Any) -> ColumnElement[bool]:
    """Tell whether a version holds now, and did not yet at the revision `after`."""
    return and_(version.since > _AFTER, version.until.is_(None))


def _parts(held: Any) -> list[Select[Any]]:
    versions = {kind: tables.version.table.c for kind, tables in KIND_TABLES.items()}
    parts = [
        _definition_part("type", held, a=versions["type"].parent_id),
        _definition_part("object", held, a=versions["object"].type_id),
        _definition_part("predicate", held),
        _definition_part("action", held),
        _child_part(
            "expression",
            "action",
            held,
            ActionExpressionRow,
            section="section",
            a="parent",
            b="predicate_id",
            name="operator",
            text="value",
        ),
        _child_part(
            "term",
            "action",
            held,
            ActionExpressionTermRow,
            section="section",
            a="term",
            b="parameter",
            c="object_id",
        ),
    ]
    for kind, parameter, type_ in (
        ("predicate", PredicateParameterRow, PredicateParameterTypeRow),
        ("action", ActionParameterRow, ActionParameterTypeRow),
    ):
        parts += [
            _child_part(f"{kind} parameter", kind, held, parameter, name="name"),
            _child_part(f"{kind} type", kind, held, type_, a="alternative", b="type_id"),
        ]
    return parts


def _gone_part(kind: str, version: VersionTable) -> Select[Any]:
    columns = version.table.c
    return _part(f"{GONE}{kind}", columns[f"{kind}_id"]).where(
        columns.kb_id == KB, columns.until > _AFTER
    )


def _head_part() -> Select[Any]:
    head = table_of(HeadRow).c
    return _part("head", head.definition_revision).where(head.kb_id == KB)


_NOW = Query(union_all(_head_part(), *_parts(lambda version: version.until.is_(None))))
_AT = Query(union_all(*_parts(held_at)))
_SINCE = Query(
    union_all(
        *(_gone_part(kind, tables.version) for kind, tables in KIND_TABLES.items()),
        *_parts(_newer),
    )
)


def load(session: Session, kb_id: int) -> tuple[int, Definitions]:
    """Read the head and all that is defined now.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.

    Returns:
        The revision that last changed a definition, and the definitions.
    """
    rows = session.rows(_NOW, kb=kb_id)
    definition_revision = next(row[1] for row in rows if row[0] == "head")
    return definition_revision, evolve(Definitions(), rows)


def load_at(session: Session, kb_id: int, at: int) -> Definitions:
    """Read all that was defined at a revision.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        at: the revision.

    Returns:
        The definitions.
    """
    return evolve(Definitions(), session.rows(_AT, kb=kb_id, at=at))


def refresh(session: Session, kb_id: int, definitions: Definitions, after: int) -> Definitions:
    """Bring definitions up to date by reading only what has changed.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        definitions: the definitions of the revision `after`.
        after: the revision.

    Returns:
        The definitions of the head.
    """
    return evolve(definitions, session.rows(_SINCE, kb=kb_id, after=after))

"""Reading definitions: all of them in one statement, however many there are."""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Integer,
    Select,
    Text,
    and_,
    bindparam,
    cast,
    func,
    literal_column,
    null,
    or_,
    select,
    true,
    union_all,
)

from ..backends import Query, Session
from ..errors import check_integer, reading_rows
from ..tables import (
    ActionNodeRow,
    ActionParameterRow,
    ActionParameterTypeRow,
    ActionTermRow,
    ActionVariableRow,
    ActionVariableTypeRow,
    Base,
    DocumentItemRow,
    FormulaNodeRow,
    FormulaTermRow,
    FormulaVariableRow,
    FormulaVariableTypeRow,
    FunctionParameterRow,
    FunctionParameterTypeRow,
    FunctionTypeRow,
    HeadRow,
    ObjectTypeRow,
    PredicateParameterRow,
    PredicateParameterTypeRow,
    TypeParentRow,
)
from .assembling import GONE, evolve
from .definitions import Definitions
from .rows import KIND_TABLES, VersionTable, is_of_version, table_of

KB: ColumnElement[int] = bindparam("kb", type_=BigInteger)
_AFTER: ColumnElement[int] = bindparam("after", type_=BigInteger)
_THEN: ColumnElement[int] = bindparam("at", type_=BigInteger)
_NUMBER = cast(null(), BigInteger)
_TEXT = cast(null(), Text)


def held_at(table: Any) -> ColumnElement[bool]:
    """Tell whether a version held at the revision `at`.

    Args:
        table: the version table, or a class that is mapped to it.

    Returns:
        The condition.
    """
    return and_(table.since <= _THEN, or_(table.until.is_(None), table.until > _THEN))


def _part(part: str, owner: Any, /, **columns: Any) -> Select[Any]:
    """Give a SELECT of the one shape that all parts of the statement share."""
    return select(
        literal_column(f"'{part}'").label("part"),
        owner.label("owner"),
        columns.get("section", _TEXT).label("section"),
        columns.get("position", _NUMBER).label("position"),
        *(columns.get(letter, _NUMBER).label(letter) for letter in "abcdef"),
        columns.get("name", _TEXT).label("name"),
        columns.get("text", _TEXT).label("text"),
    )


def _definition_part(kind: str, held: Any, **columns: Any) -> Select[Any]:
    """Give the part that reads the versions of one kind for which `held(version)` is true."""
    tables = KIND_TABLES[kind]
    version, given = tables.version.table.c, {"name": tables.name, **columns}
    return _part(kind, tables.version.owner, text=version.text, **given).where(
        version.kb_id == KB, held(version)
    )


def _child_part(part: str, kind: str, held: Any, mapped: type[Base], **columns: str) -> Select[Any]:
    """Give the part that reads what belongs to those versions in a table below theirs."""
    version, child = KIND_TABLES[kind].version.table, table_of(mapped)
    owner = f"{kind}_id"
    which = and_(version.c.kb_id == KB, held(version.c))
    chosen = {label: child.c[column] for label, column in columns.items()}
    return _part(part, child.c[owner], position=child.c.position, **chosen).where(
        child.c.kb_id == KB,
        *is_of_version(child, version, owner, which),
        # Implied by that, but this is what spares the index the rows of older versions.
        child.c.since > _AFTER if held is _newer else true(),
    )


def _newer(version: Any) -> ColumnElement[bool]:
    """Tell whether a version holds now, and did not yet at the revision `after`."""
    return and_(version.since > _AFTER, version.until.is_(None))


def _expression_parts(owner: str, held: Any, mapped: tuple[type[Base], ...]) -> list[Select[Any]]:
    nodes, variables, variable_types, terms = mapped
    columns: tuple[dict[str, str], ...] = (
        {"a": "parent", "b": "predicate_id", "c": "function_id", "name": "operator"},
        {"a": "variable"},
        {"a": "variable", "b": "alternative", "c": "type_id"},
        {"a": "term", "b": "parameter", "c": "object_id", "d": "quantifier", "e": "variable"},
    )
    node, variable, variable_type, term = columns
    return [
        _child_part(f"{owner} node", owner, held, nodes, section="section", text="value", **node),
        _child_part(
            f"{owner} variable", owner, held, variables, section="section", text="name", **variable
        ),
        _child_part(
            f"{owner} variable type",
            owner,
            held,
            variable_types,
            section="section",
            **variable_type,
        ),
        _child_part(f"{owner} term", owner, held, terms, section="section", f="child", **term),
    ]


def _parts(held: Any) -> list[Select[Any]]:
    versions = {kind: tables.version.table.c for kind, tables in KIND_TABLES.items()}
    parts = [
        _definition_part("type", held, a=versions["type"].parent_id),
        _definition_part(
            "object",
            held,
            a=versions["object"].type_id,
            b=cast(versions["object"].is_constant, Integer),
        ),
        _definition_part("predicate", held),
        _definition_part("function", held),
        _definition_part("action", held, section=versions["action"].kind),
        _definition_part("formula", held, section=versions["formula"].section),
        _definition_part(
            "document",
            held,
            section=versions["document"].domain,
            name=versions["document"].title,
        ),
        _child_part("type parent", "type", held, TypeParentRow, a="parent_id"),
        _child_part("object type", "object", held, ObjectTypeRow, a="type_id"),
        _child_part("function value type", "function", held, FunctionTypeRow, a="type_id"),
        _child_part("item", "document", held, DocumentItemRow, section="section", text="name"),
    ]
    for kind, parameter, type_ in (
        ("predicate", PredicateParameterRow, PredicateParameterTypeRow),
        ("function", FunctionParameterRow, FunctionParameterTypeRow),
        ("action", ActionParameterRow, ActionParameterTypeRow),
    ):
        parts += [
            _child_part(f"{kind} parameter", kind, held, parameter, name="name"),
            _child_part(f"{kind} type", kind, held, type_, a="alternative", b="type_id"),
        ]
    return [
        *parts,
        *_expression_parts(
            "action",
            held,
            (ActionNodeRow, ActionVariableRow, ActionVariableTypeRow, ActionTermRow),
        ),
        *_expression_parts(
            "formula",
            held,
            (FormulaNodeRow, FormulaVariableRow, FormulaVariableTypeRow, FormulaTermRow),
        ),
    ]


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
_LAST_CHANGE = Query(
    union_all(
        *(
            select(func.max(column)).where(tables.version.table.c.kb_id == KB, column <= _THEN)
            for tables in KIND_TABLES.values()
            for column in (tables.version.table.c.since, tables.version.table.c.until)
        )
    )
)
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
    with reading_rows("head", f"knowledge base {kb_id!r}"):
        definition_revision = next(row[1] for row in rows if row[0] == "head")
        key = f"knowledge base {kb_id!r}"
        check_integer("head", key, "definition_revision", definition_revision)
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


def last_change(session: Session, kb_id: int, at: int) -> int:
    """Tell which revision, up to a past one, was the last to change a definition.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        at: the past revision.

    Returns:
        The revision; 0 when there was none.
    """
    return max(row[0] or 0 for row in session.rows(_LAST_CHANGE, kb=kb_id, at=at))


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

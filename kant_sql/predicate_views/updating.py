"""Which views there should be, and what has to be done for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from itertools import groupby
from typing import Any, NamedTuple

from sqlalchemy import bindparam, select

from ..arguments import flag, optional_text, shown
from ..backends import Backend, Query, Session, create_backend
from ..backends.views import (
    Mark,
    create_view,
    drop_view,
    epoch,
    goal_condition,
    mark_of,
    readers,
    relations,
    seconds_between,
)
from ..dto.parameters import either_text, variable_name
from ..errors import InvalidArgumentError, KantSqlError, reading_rows
from ..retry import retrying
from ..schema import check, check_session
from ..tables import (
    KnowledgeBaseRow,
    PredicateParameterRow,
    PredicateParameterTypeRow,
    PredicateRow,
    TypeRow,
)
from .names import KINDS, column_names, prefixes, view_names
from .queries import INTERVAL, METADATA, RECKONED, Words, view_query

# PostgreSQL holds a lock for each view until the end, and has room for some thousands of locks.
CHANGES_AT_ONCE = 1_000

_KNOWLEDGE_BASES = Query(
    select(KnowledgeBaseRow.id, KnowledgeBaseRow.name).order_by(KnowledgeBaseRow.id)
)


def _of_one(*columns: Any) -> Query:
    """Read columns of a table, for one knowledge base, sorted by them all."""
    kb_id = columns[0].class_.kb_id
    return Query(select(*columns).where(kb_id == bindparam("kb_id")).order_by(*columns))


_PREDICATES = _of_one(PredicateRow.id, PredicateRow.name)
_TYPES = _of_one(TypeRow.id, TypeRow.name)
_PARAMETERS = _of_one(
    PredicateParameterRow.predicate_id,
    PredicateParameterRow.position,
    PredicateParameterRow.since,
    PredicateParameterRow.name,
)
_PARAMETER_TYPES = _of_one(
    PredicateParameterTypeRow.predicate_id,
    PredicateParameterTypeRow.position,
    PredicateParameterTypeRow.since,
    PredicateParameterTypeRow.alternative,
    PredicateParameterTypeRow.type_id,
)


class PredicateView(NamedTuple):
    """A generated view, and what becomes of it.

    Attributes:
        name: its name.
        kind: `fact` or `goal`.
        knowledge_base: the name of the knowledge base that it is of.
        predicate: the name of the predicate that it is of.
        columns: the names of its columns; none when it is dropped.
        change: `created`, `replaced`, `dropped` or `unchanged`.
        statements: the SQL that does it.
    """

    name: str
    kind: str
    knowledge_base: str | None
    predicate: str | None
    columns: tuple[str, ...]
    change: str
    statements: tuple[str, ...] = ()


class _Wanted(NamedTuple):
    """A view as it should be."""

    name: str
    kb_name: str
    predicate: str
    columns: tuple[str, ...]
    definition: str
    mark: Mark


def update_views(
    url: str, *, knowledge_base: str | None = None, dry_run: bool = False
) -> list[PredicateView]:
    """Bring the views of all predicates up to date; it makes no revision.

    A thousand views are changed in one transaction. What is interrupted goes on when it is run
    again.

    Args:
        url: the database URL.
        knowledge_base: the one whose views they are; None for all of the store.
        dry_run: whether to change nothing, and only tell what would be done.

    Returns:
        The views: first those that are no more, then the others, the oldest first.

    Raises:
        KantSqlError: there is no such knowledge base.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database refused; of the last thousand, nothing was changed.
    """
    return _change(url, knowledge_base, dry_run, is_drop=False)


def drop_views(
    url: str, *, knowledge_base: str | None = None, dry_run: bool = False
) -> list[PredicateView]:
    """Drop all views that `update_views` made, a thousand in one transaction.

    Args:
        url: the database URL.
        knowledge_base: the one whose views they are; None for all of the store.
        dry_run: whether to change nothing, and only tell what would be done.

    Returns:
        The views that are no more.

    Raises:
        KantSqlError: there is no such knowledge base.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database refused; of the last thousand, nothing was changed.
    """
    return _change(url, knowledge_base, dry_run, is_drop=True)


def _change(url: str, kb_name: str | None, dry_run: bool, is_drop: bool) -> list[PredicateView]:
    optional_text(kb_name, "knowledge_base")
    flag(dry_run, "dry_run", InvalidArgumentError)
    # Without a look at the file first, it would be created.
    check(url)
    with closing(create_backend(url)) as backend:
        told: list[PredicateView] | None = None
        while True:
            changes, left = retrying(
                backend, lambda: _change_once(backend, kb_name, dry_run, is_drop)
            )
            told = changes if told is None else told
            if not left:
                return told


def _change_once(
    backend: Backend, kb_name: str | None, dry_run: bool, is_drop: bool
) -> tuple[list[PredicateView], int]:
    """Change some views; tell what is to be done in all, and how many changes are left."""
    with backend.open_session() as session:
        session.begin(write=not dry_run)
        try:
            if dry_run:
                return _changes(session, kb_name, is_drop), 0
            session.lock_definitions()
            check_session(session)
            changes = _changes(session, kb_name, is_drop)
            due = [change.statements for change in changes if change.statements]
            for statements in due[:CHANGES_AT_ONCE]:
                for statement in statements:
                    session.define(statement)
            session.commit()
            return changes, len(due[CHANGES_AT_ONCE:])
        finally:
            session.rollback()


def _changes(session: Session, kb_name: str | None, is_drop: bool) -> list[PredicateView]:
    kbs: dict[int, str] = dict(session.rows(_KNOWLEDGE_BASES))
    if kb_name is not None and kb_name not in kbs.values():
        listed = ", ".join(repr(name) for name in [*kbs.values()][:20]) or "none yet"
        raise KantSqlError(
            f"there is no knowledge base {shown(kb_name)} in this store; choose one of: {listed}"
        )
    chosen = {kb_id for kb_id, name in kbs.items() if kb_name in (None, name)}
    there = relations(session)
    # One that is of no knowledge base of this store is nobody's.
    own = {
        name: mark
        for name, mark in there.items()
        if mark and (mark.kb_id in chosen or (kb_name is None and mark.kb_id not in kbs))
    }
    taken = {name.lower() for name in there if name not in own}
    wanted = [*_wanted(session, kbs, chosen, taken)]
    return [
        *_drops(session, own, wanted, is_drop),
        *([] if is_drop else _makes(session, own, wanted)),
    ]


def _drops(
    session: Session, own: Mapping[str, Mark], wanted: Sequence[_Wanted], is_drop: bool
) -> Iterator[PredicateView]:
    """Drop what is not wanted, or not in that place; each name is free again before it is given."""
    kept = set() if is_drop else {view.name for view in wanted}
    known = {view.mark[:3]: view for view in wanted}
    for name in sorted(own.keys() - kept):
        view, mark = known.get(own[name][:3]), own[name]
        of: tuple[str | None, str | None] = (view.kb_name, view.predicate) if view else (None, None)
        statement = drop_view(session.backend.dialect, name)
        yield PredicateView(name, mark.kind, *of, (), "dropped", (statement,))


def _makes(
    session: Session, own: Mapping[str, Mark], wanted: Sequence[_Wanted]
) -> Iterator[PredicateView]:
    dialect, granted = session.backend.dialect, readers(session)
    for view in wanted:
        name, before = view.name, own.get(view.name)
        statements: list[str] = []
        change = "unchanged"
        if before != view.mark:
            change = "created" if before is None else "replaced"
            drops = [] if before is None else [drop_view(dialect, name)]
            statements = drops + create_view(dialect, name, view.definition, view.mark, granted)
        kind, of = view.mark.kind, (view.kb_name, view.predicate)
        yield PredicateView(name, kind, *of, view.columns, change, tuple(statements))


def _wanted(
    session: Session, kbs: Mapping[int, str], chosen: set[int], taken: set[str]
) -> Iterator[_Wanted]:
    begins = {kind: dict(zip(kbs, prefixes(kind, [*kbs.values()]), strict=True)) for kind in KINDS}
    words = {kind: _words(session, kind) for kind in KINDS}
    for kb_id in [kb_id for kb_id in kbs if kb_id in chosen]:
        predicates = session.rows(_PREDICATES, kb_id=kb_id)
        arguments = _arguments(session, kb_id)
        names = [name for _, name in predicates]
        for kind in KINDS:
            named = view_names(begins[kind][kb_id], names, taken)
            for (predicate_id, predicate), name in zip(predicates, named, strict=True):
                columns = column_names(arguments.get(predicate_id, ()), (*INTERVAL, *METADATA))
                reckoned = column_names(RECKONED, (*columns, *INTERVAL, *METADATA))
                definition = view_query(kb_id, predicate_id, words[kind], columns, reckoned)
                mark = mark_of(kb_id, predicate_id, kind, definition)
                all_columns = (*columns, *INTERVAL, *METADATA, *reckoned)
                yield _Wanted(name, kbs[kb_id], predicate, all_columns, definition, mark)


def _words(session: Session, kind: str) -> Words:
    return Words(
        condition=goal_condition(session, kind == "goal"),
        epoch=epoch(session, "r.committed_at"),
        seconds=seconds_between(session, "s.committed_at", "u.committed_at"),
    )


def _arguments(session: Session, kb_id: int) -> dict[int, list[str]]:
    """Tell what the arguments of predicates are called, by the last definition that has them."""
    type_names: dict[int, str] = dict(session.rows(_TYPES, kb_id=kb_id))
    allowed_types = session.rows(_PARAMETER_TYPES, kb_id=kb_id)
    with reading_rows("predicate_parameter_type", f"knowledge base {kb_id!r}"):
        types = {
            key: [type_names[row[4]] for row in rows]
            for key, rows in groupby(allowed_types, lambda row: row[:3])
        }
    found: dict[int, dict[int, str]] = {}
    for predicate_id, position, since, name in session.rows(_PARAMETERS, kb_id=kb_id):
        with reading_rows("predicate_parameter", f"parameter {position!r} of {predicate_id!r}"):
            allowed = types[predicate_id, position, since]
            is_generated = name == variable_name(either_text(allowed), position)
            called = "_or_".join(allowed) if is_generated else name
            found.setdefault(predicate_id, {})[position] = called
    return {predicate_id: [*names.values()] for predicate_id, names in found.items()}

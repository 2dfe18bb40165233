"""Generated views: for each predicate of a knowledge base, its facts and its goals.

A view's name has letters, digits and underscores and is not a reserved word: it needs no quotes. It
has at most 63 bytes, as PostgreSQL truncates longer names. Where names map to the same identifier,
the oldest has it, and the others end with a hash of their own name, so a view's name never changes
its meaning.

There are no joins: each column of another table is a subquery for one row. Joins of so many tables
took minutes on 3,000 facts where PostgreSQL had no statistics. With statistics they let a condition
on an argument begin at the object (20 ms instead of 500 ms on 100,000 versions); without, it took
10 s, and the whole view twice its time. SQLite gains nothing by them. Each subquery sorts its one
row, so that PostgreSQL finds it by the primary key: for a table that it takes for small, it might
choose another index that begins with `kb_id`, and scan the knowledge base each time.

The text contains only numbers and identifiers, so that no name can inject SQL.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing
from hashlib import sha256
from itertools import count, groupby
from typing import NamedTuple

from sqlalchemy import select

from ..arguments import flag, optional_text, shown
from ..dto.lexical import either_text, fold, variable_name
from ..errors import InvalidArgumentError, KantSqlError, reading_rows
from .dialects import create_backend
from .dialects.base import Backend, Session, retrying
from .dialects.structure import Mark, ViewDialect, mark_of
from .query import Query
from .rows import columns_of
from .schema import check, check_session
from .tables import TABLES, KnowledgeBaseRow

KINDS = ("fact", "goal")
MAX_BYTES = 63
MAX_PART_BYTES = 24
_HASH_DIGITS = 8
_LAST_DIGITS = 4

# Words that PostgreSQL 18 or SQLite 3.50 refuses as unquoted columns.
_RESERVED = (
    "add all alter analyse analyze and any array as asc asymmetric authorization autoincrement "
    "between binary both case cast check collate collation column commit concurrently "
    "constraint create cross current_catalog current_date current_role current_schema "
    "current_time current_timestamp current_user default deferrable delete desc distinct do "
    "drop else end escape except exists false fetch for foreign freeze from full grant group "
    "having ilike in index initially inner insert intersect into is isnull join lateral leading "
    "left like limit localtime localtimestamp natural not nothing notnull null offset on only "
    "or order outer overlaps placing primary raise references returning right select "
    "session_user set similar some symmetric system_user table tablesample then to trailing "
    "transaction true union unique update user using values variadic verbose when where window "
    "with "
)
RESERVED_WORDS = frozenset(_RESERVED.split())


def identifier(name: str) -> str:
    """Convert a name into an identifier."""
    return "".join(
        character if unicodedata.category(character)[0] in "LNM" else "_"
        for character in fold(name)
    ).strip("_")


def view_names(prefix: str, names: Sequence[str], taken: Collection[str]) -> Iterator[str]:
    """Name the views of the predicates of one knowledge base."""
    claimed: set[str] = set()
    for name in names:
        for part in _candidates(identifier(name), fold(name), MAX_BYTES - len(prefix.encode())):
            if part in claimed:
                continue
            # Claimed even if another relation has it now, which may be dropped.
            claimed.add(part)
            if prefix + part not in taken:
                yield prefix + part
                break


def prefixes(kind: str, names: Sequence[str]) -> Iterator[str]:
    """Yield the prefix of each knowledge base's views.

    The first has `fact_`, another called tiago `fact__tiago__`. What follows does not begin with an
    underscore, and what is between has no two in a row: no two knowledge bases share a view's name.
    """
    claimed: set[str] = set()
    for position, name in enumerate(names):
        plain = re.sub("__+", "_", identifier(name))
        part = next(
            part for part in _candidates(plain, name, MAX_PART_BYTES) if part not in claimed
        )
        if position == 0:
            yield f"{kind}_"
        else:
            claimed.add(part)
            yield f"{kind}__{part}__"


def column_names(names: Sequence[str], fixed: Sequence[str]) -> list[str]:
    """Name the columns of arguments."""
    found: list[str] = []
    for name in names:
        plain = identifier(name)
        plain = f"{plain}_" if plain in RESERVED_WORDS else plain
        plain = plain if plain[:1].isalpha() else f"_{plain}"
        candidates = (
            _cut(plain, MAX_BYTES - 1 - _LAST_DIGITS) + f"_{number}" for number in count(2)
        )
        first = plain if len(plain.encode()) <= MAX_BYTES else _hashed(plain, name, MAX_BYTES)
        taken = {*found, *fixed}
        found.append(first if first not in taken else next(c for c in candidates if c not in taken))
    return found


def _candidates(plain: str, key: str, size: int) -> Iterator[str]:
    if plain and len(plain.encode()) <= size:
        yield plain
    for number in count():
        yield _hashed(plain, f"{number} {key}", size)


def _hashed(plain: str, key: str, size: int) -> str:
    digest = sha256(key.encode()).hexdigest()[:_HASH_DIGITS]
    return f"{_cut(plain, size - 1 - _HASH_DIGITS)}_{digest}".lstrip("_")


def _cut(text: str, size: int) -> str:
    return text.encode()[:size].decode(errors="ignore").rstrip("_")


INTERVAL = ("since", "since_at", "until", "until_at")
METADATA = ("asserted_by", "asserted_reason", "retracted_by", "retracted_reason")
# Added later: an argument of one of these names keeps it.
RECKONED = ("since_epoch", "until_epoch", "duration")

_ARGUMENT = """
    (
        SELECT (
            SELECT o.name FROM object AS o
            WHERE o.kb_id = {kb_id} AND o.id BETWEEN a.object_id AND a.object_id
            ORDER BY o.id LIMIT 1
        )
        FROM proposition_argument AS a
        WHERE a.kb_id = {kb_id} AND a.proposition_id = v.proposition_id AND a.position = {position}
    ) AS {name}"""
_SAID = """
    (
        SELECT {what} FROM revision AS r
        WHERE r.kb_id = {kb_id} AND r.number BETWEEN v.{number} AND v.{number}
        ORDER BY r.number LIMIT 1
    ) AS {name}"""
_BETWEEN = """
    (
        SELECT (
            SELECT {seconds} FROM revision AS u
            WHERE u.kb_id = {kb_id} AND u.number BETWEEN v.until AND v.until
            ORDER BY u.number LIMIT 1
        )
        FROM revision AS s
        WHERE s.kb_id = {kb_id} AND s.number BETWEEN v.since AND v.since
        ORDER BY s.number LIMIT 1
    ) AS {name}"""
_VIEW = """\
SELECT{columns}
FROM proposition_version AS v
WHERE v.kb_id = {kb_id} AND v.predicate_id = {predicate_id} AND {condition}"""


def _definition(
    dialect: ViewDialect,
    view: tuple[int, int, str],
    names: Sequence[str],
    reckoned: Sequence[str],
) -> str:
    """Write the definition of a view, of a knowledge base, predicate and kind."""
    kb_id, predicate_id, kind = view
    arguments = [
        _ARGUMENT.format(kb_id=kb_id, position=position, name=name)
        for position, name in enumerate(names)
    ]
    since_epoch, until_epoch, duration = reckoned
    epoch = dialect.epoch.format("r.committed_at")
    seconds = dialect.seconds.format("s.committed_at", "u.committed_at")
    said = {
        name: _SAID.format(kb_id=kb_id, what=what, number=number, name=name)
        for name, what, number in (
            ("since_at", "r.committed_at", "since"),
            ("until_at", "r.committed_at", "until"),
            ("asserted_by", "r.actor", "since"),
            ("asserted_reason", "r.reason", "since"),
            ("retracted_by", "r.actor", "until"),
            ("retracted_reason", "r.reason", "until"),
            (since_epoch, epoch, "since"),
            (until_epoch, epoch, "until"),
        )
    }
    said[duration] = _BETWEEN.format(kb_id=kb_id, seconds=seconds, name=duration)
    rest = [said.get(name, f"\n    v.{name}") for name in (*INTERVAL, *METADATA, *reckoned)]
    return _VIEW.format(
        columns=",".join([*arguments, *rest]),
        kb_id=kb_id,
        predicate_id=predicate_id,
        condition=dialect.is_goal if kind == "goal" else "NOT v.is_goal",
    )


# PostgreSQL locks each view until the commit, and has room for some thousands of locks.
CHANGES_AT_ONCE = 1_000

_KNOWLEDGE_BASES = Query(
    select(KnowledgeBaseRow.id, KnowledgeBaseRow.name).order_by(KnowledgeBaseRow.id)
)


def _of_one(table: str, *names: str) -> Query:
    """Read columns of a table, for one knowledge base, sorted by them all."""
    return columns_of(TABLES[table], names, *names)


_KEY = ("predicate_id", "position", "since")
_PREDICATES = _of_one("predicate", "id", "name")
_TYPES = _of_one("type", "id", "name")
_PARAMETERS = _of_one("predicate_parameter", *_KEY, "name")
_PARAMETER_TYPES = _of_one("predicate_parameter_type", *_KEY, "alternative", "type_id")


class PredicateView(NamedTuple):
    """A generated view and its change.

    Attributes:
        kind: `fact` or `goal`.
        knowledge_base: the name of its knowledge base.
        predicate: the name of its predicate.
        columns: the names of its columns; none if it is dropped.
        change: `created`, `replaced`, `dropped` or `unchanged`.
        statements: the SQL of the change.
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
    """Update the views of all predicates, without a revision.

    One transaction changes a thousand views. Run it again after an interruption.

    Args:
        url: the database URL.
        knowledge_base: the one whose views they are; None for all of the store.
        dry_run: whether to return the changes without making them.

    Returns:
        The views: dropped ones first, then the others, oldest first.

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
        dry_run: whether to return the changes without making them.

    Returns:
        The dropped views.

    Raises:
        KantSqlError: there is no such knowledge base.
        SchemaError: the tables are missing, outdated or too new; the message names the remedy.
        StoreError: the database refused; of the last thousand, nothing was changed.
    """
    return _change(url, knowledge_base, dry_run, is_drop=True)


def recreated_views(url: str) -> list[PredicateView]:
    """Return the statements that recreate all existing views after a drop."""
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        session.begin(write=False)
        try:
            kbs: dict[int, str] = dict(session.rows(_KNOWLEDGE_BASES))
            there = session.backend.views.list_relations(session.rows_of)
            chosen = {mark.kb_id for mark in there.values() if mark} & kbs.keys()
            taken = {name.lower() for name, mark in there.items() if not mark}
            return [*_makes(session, {}, [*_wanted(session, kbs, chosen, taken)])]
        finally:
            session.rollback()


def replaced_views(session: Session, kb_id: int | None) -> Iterator[tuple[str, str]]:
    """Yield what has the name of a generated view without being one, with the view's predicate.

    A relation of another program may have it, too. So there is no view of the predicate by another
    name, and there are generated views of the knowledge base, or the relation has the columns.
    """
    views = session.backend.views
    kbs: dict[int, str] = dict(session.rows(_KNOWLEDGE_BASES))
    there = {name.lower(): mark for name, mark in views.list_relations(session.rows_of).items()}
    marked = {mark[:3] for mark in there.values() if mark}
    having = {mark[0] for mark in marked}
    for view in _wanted(session, kbs, {kb_id, *having} & kbs.keys(), ()):
        if view.name in there and there[view.name] is None and view.mark[:3] not in marked:
            found = session.rows_of(views.columns.format(view.name))
            if view.mark.kb_id in having or tuple(name for (name,) in found) == view.columns:
                yield view.name, view.predicate


def _change(url: str, kb_name: str | None, dry_run: bool, is_drop: bool) -> list[PredicateView]:
    optional_text(kb_name, "knowledge_base")
    flag(dry_run, "dry_run", InvalidArgumentError)
    # First: connecting would create the file.
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
    """Make some of the changes; return all of them, and the number left."""
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
    there = session.backend.views.list_relations(session.rows_of)
    # Views of a knowledge base that is gone are dropped, too.
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
    """Drop unwanted views, before their names are given to others."""
    kept = set() if is_drop else {view.name for view in wanted}
    known = {view.mark[:3]: view for view in wanted}
    for name in sorted(own.keys() - kept):
        view, mark = known.get(own[name][:3]), own[name]
        of: tuple[str | None, str | None] = (view.kb_name, view.predicate) if view else (None, None)
        statement = session.backend.views.drop(name)
        yield PredicateView(name, mark.kind, *of, (), "dropped", (statement,))


def _makes(
    session: Session, own: Mapping[str, Mark], wanted: Sequence[_Wanted]
) -> Iterator[PredicateView]:
    views = session.backend.views
    readers = views.list_readers(session.rows_of)
    for view in wanted:
        name, before = view.name, own.get(view.name)
        statements: list[str] = []
        change = "unchanged"
        if before != view.mark:
            change = "created" if before is None else "replaced"
            drops = [] if before is None else [views.drop(name)]
            statements = drops + views.create(name, view.definition, view.mark, readers)
        kind, of = view.mark.kind, (view.kb_name, view.predicate)
        yield PredicateView(name, kind, *of, view.columns, change, tuple(statements))


def _wanted(
    session: Session, kbs: Mapping[int, str], chosen: Collection[int | None], taken: Collection[str]
) -> Iterator[_Wanted]:
    begins = {kind: dict(zip(kbs, prefixes(kind, [*kbs.values()]), strict=True)) for kind in KINDS}
    for kb_id in [kb_id for kb_id in kbs if kb_id in chosen]:
        predicates = session.rows(_PREDICATES, kb=kb_id)
        arguments = _arguments(session, kb_id)
        names = [name for _, name in predicates]
        for kind in KINDS:
            named = view_names(begins[kind][kb_id], names, taken)
            for (predicate_id, predicate), name in zip(predicates, named, strict=True):
                columns = column_names(arguments.get(predicate_id, ()), (*INTERVAL, *METADATA))
                reckoned = column_names(RECKONED, (*columns, *INTERVAL, *METADATA))
                view = kb_id, predicate_id, kind
                definition = _definition(session.backend.views, view, columns, reckoned)
                mark = mark_of(*view, definition)
                all_columns = (*columns, *INTERVAL, *METADATA, *reckoned)
                yield _Wanted(name, kbs[kb_id], predicate, all_columns, definition, mark)


def _arguments(session: Session, kb_id: int) -> dict[int, list[str]]:
    """Return the names of predicates' arguments, by the last definition that has each."""
    type_names: dict[int, str] = dict(session.rows(_TYPES, kb=kb_id))
    allowed_types = session.rows(_PARAMETER_TYPES, kb=kb_id)
    with reading_rows("predicate_parameter_type", f"knowledge base {kb_id!r}"):
        types = {
            key: [type_names[row[4]] for row in rows]
            for key, rows in groupby(allowed_types, lambda row: row[:3])
        }
    found: dict[int, dict[int, str]] = {}
    for predicate_id, position, since, name in session.rows(_PARAMETERS, kb=kb_id):
        with reading_rows("predicate_parameter", f"parameter {position!r} of {predicate_id!r}"):
            allowed = types[predicate_id, position, since]
            is_generated = name == variable_name(either_text(allowed), position)
            called = "_or_".join(allowed) if is_generated else name
            found.setdefault(predicate_id, {})[position] = called
    return {predicate_id: [*names.values()] for predicate_id, names in found.items()}

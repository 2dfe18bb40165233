"""Reading and writing definitions: each in a number of statements that does not grow with them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import count
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    Boolean,
    ColumnElement,
    Integer,
    Select,
    Table,
    Text,
    and_,
    bindparam,
    cast,
    func,
    null,
    select,
    true,
    union_all,
)

from ..dto.lexical import fold, is_word
from ..errors import UNREADABLE, check_integer, reading_rows, unreadable
from ..knowledge.definitions import DECLARED, KINDS, Definitions
from .dialects.base import Row, Session
from .query import Query, constant, first_rows, in_list
from .rows import (
    KB,
    KIND_TABLES,
    THEN,
    Kind,
    ListTable,
    held_at,
    is_of_version,
    looked_up,
    table_of,
)
from .tables import ErasureRow, HeadRow, RevisionRow

# How the part is named that says which elements of a kind are live no more.
GONE = "gone "
ERASED = "erased"


# The rows of each table; those of a version table have the element's name after its id.
_Rows = Mapping[Table, Sequence[Row]]


def evolve(definitions: Definitions, rows: Iterable[Row]) -> Definitions:
    """Make the definitions that follow from those of before and the rows that were read since."""
    parts: defaultdict[str, list[Row]] = defaultdict(list)
    for row in rows:
        parts[row[0]].append(row)
    tables = {
        table: [*map(columns, parts[table.name])]
        for table, columns in _COLUMNS.items()
        if table.name in parts
    }
    made: list[Any] = []
    for kind in KINDS:
        changes: dict[int, Any] = {row[1]: None for row in parts[f"{GONE}{kind}"]}
        try:
            changes.update((definition.id, definition) for definition in _made(kind, tables))
            made.append(definitions.elements(kind).evolve(changes))
        except UNREADABLE as error:
            _find_unreadable(kind, tables)
            raise unreadable(f"{kind}_version", f"some {kind}", error) from error
    evolved = Definitions(*made)
    evolved.templates, evolved.guards = definitions.templates, definitions.guards
    return evolved


def _find_unreadable(kind: str, tables: _Rows) -> None:
    """Raise the error of the first definition whose rows cannot be read, by its id."""
    for id_ in dict.fromkeys(row[0] for rows in tables.values() for row in rows):
        own = {table: [row for row in rows if row[0] == id_] for table, rows in tables.items()}
        with reading_rows(f"{kind}_version", f"{kind} {id_!r}"):
            Definitions().elements(kind).evolve(
                {definition.id: definition for definition in _made(kind, own)}
            )


def _made(kind: str, tables: _Rows) -> Iterator[Any]:
    """Make the definitions of one kind, each with a name and a text: SQLite keeps anything."""
    for definition in KIND_TABLES[kind].definitions(tables):
        if not (
            isinstance(definition.id, int)
            and isinstance(definition.name, str)
            and isinstance(definition.text, str)
            and (kind != "formula" or isinstance(definition.section, str))
        ):
            raise TypeError(f"{definition.id!r}, {definition.name!r} is {definition.text!r}")
        yield definition


_AFTER: ColumnElement[int] = bindparam("after", type_=BigInteger)
_LISTS = [(kind, list_) for kind in KIND_TABLES.values() for list_ in kind.lists]


def _is_number(column: ColumnElement[Any]) -> bool:
    return isinstance(column.type, Integer | Boolean)


def _slots(columns: Iterable[ColumnElement[Any]]) -> tuple[list[Any], list[Any]]:
    """Part columns into those that hold numbers and those that hold texts."""
    numbers: list[Any] = []
    texts: list[Any] = []
    for column in columns:
        (numbers if _is_number(column) else texts).append(column)
    return numbers, texts


# What is read of each table.
_READ: dict[Table, list[ColumnElement[Any]]] = {
    **{
        kind.version.table: [
            *(kind.version.owner, kind.name),
            *(kind.version.table.c[name] for name in kind.columns),
        ]
        for kind in KIND_TABLES.values()
    },
    **{list_.table: [list_.table.c[name] for name in list_.columns] for _, list_ in _LISTS},
}
# How many columns of a sort the widest table has.
_NUMBERS, _TEXTS = (max(map(len, sort)) for sort in zip(*map(_slots, _READ.values()), strict=True))


def _part(part: str, columns: Iterable[ColumnElement[Any]]) -> Select[Any]:
    """Return a SELECT of the one shape that all parts of the statement share."""
    numbers, texts = _slots(columns)
    numbers = [cast(each, Integer) if isinstance(each.type, Boolean) else each for each in numbers]
    numbers += [cast(null(), BigInteger)] * (_NUMBERS - len(numbers))
    texts += [cast(null(), Text)] * (_TEXTS - len(texts))
    return select(
        constant(part).label("part"),
        *(number.label(f"number_{place}") for place, number in enumerate(numbers)),
        *(text.label(f"text_{place}") for place, text in enumerate(texts)),
    )


def _places(columns: Sequence[ColumnElement[Any]]) -> Callable[[Row], Row]:
    """Return what takes columns, in their order, out of a row of the statement."""
    number, text = count(1), count(1 + _NUMBERS)
    return itemgetter(*(next(number if _is_number(column) else text) for column in columns))


_COLUMNS = {table: _places(columns) for table, columns in _READ.items()}


def _version_part(kind: Kind, held: Any) -> Select[Any]:
    """Return the part that reads the versions of one kind for which `held(version)` is true."""
    version = kind.version.table
    return _part(version.name, _READ[version]).where(version.c.kb_id == KB, held(version.c))


def _list_part(kind: Kind, list_: ListTable, held: Any) -> Select[Any]:
    """Return the part that reads what belongs to those versions in a table below theirs."""
    version, table = kind.version, list_.table
    which = and_(version.table.c.kb_id == KB, held(version.table.c))
    return _part(table.name, _READ[table]).where(
        table.c.kb_id == KB,
        *is_of_version(table, version.table, version.owner.name, which),
        # Redundant, but it keeps the index scan away from older versions.
        table.c.since > _AFTER if held is _newer else true(),
    )


def _newer(version: Any) -> ColumnElement[bool]:
    """Return whether a version held at the revision `at`, and not yet at `after`."""
    return and_(version.since > _AFTER, held_at(version))


def _ended(version: Any) -> ColumnElement[bool]:
    """Return whether a version ended after the revision `after`, up to `at`."""
    return and_(version.until > _AFTER, version.until <= THEN)


def _parts(held: Any) -> list[Select[Any]]:
    return [
        *(_version_part(kind, held) for kind in KIND_TABLES.values()),
        *(_list_part(kind, list_, held) for kind, list_ in _LISTS),
    ]


def _gone_parts() -> Iterator[Select[Any]]:
    """Return the parts that read what versions of each kind ended."""
    for kind, tables in KIND_TABLES.items():
        version = tables.version.table.c
        part = _part(f"{GONE}{kind}", [tables.version.owner])
        yield part.where(version.kb_id == KB, _ended(version))


_HEAD, _ERASURE = table_of(HeadRow).c, table_of(ErasureRow).c
_NOW = Query(
    lambda: union_all(
        _part("head", [_HEAD.definition_revision]).where(_HEAD.kb_id == KB),
        *_parts(lambda version: version.until.is_(None)),
    )
)
_AT = Query(lambda: union_all(*_parts(held_at)))
_LAST_CHANGE = Query(
    lambda: union_all(
        *(
            select(func.max(column)).where(tables.version.table.c.kb_id == KB, column <= THEN)
            for tables in KIND_TABLES.values()
            for column in (tables.version.table.c.since, tables.version.table.c.until)
        )
    )
)
_ADVANCE = Query(
    lambda: union_all(
        *_gone_parts(),
        *_parts(_newer),
        _part(ERASED, [_ERASURE.since]).where(_ERASURE.kb_id == KB, _ERASURE.since > _AFTER),
    )
)


def _last_text(version: Any) -> ColumnElement[Any]:
    """Look up how an element was last defined after a version, up to `at`; NULL if it was not."""
    table = version.since.table
    later, owner = table.alias("later"), [*table.primary_key][1].name
    texts = select(later.c.text).where(
        later.c.kb_id == KB,
        later.c[owner] == table.c[owner],
        later.c.since > version.since,
        later.c.since <= THEN,
    )
    last = first_rows(texts.order_by(later.c.since.desc()), 1)
    return last.correlate(table).scalar_subquery()


def _was_lost(version: Any) -> ColumnElement[bool]:
    return and_(_ended(version), _last_text(version).is_(None))


_LOST = Query(
    lambda: union_all(
        *(_version_part(KIND_TABLES[kind], _was_lost) for kind in DECLARED),
        *(
            _list_part(kind, list_, _was_lost)
            for kind, list_ in _LISTS
            if kind.identity.name in DECLARED
        ),
    )
)


class Lost(NamedTuple):
    """An element that is defined no more: its last definition, when it ended, and in what."""

    kind: str
    id: int
    text: str
    time: datetime
    revision: int


class Ends(NamedTuple):
    """Types, objects, predicates and functions that are no longer there, and others as kind and id.

    The others were defined otherwise later: what was said of them may not fit any more.
    """

    lost: list[Lost]
    redefined: list[tuple[str, int]]


def _end_of(kind: str) -> Select[Any]:
    table, owner = KIND_TABLES[kind].version.table.c, KIND_TABLES[kind].version.owner
    time = looked_up(RevisionRow.committed_at, RevisionRow.number, table.until)
    last = _last_text(table)
    columns: tuple[Any, ...] = constant(kind), owner, table.text, time
    named = select(*columns, table.until.label("ended"), last.is_(None).label("is_lost"))
    differs = func.coalesce(last, constant("")) != table.text
    return named.where(table.kb_id == KB, _ended(table), differs)


_ENDS = Query(lambda: union_all(*map(_end_of, DECLARED)).order_by("ended"))


def read_ends(session: Session, kb_id: int, after: int, at: int) -> Ends:
    """Read which definitions ended between two revisions, but for those that are the same again."""
    ends = Ends([], [])
    rows = session.rows(_ENDS, kb=kb_id, after=after, at=at)
    for kind, id_, definition, time, revision, is_lost in rows:
        with reading_rows("revision", f"revision {revision!r}"):
            if is_lost:
                ends.lost.append(Lost(kind, id_, definition, session.to_time(time), revision))
            else:
                ends.redefined.append((kind, id_))
    return ends


def with_lost(
    session: Session, kb_id: int, definitions: Definitions, after: int, at: int
) -> Definitions:
    """Add to the definitions of a revision those that have ended since an earlier one."""
    return evolve(definitions, session.rows(_LOST, kb=kb_id, after=after, at=at))


def last_definitions(session: Session, kb_id: int, after: int, at: int) -> Definitions:
    """Read all that was known between two revisions, as it was last defined."""
    return with_lost(session, kb_id, load_at(session, kb_id, at), after, at)


def without(definitions: Definitions, lost: Iterable[Lost]) -> Definitions:
    """Take elements from definitions."""
    return evolve(definitions, [(f"{GONE}{one.kind}", one.id) for one in lost])


def load(session: Session, kb_id: int) -> tuple[int, Definitions]:
    """Read the head and all that is defined now."""
    rows = session.rows(_NOW, kb=kb_id)
    with reading_rows("head", f"knowledge base {kb_id!r}"):
        definition_revision = next(row[1] for row in rows if row[0] == "head")
        key = f"knowledge base {kb_id!r}"
        check_integer("head", key, "definition_revision", definition_revision)
    return definition_revision, evolve(Definitions(), rows)


def load_at(session: Session, kb_id: int, at: int) -> Definitions:
    """Read all that was defined at a revision."""
    definitions = evolve(Definitions(), session.rows(_AT, kb=kb_id, at=at))
    definitions.revision = at
    return definitions


def advance(
    session: Session, kb_id: int, definitions: Definitions, after: int, at: int
) -> Definitions:
    """Bring definitions of one past revision to a later one, by reading only what has changed."""
    return evolve(definitions, session.rows(_ADVANCE, kb=kb_id, after=after, at=at))


def last_change(session: Session, kb_id: int, at: int) -> int:
    """Return which revision, up to a past one, was the last to change a definition."""
    return max(row[0] or 0 for row in session.rows(_LAST_CHANGE, kb=kb_id, at=at))


def refresh(
    session: Session, kb_id: int, definitions: Definitions, after: int, at: int
) -> Definitions | None:
    """Bring definitions to the last change, like `advance`; None after an erasure."""
    rows = session.rows(_ADVANCE, kb=kb_id, after=after, at=at)
    return None if any(row[0] == ERASED for row in rows) else evolve(definitions, rows)


_IDENTITIES = {
    kind: Query(
        select(tables.identity.c.key, tables.identity.c.id, tables.identity.c.name).where(
            tables.identity.c.kb_id == KB, in_list(tables.identity.c.key, "keys")
        )
    )
    for kind, tables in KIND_TABLES.items()
}


def find_identities(
    session: Session, kb_id: int, kind: str, keys: set[str]
) -> dict[str, tuple[int, str] | None]:
    """Find the identities of names, in one statement."""
    found: dict[str, tuple[int, str] | None] = dict.fromkeys(keys)
    rows = session.rows(_IDENTITIES[kind], kb=kb_id, keys=session.list_value(sorted(keys)))
    found.update((key, (id_, name)) for key, id_, name in rows)
    return found


def find_id(session: Session, kb_id: int, kind: str, name: str) -> int | None:
    """Find the id of a name, in one statement at most; None if nothing ever had it."""
    key = fold(name)
    found = find_identities(session, kb_id, kind, {key})[key] if is_word(key) else None
    return None if found is None else found[0]

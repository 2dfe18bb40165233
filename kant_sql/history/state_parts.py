"""Pages of a state: its elements, since when they hold, and elements just retracted.

A page costs the same in a state of a million facts: long parts are counted up to a bound, and then
read in the order of an index instead of that of the texts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Select,
    case,
    func,
    literal_column,
    or_,
    select,
    tuple_,
    union_all,
)

from ..dao.text import refuse_unknown_names
from ..dto.lexical import fold
from ..knowledge.definitions import DOMAIN_SECTIONS, PROBLEM_SECTIONS
from ..moment_text import When
from ..pddl.lexer import tokenize
from ..sql.definition_rows import find_id
from ..sql.dialects.base import Row, Session
from ..sql.dialects.containing import contains, is_in, pattern_of
from ..sql.intervals import held_by, held_then, then
from ..sql.places import Place, from_place, place_text, read_place
from ..sql.query import Query, constant, first_rows, in_rows, integer
from ..sql.rows import (
    ATOM_TABLES,
    FACT,
    GOAL,
    KB,
    PROPOSITION,
    THEN,
    VALUE,
    VERSION_COLUMNS,
    VersionColumns,
    looked_up,
    table_of,
)
from ..sql.tables import PropositionRow
from ..store.snapshot import read_position, refuse_archived
from ..store.state import State
from .moments import state_at
from .revisions import Revision, read_numbered

# Limits: rows counted exactly, rows sorted by text, and rows searched for a text per page.
COUNTED, SORTED, SEARCHED = 20_000, 10_000, 10_000
_BY_TEXT = (str,)
# Retracted elements that are read, for each state.
GONE = 200
_NAMED = ("object", "type", "predicate", "function", "action", "rule")
# The parts of a state, in the order of display.
PARTS = {
    FACT: "Facts",
    GOAL: "Goals",
    VALUE: "Values",
    "object": "Objects",
    "type": "Types",
    "predicate": "Predicates",
    "function": "Functions",
    "action": "Actions",
    "derived": "Derived predicates",
    "domain constraint": "Constraints of the domain",
    "initial": "Initial literals",
    "timed": "Timed initial literals",
    "constraint": "Constraints of the problem",
    "metric": "Metric",
    "rule": "Rules that are kept",
}
assert {*PARTS} == {FACT, VALUE, *_NAMED, *DOMAIN_SECTIONS, *PROBLEM_SECTIONS}


class StateFilter(NamedTuple):
    """A filter of the elements of a state; all conditions apply."""

    text: str | None = None  # a part of their text, ignoring case
    predicate: str | None = None  # their predicate or function
    object: str | None = None  # an object that they name


class HeldElement(NamedTuple):
    """An element of a state.

    Attributes:
        kind: its kind, as in `Change`.
        text: its canonical PDDL text.
        since: the revision that asserted it: by whom, when and why.
        is_new: whether that is the state's own revision.
    """

    kind: str
    text: str
    since: Revision | None
    is_new: bool


class StatePart(NamedTuple):
    """A page of the elements of one kind.

    Attributes:
        kind: the kind, one of `PARTS`.
        title: their title.
        elements: the elements.
        gone: those that the state's revision retracted, `GONE` at most.
        total: their number, as far as they are counted.
        is_counted: whether `total` counts all.
        is_searched: whether the text was searched only in those from `offset` on, before `end`.
        offset: the number before the page.
        end: the number before the next page.
        next: the value of `after` for the next page; None after the last.
    """

    kind: str
    title: str
    elements: list[HeldElement]
    gone: list[HeldElement]
    total: int
    is_counted: bool
    is_searched: bool
    offset: int
    end: int
    next: str | None


class StatePage(NamedTuple):
    """A page of a state.

    Attributes:
        number: the number of the state's revision.
        head: the last revision.
        revision: the state's revision; None before the first.
        parts: the pages of its kinds.
        kinds: the title of each kind.
    """

    number: int
    head: int
    revision: Revision | None
    parts: list[StatePart]
    kinds: dict[str, str]


class _Found(NamedTuple):
    """The lines of a part: kind, text and first revision."""

    lines: list[Row]
    total: int
    is_counted: bool
    is_searched: bool
    passed: int
    next: Place | None


_NOTHING = _Found([], 0, True, False, 0, None)


class _Shape(NamedTuple):
    """Which statement reads a part: its conditions, without their values."""

    kind: str
    is_past: bool = False
    has_text: bool = False
    has_predicate: bool = False
    has_object: bool = False
    after: tuple[type, ...] = ()  # the types of the columns of a page's position


# The parameter with the id of the predicate or the function.
_HEADS = {PROPOSITION: "predicate", VALUE: "function"}
_SIZE, _SKIP = integer("size"), integer("skip")


def _lines(columns: VersionColumns) -> Select[Any]:
    since = columns.version.since
    return select(columns.kind.label("kind"), columns.text.label("text"), since.label("since"))


def _keyed(lines: Select[Any], key: Sequence[Any]) -> Select[Any]:
    """Add the columns of the order."""
    return lines.add_columns(*(column.label(f"key{n}") for n, column in enumerate(key)))


def _after(columns: Sequence[Any], shape: _Shape, *fixed: Any) -> list[ColumnElement[bool]]:
    """Return the condition that a line comes after the position of a page, if any."""
    # `fixed` is the column after the first one in the index, with its value.
    if not shape.after or shape.after == _BY_TEXT:
        return []
    # A missing argument or end: other rows that are equal so far lack it, too.
    kept = [n for n, one in enumerate(shape.after) if one is int]
    own, values = [columns[n] for n in kept], [integer(f"key{n}") for n in kept]
    own[1:1], values[1:1] = fixed[:1], fixed[1:]
    return [tuple_(*own) > tuple_(*values)]


def _key_types(shape: _Shape) -> list[tuple[type, ...]]:
    """Return the types of keys in the order of an index."""
    none = type(None)
    if shape.kind == GOAL:
        return []
    if shape.kind not in (FACT, VALUE) or shape.has_object:
        return [(int,)]
    if shape.is_past:
        firsts = [()] if shape.kind == VALUE else [(int,), (none,)]
        return [(int, int, *first, int, end, int) for first in firsts for end in (int, none)]
    if shape.kind == VALUE:
        return [(int, int)]
    return [(int, first, second, int) for first, second in ((int, int), (int, none), (none, none))]


def _of_atoms(source: str, shape: _Shape) -> Select[Any]:
    """Select facts, goals or values by their versions, in the order of an index."""
    columns = VERSION_COLUMNS[source]
    version = columns.version
    owner = version[ATOM_TABLES[source].head]
    conditions: list[Any] = [version.kb_id == KB]
    if source == PROPOSITION:
        conditions.append(_is_wanted(version, shape))
    if shape.has_predicate:
        conditions.append(owner == integer(_HEADS[source]))
    if shape.is_past:
        # Goals have their own index.
        is_found = shape.has_predicate or shape.kind == GOAL
        conditions.append(held_then(version) if is_found else held_by(source, version, THEN))
        first = [version.first_object_id] if source == PROPOSITION else []
        key = [owner, version.fork, *first, version.since, version.until, columns.owner]
        order = key
        # An expression uses no index: find past versions by their forks.
        conditions += _after([owner + constant(0), *key[1:]], shape)
    else:
        conditions.append(version.until.is_(None))
        arguments, is_goal = [], []
        if source == PROPOSITION:
            arguments = [version.first_object_id, version.second_object_id]
            is_goal = [version.is_goal]
        key = [owner, *arguments, columns.owner]
        order = [owner, *is_goal, *arguments, columns.owner]
        conditions += _after(key, shape, *is_goal, *[constant(False)] * len(is_goal))
    return _keyed(_lines(columns), key).where(*conditions).order_by(*order)


def _is_wanted(version: Any, shape: _Shape) -> ColumnElement[Any]:
    """Return whether a version belongs to a goal, or to a fact."""
    if shape.kind == GOAL:
        # As the partial index of goals has it.
        is_goal: ColumnElement[Any] = version.is_goal
        return is_goal
    if shape.has_predicate or shape.is_past:
        is_fact: ColumnElement[Any] = version.is_goal == constant(False)
        return is_fact
    # SQLite drops a column that equals a constant from the order, which then differs from the
    # index.
    return literal_column("(NOT proposition_version.is_goal)")


def _of_object(source: str, shape: _Shape) -> Select[Any]:
    """Select facts, goals or values that name an object: look one version up for each."""
    tables, version = ATOM_TABLES[source], VERSION_COLUMNS[source].version
    table, arguments, id_ = tables.identity, tables.arguments.c, tables.owner
    atom = table.c
    mentioning = select(arguments[id_]).where(
        arguments.kb_id == KB, arguments.object_id == integer("object")
    )
    # In the order of an index: the bound always cuts off the same rows.
    mentioning = first_rows(mentioning.order_by(arguments[id_]), SEARCHED)
    own = select(version.since).where(version.kb_id == KB, version[id_] == atom.id)
    is_open: ColumnElement[bool] = version.until.is_(None)
    if shape.is_past:
        own, is_open = own.where(version.since <= THEN), or_(is_open, version.until > THEN)
    # The last one: without statistics, an index of all predicates would be read by `until`.
    own = own.with_only_columns(case((is_open, version.since))).order_by(version.since.desc())
    since = first_rows(own, 1).correlate(table).scalar_subquery()
    conditions: list[Any] = [atom.kb_id == KB, in_rows(atom.id, mentioning)]
    if source == PROPOSITION:
        # As an expression, which uses no index: SQLite would read all atoms by it.
        conditions.append(
            literal_column(f"({'' if shape.kind == GOAL else 'NOT '}proposition.is_goal)")
        )
    if shape.has_predicate:
        conditions.append(atom[tables.head] == integer(_HEADS[source]))
    columns = atom.id.label("id"), atom.kb_id.label("kb_id"), since.label("since"), atom.text
    held = select(*columns).where(*conditions).subquery("held")
    text: Any = held.c.text
    if source == VALUE:
        own_id = version[id_] == held.c.id
        text = looked_up(version.text, version.since, held.c.since, own_id)
    lines = select(constant(shape.kind).label("kind"), text.label("text"), held.c.since)
    key = [held.c.id]
    found = _keyed(lines, key).where(held.c.since.is_not(None), *_after(key, shape))
    return found.order_by(*key)


def _of_definitions(source: str, shape: _Shape) -> Select[Any]:
    """Select named elements, or formulas of a section."""
    columns = VERSION_COLUMNS[source]
    version = columns.version
    held = held_by(source, version, THEN if shape.is_past else None)
    key = [columns.owner]
    lines = _keyed(_lines(columns), key).where(version.kb_id == KB, held, *_after(key, shape))
    lines = lines.order_by(*key)
    if source == "formula":
        lines = lines.where(version.section == constant(shape.kind))
        names = {"predicate_word": shape.has_predicate, "object_word": shape.has_object}
        for parameter, is_asked in names.items():
            if is_asked:
                lines = lines.where(contains(_words(columns.text), parameter))
    elif shape.has_object:
        lines = lines.where(columns.owner == integer("object"))
    return lines


def _words(text: Any) -> ColumnElement[str]:
    """Write a text as words between spaces."""
    for parenthesis in "()":
        text = func.replace(text, constant(parenthesis), constant(" "))
    spaced: ColumnElement[str] = constant(" ").concat(text).concat(constant(" "))
    return spaced


def _selects(shape: _Shape) -> list[Select[Any]]:
    """Return the selects of a part: goals are atoms or formulas."""
    source = {FACT: PROPOSITION, GOAL: PROPOSITION, VALUE: VALUE}.get(shape.kind)
    found = []
    if source is not None:
        found.append((_of_object if shape.has_object else _of_atoms)(source, shape))
    elif shape.kind in _NAMED:
        found.append(_of_definitions(shape.kind, shape))
    if shape.kind not in (FACT, VALUE, *_NAMED):
        found.append(_of_definitions("formula", shape))
    return found


@lru_cache(maxsize=64)
def _counts(shapes: tuple[_Shape, ...]) -> Query:
    """Count the parts, up to a bound."""
    selects, bound = [], constant(COUNTED + 1)
    for shape in shapes:
        parts = [
            first_rows(each.order_by(None).with_only_columns(constant(1)), bound)
            for each in _selects(shape)
        ]
        numbers = [
            select(func.count()).select_from(part.subquery()).scalar_subquery() for part in parts
        ]
        selects.append(select(constant(shape.kind), sum(numbers[1:], start=numbers[0])))
    return Query(union_all(*selects))


@lru_cache(maxsize=256)
def _sorted(shape: _Shape) -> Query:
    """Read a part in the order of its texts, and count its rows."""
    parts = [each.order_by(None) for each in _selects(shape)]
    parts = [each.with_only_columns(*[*each.selected_columns][:3]) for each in parts]
    part = (parts[0] if len(parts) == 1 else union_all(*parts)).subquery("part").c
    lines = select(part.kind, part.text, part.since, func.count().over().label("total"))
    if shape.has_text:
        lines = lines.where(contains(part.text))
    if shape.after:
        found = lines.subquery("found").c
        lines = select(*found).where(from_place([found.text], shape.after, "key"))
        lines = lines.order_by(found.text)
    else:
        lines = lines.order_by(part.text)
    return Query(lines.limit(_SIZE).offset(_SKIP))


@lru_cache(maxsize=256)
def _indexed(shape: _Shape) -> Query:
    """Read a long part in the order of an index, or search for a text in some of it."""
    # A row has the columns of the key after kind, text and revision. Rows of a search also have
    # whether the text is in them, and their position; the last searched row is among them.
    (lines,) = _selects(shape)
    by_version = shape.kind == FACT and not shape.has_object
    size = constant(SEARCHED) if shape.has_text else _SIZE
    if by_version:
        # Texts of the page only: PostgreSQL also computes the columns of skipped rows.
        version = VERSION_COLUMNS[PROPOSITION].version
        key = [*lines.selected_columns][3:]
        ids = lines.with_only_columns(version.proposition_id.label("id"), version.since, *key)
        _, since, *keys = some = first_rows(ids, size).subquery("some").c
        atom = table_of(PropositionRow).c
        text: Any = looked_up(atom.text, atom.id, some.id)
        lines = select(constant(FACT).label("kind"), text.label("text"), since, *keys)
    else:
        lines = first_rows(lines, size)
    if not shape.has_text:
        return Query(lines)
    found = lines.subquery("found").c
    matches, place = contains(found.text).label("matches"), func.row_number().over().label("place")
    numbered = select(*found, matches, place).subquery("numbered").c
    wanted = select(*numbered).where(or_(numbered.matches, numbered.place == constant(SEARCHED)))
    return Query(first_rows(wanted.order_by(numbered.place), _SIZE))


def _gone_of(source: str) -> Select[Any]:
    columns = VERSION_COLUMNS[source]
    lines = _lines(columns).where(columns.version.kb_id == KB, columns.version.until == THEN)
    return select(first_rows(lines, GONE).subquery())


_GONE = Query(union_all(*(_gone_of(name) for name in VERSION_COLUMNS if name != "document")))


class _Question(NamedTuple):
    """A question about a state, with the ids of the names in it."""

    asked: StateFilter  # the conditions
    at: int | None  # the revision; None for the present
    parameters: dict[str, Any]  # the parameters of its statements

    def shapes(self, kinds: Iterable[str]) -> tuple[_Shape, ...]:
        """Return the conditions of the parts that may have matching elements."""
        _, predicate, object_ = self.asked
        has_names = predicate is not None or object_ is not None
        return tuple(
            _Shape(kind, self.at is not None, False, predicate is not None, object_ is not None)
            for kind in kinds
            if kind not in _NAMED or not has_names or (kind == "object" and predicate is None)
        )


def _question(session: Session, kb_id: int, asked: StateFilter, at: int | None) -> _Question:
    """Find the ids of names; -1 for a name that never existed."""
    parameters: dict[str, Any] = {"kb": kb_id} if at is None else {"kb": kb_id, **then(session, at)}
    names = {"predicate": asked.predicate, "function": asked.predicate, "object": asked.object}
    for kind, name in names.items():
        if name is None:
            continue
        found = find_id(session, kb_id, kind, name)
        parameters[kind] = -1 if found is None else found
        parameters[f"{kind}_word"] = pattern_of(session, f" {name} ")
    if asked.text is not None:
        parameters["pattern"] = pattern_of(session, asked.text)
    return _Question(asked, at, parameters)


def read_state(
    reader: State,
    when: When | None,  # which state; None for the present
    asked: StateFilter,
    kind: str | None = None,  # one of `PARTS`; None for the beginning of each
    after: str | None = None,  # the position of the page of a kind: `next` of the last one
    limit: int = 200,
) -> StatePage:
    """Read a page of a state."""
    asked_at = reader.at if when is None else state_at(reader, when)
    kinds = tuple(PARTS) if kind is None else (kind,)

    def work(session: Session, kb_id: int) -> StatePage:
        # In the snapshot of the page: others may write, or archive this state, at any moment.
        position = read_position(session, kb_id)
        head = position.head if reader.upto is None else reader.upto
        revision = head if asked_at is None else asked_at
        at = None if revision == head and reader.at is None else revision
        if at is not None:
            refuse_archived(session, kb_id, at, position.archived)
        question = _question(session, kb_id, asked, at)
        parts = _read_parts(session, question, kinds, after, limit)
        gone = _read_gone(session, kb_id, revision, asked, kinds)
        lines = [*gone, *(line for found in parts.values() for line in found.lines)]
        numbers = {line[2] for line in lines} | {revision} - {0}
        revisions = read_numbered(session, kb_id, numbers)

        def made(lines: Iterable[Row]) -> list[HeldElement]:
            return [
                HeldElement(kind, text, revisions.get(since), since == revision)
                for kind, text, since, *_ in lines
            ]

        def part(kind: str) -> StatePart:
            found = parts.get(kind, _NOTHING)
            own = made(line for line in gone if line[0] == kind)
            counted = found.total, found.is_counted, found.is_searched, found.passed
            end = found.total if found.next is None else found.next.passed
            following = place_text(found.next)
            return StatePart(kind, PARTS[kind], made(found.lines), own, *counted, end, following)

        shown = [part(kind) for kind in PARTS if kind in parts or any(g[0] == kind for g in gone)]
        return StatePage(revision, head, revisions.get(revision), shown, PARTS)

    page = reader.store.query_known(work, StatePage(0, 0, None, [], PARTS))
    if not any(part.elements for part in page.parts):
        refuse_unknown_names(reader.store, asked.predicate, asked.object)
    return page


def _read_parts(
    session: Session, question: _Question, kinds: Iterable[str], after: str | None, limit: int
) -> dict[str, _Found]:
    shapes = question.shapes(kinds)
    with session.planned_now():
        counted = session.rows(_counts(shapes), **question.parameters) if shapes else ()
        totals: dict[str, int] = {row[0]: row[1] for row in counted}
        return {
            shape.kind: _read_part(session, question, shape, totals[shape.kind], after, limit)
            for shape in shapes
            if totals[shape.kind]
        }


def _read_part(
    session: Session, question: _Question, shape: _Shape, total: int, after: str | None, limit: int
) -> _Found:
    place = read_place(after, _BY_TEXT, *_key_types(shape))
    is_counted, has_text = total <= COUNTED, question.asked.text is not None
    shape = shape._replace(has_text=has_text, after=place.types)
    own = {**question.parameters, "size": limit + 1, **place.of("key")}
    # Goals are atoms and formulas, which share no index.
    by_text = place.types == _BY_TEXT if place.key else total <= SORTED or shape.kind == GOAL
    rows = session.rows((_sorted if by_text else _indexed)(shape), **own)
    page, end = rows[:limit], None
    if by_text:
        if has_text:
            total = rows[0][3] if rows else 0
        if len(rows) > limit:
            end = place.behind([(row[1],) for row in page])
    elif has_text:
        if len(rows) > limit:
            end = Place(place.passed + page[-1][-1], page[-1][3:-2])
        elif (
            rows
            and rows[-1][-1] == SEARCHED
            and not (is_counted and place.passed + SEARCHED >= total)
        ):
            end = Place(place.passed + SEARCHED, rows[-1][3:-2])
        page = [row for row in page if row[-2]]
    elif len(rows) > limit:
        end = Place(place.passed + limit, page[-1][3:])
    is_searched = has_text and not by_text
    return _Found(page, min(total, COUNTED), is_counted, is_searched, place.passed, end)


def _read_gone(
    session: Session, kb_id: int, revision: int, asked: StateFilter, kinds: Iterable[str]
) -> list[Row]:
    """Read the matching elements that a revision retracted."""
    wanted = frozenset(kinds)
    names = {fold(name) for name in (asked.predicate, asked.object) if name is not None}
    gone = [
        row
        for row in session.rows(_GONE, kb=kb_id, at=revision)
        if row[0] in wanted
        and (not names or names <= set(tokenize(fold(row[1]))))
        and is_in(asked.text, row[1])
    ]
    return sorted(gone)[:GONE]

"""Objects as tables, one for each type: a row has the facts and values of one object."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator
from functools import cache, partial
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple

from sqlalchemy import select, union_all

from ..dao.text import refuse_unknown
from ..dto.lexical import ROOT_TYPE, fold
from ..knowledge.definitions import Definitions, Elements, ObjectDefinition, TypeDefinition
from ..sql.intervals import held_then, then
from ..sql.places import Place, place_text, read_place
from ..sql.query import Query, constant, first_rows, in_list, in_rows
from ..sql.rows import ATOM_TABLES, KB, PROPOSITION, VALUE, looked_up
from ..store.snapshot import View
from ..store.state import State

# Facts, and values, on a page at most.
MOST = 5_000
# The cell of a predicate without other arguments.
MARK = "✓"


class ObjectRow(NamedTuple):
    """An object, and its cells by column: other arguments, values, or a mark."""

    object: str
    cells: dict[str, list[str]]


class ObjectTable(NamedTuple):
    """Objects of one type, and the columns that have a cell.

    A column is the name of a predicate or a function; after an arrow, the object is its second
    argument. For each, `columns` has the text of the fact or the fluent behind a cell, with
    `{object}` and `{cell}` in it; empty for functions of two arguments.
    """

    type: str
    columns: dict[str, str]
    rows: list[ObjectRow]


class ObjectsPage(NamedTuple):
    """A page of the objects of a state, by type and name.

    Attributes:
        types: the types with objects.
        total: the number of objects, of the requested type.
        tables: a table for each type.
        is_cut: whether some facts and values of these objects are omitted.
        next: the value of `after` for the next page; None after the last.
    """

    types: list[str]
    total: int
    tables: list[ObjectTable]
    is_cut: bool
    next: str | None


@cache
def _facts(is_past: bool) -> Query:
    """Select the facts of some objects: predicate, position of the object, and both arguments."""
    version = ATOM_TABLES[PROPOSITION].version.c
    arguments = version.first_object_id, version.second_object_id
    parts = [
        select(version.predicate_id, constant(place), own, other).where(
            version.kb_id == KB,
            in_list(version.predicate_id, "heads"),
            version.is_goal == constant(False),
            in_list(own, "objects"),
            held_then(version) if is_past else version.until.is_(None),
        )
        for place, (own, other) in enumerate((arguments, arguments[::-1]))
    ]
    return Query(first_rows(union_all(*parts), MOST + 1))


@cache
def _values(is_past: bool) -> Query:
    """Select the values of fluents that begin with some objects: function, arguments, value."""
    fluent, argument, version = (table.c for table in ATOM_TABLES[VALUE][:3])
    named = select(argument.function_value_id).where(
        argument.kb_id == KB,
        in_list(argument.object_id, "objects"),
        argument.position == constant(0),
    )
    arguments = looked_up(fluent.arguments, fluent.id, version.function_value_id)
    rows = select(version.function_id, arguments, version.value, version.object_id).where(
        version.kb_id == KB,
        in_list(version.function_id, "heads"),
        in_rows(version.function_value_id, named),
        held_then(version) if is_past else version.until.is_(None),
    )
    return Query(first_rows(rows, MOST + 1))


_Key = tuple[str, int, int]


def _columns(definitions: Definitions) -> dict[_Key, tuple[str, str]]:
    """Return the columns, by predicate or function and the position of the object."""
    made: dict[_Key, tuple[str, str]] = {}
    for one in definitions.predicates:
        if len(one.parameters) == 1:
            made["fact", one.id, 0] = one.name, f"({one.name} {{object}})"
        elif len(one.parameters) == 2:
            made["fact", one.id, 0] = one.name, f"({one.name} {{object}} {{cell}})"
            made["fact", one.id, 1] = f"← {one.name}", f"({one.name} {{cell}} {{object}})"
    for each in definitions.functions:
        if len(each.parameters) in (1, 2):
            text = "" if len(each.parameters) == 2 else f"({each.name} {{object}})"
            made["value", each.id, 0] = each.name, text
    return made


def _said(
    view: View, columns: dict[_Key, tuple[str, str]], ids: list[int]
) -> list[list[tuple[int, _Key, str]]]:
    """Read the facts and values of some objects, in two statements."""
    past = {} if view.at is None else then(view.session, view.at)
    name = view.definitions.objects.live

    def rows(source: str, query: Query) -> Iterator[Any]:
        heads = [key[1] for key in columns if key[0] == source]
        given = {"heads": heads, "objects": ids}
        listed = {key: view.session.list_value(value) for key, value in given.items()}
        yield from view.session.rows(query, kb=view.kb_id, **listed, **past)

    facts = [
        (own, ("fact", head, place), MARK if other is None else name(other).name)
        for head, place, own, other in rows("fact", _facts(view.at is not None))
    ]
    values = []
    for head, arguments, number, object_id in rows("value", _values(view.at is not None)):
        own, *others = map(int, arguments.split())
        value = number if object_id is None else name(object_id).name
        text = f"{name(others[0]).name}: {value}" if others else value
        values.append((own, ("value", head, 0), text))
    return [facts, values]


def _order(types: Elements[TypeDefinition], one: ObjectDefinition) -> tuple[str, str]:
    return fold(types.live(one.type_id).name), fold(one.name)


def _tables(
    types: Elements[TypeDefinition],
    page: list[ObjectDefinition],
    columns: dict[_Key, tuple[str, str]],
    said: list[tuple[int, _Key, str]],
) -> list[ObjectTable]:
    """Make a table of the objects of each type, which are adjacent."""
    cells: defaultdict[int, defaultdict[_Key, list[str]]] = defaultdict(lambda: defaultdict(list))
    for id_, key, text in said:
        cells[id_][key].append(text)
    tables = []
    for type_id, group in groupby(page, attrgetter("type_id")):
        own = [*group]
        keys = [key for key in columns if any(key in cells[one.id] for one in own)]
        rows = [
            ObjectRow(one.name, {columns[key][0]: sorted(cells[one.id][key]) for key in keys})
            for one in own
        ]
        tables.append(
            ObjectTable(types.live(type_id).name, dict(columns[key] for key in keys), rows)
        )
    return tables


def read_objects_page(
    state: State, type_: str | None = None, after: str | None = None, limit: int = 100
) -> ObjectsPage:
    """Read a page of the objects of a state, with their facts and values."""
    place = read_place(after, (str, str))
    if type_ is not None:
        refuse_unknown(state.store, type_, "type")

    def work(view: View) -> ObjectsPage:
        types = view.definitions.types
        every = sorted(view.definitions.objects, key=partial(_order, types))
        some = every
        if type_ is not None and fold(type_) != ROOT_TYPE:
            own = types.named(type_)
            wanted = view.definitions.subtypes(*(() if own is None else (own.id,)))
            some = [one for one in every if not wanted.isdisjoint(one.type_ids)]
        begin = bisect_right(some, place.key, key=partial(_order, types)) if place.key else 0
        page = some[begin : begin + limit]
        end = Place(0, _order(types, page[-1])) if begin + limit < len(some) else None
        columns = _columns(view.definitions)
        said = _said(view, columns, [one.id for one in page]) if page else []
        tables = _tables(types, page, columns, [each for part in said for each in part])
        names = dict.fromkeys(types.live(one.type_id).name for one in every)
        is_cut = any(len(part) > MOST for part in said)
        return ObjectsPage([*names], len(some), tables, is_cut, place_text(end))

    return state.store.read_in_snapshot(work, state.at)

"""The recipes of docs/architecture.md: they say all that a new element or column needs."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from sqlalchemy import BigInteger, Column, MetaData, String, Table

from kant_sql.knowledge.canonical import _TEXTS, canonical_text
from kant_sql.knowledge.definitions import KINDS, Definitions
from kant_sql.sql.rows import KIND_TABLES, Kind, ListTable, RowsByTable

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "kant_sql"
RECIPE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
# What names a function as a kind of element, in the order of the layers.
OF_FUNCTIONS = {
    "PddlFunctionDto",
    "TABLES['function']",
    "TABLES['function_version']",
    "TABLES['function_type']",
    "FunctionDefinition",
    "PddlFunctionDao",
    "SqlFunctionDao",
}
# What a function has beyond a named element: why each other module mentions one.
BEYOND = {
    "aio.py": "the awaitable DAO has its type",
    "cli/state.py": "the command that sets a value",
    "dao/base.py": "a result of values builds the DTOs of their functions",
    "dao/function_value.py": "functions have values",
    "dao/proposition.py": "arguments of fluents and of facts are checked alike",
    "documents/build.py": "a domain lists functions",
    "documents/load.py": "a domain declares functions",
    "dto/__init__.py": "public names",
    "history/elements.py": "the history of a value is asked for by its function",
    "history/verify/definition_check.py": "parameters of both kinds are checked alike",
    "knowledge/resolved.py": "conditions and effects apply functions",
    "reasoning/effects.py": "effects change the values of functions",
    "knowledge/symbols.py": "conditions apply functions",
    "reasoning/world.py": "a plan is executed with the functions of its documents",
    "sql/intervals.py": "past values are found by their function",
}


def _section(title: str) -> str:
    """The text of one section of the page."""
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", RECIPE, re.M | re.S)
    assert found is not None, title
    return found[1]


def _files(title: str) -> set[str]:
    """The modules that a recipe names."""
    return {
        name
        for name in re.findall(r"`([\w/]+\.py)`", _section(title))
        if not name.startswith("tests/")
    }


def _modules_that_mention(names: set[str]) -> set[str]:
    found = set()
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        mentioned = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        mentioned |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        mentioned |= {node.name for node in ast.walk(tree) if isinstance(node, ast.alias)}
        mentioned |= {node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
        mentioned |= {
            ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Subscript)
        }
        if mentioned & names:
            found.add(path.relative_to(PACKAGE).as_posix())
    return found


@pytest.mark.more
def test_the_recipe_names_each_module_that_a_function_is_in() -> None:
    title = "How to add a PDDL element"
    named = _files(title)
    assert all((PACKAGE / name).is_file() for name in named)
    # Each step names its module first; only elements with formulas need a second one.
    assert len(re.findall(r"^\d+\. `[\w/]+\.py`", _section(title), re.M)) == 8
    assert _modules_that_mention(OF_FUNCTIONS) - named == BEYOND.keys()


def test_each_kind_is_described_once_in_each_place() -> None:
    assert list(KIND_TABLES) == list(KINDS)
    definitions = [kind._definition for kind in KIND_TABLES.values()]
    assert [*_TEXTS] == definitions


def test_the_recipe_of_a_column_names_where_a_column_is_known() -> None:
    named = _files("How to add a column")
    known = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if re.search(r"\bis_constant\b.*Mapped|\n    is_constant: bool", path.read_text("utf-8"))
    }
    assert known <= named


class Stop(NamedTuple):
    """An entry of a toy's list, which has a list itself."""

    name: str
    type_ids: tuple[int, ...]


class RouteDefinition(NamedTuple):
    """A toy element."""

    id: int
    name: str
    length: int
    stops: tuple[Stop, ...]
    near: tuple[int, ...]
    text: str = ""


# Tables that the store's own metadata does not see.
TOY = MetaData()


def _table(table: str, /, *keys: str, **columns: Any) -> Table:
    """A toy's table; each key is a part of its primary key."""
    own = (Column(key, BigInteger, primary_key=True) for key in keys)
    return Table(table, TOY, *own, *(Column(each, type_) for each, type_ in columns.items()))


def _toy() -> Kind:
    version, stop = ("kb_id", "route_id", "since"), "position"
    text = String(20)
    TOY.clear()
    stops = _table("route_stop", *version, stop, name=text)
    types = _table("route_stop_type", *version, stop, "alternative", type_id=BigInteger)
    near = _table("route_near", *version, "position", object_id=BigInteger)
    return Kind(
        RouteDefinition,
        _table("route", "kb_id", "id", name=text, key=text),
        _table("route_version", *version, until=BigInteger, text=text, length=BigInteger),
        stops=ListTable(stops, Stop, type_ids=ListTable(types)),
        near=ListTable(near, first=1),
    )


ROUTES = (
    RouteDefinition(7, "a", 3, (Stop("x", (1, 2)), Stop("y", (3,))), (9, 8), "(a)"),
    RouteDefinition(8, "b", 0, (), (), "(b)"),
)


def test_a_description_is_all_that_a_new_kind_needs_to_be_written_and_read() -> None:
    kind = _toy()
    written: RowsByTable = defaultdict(list)
    for route in ROUTES:
        kind.add_rows(written, 1, 5, route)
    assert [table.name for table in (kind.version.table, *kind.version.children)] == [
        "route_version",
        "route_stop",
        "route_stop_type",
        "route_near",
    ]
    assert written[kind.version.table][0] == (1, 7, 5, None, "(a)", 3)
    assert written[TOY.tables["route_near"]] == [(1, 7, 5, 1, 9), (1, 7, 5, 2, 8)]
    names = {route.id: route.name for route in ROUTES}
    read = {
        table: [
            (row[1], names[row[1]], *row[4:]) if table is kind.version.table else (row[1], *row[3:])
            for row in reversed(rows)
        ]
        for table, rows in written.items()
    }
    assert sorted(kind.definitions(read)) == [*ROUTES]


def test_a_field_without_a_column_is_refused_at_once() -> None:
    class Wrong(NamedTuple):
        id: int
        name: str
        width: int

    with pytest.raises(KeyError, match="width"):
        Kind(Wrong, TOY.tables["route"], TOY.tables["route_version"])


def test_a_definition_of_no_kind_has_no_text() -> None:
    with pytest.raises(KeyError):
        canonical_text(Definitions(), ROUTES[0])

"""The recipes of docs/architecture.md: they say all that a new element or column needs."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from kant_sql.knowledge.canonical import _TEXTS
from kant_sql.knowledge.definitions import KINDS
from kant_sql.sql.rows import KIND_TABLES

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "kant_sql"
RECIPE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
# What names a function as a kind of element, in the order of the layers.
OF_FUNCTIONS = {
    *("PddlFunctionDto", "TABLES['function']", "TABLES['function_version']"),
    *("TABLES['function_type']", "FunctionDefinition", "PddlFunctionDao", "SqlFunctionDao"),
}
# What a function has beyond a named element: why each other module mentions one.
BEYOND = {
    "aio.py": "the awaitable DAO has its type",
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
            ast.unparse(node).removeprefix("t.")
            for node in ast.walk(tree)
            if isinstance(node, ast.Subscript)
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

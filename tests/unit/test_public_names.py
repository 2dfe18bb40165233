"""Names: each public one resolves, type checkers see the same one, and each has one meaning."""

from __future__ import annotations

import ast
import importlib
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

import kant_sql

SOURCE = Path(kant_sql.__file__)
HOMES = {name: module for module, names in kant_sql._HOMES.items() for name in names}


def typed_homes() -> dict[str, str]:
    """Give the module that each name comes from which type checkers alone see imported."""
    for node in ast.parse(SOURCE.read_text()).body:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return {
                name.name: f".{part.module}"
                for part in node.body
                if isinstance(part, ast.ImportFrom) and part.module
                for name in part.names
            }
    raise AssertionError("no names for type checkers")


def test_a_name_comes_from_where_type_checkers_see_it() -> None:
    assert typed_homes() == HOMES


@pytest.mark.parametrize("name", kant_sql.__all__)
def test_each_public_name_resolves(name: str) -> None:
    value = getattr(kant_sql, name)
    home = HOMES.get(name)
    if home is not None:
        assert value is getattr(importlib.import_module(home, "kant_sql"), name)
    assert name in dir(kant_sql)


def test_what_has_a_home_is_public() -> None:
    assert set(HOMES) <= set(kant_sql.__all__)


def test_modules_are_attributes_and_are_not_shown() -> None:
    for path in SOURCE.parent.iterdir():
        name = path.stem
        if name[0] != "_" and name not in ("py", "web", "plots", "export", "cli"):
            assert isinstance(getattr(kant_sql, name), ModuleType)
            assert name not in dir(kant_sql)


def test_the_front_door_can_be_held_in_mind() -> None:
    assert len(dir(kant_sql)) <= 90
    assert len([name for name in dir(kant_sql.KnowledgeBase) if name[0] != "_"]) <= 59


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    name = "KnowledgBase"
    with pytest.raises(AttributeError, match="'kant_sql' has no attribute 'KnowledgBase'"):
        getattr(kant_sql, name)
    assert not hasattr(kant_sql, "cli_")


def test_no_two_classes_share_a_name() -> None:
    names = Counter(
        node.name
        for path in SOURCE.parent.rglob("*.py")
        # The drop-in has the original library's names.
        if path.name != "compat.py"
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert len(names) > 200
    assert [name for name, count in names.items() if count > 1] == []

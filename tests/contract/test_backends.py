"""A backend is one file and one registration: everything else works on it unchanged."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import kant_sql
from kant_sql.sql.dialects import BACKENDS
from kant_sql.sql.predicate_views import update_views
from tests.support.stores import Connect
from tests.support.worlds.robots import WP2, robot_at

pytestmark = pytest.mark.every_backend

PACKAGE = Path(kant_sql.__file__).parent
# Where a dialect may be named: families with a class of their own, and types of columns.
NAMED = {"factory.py", "sql/tables/base.py"}

TOY = """
from kant_sql.sql.dialects.sqlite import SqliteBackend


class ToyBackend(SqliteBackend):
    pass
"""


def test_a_registered_backend_serves_all_of_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, connect: Connect
) -> None:
    (tmp_path / "toy_backend.py").write_text(TOY)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(BACKENDS, "toy", "toy_backend:ToyBackend")
    toy_url = f"toy:///{tmp_path / 'robot.toy'}"
    kb = connect(toy_url, knowledge_base="tiago", actor="me")
    assert type(kb.store.factory._store.backend).__name__ == "ToyBackend"  # type: ignore[attr-defined]
    kb.propositions.save(robot_at())
    kb.propositions.save(robot_at(place=WP2))
    assert [str(each) for each in kb.at(1).propositions.get_all()] == [str(robot_at())]
    assert kb.restore(1) == 3
    assert {view.change for view in update_views(toy_url)} == {"created"}
    assert kb.store.archive(3, to=f"toy:///{tmp_path / 'archive.toy'}").versions == {}
    verified = kb.store.verify()
    assert (verified.findings, verified.revisions) == ((), 3)


def test_no_other_module_names_a_dialect() -> None:
    named = {
        module.relative_to(PACKAGE).as_posix()
        for module in PACKAGE.rglob("*.py")
        if "dialects" not in module.parts
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value in BACKENDS
    }
    assert named == NAMED

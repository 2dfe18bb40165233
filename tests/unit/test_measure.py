"""`make measure` counts what it says, on a small tree whose measures are known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.measure import (
    Imports,
    floors,
    main,
    measure,
    module_graph,
    read_sources,
    report,
    sibling_graph,
)

LONG = (
    '''def long(session):
    """Do much.

    Args:
        session: the session.
    """
'''
    + "    session()\n" * 40
)

TREE = {
    "kant_sql/__init__.py": '"""All."""\n\nfrom .store import Store\n',
    "kant_sql/errors.py": "",
    "kant_sql/store/__init__.py": "from .store import (\n    Store,\n)\n",
    "kant_sql/store/store.py": (
        "from typing import TYPE_CHECKING\n"
        "from ..errors import KantSqlError  # no comment line\n"
        "if TYPE_CHECKING:\n"
        "    from .transaction import Transaction\n"
    ),
    "kant_sql/store/transaction.py": (
        "# Why, not what.\n"
        "class Transaction:\n"
        '    """A transaction.\n'
        "\n"
        "    Attributes:\n"
        "        knowledge_base: The knowledge base.\n"
        "        session: the session of the writer.\n"
        '    """\n'
        "    def store(self):\n"
        "        from kant_sql.store.store import Store\n"
        '        text = "# no comment"\n'
    ),
    "kant_sql/sql/__init__.py": "",
    "kant_sql/sql/query.py": "from . import dialects\nfrom .. import errors\n",
    "kant_sql/sql/dialects/__init__.py": "from kant_sql.sql import query\n",
    "kant_sql/cli.py": "import kant_sql\n" + LONG,
    "kant_sql/history.py": "\n" * 701,
    "migrations/versions/0001_initial.py": "import alembic\n# A comment.\n",
}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name, text in TREE.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_files_and_lines_are_counted(root: Path) -> None:
    measures = measure(root)
    assert (measures.files, measures.small_files) == (10, 9)
    assert measures.package_lines == 3 + 3 + 4 + 11 + 2 + 1 + 47 + 701
    assert measures.lines == measures.package_lines + 2
    assert measures.import_lines == 1 + 3 + 3 + 1 + 2 + 1 + 1 + 1
    assert measures.docstring_lines == 1 + 6 + 5
    assert measures.comment_lines == 2


def test_docstring_lines_that_repeat_the_name_are_counted(root: Path) -> None:
    assert measure(root).empty_docstring_lines == 2


def test_long_functions_and_modules_are_listed_without_the_docstrings(root: Path) -> None:
    measures = measure(root)
    assert measures.long_functions == [(41, "kant_sql/cli.py:2 long")]
    assert measures.long_modules == [(701, "kant_sql/history.py")]


def test_imports_are_resolved_wherever_they_stand(root: Path) -> None:
    assert module_graph(read_sources(root, "kant_sql")) == {
        "kant_sql": {"kant_sql.store"},
        "kant_sql.cli": {"kant_sql"},
        "kant_sql.errors": set(),
        "kant_sql.history": set(),
        "kant_sql.store": {"kant_sql.store.store"},
        "kant_sql.store.store": {"kant_sql.errors", "kant_sql.store.transaction"},
        "kant_sql.store.transaction": {"kant_sql.store.store"},
        "kant_sql.sql": set(),
        "kant_sql.sql.query": {"kant_sql.sql.dialects", "kant_sql.errors"},
        "kant_sql.sql.dialects": {"kant_sql.sql.query"},
    }


def test_type_checking_and_function_level_imports_make_circles(root: Path) -> None:
    assert measure(root).modules.circles == [
        ["kant_sql.sql.dialects", "kant_sql.sql.query"],
        ["kant_sql.store.store", "kant_sql.store.transaction"],
    ]


def test_rooms_are_the_entries_of_the_package(root: Path) -> None:
    rooms = measure(root).rooms
    assert rooms.nodes == 5  # cli, errors, history, sql, store
    assert rooms.circles == []
    # errors; sql and store; cli, which imports the package and so the store
    assert rooms.floors == 3


def test_a_sub_package_is_one_sibling_of_the_modules_beside_it(root: Path) -> None:
    measures = measure(root)
    assert measures.packages == 3  # sql, sql.dialects, store
    assert measures.sibling_circles == [
        ["kant_sql.sql.dialects", "kant_sql.sql.query"],
        ["kant_sql.store.store", "kant_sql.store.transaction"],
    ]


def test_an_import_below_a_sub_package_is_one_of_the_sub_package() -> None:
    graph = {"p.a": {"p.b.c"}, "p.b.c": {"p.b.d"}, "p.b.d": {"p.a", "q"}, "p": set(), "q": set()}
    assert sibling_graph(graph, "p") == {"p.a": {"p.b"}, "p.b": {"p.a"}}
    assert sibling_graph(graph, "p.b") == {"p.b.c": {"p.b.d"}, "p.b.d": set()}


def test_a_circle_stands_on_one_floor() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d", "e"}, "d": {"e"}, "e": set()}
    assert floors(graph) == 4
    assert floors({}) == 0


def test_each_circle_is_listed_once() -> None:
    graph = {"a": {"b", "c"}, "b": {"c", "a"}, "c": {"a"}, "d": {"a"}}
    imports = Imports.of(graph)
    assert imports.circles == [["a", "b"], ["a", "c"], ["a", "b", "c"]]
    assert imports.components == [{"a", "b", "c"}]


def test_coverage_is_of_the_record_if_there_is_one(root: Path) -> None:
    assert measure(root).coverage is None
    totals = {"covered_lines": 3, "num_statements": 4, "covered_branches": 1, "num_branches": 2}
    (root / "coverage.json").write_text(json.dumps({"totals": totals}))
    assert measure(root).coverage == (75, 50)
    assert list(report(measure(root)))[-1].split() == ["coverage", "of", "branches", "50.0", "%"]


def test_the_command_measures_another_checkout(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--root", str(root)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "files in kant_sql/ 10" in lines
    assert "sql.dialects > sql.query > sql.dialects" in lines
    assert "coverage unknown `make coverage` records it" in lines


def test_a_folder_without_the_package_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="no Python files"):
        main(["--root", str(tmp_path)])

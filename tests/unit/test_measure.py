"""`make measure` counts what it says, on small trees and calls whose measures are known."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import measure

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
    "tests/test_all.py": "import kant_sql\n# A comment.\n",
}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name, text in TREE.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_files_and_lines_are_counted(root: Path) -> None:
    size = measure.measure(root)
    assert size.files == 10
    assert size.lines == 3 + 3 + 4 + 11 + 2 + 1 + 47 + 701
    assert size.test_lines == 2


def test_long_functions_are_listed_without_their_docstrings(root: Path) -> None:
    assert measure.measure(root).long_functions == ["41 lines: kant_sql/cli.py:2 long"]


def test_imports_are_resolved_wherever_they_stand(root: Path) -> None:
    assert measure.module_graph(measure.read_sources(root, "kant_sql")) == {
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
    assert sorted(measure.measure(root).circles) == [
        "circle: kant_sql.sql.dialects, kant_sql.sql.query",
        "circle: kant_sql.store.store, kant_sql.store.transaction",
    ]


def test_rooms_are_the_entries_of_the_package(root: Path) -> None:
    rooms = measure.sibling_graph(
        measure.module_graph(measure.read_sources(root, "kant_sql")), "kant_sql"
    )
    assert len(rooms) == 5  # cli, errors, history, sql, store
    assert measure.circles(rooms) == []
    # errors; sql and store; cli, which imports the package and so the store
    assert measure.measure(root).floors == measure.floors(rooms) == 3


def test_an_import_below_a_sub_package_is_one_of_the_sub_package() -> None:
    graph = {"p.a": {"p.b.c"}, "p.b.c": {"p.b.d"}, "p.b.d": {"p.a", "q"}, "p": set(), "q": set()}
    assert measure.sibling_graph(graph, "p") == {"p.a": {"p.b"}, "p.b": {"p.a"}}
    assert measure.sibling_graph(graph, "p.b") == {"p.b.c": {"p.b.d"}, "p.b.d": set()}


def test_a_circle_stands_on_one_floor() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d", "e"}, "d": {"e"}, "e": set()}
    assert measure.floors(graph) == 4
    assert measure.floors({}) == 0


def test_one_circle_is_one_line(root: Path) -> None:
    graph = {"a": {"b", "c"}, "b": {"c", "a"}, "c": {"a"}, "d": {"a"}}
    assert measure.circles(graph) == ["circle: a, b, c"]


def test_the_source_of_another_checkout_is_measured(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert measure.main(["--root", str(root), "--source"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "| files | 10 |" in lines
    assert "circle: kant_sql.sql.dialects, kant_sql.sql.query" in lines


def test_calls_files_and_switches_are_those_of_the_package(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("def inner(sort): return sort()\n")
    (tmp_path / "two.py").write_text(
        "import one\ndef outer(): return one.inner(lambda: sorted([2, 1], key=str))\n"
    )
    script = (
        f"import sys; sys.path[:0] = [{str(measure.ROOT)!r}, {str(tmp_path)!r}]; import two\n"
        f"from tests.measure import follow; print(follow(two.outer, {str(tmp_path)!r}))"
    )
    # outer, inner, and the lambda of the first file; `sorted` and `str` are nobody's
    assert measure.run(tmp_path, "-c", script) == "3, 2, 2\n"


def test_a_program_of_this_checkout_shows_calls_and_names(tmp_path: Path) -> None:
    shown = measure.run(
        measure.ROOT, str(measure.ROOT / "tests" / "measure.py"), "--probe", str(tmp_path)
    ).splitlines()
    names = [line.partition("|")[0] for line in shown]
    save, query, members = (
        [int(number) for number in line.partition("|")[2].split(", ")] for line in shown
    )
    assert names[0] == "warm save: calls, files, switches"
    assert all(number > 0 for number in (*save, *query, *members))


def test_a_folder_without_the_package_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="no Python files"):
        measure.main(["--root", str(tmp_path)])

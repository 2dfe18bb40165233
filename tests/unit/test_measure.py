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
    "kant_sql/store/store.py": "# Why, not what.\nclass Store:\n    pass\n",
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
    assert size.files == 5
    assert size.lines == 3 + 3 + 47 + 701
    assert size.test_lines == 2


def test_long_functions_are_listed_without_their_docstrings(root: Path) -> None:
    assert measure.measure(root).long_functions == ["41 lines: kant_sql/cli.py:2 long"]


def test_the_source_of_another_checkout_is_measured(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert measure.main(["--root", str(root), "--source"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "| files | 5 |" in lines
    assert "41 lines: kant_sql/cli.py:2 long" in lines


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

"""The migrations ship inside the wheel, and the library finds them there."""

from __future__ import annotations

import shutil
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

from hatchling.builders.wheel import WheelBuilder

from tests.support.processes.commands import child

ROOT = Path(__file__).parents[2]

PROGRAM = """
import kant_sql, kant_sql.sql.schema
print(kant_sql.__file__)
print(kant_sql.sql.schema.migrations_folder())
with kant_sql.connect("sqlite:///new.db") as kb:
    kb.types.save(kant_sql.PddlTypeDto("robot"))
    print(kb.revision)
"""


def test_the_wheel_is_told_to_hold_the_migrations() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = config["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["packages"] == ["kant_sql", "kant_sql_plugins"]
    assert wheel["force-include"] == {"migrations": "kant_sql/migrations"}


def test_the_wheel_has_what_is_not_python(tmp_path: Path) -> None:
    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    with ZipFile(wheel) as file:
        packed = set(file.namelist())
    folders = [ROOT / "kant_sql" / "web", ROOT / "kant_sql_plugins"]
    found = [
        one
        for folder in folders
        for one in folder.rglob("*")
        if one.suffix in (".html", ".css", ".js")
    ]
    assert {one.name for one in found} >= {"base.html", "guide.html", "style.css"}
    assert {one.relative_to(ROOT).as_posix() for one in found} <= packed


def test_an_installed_library_creates_a_store_by_the_migrations_in_it(tmp_path: Path) -> None:
    package = tmp_path / "site" / "kant_sql"
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "kant_sql", package, ignore=ignore)
    shutil.copytree(ROOT / "migrations", package / "migrations", ignore=ignore)
    words, path = ("-W", "error", "-c", PROGRAM), str(package.parent)
    done = child(*words, program=[sys.executable], cwd=tmp_path, PYTHONPATH=path)
    assert (done.stdout.splitlines(), done.stderr) == (
        [str(package / "__init__.py"), str(package / "migrations"), "1"],
        "",
    )

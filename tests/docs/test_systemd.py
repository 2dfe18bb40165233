"""The systemd units of the docs are what systemd takes."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

DOCUMENT = Path(__file__).parents[2] / "docs" / "replicas.md"
PROGRAM = "/usr/local/bin/kant-sql"


def unit() -> str:
    (text,) = re.findall(r"^```ini\n(.*?)^```", DOCUMENT.read_text(), re.DOTALL | re.MULTILINE)
    return str(text)


def test_exit_codes_that_ask_for_no_restart_are_those_of_the_table() -> None:
    rows = re.findall(r"^\| (\d+) \| .* \| no \|$", DOCUMENT.read_text(), re.MULTILINE)
    assert f"RestartPreventExitStatus={' '.join(rows)}" in unit().splitlines()
    assert rows == ["2", "65", "77", "78"]


def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not installed")
    # A unit has to quote a path with a space in it.
    program = tmp_path / "kant-sql"
    program.symlink_to(Path(sys.executable).with_name("kant-sql"))
    assert PROGRAM in unit()
    path = tmp_path / "kant-sql-push.service"
    # It looks for the program, and for nothing that the unit does not name.
    path.write_text(unit().replace(PROGRAM, str(program)))
    done = subprocess.run(
        [analyze, "verify", "--man=no", str(path)], capture_output=True, text=True, check=False
    )
    complaints = [line for line in done.stderr.splitlines() if path.name in line]
    assert (done.returncode, complaints) == (0, []), done.stderr
    path.write_text(path.read_text().replace("Type=exec", "Type=unknown"))
    done = subprocess.run(
        [analyze, "verify", "--man=no", str(path)], capture_output=True, text=True, check=False
    )
    assert path.name in done.stderr

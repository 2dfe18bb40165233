"""Running the command line, in this process and in a child."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from kant_sql.cli.main import app

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "kant_sql.cli.main"]
CHILD_TIMEOUT = 60


def run(*words: str, url: str | None = None) -> Result:
    """Run `kant-sql` in this process, with `url` as the default URL."""
    return CliRunner().invoke(app, list(words), env={"KANT_SQL_URL": url})


def environment(**variables: str) -> dict[str, str]:
    """The environment of a child: this one, without a default URL unless it is given."""
    kept = {name: value for name, value in os.environ.items() if name != "KANT_SQL_URL"}
    return {**kept, **variables}


def child(
    *words: str, command: Sequence[str] = COMMAND, cwd: Path = ROOT, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run `kant-sql`, or another command, as a process of its own."""
    return subprocess.run(
        [*command, *words],
        capture_output=True,
        text=True,
        encoding="utf-8",
        env=environment(**variables),
        cwd=cwd,
        timeout=CHILD_TIMEOUT,
        check=False,
    )


def start(*words: str, **options: Any) -> subprocess.Popen[bytes]:
    """Start `kant-sql` as a process of its own, and leave it running."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.Popen([*COMMAND, *words], env=environment(), **options)


def one_line(error: str) -> str:
    """The one line that an error is; fails when it is anything else."""
    lines = error.splitlines()
    assert len(lines) == 1, error
    assert lines[0].startswith("kant-sql: "), error
    return lines[0]

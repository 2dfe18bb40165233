"""The command line and the examples, run in this process and in a child."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any
from unittest import mock

from typer.main import get_command
from typer.testing import CliRunner, Result

from kant_sql.cli.main import app
from tests.support.processes.warm import MODULES, python

ROOT = Path(__file__).resolve().parents[3]
# As users start it, for tests in which the start matters: most only need a `command()`.
PROGRAM = [sys.executable, "-m", "kant_sql.cli.main"]
CHILD_TIMEOUT = 60
EXAMPLES = ROOT / "examples"


_commands = functools.cache(get_command)


def run(*words: str, url: str | None = None) -> Result:
    """Run `kant-sql` in this process, with `url` as the default URL."""
    # Otherwise, it makes the commands anew from their functions, which takes as long as they do.
    with mock.patch("typer.testing._get_command", _commands):
        return CliRunner().invoke(app, list(words), env={"KANT_SQL_URL": url})


def command() -> list[str]:
    """Return the command line that starts `kant-sql` as its own process."""
    return [str(python(*MODULES)), "-m", "kant_sql.cli.main"]


def environment(**variables: str) -> dict[str, str]:
    """Return the environment of a child: this one, without a default URL unless given."""
    kept = {name: value for name, value in os.environ.items() if name != "KANT_SQL_URL"}
    return {**kept, **variables}


def child(
    *words: str,
    program: Sequence[str] = (),
    cwd: Path = ROOT,
    given: str | None = None,
    timeout: float = CHILD_TIMEOUT,
    **variables: str,
) -> subprocess.CompletedProcess[str]:
    """Run `kant-sql`, or another program, as its own process, with `given` as its input."""
    return subprocess.run(
        [*(program or command()), *words],
        input=given,
        capture_output=True,
        text=True,
        encoding="utf-8",
        env=environment(**variables),
        cwd=cwd,
        timeout=timeout,
        check=False,
    )


def start(*words: str, program: Sequence[str] = (), **options: Any) -> subprocess.Popen[bytes]:
    """Start `kant-sql` as its own process, and leave it running."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.Popen([*(program or command()), *words], env=environment(), **options)


def one_line(error: str) -> str:
    """Return the only line of an error; fail if there is more."""
    lines = error.splitlines()
    assert len(lines) == 1, error
    assert lines[0].startswith("kant-sql: "), error
    return lines[0]


def written(*words: str, url: str | None = None) -> str:
    """Return the output of a command that succeeds without a complaint."""
    result = run(*words, url=url)
    assert (result.exit_code, result.stderr) == (0, ""), result.stderr
    return result.stdout


def documents(*words: str, code: int = 0, url: str | None = None) -> list[Any]:
    """Return the JSON documents that a command writes, one per line."""
    result = run(*words, "--json", url=url)
    assert (result.exit_code, result.stderr) == (code, ""), result.stderr
    return [json.loads(line) for line in result.stdout.splitlines()]


def document(*words: str, code: int = 0, url: str | None = None) -> Any:
    """Return the only JSON document that a command writes."""
    (one,) = documents(*words, code=code, url=url)
    return one


def complaint(*words: str, code: int = 1, url: str | None = None) -> str:
    """Return the error line of a command that fails and writes nothing else."""
    result = run(*words, url=url)
    assert (result.exit_code, result.stdout) == (code, "")
    return one_line(result.stderr)


def in_terminal(
    *words: str,
    is_output: bool = True,
    width: int = 80,
    variables: Mapping[str, str] = MappingProxyType({}),
) -> tuple[str, str]:
    """Return the output of a successful command to a terminal, and to a pipe.

    The terminal is its standard output, or its standard error.
    """
    import pty

    controller, terminal = pty.openpty()
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    streams["stdout" if is_output else "stderr"] = terminal
    around = {"TERM": "xterm", "COLUMNS": str(width), "KANT_SQL_PAGER": "", **variables}
    process = subprocess.Popen([*command(), *words], env=environment(**around), **streams)  # type: ignore[call-overload]
    os.close(terminal)
    shown = b""
    # On Linux, the end of a terminal is an error.
    with suppress(OSError):
        while part := os.read(controller, 65536):
            shown += part
    os.close(controller)
    piped = b"".join(filter(None, process.communicate(timeout=CHILD_TIMEOUT)))
    assert process.returncode == 0, piped
    return shown.decode().replace("\r\n", "\n"), piped.decode()


def run_example(
    name: str, *arguments: str, timeout: float = 120, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run an example to its end, away from the repository's root."""
    program = [str(python(*MODULES)), str(EXAMPLES / name)]
    return child(*arguments, program=program, cwd=EXAMPLES, timeout=timeout, **variables)

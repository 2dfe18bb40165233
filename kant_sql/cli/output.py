"""How the commands write: styled tables in a terminal or a pager, plain text in a pipe, or JSON."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Annotated, TextIO

import typer
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

JSON_OPTION = "--json"
AsJson = Annotated[bool, typer.Option(JSON_OPTION, help="One JSON document.")]

# What would steer a terminal, or what some reader takes for the end of a line.
_STEERING = r"\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
_CONTROLS = re.compile(rf"[\x00-\x1f{_STEERING}")
_CONTROLS_BUT_SPACE = re.compile(rf"[\x00-\x08\x0b-\x1f{_STEERING}")
_GAP = "  "
_TAB = "  "
# Rich takes a second for 10,000 rows, which nobody reads in a box.
_BOXED_ROWS = 5_000
# Rich leaves out what it has no place for, all of it where COLUMNS is 0.
_LEAST_WIDTH = 40


def printable(text: str) -> str:
    """Write free text on one line, so that it cannot steer a terminal.

    Args:
        text: the text.

    Returns:
        The text, with its control characters as in a JSON string.
    """
    return _CONTROLS.sub(_escaped, text)


def printable_lines(text: str) -> str:
    """Write a text that may have several lines, so that it cannot steer a terminal.

    Args:
        text: the text.

    Returns:
        The text, with its control characters but tabs and the ends of lines as in a JSON string.
    """
    return _CONTROLS_BUT_SPACE.sub(_escaped, text)


def _escaped(match: re.Match[str]) -> str:
    return json.dumps(match[0])[1:-1]


def plural(count: int, noun: str) -> str:
    """Write how many there are of something.

    Args:
        count: the number.
        noun: what it is, of which the plural ends in s.

    Returns:
        As `1 file`, `1,204 files`.
    """
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def json_text(value: object, to: TextIO | None = None) -> str:
    """Write JSON on one line.

    Args:
        value: what JSON can say.
        to: where it is to be written; standard output when not given.

    Returns:
        The document; characters that the stream cannot take are escaped.
    """
    encoding = (to or sys.stdout).encoding or ""
    ascii_only = encoding.lower().replace("-", "") != "utf8"
    return printable(json.dumps(value, ensure_ascii=ascii_only))


def write_json(value: object) -> None:
    """Write a JSON document and end the line.

    Args:
        value: what JSON can say.
    """
    sys.stdout.write(json_text(value) + "\n")


PAGER_VARIABLES = "KANT_SQL_PAGER", "PAGER"
# As git has it: less quits when all fits on the screen, passes colours on, and leaves the text.
_PAGER_DEFAULTS = {"LESS": "FRX", "LV": "-c"}


class _Paging:
    """Whether a pager is wanted, and whether one is between this process and the terminal."""

    is_wanted = True
    is_on = False


def want_pager(wanted: bool) -> None:
    """Set whether long output may go through a pager.

    Args:
        wanted: whether it may.
    """
    _Paging.is_wanted = wanted


def is_terminal() -> bool:
    """Tell whether somebody reads standard output in a terminal, perhaps through a pager.

    Returns:
        Whether it is so.
    """
    return _Paging.is_on or sys.stdout.isatty()


@contextmanager
def paged() -> Iterator[None]:
    """Send what the block writes through a pager, if it goes to a terminal.

    Who quits the pager has read enough: that ends the block, and is no failure.

    Yields:
        Nothing.
    """
    command = _pager() if _Paging.is_wanted and sys.stdout.isatty() else None
    if command is None:
        yield
        return
    sys.stdout.flush()
    descriptor = sys.stdout.fileno()
    terminal = os.dup(descriptor)
    pager = subprocess.Popen(
        command, shell=True, stdin=subprocess.PIPE, env={**_PAGER_DEFAULTS, **os.environ}
    )
    assert pager.stdin is not None
    os.dup2(pager.stdin.fileno(), descriptor)
    pager.stdin.close()
    _Paging.is_on = True
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        _forget(descriptor)
    except BaseException:
        with suppress(BrokenPipeError):
            sys.stdout.flush()
        _forget(descriptor)
        raise
    finally:
        _Paging.is_on = False
        # The pager is at its end when nobody can write to it any more.
        os.dup2(terminal, descriptor)
        os.close(terminal)
        _wait_for(pager)


def _pager() -> str | None:
    """Find the pager's command; None where there is none, or none is wanted."""
    for variable in PAGER_VARIABLES:
        if variable in os.environ:
            command = os.environ[variable].strip()
            break
    else:
        command = "" if os.environ.get("TERM", "dumb") == "dumb" else "less"
    with suppress(ValueError):
        words = shlex.split(command)
        if words in ([], ["cat"]) or shutil.which(words[0]) is None:
            return None
    return command


def _forget(descriptor: int) -> None:
    """Let what is still buffered go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)
    sys.stdout.flush()


def _wait_for(pager: subprocess.Popen[bytes]) -> None:
    """Wait until the pager has been quit: Ctrl-C is for the pager alone."""
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if is_main else None
    try:
        pager.wait()
    finally:
        if is_main:
            signal.signal(signal.SIGINT, before)


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Let it be seen that nobody reads any more: rich would end the process with a failure."""
        raise BrokenPipeError


class Printer:
    """Writes for people: with styles and boxes in a terminal, plain text anywhere else.

    No text is ever cut off, and none is read as markup or steers a terminal: who changed a store
    without the library may have put anything into it.
    """

    def __init__(self) -> None:
        is_forced = True if _Paging.is_on else None
        self._console = (
            _Console(highlight=False, force_terminal=is_forced) if is_terminal() else None
        )
        if self._console is not None:
            self._console.width = max(self._console.width, _LEAST_WIDTH)

    def line(self, text: str = "", style: str = "") -> None:
        """Write a line.

        Args:
            text: the text; it may hold line breaks.
            style: its style in a terminal.
        """
        text = printable_lines(text)
        if self._console is None:
            sys.stdout.write(f"{text}\n")
        else:
            self._console.print(Text(text.replace("\t", _TAB), style), soft_wrap=True)

    def table(self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Write a table under a title that tells how many rows it has.

        Args:
            title: what the rows are.
            columns: the head of each column.
            rows: the cells of each row; in the last column they may hold line breaks.
        """
        self.line()
        self.line(f"{title} ({len(rows)})", "bold")
        if not rows:
            return
        rows = [[printable_lines(cell) for cell in row] for row in rows]
        if self._console is None or len(rows) > _BOXED_ROWS:
            _write_columns(columns, rows)
            return
        table = Table()
        for column in columns:
            table.add_column(Text(column), overflow="fold")
        for row in rows:
            table.add_row(*(Text(cell.replace("\t", _TAB)) for cell in row))
        self._console.print(table)


def _write_columns(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write the columns side by side; one alone needs no head beside the title."""
    lines = [columns, *rows] if len(columns) > 1 else rows
    widths = [max(map(cell_len, cells)) for cells in zip(*lines, strict=True)][:-1]
    for *cells, last in lines:
        padded = (
            cell + " " * (width - cell_len(cell)) for cell, width in zip(cells, widths, strict=True)
        )
        sys.stdout.write(f"{_GAP.join([*padded, last]).rstrip()}\n")

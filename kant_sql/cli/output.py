"""Output: styled tables in a terminal or a pager, plain text in a pipe, or JSON; progress bars."""

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
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TextIO, TypeVar, cast

from ..errors import printable
from ..json_values import json_value

if TYPE_CHECKING:
    from rich.console import Console

T = TypeVar("T")

FAILED = 1
# No rule is violated, but one could not be judged.
NOT_JUDGED = 3

Document = dict[str, object]

_LAYOUT = re.compile(r"[^\t\n]+")
_GAP = "  "
_TAB = "  "
# Rich takes a second for 10,000 rows; nobody reads that many in a box.
_BOXED_ROWS = 5_000
# Rich drops text that does not fit: all of it if COLUMNS is 0.
_LEAST_WIDTH = 40


def printable_lines(text: str) -> str:
    """Escape text as `printable` does, but keep line feeds and tabs."""
    return _LAYOUT.sub(lambda match: printable(match[0]), text)


def plural(count: int, noun: str) -> str:
    """Return a count with its noun, as in `2 revisions`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def json_text(value: object, to: TextIO | None = None) -> str:
    """Return a value or a result as JSON on one line, in ASCII unless the stream is UTF-8."""
    encoding = (to or sys.stdout).encoding or ""
    ascii_only = encoding.lower().replace("-", "") != "utf8"
    return printable(json.dumps(json_value(value), ensure_ascii=ascii_only))


def write_json(value: object = None, /, **header: object) -> None:
    """Write a value or a result as JSON on a line, after the keys of a header."""
    if header:
        own = json_value(value)
        value = {**header, **own} if isinstance(own, dict) else header
    sys.stdout.write(json_text(value) + "\n")


PAGER_VARIABLES = "KANT_SQL_PAGER", "PAGER"
# As in git: less quits if all fits on the screen, passes colours, and leaves the text there.
_PAGER_DEFAULTS = {"LESS": "FRX", "LV": "-c"}


class _Paging:
    """Whether a pager is allowed, and whether one is running."""

    is_wanted = True
    is_on = False


def want_pager(wanted: bool) -> None:
    """Set whether long output may go through a pager."""
    _Paging.is_wanted = wanted


def is_terminal() -> bool:
    """Return whether standard output is a terminal, directly or through a pager."""
    return _Paging.is_on or sys.stdout.isatty()


@contextmanager
def paged() -> Iterator[None]:
    """Send the block's output through a pager if it goes to a terminal."""
    # Quitting the pager ends the block and is not a failure.
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
        drop_output()
    except BaseException:
        with suppress(BrokenPipeError):
            sys.stdout.flush()
        drop_output()
        raise
    finally:
        _Paging.is_on = False
        # The pager sees the end of its input once no descriptor is open for writing.
        os.dup2(terminal, descriptor)
        os.close(terminal)
        _wait_for(pager)


def _pager() -> str | None:
    """Return the pager's command; None if it is missing or disabled."""
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


def _wait_for(pager: subprocess.Popen[bytes]) -> None:
    """Wait until the pager quits; Ctrl-C is for the pager alone."""
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if is_main else None
    try:
        pager.wait()
    finally:
        if is_main:
            signal.signal(signal.SIGINT, before)


def drop_output(stream: TextIO | None = None) -> None:
    """Discard buffered output, so that flushing it at exit cannot fail."""
    stream = stream or sys.stdout
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
    stream.flush()


def complain(message: str) -> None:
    """Write a line to standard error, even if nobody reads it."""
    write_error(f"kant-sql: {printable(' '.join(message.split()))}")


def write_error(line: str) -> None:
    """Write an escaped line to standard error, even if nobody reads it."""
    try:
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()
    except BrokenPipeError:
        drop_output(sys.stderr)


class _Deaf:
    """A stream whose text is dropped once its reader is gone."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write some text."""
        with self._dropping():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write what is buffered."""
        with self._dropping():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextmanager
    def _dropping(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            drop_output(self._stream)


@contextmanager
def to_the_end() -> Iterator[None]:
    """Let the block finish its work, even if nobody reads the output any more."""
    stream, sys.stdout = sys.stdout, cast(TextIO, _Deaf(sys.stdout))
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stdout = stream


def _terminal(is_forced: bool | None) -> Console:
    from rich.console import Console

    class Terminal(Console):
        def on_broken_pipe(self) -> None:
            """Report a closed pipe; rich would exit with a failure."""
            raise BrokenPipeError

    return Terminal(highlight=False, force_terminal=is_forced)


class Printer:
    """Output for people: styles and boxes in a terminal, plain text elsewhere.

    Text is never cut off, read as markup, or able to control a terminal: a store that was changed
    without the library may contain anything.
    """

    def __init__(self) -> None:
        is_forced = True if _Paging.is_on else None
        self._console = _terminal(is_forced) if is_terminal() else None
        if self._console is not None:
            self._console.width = max(self._console.width, _LEAST_WIDTH)

    def line(self, text: str = "", style: str = "") -> None:
        """Write a line."""
        text = printable_lines(text)
        if self._console is None:
            sys.stdout.write(f"{text}\n")
        else:
            from rich.text import Text

            self._console.print(Text(text.replace("\t", _TAB), style), soft_wrap=True)

    def table(self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Write a table under a title with the number of rows."""
        self.line()
        self.line(f"{title} ({len(rows)})", "bold")
        if not rows:
            return
        rows = [[printable_lines(cell) for cell in row] for row in rows]
        if self._console is None or len(rows) > _BOXED_ROWS:
            _write_columns(columns, rows)
            return
        from rich.table import Table
        from rich.text import Text

        table = Table()
        for column in columns:
            table.add_column(Text(column), overflow="fold")
        for row in rows:
            table.add_row(*(Text(cell.replace("\t", _TAB)) for cell in row))
        self._console.print(table)


def write_each(
    found: Iterable[T],
    as_json: bool,
    write: Callable[[Printer, T], None],
    *,
    is_spaced: bool = False,
    **header: object,
) -> int:
    """Write each result, as JSON Lines or for people; return how many there are."""
    printer, count = Printer(), 0
    for count, one in enumerate(found, 1):
        if as_json:
            write_json(one, **header)
            continue
        if is_spaced and count > 1:
            printer.line()
        write(printer, one)
    return count


def _write_columns(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write aligned columns; a single column needs no head beside the title."""
    from rich.cells import cell_len

    lines = [columns, *rows] if len(columns) > 1 else rows
    widths = [max(map(cell_len, cells)) for cells in zip(*lines, strict=True)][:-1]
    for *cells, last in lines:
        padded = (
            cell + " " * (width - cell_len(cell)) for cell, width in zip(cells, widths, strict=True)
        )
        sys.stdout.write(f"{_GAP.join([*padded, last]).rstrip()}\n")


@contextmanager
def bar(name: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a progress bar in a terminal; yield the function that moves it."""
    from rich.console import Console

    console = Console(stderr=True)
    if not (sys.stderr.isatty() and console.is_interactive):
        yield None
        return
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        # Square brackets in a name are not markup.
        task = progress.add_task(printable(name).replace("[", r"\["), total=None)
        yield lambda done, whole: progress.update(task, completed=done, total=whole)

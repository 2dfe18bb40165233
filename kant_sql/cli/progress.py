"""How far a long command has come, where somebody sees it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from .output import printable


def progress_console() -> Console | None:
    """Find the terminal that progress is shown on.

    Returns:
        Standard error, when it is a terminal on which something can move; else None. FORCE_COLOR,
        which is often set where nobody looks, makes no terminal of a pipe.
    """
    console = Console(stderr=True)
    return console if sys.stderr.isatty() and console.is_interactive else None


@contextmanager
def bar(name: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar in a terminal.

    Args:
        name: what stands before it.

    Yields:
        What is to be called with how much is done, and how much there is; None in a pipe.
    """
    console = progress_console()
    if console is None:
        yield None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        # Square brackets in a name are no markup.
        task = progress.add_task(printable(name).replace("[", r"\["), total=None)
        yield lambda done, whole: progress.update(task, completed=done, total=whole)

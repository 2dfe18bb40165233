"""The entry point of `kant-sql`."""

from __future__ import annotations

import functools
import logging
import os
import sys
from collections.abc import Callable
from contextlib import nullcontext
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperArgument, TyperGroup

from .. import __version__
from .anchor import anchor, kbs
from .archive import archive
from .check import check
from .db import db
from .diff import diff
from .dump import dump
from .errors import INTERRUPTED, EndedEarlyError, run_to_exit_code
from .history import blame, history
from .load import load
from .log import log
from .output import paged, want_pager
from .plan import plan, plans
from .restore import restore
from .show import show
from .verify import verify
from .views import views
from .watch import watch


class Argument(TyperArgument):
    """An argument whose metavar is all that the help calls it: no braces, dots or Python types."""

    def get_usage_pieces(self, ctx: Any) -> list[str]:
        """Write the argument for the usage line.

        Args:
            ctx: what Typer gives.

        Returns:
            Its metavar.
        """
        return [self.metavar or str(self.name)]

    def get_help_record(self, ctx: Any) -> tuple[str, str] | None:
        """Write the argument for the list of arguments.

        Args:
            ctx: what Typer gives.

        Returns:
            Its metavar and its help.
        """
        record = super().get_help_record(ctx)
        return record and (self.metavar or str(self.name), record[1])


class Commands(TyperGroup):
    """The commands, with errors and endings of our own: one line, never a traceback."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        _name_arguments(self)

    def main(self, *args: Any, **options: Any) -> NoReturn:
        """Run a command line and exit.

        Args:
            *args: the words after the program's name; the process's own when not given.
            **options: what else Typer gives.
        """
        given = args[0] if args else options.get("args")
        words = sys.argv[1:] if given is None else list(given)
        options.update(args=words, prog_name="kant-sql", standalone_mode=False)
        sys.exit(run_to_exit_code(lambda: super(Commands, self).main(**options), words))

    def invoke(self, ctx: Any) -> Any:
        """Run a command.

        Args:
            ctx: what Typer gives.

        Returns:
            What the command returns.

        Raises:
            EndedEarlyError: nobody reads the output any more, or Ctrl-C was pressed. Typer itself
                would call the former a failure, and wait for a reader after the latter.
        """
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:
            raise EndedEarlyError(0) from error
        except KeyboardInterrupt as error:
            raise EndedEarlyError(INTERRUPTED) from error


def _name_arguments(command: Any) -> None:
    """Make the arguments of a command, and of those in it, ours: Typer offers no other way."""
    for parameter in command.params:
        if type(parameter) is TyperArgument:
            parameter.__class__ = Argument
    for one in getattr(command, "commands", {}).values():
        _name_arguments(one)


def _in_pager(command: Callable[..., object]) -> Callable[..., object]:
    """Let a command write through a pager, where people read it."""

    @functools.wraps(command)
    def run_in_pager(*words: Any, **options: Any) -> object:
        with nullcontext() if options.get("as_json") else paged():
            return command(*words, **options)

    return run_in_pager


# Help is plain text: what it says of URLs would be read as markup.
app = typer.Typer(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(db, name="db")
_PAGED = (dump, plans, kbs, show, log, diff, history, blame)
_COMMANDS = (
    load,
    dump,
    check,
    plan,
    plans,
    kbs,
    show,
    log,
    diff,
    history,
    blame,
    restore,
    views,
    watch,
)
for _command in (*_COMMANDS, verify, anchor, archive):
    app.command()(_in_pager(_command) if _command in _PAGED else _command)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"kant-sql {__version__}")
        raise typer.Exit


@app.callback()
def _kant_sql(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Tell the version.")
    ] = False,
    no_pager: Annotated[
        bool, typer.Option("--no-pager", help="Write long output straight to the terminal.")
    ] = False,
) -> None:
    """Fill, question and plan from the knowledge base that remembers."""
    want_pager(not no_pager)


def run() -> None:
    """Run the process's command line."""
    # The process may have been started with these closed.
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        # Standard error does so by itself: what its encoding lacks is escaped, and no failure.
        sys.stdout.reconfigure(errors="backslashreplace")
    _log()
    app()


def _log() -> None:
    """Log to standard error: warnings, or what `KANT_SQL_LOG` says."""
    level = os.environ.get("KANT_SQL_LOG", "warning").upper()
    if level not in logging.getLevelNamesMapping():
        sys.exit(f"KANT_SQL_LOG={level.lower()}: expected debug, info, warning or error")
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger("kant_sql").setLevel(level)


if __name__ == "__main__":
    run()

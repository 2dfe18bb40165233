"""The entry point of `kant-sql`: commands, exit codes, and errors as one line."""

from __future__ import annotations

import gc
import logging
import os
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial, wraps
from importlib import import_module
from io import TextIOWrapper
from keyword import iskeyword
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from .. import __version__
from ..errors import KantSqlError
from ..plugins import Plugins
from . import output
from .common import JSON_OPTION, CommandGroup, ServiceError

WRONG_USAGE, INTERRUPTED = 2, 130
_WRONG_USAGE = "UsageError"

_AUTHORITY = re.compile(r"(://[^\s:@/]*:)\S*@")
_WHOLE_URL = re.compile(r"(://[^:@/]*:).*@", re.DOTALL)
_OPTION = re.compile(r"([?&][^\s=&]*password[^\s=&]*=)[^\s&'\"]*", re.IGNORECASE)


class EndedEarlyError(Exception):
    """The command ended early; the rest of its output is discarded."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


def run_to_exit_code(command: Callable[[], object], words: Sequence[str]) -> int:
    """Run a command and return its exit code; an expected error becomes one line."""
    try:
        code = command()
        sys.stdout.flush()
    except EndedEarlyError as end:
        output.drop_output()
        return end.code
    except BrokenPipeError:
        output.drop_output()
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except ServiceError as error:
        return _complain(error.error, str(error.error), words, error.code)
    except OSError as error:
        if error.filename is not None:
            return _complain(error, f"{error.filename}: {error.strerror}", words, output.FAILED)
        output.drop_output()
        message = f"cannot write the output: {error.strerror or error}"
        return _complain(error, message, words, output.FAILED)
    except KantSqlError as error:
        return _complain(error, str(error), words, output.FAILED)
    except Exception as error:
        # Typer's own errors: the module of their base class depends on its version.
        if not hasattr(error, "format_message"):
            raise
        message = str(error.format_message()).rstrip(".")
        context = getattr(error, "ctx", None)
        command_path = context.command_path if context else "kant-sql"
        return _complain(error, f"{message}; try: {command_path} --help", words, WRONG_USAGE)
    return code if isinstance(code, int) else 0


def without_passwords(text: str, words: Sequence[str]) -> str:
    """Mask the passwords of all database URLs in a text."""
    for word in words:
        if "://" in word:
            text = text.replace(word, _WHOLE_URL.sub(r"\1***@", word))
    return _OPTION.sub(r"\1***", _AUTHORITY.sub(r"\1***@", text))


def _complain(error: Exception, message: str, words: Sequence[str], code: int) -> int:
    line = " ".join(without_passwords(message, words).split())
    # Whether the words ask for JSON, even if the rest of them is wrong.
    if JSON_OPTION in (words[: words.index("--")] if "--" in words else words):
        name = _WRONG_USAGE if code == WRONG_USAGE else type(error).__name__
        document = {"error": line, "type": name, "exit_code": code}
        output.write_error(output.json_text(document, sys.stderr))
    else:
        output.complain(line)
    return code


def _within(
    block: Callable[[], AbstractContextManager[None]], command: Callable[..., object]
) -> Callable[..., object]:
    """Run a command in a block; a pager is not for JSON."""

    @wraps(command)
    def run_within(*words: Any, **options: Any) -> object:
        with nullcontext() if block is output.paged and options.get("as_json") else block():
            return command(*words, **options)

    return run_within


# The module of each command; its name is that of the function, with `-` for `_`.
_HOMES = {
    **dict.fromkeys(("load", "dump", "check"), "documents"),
    **dict.fromkeys(("plan", "plans", "validate"), "plans"),
    "kbs": "store",
    "show": "state",
    **dict.fromkeys(("query", "holds", "goals"), "asking"),
    **dict.fromkeys(("why-not", "applicable", "apply"), "plans"),
    **dict.fromkeys(("log", "diff", "history", "blame", "consequences", "origins"), "history"),
    **dict.fromkeys(("acts", "statistics"), "acts"),
    **dict.fromkeys(("unconfirmed", "corrections"), "history"),
    **dict.fromkeys(("when", "rules"), "asking"),
    **dict.fromkeys(("restore", "branch"), "history"),
    "merge": "merging",
    **dict.fromkeys(("views", "export"), "store"),
    "watch": "history",
    **dict.fromkeys(("serve", "report"), "web"),
    "tokens": "tokens",
    **dict.fromkeys(("ros", "import"), "ros"),
    "verify": "verifying",
    **dict.fromkeys(("anchor", "backup", "archive"), "store"),
    **dict.fromkeys(("push", "promote"), "replication"),
    **dict.fromkeys(("erase", "retention"), "erasing"),
    "db": "store",
}
_PAGED = {"dump", "plans", "kbs", "show", "query", "goals", "applicable"}
_PAGED |= {"log", "acts", "statistics", "diff", "history", "blame", "when", "rules"}
_PAGED |= {"consequences", "origins", "unconfirmed", "corrections"}
# Their exit code reports the state of the store.
_FINISHED = {"verify", "push", "promote", "erase", "retention", "merge"}


def _find(name: str) -> Any:
    """Import the function of a command."""
    module = import_module(f".{_HOMES[name]}", __package__)
    found = getattr(module, f"{name}_" if iskeyword(name) else name.replace("-", "_"))
    if name in _PAGED:
        return _within(output.paged, found)
    # They finish their work, and keep their exit code, when nobody reads their output any more.
    return _within(output.to_the_end, found) if name in _FINISHED else found


class Commands(CommandGroup):
    """The commands; an error is one line, never a traceback."""

    functions = {name: partial(_find, name) for name in _HOMES}  # noqa: RUF012
    plugins = Plugins("kant_sql.commands")

    def main(self, *args: Any, **options: Any) -> NoReturn:
        """Run a command line and exit."""
        given = args[0] if args else options.get("args")
        words = sys.argv[1:] if given is None else list(given)
        options.update(args=words, prog_name="kant-sql", standalone_mode=False)
        sys.exit(run_to_exit_code(lambda: super(Commands, self).main(**options), words))

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:
            raise EndedEarlyError(0) from error
        except KeyboardInterrupt as error:
            raise EndedEarlyError(INTERRUPTED) from error


# Help is plain text: URLs in it would be read as markup.
app = typer.Typer(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"kant-sql {__version__}")
        raise typer.Exit


@app.callback()
def _kant_sql(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
    no_pager: Annotated[
        bool, typer.Option("--no-pager", help="Write long output without a pager.")
    ] = False,
) -> None:
    """Store what a robot knows, query it, plan and act on it, and see its history."""
    output.want_pager(not no_pager)


def run() -> None:
    """Run the command line of this process."""
    # Somebody may have started the process with these closed.
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        # As standard error does by default: escape what the encoding lacks.
        sys.stdout.reconfigure(errors="backslashreplace")
    _log()
    # A short command mostly imports, which leaves no garbage to collect.
    gc.set_threshold(100_000)
    app()


def _log() -> None:
    """Log to standard error, warnings unless `KANT_SQL_LOG` has another level."""
    level = os.environ.get("KANT_SQL_LOG", "warning").upper()
    if level not in logging.getLevelNamesMapping():
        sys.exit(f"KANT_SQL_LOG={level.lower()}: expected debug, info, warning or error")
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    for name in ("kant_sql", "kant_sql.sql"):
        logging.getLogger(name).setLevel(level)


if __name__ == "__main__":
    run()

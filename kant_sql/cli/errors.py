"""How a command ends: with an exit code, and one line on standard error when it failed.

The line is text, or a JSON document when the output was to be JSON.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Sequence

import typer

from ..errors import KantSqlError, SourceError
from .output import JSON_OPTION, json_text, printable

FAILED, WRONG_USAGE, INTERRUPTED = 1, 2, 130
_WRONG_USAGE = "UsageError"

_AUTHORITY = re.compile(r"(://[^\s:@/]*:)\S*@")
_WHOLE_URL = re.compile(r"(://[^:@/]*:).*@", re.DOTALL)
_OPTION = re.compile(r"([?&][^\s=&]*password[^\s=&]*=)[^\s&'\"]*", re.IGNORECASE)


class EndedEarlyError(Exception):
    """The command ended before its output did, and what is left of it is not wanted.

    Attributes:
        code: the exit code.
    """

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


def run_to_exit_code(command: Callable[[], object], words: Sequence[str]) -> int:
    """Run a command and tell its exit code; what it raises on purpose becomes one line.

    Args:
        command: the command.
        words: the words of the command line, none of which may reveal a password.

    Returns:
        The exit code.
    """
    try:
        code = command()
        sys.stdout.flush()
    except EndedEarlyError as end:
        _drop_output()
        return end.code
    except BrokenPipeError:
        _drop_output()
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except SourceError as error:
        return _complain(error, f"{error.filename}: {error.strerror}", words, FAILED)
    except KantSqlError as error:
        return _complain(error, str(error), words, FAILED)
    except OSError as error:
        if error.filename is not None:
            return _complain(error, f"{error.filename}: {error.strerror}", words, FAILED)
        _drop_output()
        message = f"cannot write the output: {error.strerror or error}"
        return _complain(error, message, words, FAILED)
    except Exception as error:
        # Typer's own errors; their base class has another home in each version of it.
        if not hasattr(error, "format_message"):
            raise
        return _complain(error, _usage(error), words, WRONG_USAGE)
    return code if isinstance(code, int) else 0


def without_passwords(text: str, words: Sequence[str]) -> str:
    """Hide the passwords of all database URLs in a text.

    Args:
        text: the text.
        words: words that may have got into the text, and may be such URLs with odd passwords.

    Returns:
        The text with `***` for each password.
    """
    for word in words:
        if "://" in word:
            text = text.replace(word, _WHOLE_URL.sub(r"\1***@", word))
    return _OPTION.sub(r"\1***", _AUTHORITY.sub(r"\1***@", text))


def _usage(error: Exception) -> str:
    message = str(error.format_message()).rstrip(".")  # type: ignore[attr-defined]
    context = getattr(error, "ctx", None)
    return f"{message}; try: {context.command_path if context else 'kant-sql'} --help"


def _complain(error: Exception, message: str, words: Sequence[str], code: int) -> int:
    line = " ".join(without_passwords(message, words).split())
    if _wants_json(words):
        name = _WRONG_USAGE if code == WRONG_USAGE else type(error).__name__
        document = {"error": line, "type": name, "exit_code": code}
        sys.stderr.write(f"{json_text(document, sys.stderr)}\n")
    else:
        sys.stderr.write(f"kant-sql: {printable(line)}\n")
    return code


def _wants_json(words: Sequence[str]) -> bool:
    """Tell whether the output is to be JSON, also where the words make no sense."""
    options = words[: words.index("--")] if "--" in words else words
    return JSON_OPTION in options


def _drop_output() -> None:
    """Let what is still buffered go nowhere, so that the end of Python does not fail on it."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)

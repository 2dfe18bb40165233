"""The files that a command is given: `-` is standard input."""

from __future__ import annotations

import errno
import hashlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..errors import KantSqlError, SourceError
from ..pddl.cursor import Reading
from ..pddl.forms import DOMAIN, PROBLEM, Form, Scanner
from ..pddl.tokens import Text, decode, read_file

STANDARD_INPUT = "-"
_STDIN = "<stdin>"


class Inputs(NamedTuple):
    """What there is to load.

    Attributes:
        domains: the texts of the domain, which may be spread over several.
        problem: the problem's text, if there is one.
        files: where they are from, as JSON values.
    """

    domains: tuple[Text, ...]
    problem: Text | None
    files: tuple[dict[str, str], ...]


def read_bytes(path: str) -> tuple[str, bytes]:
    """Read a file.

    Args:
        path: its path.

    Returns:
        What messages call it, and what it holds.

    Raises:
        SourceError: it cannot be read.
    """
    name = _STDIN if path == STANDARD_INPUT else str(Path(path))
    return name, _read_stdin() if path == STANDARD_INPUT else read_file(name)


def read_inputs(paths: Sequence[str]) -> Inputs:
    """Read files, and tell from what is in them what each is for.

    Args:
        paths: the paths.

    Returns:
        The texts of the domain and of the problem.

    Raises:
        PddlError: a file is no PDDL text.
        KantSqlError: two files have a problem.
        SourceError: a file cannot be read.
    """
    domains: list[Text] = []
    problems: list[Text] = []
    files = []
    for path in paths:
        name, data = read_bytes(path)
        text = decode(name, data)
        forms = Scanner(Reading(strict=False), text).scan()
        kinds = {form.kind for form in forms}
        if DOMAIN in kinds:
            domains.append(_without(text, forms, PROBLEM))
        if PROBLEM in kinds:
            problems.append(_without(text, forms, DOMAIN))
        files.append({"path": _as_text(name), "sha256": hashlib.sha256(data).hexdigest()})
    if len(problems) > 1:
        first, second = problems[:2]
        raise KantSqlError(f"{first.name} and {second.name} each have a problem: load one of them")
    return Inputs(tuple(domains), problems[0] if problems else None, tuple(files))


def _without(text: Text, forms: Sequence[Form], kind: str) -> Text:
    """Leave out the forms of a kind, so that nobody warns of them."""
    ends = [*(form.head.start for form in forms[1:]), len(text.code)]
    parts = [(form.head.start, end) for form, end in zip(forms, ends, strict=True)]
    unwanted = [part for form, part in zip(forms, parts, strict=True) if form.kind == kind]
    return text.without(unwanted) if unwanted else text


def _as_text(name: str) -> str:
    """Write a path that may be no Unicode text."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def _read_stdin() -> bytes:
    if not sys.stdin:
        # The process was started with it closed.
        raise SourceError(errno.EBADF, os.strerror(errno.EBADF), _STDIN)
    try:
        return sys.stdin.buffer.read()
    except OSError as error:
        number = error.errno or errno.EIO
        raise SourceError(number, os.strerror(number), _STDIN) from error

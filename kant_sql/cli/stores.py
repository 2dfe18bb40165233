"""What the commands that read a knowledge base share: which store, which one, and when."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Annotated

import typer

from ..catalog import knowledge_bases
from ..errors import KantSqlError
from ..knowledge_base import KnowledgeBase, connect

URL_VARIABLE = "KANT_SQL_URL"
DEFAULT_NAME = "default"
_NAMES_SHOWN = 20

Url = Annotated[
    str,
    typer.Argument(
        metavar="URL",
        envvar=URL_VARIABLE,
        show_default=False,
        help="The database URL, for example sqlite:///robot.db",
    ),
]
Name = Annotated[
    str | None,
    typer.Option(
        "--kb",
        metavar="NAME",
        show_default=False,
        help=f"The knowledge base; when not given, the only one, or else '{DEFAULT_NAME}'.",
    ),
]
At = Annotated[
    str | None,
    typer.Option(
        metavar="REV|TIME",
        show_default=False,
        help="The revision's number, or a time in ISO 8601 (UTC without a zone).",
    ),
]


def split_url(words: Sequence[str], example: str) -> tuple[str, list[str]]:
    """Tell the URL from the files that follow it.

    Args:
        words: the arguments; the first is the URL, or else the environment has it.
        example: how they could look.

    Returns:
        The URL and the files.

    Raises:
        typer.BadParameter: one of them is missing.
    """
    default = os.environ.get(URL_VARIABLE)
    if default and words and "://" not in words[0]:
        words = [default, *words]
    if len(words) < 2 or "://" not in words[0]:
        raise typer.BadParameter(
            f"give a URL (or set {URL_VARIABLE}) and files, {example}", param_hint="[URL] FILE..."
        )
    return words[0], list(words[1:])


@contextmanager
def open_to_read(url: str, name: str | None) -> Iterator[tuple[str, KnowledgeBase]]:
    """Open a knowledge base that exists. Nothing is created.

    Args:
        url: the database URL.
        name: the knowledge base's name; None for the only one, or else the default.

    Yields:
        The name and the knowledge base.

    Raises:
        KantSqlError: there is no such store, or no such knowledge base in it.
    """
    chosen = choose(name, knowledge_bases(url))
    with connect(url, knowledge_base=chosen) as kb:
        yield chosen, kb


@contextmanager
def open_state(url: str, name: str | None, at: str | None) -> Iterator[tuple[str, KnowledgeBase]]:
    """Open one state of a knowledge base that exists. Nothing is created.

    Args:
        url: the database URL.
        name: the knowledge base's name; None for the only one, or else the default.
        at: a revision's number or a time as text; None for now.

    Yields:
        The name, and the knowledge base at one revision, whatever is written meanwhile.

    Raises:
        KantSqlError: there is no such store, knowledge base or revision.
        typer.BadParameter: `at` is neither a number nor a time.
    """
    when = None if at is None else parse_when(at)
    with open_to_read(url, name) as (chosen, knowledge_base):
        yield chosen, knowledge_base.at(knowledge_base.revision if when is None else when)


def choose(name: str | None, names: Sequence[str]) -> str:
    """Choose a knowledge base of a store.

    Args:
        name: the name that was given, if any.
        names: the names that exist.

    Returns:
        The name.

    Raises:
        KantSqlError: it does not exist, or which one is meant is not clear.
    """
    if name is None and len(names) == 1:
        return names[0]
    wanted = DEFAULT_NAME if name is None else name
    if wanted in names:
        return wanted
    if not names:
        raise KantSqlError("this store holds no knowledge base yet: nothing was ever written to it")
    listed = ", ".join(repr(other) for other in names[:_NAMES_SHOWN])
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    raise KantSqlError(
        f"there is no knowledge base {wanted!r} in this store; choose one with --kb: {listed}{more}"
    )


def parse_when(text: str) -> int | datetime:
    """Read a revision's number or a time.

    Args:
        text: digits are a number, all else is a time in ISO 8601; one without a zone is in UTC.

    Returns:
        The number, or the time in UTC.

    Raises:
        typer.BadParameter: it is neither.
    """
    try:
        if text.removeprefix("-").isdecimal():
            return int(text)
        moment = datetime.fromisoformat(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC)
    except (ValueError, OverflowError):
        raise typer.BadParameter(
            f"{text!r} is neither a revision's number nor a time as 2026-01-31T09:30:00Z",
            param_hint="--at",
        ) from None

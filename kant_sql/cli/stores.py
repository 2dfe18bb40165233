"""What the commands that read a knowledge base share: which store, which one, and when."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, NoReturn

import typer

from ..catalog import knowledge_bases, removed_on_failure
from ..errors import KantSqlError
from ..knowledge_base import KnowledgeBase, connect
from ..pddl.cursor import hint
from ..pddl.tokens import tokenize
from .output import printable
from .times import parse_state

URL_VARIABLE = "KANT_SQL_URL"
DEFAULT_NAME = "default"
_NAMES_SHOWN = 20
_ENDING = "SIGTERM", "SIGHUP"

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


def split_url(words: Sequence[str], usage: str, example: str) -> tuple[str, list[str]]:
    """Tell the URL from what follows it.

    Args:
        words: the arguments; the first is the URL, or else the environment has it.
        usage: what they are, as `[URL] FILE...`.
        example: how they could look.

    Returns:
        The URL and the others, as many as `usage` has, or any number where it ends in dots.

    Raises:
        typer.BadParameter: one of them is missing, or too many are given.
    """
    wanted = usage.split()
    default = os.environ.get(URL_VARIABLE)
    if default and words and "://" not in words[0]:
        words = [default, *words]
    is_right = len(words) == len(wanted) or (wanted[-1].endswith("...") and len(words) >= 2)
    if not is_right or "://" not in words[0]:
        raise typer.BadParameter(
            f"give a URL (or set {URL_VARIABLE}) and {' '.join(wanted[1:])}, such as: {example}",
            param_hint=usage,
        )
    return words[0], list(words[1:])


@contextmanager
def leaving_nothing(url: str) -> Iterator[None]:
    """Remove the SQLite file that the block creates, when the block fails or is stopped.

    Args:
        url: the database URL.

    Yields:
        Nothing.
    """
    with removed_on_failure(url), _stopping_by_exception():
        yield


@contextmanager
def _stopping_by_exception() -> Iterator[None]:
    """Let the signals that end a process end the block, so that it can clean up behind itself."""

    def stop(number: int, frame: object) -> NoReturn:
        raise SystemExit(128 + number)

    is_main = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in _ENDING if is_main and hasattr(signal, name)]
    changed = [one for one in numbers if signal.getsignal(one) is signal.SIG_DFL]
    for one in changed:
        signal.signal(one, stop)
    try:
        yield
    finally:
        for one in changed:
            signal.signal(one, signal.SIG_DFL)


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
    when = parse_state(at)
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
        raise KantSqlError(
            "this store holds no knowledge base yet: nothing was ever written to it; name another "
            "store, or fill this one with: kant-sql load"
        )
    listed = ", ".join(repr(other) for other in names[:_NAMES_SHOWN])
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    raise KantSqlError(
        f"there is no knowledge base {wanted!r} in this store; choose one with --kb: {listed}{more}"
    )


def unknown_element(kb: KnowledgeBase, name: str, element: str, what: str) -> KantSqlError:
    """Make the error of an element that is asked for in vain.

    Args:
        kb: the knowledge base, or a state of it.
        name: its name.
        element: the element, as it was given.
        what: what is wrong with it, and what to do.

    Returns:
        The error, with a name that may have been meant.
    """
    daos = (kb.types, kb.objects, kb.predicates, kb.functions, kb.actions, kb.processes, kb.events)
    names = [dto.name for dao in daos for dto in dao.get_all()]
    known = {one.lower() for one in names}
    words = (word for word in tokenize(element) if word not in "()-" and word.lower() not in known)
    hints = (found for word in words if (found := hint(word, names)))
    return KantSqlError(
        f"{printable(element)!r} in knowledge base {name!r}: it {what}{next(hints, '')}"
    )

"""`kant-sql history` and `kant-sql blame`: when an element held, and who says what holds now."""

from __future__ import annotations

from typing import Annotated

import typer

from .entries import version_document, write_version
from .output import Printer, write_json
from .stores import URL_VARIABLE, Name, open_state, split_url, unknown_element
from .times import At

_USAGE = "[URL] NAME|PDDL"
_EXAMPLE = "sqlite:///robot.db '(robot_at rb1 wp1)'"
_Words = Annotated[
    list[str],
    typer.Argument(
        metavar=_USAGE,
        show_default=False,
        help=f"The database URL [env var: {URL_VARIABLE}], and a name, or PDDL as "
        "'(robot_at rb1 wp1)'.",
    ),
]


def history(
    words: _Words,
    kb: Name = None,
    at: At = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="JSON Lines: one document for each version.")
    ] = False,
) -> None:
    """Write when an element held, and who and why at both ends.

    The oldest time comes first.
    """
    url, (element,) = split_url(words, _USAGE, _EXAMPLE)
    with open_state(url, kb, at) as (name, state):
        versions = state.history(element)
        if not versions:
            raise unknown_element(state, name, element, "never was there; see: kant-sql log")
        printer = Printer()
        for position, version in enumerate(versions):
            if as_json:
                write_json(version_document(version))
                continue
            if position:
                printer.line()
            write_version(printer, version)


def blame(
    words: _Words,
    kb: Name = None,
    at: At = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Write who asserted what holds, when and why."""
    url, (element,) = split_url(words, _USAGE, _EXAMPLE)
    with open_state(url, kb, at) as (name, state):
        version = state.blame(element)
        if version is None:
            raise unknown_element(state, name, element, "does not hold; see: kant-sql history")
        if as_json:
            write_json(version_document(version))
        else:
            write_version(Printer(), version)

"""`kant-sql diff`: what is different between two states."""

from __future__ import annotations

from typing import Annotated

import typer

from .entries import write_changes
from .output import Printer, write_json
from .stores import URL_VARIABLE, Name, open_to_read, split_url
from .times import parse_state

_USAGE = "[URL] A B"


def diff(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar=_USAGE,
            show_default=False,
            help=f"The database URL [env var: {URL_VARIABLE}], and two moments: each a revision's "
            "number, a time in ISO 8601, or as 'yesterday'.",
        ),
    ],
    kb: Name = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Write what holds at B and not at A (+), or the reverse (-)."""
    url, (a, b) = split_url(words, _USAGE, "sqlite:///robot.db 12 '2 hours ago'")
    moments = parse_state(a, "A"), parse_state(b, "B")
    with open_to_read(url, kb) as (name, knowledge_base):
        head = knowledge_base.revision
        first, second = (head if moment is None else moment for moment in moments)
        changes = knowledge_base.diff(first, second)
        if as_json:
            ends = [knowledge_base.at(when).revision for when in (first, second)]
            document = {"knowledge_base": name, "a": ends[0], "b": ends[1]}
            write_json({**document, "changes": [change._asdict() for change in changes]})
        else:
            write_changes(Printer(), changes)

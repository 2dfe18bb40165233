"""`kant-sql restore`: make the state equal to a past one."""

from __future__ import annotations

from typing import Annotated

import typer

from .entries import write_changes
from .output import Printer, write_json
from .stores import URL_VARIABLE, Name, open_to_read, split_url
from .times import parse_state

_USAGE = "[URL] REV|TIME"


def restore(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar=_USAGE,
            show_default=False,
            help=f"The database URL [env var: {URL_VARIABLE}], and a revision's number, a time in "
            "ISO 8601, or as '2 hours ago'.",
        ),
    ],
    kb: Name = None,
    actor: Annotated[
        str | None, typer.Option(metavar="NAME", show_default=False, help="Who does it.")
    ] = None,
    reason: Annotated[
        str | None, typer.Option(metavar="TEXT", show_default=False, help="Why.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Make the state equal to a past one, as a new revision.

    It can be undone the same way.
    """
    url, (when,) = split_url(words, _USAGE, "sqlite:///robot.db 12")
    moment = parse_state(when, "REV|TIME")
    with open_to_read(url, kb) as (name, knowledge_base):
        restored = knowledge_base.revision
        if moment is not None:
            restored = knowledge_base.at(moment).revision
        made = knowledge_base.restore(restored, reason=reason, actor=actor)
        changes = [] if made is None else knowledge_base.diff(made - 1, made)
        if as_json:
            document = {"knowledge_base": name, "restored": restored, "revision": made}
            write_json({**document, "changes": [change._asdict() for change in changes]})
            return
        printer = Printer()
        if made is None:
            printer.line(f"knowledge base {name}: nothing is different from revision {restored}")
            return
        printer.line(f"knowledge base {name}, revision {made}: as revision {restored} was", "bold")
        write_changes(printer, changes)

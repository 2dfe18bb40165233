"""`kant-sql log`: the revisions, newest first."""

from __future__ import annotations

from typing import Annotated

import typer

from .entries import entry_document, write_entry
from .output import Printer, write_json
from .stores import Name, Url, open_to_read
from .times import Since, Until, parse_optional


def log(
    url: Url,
    kb: Name = None,
    limit: Annotated[
        int | None,
        typer.Option(
            "--limit", "-n", metavar="N", min=1, show_default=False, help="Only the N newest."
        ),
    ] = None,
    since: Since = None,
    until: Until = None,
    actor: Annotated[
        str | None,
        typer.Option(metavar="NAME", show_default=False, help="Only revisions of this actor."),
    ] = None,
    element: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|PDDL",
            show_default=False,
            help="Only what changed this element: a name, or PDDL as '(robot_at rb1 wp1)'.",
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="JSON Lines: one document for each revision.")
    ] = False,
) -> None:
    """Write the revisions, newest first: when, who, why and what."""
    first, last = parse_optional(since, "--since"), parse_optional(until, "--until")
    with open_to_read(url, kb) as (_, knowledge_base):
        printer = Printer()
        entries = knowledge_base.log(
            since=first, until=last, actor=actor, element=element, limit=limit
        )
        for position, entry in enumerate(entries):
            if as_json:
                write_json(entry_document(entry))
                continue
            if position:
                printer.line()
            write_entry(printer, entry)

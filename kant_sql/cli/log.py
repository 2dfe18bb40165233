"""`kant-sql log`: the revisions, newest first."""

from __future__ import annotations

from typing import Annotated

import typer

from ..errors import KantSqlError
from ..knowledge_base import KnowledgeBase
from ..pddl.cursor import hint
from .entries import entry_document, write_entry
from .output import Printer, printable, write_json
from .stores import Name, Url, open_to_read, unknown_element
from .times import Since, Until, parse_optional, parse_state

# The actors of so many revisions may be those that were meant.
_RECENT = 1_000


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
    first, last = parse_optional(since, "--since"), parse_state(until, "--until")
    with open_to_read(url, kb) as (name, knowledge_base):
        printer, position = Printer(), -1
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
        if position < 0:
            _refuse_unknown(knowledge_base, name, actor, element)


def _refuse_unknown(kb: KnowledgeBase, name: str, actor: str | None, element: str | None) -> None:
    """Raise when a filter names what never was: that nothing is found then says nothing."""
    if element is not None and not any(kb.log(element=element, limit=1)):
        raise unknown_element(kb, name, element, "never was there; see: kant-sql log")
    if actor is not None and not any(kb.log(actor=actor, limit=1)):
        recent = {one.actor: None for one in kb.revisions(after=max(0, kb.revision - _RECENT))}
        close = hint(actor, [one for one in recent if one is not None])
        raise KantSqlError(
            f"{printable(actor)!r} in knowledge base {name!r}: no revision is of this actor"
            f"; see: kant-sql log{close}"
        )

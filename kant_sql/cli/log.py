"""`kant-sql log`: the revisions, newest first."""

from __future__ import annotations

from typing import Annotated

import typer

from ..history import LogEntry
from .output import Printer, json_text, printable, time_text, write_json
from .stores import Name, Url, open_to_read

_STYLES = {"+": "green", "-": "red"}


def log(
    url: Url,
    kb: Name = None,
    limit: Annotated[
        int | None,
        typer.Option(
            "--limit", "-n", metavar="N", min=1, show_default=False, help="Only the N newest."
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="JSON Lines: one document for each revision.")
    ] = False,
) -> None:
    """Write the revisions, newest first: when, who, why, and what each changed."""
    with open_to_read(url, kb) as (_, knowledge_base):
        printer = Printer()
        for position, entry in enumerate(knowledge_base.log(limit)):
            if as_json:
                write_json(entry_document(entry))
            else:
                if position:
                    printer.line()
                write_entry(printer, entry)


def entry_document(entry: LogEntry) -> dict[str, object]:
    """Give a revision in the form that becomes JSON.

    Args:
        entry: the revision and its changes.

    Returns:
        The document.
    """
    revision = entry.revision
    return {
        "number": revision.number,
        "committed_at": time_text(revision.committed_at),
        "actor": revision.actor,
        "reason": revision.reason,
        "source": revision.source,
        "hash": revision.hash,
        "changes": [change._asdict() for change in entry.changes],
    }


def write_entry(printer: Printer, entry: LogEntry) -> None:
    """Write a revision for people.

    Args:
        printer: where to.
        entry: the revision and its changes.
    """
    revision = entry.revision
    printer.line(f"revision {revision.number}  {time_text(revision.committed_at)}", "bold")
    for name, value in (("actor", revision.actor), ("reason", revision.reason)):
        if value is not None:
            printer.line(f"  {name}: {printable(value)}")
    if revision.source is not None:
        printer.line(f"  source: {json_text(revision.source)}")
    for sign, kind, text in entry.changes:
        indented = text.replace("\n", "\n    ")
        printer.line(f"  {sign} {kind} {indented}", _STYLES[sign])

"""`kant-sql archive`: what ended long ago is moved into another store."""

from __future__ import annotations

from typing import Annotated

import typer

from ..history import Archived
from .output import Printer, printable, write_json
from .progress import bar
from .stores import Name, Url, leaving_nothing, open_to_read
from .times import parse_when


def archive(
    url: Url,
    before: Annotated[
        str,
        typer.Option(
            metavar="REV|TIME",
            show_default=False,
            help="What ended before it is moved: a time in ISO 8601 (UTC without a zone), as "
            "'90 days ago', or a revision's number.",
        ),
    ],
    to: Annotated[
        str,
        typer.Option(
            metavar="URL",
            show_default=False,
            help="The other store; a new SQLite file is created.",
        ),
    ],
    kb: Name = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only count.")] = False,
    actor: Annotated[
        str | None, typer.Option(metavar="NAME", show_default=False, help="Who does it.")
    ] = None,
    reason: Annotated[
        str | None, typer.Option(metavar="TEXT", show_default=False, help="Why.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Move what ended before a time into another store.

    That store then answers for it.
    """
    when = parse_when(before, "--before")
    with (
        open_to_read(url, kb) as (name, knowledge_base),
        leaving_nothing(to),
        bar(name) as told,
    ):
        done = knowledge_base.archive(
            when, to=to, dry_run=dry_run, reason=reason, actor=actor, progress=told
        )
    if as_json:
        write_json({"knowledge_base": name, "dry_run": dry_run, **done._asdict()})
    else:
        _write(Printer(), name, done, dry_run)


def _write(printer: Printer, name: str, done: Archived, dry_run: bool) -> None:
    kb = f"knowledge base {printable(name)}"
    if not done.versions:
        printer.line(f"{kb}: nothing is here that ended up to revision {done.upto}")
        return
    verb = "to move" if dry_run else f"moved in revision {done.revision}"
    total = sum(done.versions.values())
    versions = "1 version" if total == 1 else f"{total} versions"
    printer.line(
        f"{kb}: {versions} that ended up to revision {done.upto} {verb} to "
        f"{printable(done.target)}",
        "bold",
    )
    rows = [[table, str(number)] for table, number in done.versions.items()]
    printer.table("versions", ["table", "versions"], rows)

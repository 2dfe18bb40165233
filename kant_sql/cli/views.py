"""`kant-sql views`: for each predicate a view of its facts and one of its goals."""

from __future__ import annotations

from typing import Annotated

import typer

from ..predicate_views import PredicateView, drop_views, update_views
from .output import Printer, printable, write_json
from .stores import Url


def views(
    url: Url,
    kb: Annotated[
        str | None,
        typer.Option(
            "--kb",
            metavar="NAME",
            show_default=False,
            help="The knowledge base; when not given, all of the store.",
        ),
    ] = None,
    drop: Annotated[
        bool, typer.Option("--drop", help="Drop the views that this command made.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--sql", "--dry-run", help="Only write the SQL; nothing is changed.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Make views of the predicates, or bring them up to date."""
    changes = (drop_views if drop else update_views)(url, knowledge_base=kb, dry_run=dry_run)
    if as_json:
        write_json({"views": [_document(change, dry_run) for change in changes]})
    elif dry_run:
        statements = (statement for change in changes for statement in change.statements)
        typer.echo("".join(f"{statement};\n" for statement in statements), nl=False)
    else:
        _write(changes)


def _document(change: PredicateView, dry_run: bool) -> dict[str, object]:
    document = change._asdict()
    if not dry_run:
        del document["statements"]
    return document


def _write(changes: list[PredicateView]) -> None:
    rows = [
        (
            change.name,
            change.change,
            printable(change.knowledge_base or ""),
            printable(change.predicate or ""),
        )
        for change in changes
    ]
    Printer().table("views", ("view", "change", "knowledge base", "predicate"), rows)

"""`kant-sql kbs` and `anchor`: where the knowledge bases of a store stand, to see or to keep."""

from __future__ import annotations

from typing import Annotated

import typer

from ..canonical import time_text
from ..catalog import knowledge_bases, standings
from ..knowledge_base import connect
from .output import AsJson, Printer, printable, write_json
from .stores import Url


def kbs(url: Url, as_json: AsJson = False) -> None:
    """List the knowledge bases: how far they have come, when, by whom."""
    found = standings(url)
    if as_json:
        write_json(
            {
                "knowledge_bases": [
                    {**one._asdict(), "committed_at": time_text(one.committed_at)} for one in found
                ]
            }
        )
        return
    rows = [
        (
            printable(one.name),
            str(one.revision),
            time_text(one.committed_at),
            printable(one.actor or ""),
            printable(one.reason or ""),
        )
        for one in found
    ]
    columns = "knowledge base", "revision", "last change", "actor", "reason"
    Printer().table("knowledge bases", columns, rows)


def anchor(
    url: Url,
    as_json: Annotated[
        bool, typer.Option("--json", help="As without it: one JSON document.")
    ] = False,
) -> None:
    """Write where all knowledge bases stand, to keep elsewhere.

    That is one small JSON document. 'kant-sql verify --anchor FILE' compares a store with it.
    """
    # That tells what is wrong with the store, and creates nothing.
    names = knowledge_bases(url)
    with connect(url, knowledge_base=names[0] if names else "default") as knowledge_base:
        typer.echo(knowledge_base.anchor().text())

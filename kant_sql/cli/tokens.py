"""`kant-sql tokens`: who may read and write over HTTP."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .common import AsJson, command_group, option
from .output import Printer, write_json

tokens = command_group(
    "kant_sql.commands.tokens", "Make and revoke the tokens of programs that use HTTP."
)

TokensPath = Annotated[
    Path, typer.Argument(metavar="FILE", help="The file of tokens, which keeps only their hashes.")
]


@tokens.command()
def add(
    file: TokensPath,
    actor: Annotated[str, option("The actor of its writes.", metavar="NAME")],
    kb: Annotated[
        list[str],
        option("A knowledge base for the token, or * for all; repeatable.", metavar="NAME"),
    ],
    scope: Annotated[
        list[str],
        option("What it may do: read, write, apply or verify; repeatable.", metavar="SCOPE"),
    ],
) -> None:
    """Make a token, and write it to standard output, once only."""
    from ..web.tokens import TokenFile

    made = TokenFile(file).add(actor, kb, scope)
    sys.stdout.write(f"{made}\n")


@tokens.command("list")
def list_(file: TokensPath, as_json: AsJson = False) -> None:
    """List the tokens of a file: their ids, actors, knowledge bases and scopes."""
    from ..web.tokens import TokenFile

    found = TokenFile(file).tokens()
    if as_json:
        shown = [
            {name: value for name, value in vars(one).items() if name != "sha256"} for one in found
        ]
        write_json(tokens=shown)
        return
    printer = Printer()
    for one in found:
        names, scopes = " ".join(one.knowledge_bases), " ".join(one.scopes)
        until = "" if one.revoked_at is None else f", revoked {one.revoked_at}"
        printer.line(f"{one.id}: {one.actor}, {scopes}, of {names}, made {one.created_at}{until}")


@tokens.command()
def revoke(
    file: TokensPath,
    id: Annotated[str, typer.Argument(metavar="ID", help="The id, with which the token begins.")],
) -> None:
    """Revoke a token. A running server refuses it from the next request on."""
    from ..web.tokens import TokenFile

    revoked = TokenFile(file).revoke(id)
    Printer().line(f"{revoked.id}: revoked")

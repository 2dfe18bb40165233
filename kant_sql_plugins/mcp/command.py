"""`kant-sql mcp`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from kant_sql.cli.common import Name, Url, option
from kant_sql.errors import ExtraMissingError

MISSING = "this needs the SDK of the Model Context Protocol; run: pip install 'kant-sql[mcp]'"


def mcp(
    url: Url,
    write: Annotated[
        str | None,
        option(
            "Where to write: 'branch', to branches that it begins itself; 'checked', to a "
            "knowledge base that keeps a rule that refuses.",
            "--write",
            metavar="WHERE",
        ),
    ] = None,
    kb: Name = None,
    actor: Annotated[
        str, option("With --write: the actor of all revisions.", "--actor", metavar="NAME")
    ] = "mcp",
) -> None:
    """Answer programs with language models, by standard input.

    It speaks the Model Context Protocol: the program starts this command, as its configuration
    says. All tools only read, unless --write says otherwise. Ends when its input does.
    """
    if write not in (None, "branch", "checked"):
        raise typer.BadParameter(f"{write!r}: expected branch or checked", param_hint="--write")
    if kb is not None and write != "checked":
        raise typer.BadParameter("goes with --write checked", param_hint="--kb")
    try:
        from .stdio import serve
    except ImportError as error:
        raise ExtraMissingError(MISSING) from error
    where: Any = write
    serve(url, where, kb, actor)

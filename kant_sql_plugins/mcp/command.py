"""`kant-sql mcp`."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from kant_sql.cli.common import Name, Url, option
from kant_sql.errors import needing

MISSING = "this needs the SDK of the Model Context Protocol; run: pip install 'kant-sql[mcp]'"


class _Command(TyperCommand):
    """Reads `--write` alone as `--write checked`: Typer has no option with an optional word."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line."""
        words = []
        for word, following in zip(args, [*args[1:], "--"], strict=True):
            words += [word, "checked"] if word == "--write" and following[:1] == "-" else [word]
        return super().parse_args(ctx, words)


mcp = typer.Typer(rich_markup_mode=None, add_completion=False)


@mcp.command(cls=_Command)
def answer_models(
    url: Url,
    write: Annotated[
        str | None,
        option(
            "Where to write: 'branch', to branches that it begins itself; 'checked' (the default "
            "of the option alone), to a knowledge base that keeps a rule that refuses.",
            metavar="WHERE",
        ),
    ] = None,
    kb: Name = None,
    actor: Annotated[
        str, option("With --write: the actor of all revisions.", metavar="NAME")
    ] = "mcp",
) -> None:
    """Serve programs with language models over standard input.

    It speaks the Model Context Protocol, and is started by the program. All tools are read-only,
    unless you give --write. Ends with its input.
    """
    if write not in (None, "branch", "checked"):
        raise typer.BadParameter(f"{write!r}: expected branch or checked", param_hint="--write")
    if kb is not None and write != "checked":
        raise typer.BadParameter("needs --write checked", param_hint="--kb")
    with needing(MISSING):
        from .stdio import serve
    where: Any = write
    serve(url, where, kb, actor)

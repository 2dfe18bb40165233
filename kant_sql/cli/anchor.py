"""`kant-sql anchor`: where the knowledge bases of a store stand, to keep elsewhere."""

from __future__ import annotations

from typing import Annotated

import typer

from ..catalog import knowledge_bases
from ..knowledge_base import connect
from .stores import Url


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

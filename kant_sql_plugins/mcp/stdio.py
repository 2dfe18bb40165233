"""The server over standard input and output."""

from __future__ import annotations

from contextlib import ExitStack

import anyio

from kant_sql.web.stores import OpenStore

from .server import make_server
from .writing import SAID, Target, Writing


def serve(
    url: str,
    target: Target | None = None,
    name: str | None = None,
    actor: str = "mcp",
) -> None:
    """Serve a store over standard input and output, until the input ends.

    Args:
        url: the database URL.
        target: where to write; None for a server that only reads.
        name: with `checked`, the knowledge base to write to; None for the only one.
        actor: the actor of the writes.

    Raises:
        ReadOnlyError: the knowledge base has no kept rule that refuses.
        KantSqlError: the store cannot be opened.
    """
    with ExitStack() as opened:
        store = OpenStore(url)
        opened.callback(store.close)
        if target is None:
            server = make_server(store)
        else:
            written = OpenStore(url, read_only=False)
            opened.callback(written.close)
            tools = Writing(written, target, name, actor).tools()
            server = make_server(store, tools, SAID[target])
        anyio.run(server.run_stdio_async)

"""`kant-sql demo`: a small world in the browser."""

from __future__ import annotations

import shlex
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from kant_sql.cli.common import option, signals_raise
from kant_sql.cli.web import WEB_MISSING, listen
from kant_sql.errors import InvalidArgumentError, needing, printable

if TYPE_CHECKING:
    from .stories import World


def demo(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", show_default=False, help="The world; default: list them."),
    ] = None,
    store: Annotated[
        str | None,
        option(
            "Write to this store, and keep it; default: a file that is removed at the end.",
            metavar="URL",
        ),
    ] = None,
    port: Annotated[
        int, option("The port; default: a free one.", metavar="NUMBER", min=0, max=65535)
    ] = 0,
    no_browser: Annotated[bool, option("Only print the address.", "--no-browser")] = False,
) -> None:
    """Open a small world in the browser, with a guided page.

    Ends with Ctrl-C.
    """
    from .worlds import WORLDS, find

    if name is None:
        width = max(len(world.name) for world in WORLDS)
        for world in WORLDS:
            typer.echo(f"{world.name:{width}}  {world.line}")
        typer.echo(f"Open one with: kant-sql demo {WORLDS[0].name}")
        return
    chosen = find(name)
    if chosen is None:
        names = ", ".join(world.name for world in WORLDS)
        raise InvalidArgumentError(f"there is no demo {printable(name)!r}; choose one of: {names}")
    with signals_raise(), _kept_or_temporary(store, chosen.name) as url:
        _serve(chosen, url, port, has_browser=not no_browser, is_kept=store is not None)


@contextmanager
def _kept_or_temporary(store: str | None, name: str) -> Iterator[str]:
    """Yield the given URL, or that of a file in a folder that is removed afterwards."""
    if store is not None:
        yield store
        return
    with TemporaryDirectory(prefix="kant-sql-demo-", ignore_cleanup_errors=True) as folder:
        yield f"sqlite:///{Path(folder) / name}.db"


def _serve(world: World, url: str, port: int, *, has_browser: bool, is_kept: bool) -> None:
    """Write the story of a world, and serve it until the process is interrupted."""
    with needing(WEB_MISSING):
        from kant_sql.web.application import make_server

        from .pages import PAGES
    from kant_sql.knowledge_base import open_store

    from .worlds import write

    with open_store(url) as store:
        write(world, store)
    server, _ = make_server(url, port=port, added=(PAGES,))
    listening, address = listen(server.config)
    page = f"{address}/guide?kb={world.name}"
    sys.stdout.write(
        f"{page}\n\nThe same at a prompt and in Python, in another terminal:\n"
        f"  export KANT_SQL_URL={shlex.quote(url)}\n\n"
        f"Ctrl-C ends the demo{'' if is_kept else ' and removes its store'}.\n"
    )
    sys.stdout.flush()
    if has_browser:
        # In a thread: a terminal browser returns only when its reader leaves.
        Thread(target=webbrowser.open, args=(page,), daemon=True).start()
    server.run(sockets=[listening])

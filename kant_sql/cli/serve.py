"""`kant-sql serve`: the store in a browser."""

from __future__ import annotations

import socket
import sys
from typing import Annotated

from ..errors import ExtraMissingError, printable
from .common import Url, option

WEB_MISSING = "this needs FastAPI, uvicorn and Jinja2; run: pip install 'kant-sql[web]'"


def serve(
    url: Url,
    host: Annotated[
        str,
        option(
            "The address to listen at; any other than this machine's needs a token.",
            metavar="ADDRESS",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, option("The port; 0 for a free one.", metavar="NUMBER", min=0, max=65535)
    ] = 8765,
    allow_host: Annotated[
        list[str] | None,
        option(
            "Another host name that the server answers to; you can repeat this.",
            metavar="NAME",
        ),
    ] = None,
) -> None:
    """Show the store in a browser, and its data as JSON.

    All pages are read-only. Ends with Ctrl-C. At an address that other machines reach, readers
    need the token that is printed at the start, or the one in KANT_SQL_TOKEN.
    """
    try:
        from ..web.serving import make_server
    except ImportError as error:
        raise ExtraMissingError(WEB_MISSING) from error
    server, token = make_server(url, host=host, port=port, hosts=allow_host or ())
    listening = server.config.bind_socket()
    # Inherited by connections; else each answer to a kept connection waits 40 ms for the reader's
    # acknowledgement.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    address, number = listening.getsockname()[:2]
    name = f"[{address}]" if ":" in address else address
    sys.stdout.write(f"http://{name}:{number}/\n")
    if token is not None:
        sys.stdout.write(f"token: {printable(token)}\n")
    sys.stdout.flush()
    server.run(sockets=[listening])

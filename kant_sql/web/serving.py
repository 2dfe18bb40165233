"""Serving the application of a store over HTTP."""

from __future__ import annotations

import os
import secrets
import socket
from collections.abc import Sequence

import anyio
import uvicorn
from fastapi import FastAPI

from ..errors import InvalidArgumentError
from .application import create_app
from .security import TOKEN_VARIABLE, is_loopback

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765
# Names and conditions are in the address.
LONGEST_REQUEST = 256 * 1024


def token_for(host: str) -> str | None:
    """Return the token that readers need at an address.

    Returns:
        `KANT_SQL_TOKEN` if it is set; else a new one, or None for the loopback address.

    Raises:
        InvalidArgumentError: the variable is set, and too short to be a secret, or no text that a
            header can have.
    """
    given = os.environ.get(TOKEN_VARIABLE)
    if given is None:
        return None if is_loopback(host) else secrets.token_urlsafe(24)
    if len(given) < 16:
        raise InvalidArgumentError(
            f"{TOKEN_VARIABLE} has {len(given)} characters; use 16 or more that nobody guesses"
        )
    if not (given.isascii() and given.isprintable()) or given != given.strip():
        raise InvalidArgumentError(
            f"{TOKEN_VARIABLE} has characters that HTTP headers cannot carry; use ASCII "
            "letters and "
            "digits"
        )
    return given


def make_server(
    url: str, *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT, hosts: Sequence[str] = ()
) -> tuple[uvicorn.Server, str | None]:
    """Make a server of one store.

    Args:
        url: the database URL.
        host: the address to bind to.
        port: the port; 0 for a free one.
        hosts: further names under which it may be asked.

    Returns:
        The server, to run, and the token that readers need, if any.

    Raises:
        KantSqlError: the store cannot be opened.
    """
    token = token_for(host)
    app = create_app(url, bound=host, hosts=hosts, token=token)
    config = uvicorn.Config(
        app,
        host=host,
        port=port,
        log_level="warning",
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=LONGEST_REQUEST,
        timeout_graceful_shutdown=2,
    )
    return _Server(config), token


class _Server(uvicorn.Server):
    """A server that does not wait for readers of live changes, nor for slow questions, to stop."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End streams and cancel questions before connections are awaited."""
        app = self.config.app
        assert isinstance(app, FastAPI)
        app.state.live.close()
        await anyio.to_thread.run_sync(app.state.store.cancel)
        await super().shutdown(sockets)

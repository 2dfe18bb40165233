"""A real HTTP server of the web application, in a thread of the tests."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fastapi import FastAPI

from kant_sql.web.application import make_server
from kant_sql.web.tokens import TokenFile
from tests.support.processes.workers import wait_for

PATIENCE = 20.0


@contextmanager
def running(
    url: str,
    *,
    port: int = 0,
    pages: object = None,
    tokens: TokenFile | None = None,
    certificate: Path | None = None,
) -> Iterator[str]:
    """Serve a store, with additional pages, until the block ends; yield the address.

    With a certificate and its key in one file, it speaks TLS, like a proxy in front of it.
    """
    server, _ = make_server(url, port=port, tokens=tokens)
    app = server.config.app
    assert isinstance(app, FastAPI)
    if pages is not None:
        app.include_router(pages.api)  # type: ignore[attr-defined]
    if certificate is not None:
        server.config.ssl_certfile = certificate
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        wait_for(lambda: server.started or not thread.is_alive())
        assert thread.is_alive()
        bound = server.servers[0].sockets[0].getsockname()[1]
        yield f"http{'s' * (certificate is not None)}://127.0.0.1:{bound}"
    finally:
        server.should_exit = True
        thread.join(PATIENCE)

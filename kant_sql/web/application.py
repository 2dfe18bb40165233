"""The application: its pages, their JSON, static files, and errors; and its server."""

from __future__ import annotations

import json
import logging
import os
import secrets
import socket
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from http import HTTPStatus
from typing import Protocol

import anyio
import uvicorn
from fastapi import Depends, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from .. import __version__
from ..arguments import shown
from ..dao_calls import DAO_PATH, LONGEST_BODY, LONGEST_HEAD, TOKEN_VARIABLE, is_loopback
from ..errors import InvalidArgumentError, KantSqlError
from ..json_values import JsonValue, json_value
from ..plugins import Plugins
from .dao_routes import reading
from .description import describe, schema_of
from .live import LiveHub, live
from .pages import TOPICS
from .registry import Pages, VisibleJson, status_of
from .rendering import STATIC, render
from .security import Guard, Programs, allowed_hosts
from .stores import OpenStore
from .tokens import TokenFile
from .transactions import Transactions
from .writing import MOST_WRITERS, PATH_SCOPES, Refusal, write_routes

logger = logging.getLogger("kant_sql.web")

# Questions that run at the same time; each has a thread and a connection.
MOST_QUESTIONS = 8


class Endpoint(Protocol):
    """A plugin's answers to admitted `POST` requests at its name."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""

    def running(self) -> AbstractAsyncContextManager[None]:
        """Answer while the block runs."""


ENDPOINTS: Plugins[Callable[[OpenStore], Endpoint]] = Plugins("kant_sql.web_endpoints")


def create_app(
    url: str,
    *,
    bound: str = "127.0.0.1",
    hosts: Iterable[str] = (),
    token: str | None = None,
    tokens: TokenFile | None = None,
    added: Sequence[Pages] = (),
) -> FastAPI:
    """Make the application of one store.

    Args:
        url: the database URL.
        bound: the address that the server is bound to.
        hosts: further host names that it answers to.
        token: what a reader has to know; None if everybody who reaches the server may read.
        tokens: the tokens of programs that write; None for a server that only reads.
        added: the pages of a plugin; every page links the first of each.

    Returns:
        An ASGI application, for uvicorn or another server.

    Raises:
        KantSqlError: the store cannot be opened, as for `connect`.
    """
    # First: it creates a new file.
    writing = None if tokens is None else OpenStore(url, read_only=False)
    store = OpenStore(url)
    plugged = [(name, ENDPOINTS.get(name)) for name in ENDPOINTS.names()]
    endpoints = {name: make(store) for name, make in plugged if make is not None}

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.state.limiter = anyio.CapacityLimiter(MOST_QUESTIONS)
        app.state.writers = anyio.CapacityLimiter(MOST_WRITERS)
        app.state.looked = {}
        async with AsyncExitStack() as running:
            for endpoint in endpoints.values():
                await running.enter_async_context(endpoint.running())
            try:
                yield
            finally:
                app.state.live.close()
                await anyio.to_thread.run_sync(app.state.transactions.close)
                store.close()
                if writing is not None:
                    writing.close()

    app = FastAPI(
        title="kant_sql",
        summary="A knowledge base with its history, read over HTTP.",
        version=__version__,
        openapi_url="/api/openapi.json",
        default_response_class=VisibleJson,
        # Also for wrong parameters, for which FastAPI would describe its own document.
        responses={"default": {"model": schema_of(Refusal), "description": "An error"}},
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
    )
    app.state.store = store
    app.state.live = LiveHub(store)
    app.state.added = [pages.first for pages in added]
    app.state.writing = writing
    app.state.transactions = Transactions()
    # First: programs ask these most often, and the routes before a path are tried one by one.
    strict = [Depends(_check_parameters)]
    app.include_router(reading, dependencies=strict)
    if writing is not None:
        app.include_router(write_routes, dependencies=strict)
    for pages in (*TOPICS, *added):
        app.include_router(pages.api, dependencies=strict)
        app.include_router(pages.html)
    app.include_router(live, dependencies=strict)
    describe(app)
    for name, endpoint in endpoints.items():
        app.router.routes.append(Route(f"/{name}", endpoint, methods=["POST"]))
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    _answer_errors(app)
    own = None if tokens is None else Programs(tokens, PATH_SCOPES, LONGEST_BODY)
    app.state.accepts = (lambda scope: True) if own is None else own.accepts
    app.add_middleware(
        Guard, bound=bound, hosts=allowed_hosts(bound, hosts), token=token, programs=own
    )
    return app


async def _check_parameters(request: Request) -> None:
    """Refuse a parameter that the route does not read: the answer would be to another question."""
    read = request.scope["route"].dependant.query_params
    # A token for one knowledge base gives its name to every request.
    known = dict.fromkeys(("kb", *(each.alias for each in read)))
    for name in request.query_params:
        if name not in known:
            raise InvalidArgumentError(
                f"{request.url.path} has no parameter {shown(name)}; it has {', '.join(known)}"
            )


def _answer_errors(app: FastAPI) -> None:
    """Answer errors with one sentence, never with a traceback."""

    @app.exception_handler(KantSqlError)
    async def refused(request: Request, error: KantSqlError) -> Response:
        said = app.state.store.folders.said(error)
        details = json_value(vars(error)) if request.url.path.startswith(DAO_PATH) else None
        return _error(request, status_of(error), said, type(error).__name__, details)

    @app.exception_handler(RequestValidationError)
    async def wrong(request: Request, error: RequestValidationError) -> Response:
        parts = [
            f"the body is not JSON: {part['ctx']['error']}"
            if part["type"] == "json_invalid"
            else f"{'.'.join(map(str, part['loc'][1:] or part['loc']))}: {part['msg']}"
            for part in error.errors()
        ]
        if isinstance(error.body, bytes) and error.body:
            parts = ["the body is taken for JSON only with Content-Type: application/json"]
        return _error(request, 422, "; ".join(parts), "InvalidArgumentError")

    @app.exception_handler(HTTPException)
    async def failed(request: Request, error: HTTPException) -> Response:
        response = _error(request, error.status_code, str(error.detail), "HTTPException")
        response.headers.update(error.headers or {})
        return response

    @app.exception_handler(Exception)
    async def broken(request: Request, error: Exception) -> Response:
        logger.error("%s %s failed", request.method, request.url.path, exc_info=error)
        message = "the server failed; its log says more"
        return _error(request, 500, message, "InternalServerError")


def _error(
    request: Request, status: int, message: str, kind: str, details: JsonValue = None
) -> Response:
    if request.url.path.startswith(("/api/", "/static/")):
        document = {"error": message, "type": kind}
        if not details:
            return VisibleJson(document, status)
        # Details may have any characters, which this escapes.
        text = json.dumps({**document, "details": details})
        return Response(text, status, media_type="application/json")
    page = {"status": status, "phrase": HTTPStatus(status).phrase, "message": message}
    return render(request, "error.html", page, request.query_params.get("kb"), status=status)


DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765


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
            f"{TOKEN_VARIABLE} has characters that HTTP headers cannot carry; use ASCII letters "
            "and digits"
        )
    return given


def make_server(
    url: str,
    *,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    hosts: Sequence[str] = (),
    tokens: TokenFile | None = None,
    added: Sequence[Pages] = (),
) -> tuple[uvicorn.Server, str | None]:
    """Make a server of one store.

    Args:
        url: the database URL.
        host: the address to bind to.
        port: the port; 0 for a free one.
        hosts: further host names that it answers to.
        tokens: the tokens of programs that write; None for a server that only reads.
        added: the pages of a plugin.

    Returns:
        The server, to run, and the token that readers need, if any.

    Raises:
        KantSqlError: the store cannot be opened.
    """
    token = token_for(host)
    if tokens is not None:
        # This refuses a file without tokens now.
        tokens.tokens()
    app = create_app(url, bound=host, hosts=hosts, token=token, tokens=tokens, added=added)
    config = uvicorn.Config(
        app,
        host=host,
        port=port,
        log_level="warning",
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=LONGEST_HEAD,
        timeout_graceful_shutdown=2,
    )
    return _Server(config), token


class _Server(uvicorn.Server):
    """A server that stops without waiting for readers of live changes or slow questions."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End streams and cancel questions before waiting for connections."""
        app = self.config.app
        assert isinstance(app, FastAPI)
        app.state.live.close()
        await anyio.to_thread.run_sync(app.state.store.cancel)
        await super().shutdown(sockets)

"""The protocol over HTTP, at `/mcp` of `kant-sql serve`; the first request imports the SDK."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING

import anyio
from anyio.abc import TaskGroup, TaskStatus
from starlette.requests import ClientDisconnect
from starlette.types import Receive, Scope, Send

from kant_sql.web.security import refusal
from kant_sql.web.stores import OpenStore

from .command import MISSING

if TYPE_CHECKING:
    from mcp.server.streamable_http_manager import StreamableHTTPSessionManager


class Endpoint:
    """Answers each request of the protocol on its own: there are no sessions."""

    def __init__(self, store: OpenStore) -> None:
        self._store = store
        self._lock = anyio.Lock()
        self._tasks: TaskGroup | None = None
        self._manager: StreamableHTTPSessionManager | None = None

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Answer while the block runs."""
        async with anyio.create_task_group() as self._tasks:
            yield
            self._tasks.cancel_scope.cancel()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that the guard of the server has admitted."""
        token = scope.get("token")
        if token is not None and not token.is_for_all:
            # The body names the knowledge base, and the guard does not read the body.
            why = "the token is for some knowledge bases only; this needs one for all of them"
            await refusal(scope, 403, why)(scope, receive, send)
            return
        try:
            manager = await self._started()
        except ImportError:
            await refusal(scope, 501, MISSING)(scope, receive, send)
            return
        # A client that leaves during a request gets no answer.
        with suppress(ClientDisconnect):
            await manager.handle_request(scope, receive, send)

    async def _started(self) -> StreamableHTTPSessionManager:
        async with self._lock:
            if self._manager is None:
                assert self._tasks is not None
                self._manager = await self._tasks.start(self._run)
            return self._manager

    async def _run(self, *, task_status: TaskStatus[StreamableHTTPSessionManager]) -> None:
        manager = await anyio.to_thread.run_sync(self._make)
        async with manager.run():
            task_status.started(manager)
            await anyio.sleep_forever()

    def _make(self) -> StreamableHTTPSessionManager:
        from mcp.server.transport_security import TransportSecuritySettings

        from .server import make_server

        server = make_server(self._store)
        # The guard checks the host names.
        names = TransportSecuritySettings(enable_dns_rebinding_protection=False)
        server.streamable_http_app(stateless_http=True, transport_security=names)
        return server.session_manager

"""Calls of DAOs over HTTP, which the DAO family of `http://` and `https://` makes."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from ..dao_calls import call, document
from ..errors import InvalidArgumentError
from ..knowledge_base import KnowledgeBase
from .registry import KbName
from .stores import OpenStore, answer
from .tokens import Token
from .writing import WRITES, Kind, Result

reading = APIRouter(prefix="/api", tags=["DAOs"])


@reading.get("/dao", response_model=dict[str, Any])
async def read_dao(
    request: Request,
    kind: Annotated[Kind | None, Query(description="The DAO; none for the revision.")] = None,
    do: Annotated[str, Query(description="Its method, one that reads.")] = "",
    arguments: Annotated[str, Query(description="Its arguments, as `POST` takes them.")] = "",
    kb_name: KbName = None,
) -> Response:
    """Call a method of a DAO that reads, or give the last revision and the actor of the token."""
    # Who may write begins a knowledge base: until then it is empty.
    store: OpenStore = request.app.state.writing or request.app.state.store
    token: Token | None = request.scope.get("token")

    def work() -> str:
        with store.knowledge_base(store.choose(kb_name)) as kb:
            if kind is None:
                actor = None if token is None else token.actor
                return json.dumps({"revision": kb.revision, "actor": actor})
            try:
                given = json.loads(arguments)
            except (ValueError, RecursionError) as error:
                raise InvalidArgumentError(f"the arguments are not JSON: {error}") from error
            return json.dumps(document(call(kb, kind, do, given, reads=True)))

    return Response(await answer(request, work), media_type="application/json")


@WRITES.post("/dao", "write")
def dao(kb: KnowledgeBase, *, kind: Kind, do: str, arguments: Any) -> list[Result]:
    """Call a method of a DAO that writes, as the library does; the result is what it returns.

    Args:
        kind: the DAO, as an attribute of `kb` or `kb.pddl`.
        do: its method.
        arguments: its arguments by name: `{"pool": [...], "value": {"map": {...}}}`.
    """
    return [call(kb, kind, do, arguments, reads=False)]

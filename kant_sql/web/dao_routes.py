"""Calls of DAOs over HTTP, which the DAO family of `http://` and `https://` makes."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from ..arguments import shown
from ..dao_calls import TRANSACTION_PATH, call, document, is_read, keywords, read
from ..errors import ConnectionLostError, InvalidArgumentError
from ..json_values import json_value
from ..knowledge_base import KnowledgeBase
from ..store.requests import find_request, keep_request
from .registry import KbName
from .security import refusal
from .stores import OpenStore, answer
from .tokens import Token
from .transactions import GONE, Lend, Step, Transactions
from .writing import PATH_SCOPES, Kind, RequestKey, Result, open_transaction, post, write_routes

reading = APIRouter(prefix="/api", tags=["DAOs"])


@reading.get("/dao", response_model=dict[str, Any])
async def read_dao(
    request: Request,
    kind: Annotated[Kind | None, Query(description="The DAO; none for the revision.")] = None,
    do: Annotated[str, Query(description="Its method, one that reads.")] = "",
    arguments: Annotated[str, Query(description="Its arguments, as `POST` takes them.")] = "",
    at: Annotated[
        str, Query(description="A list of arguments of `kb.at`, for a past state, in that form.")
    ] = "",
    kb_name: KbName = None,
) -> Response:
    """Call a reading method of a DAO, or return the last revision and the actor of the token."""
    # Who may write begins a knowledge base: until then it is empty.
    store: OpenStore = request.app.state.writing or request.app.state.store
    token: Token | None = request.scope.get("token")

    def work() -> str:
        with store.knowledge_base(store.choose(kb_name)) as present:
            kb = present
            for moments in _moments(at):
                kb = kb.at(**moments)
            if kind is None:
                actor = None if token is None else token.actor
                return json.dumps({"revision": kb.revision, "actor": actor})
            return json.dumps(document(call(kb, kind, do, _parsed(arguments), reads=True)))

    return Response(await answer(request, work), media_type="application/json")


def _moments(at: str) -> list[dict[str, Any]]:
    """Read the arguments of `kb.at`, each for the state of the one before."""
    if not at:
        return []
    found = read(_parsed(at))
    names = {"when", "known", "valid"}
    if isinstance(found, list) and all(isinstance(o, dict) and o.keys() <= names for o in found):
        return found
    raise InvalidArgumentError(f"at is a list of arguments of kb.at, not {shown(found)}")


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidArgumentError(f"the arguments are not JSON: {error}") from error


@post("/dao", "write")
def dao(kb: KnowledgeBase, *, kind: Kind, do: str, arguments: Any) -> list[Result]:
    """Call a writing method of a DAO, as the library does, and return its result.

    Args:
        kind: the DAO, as an attribute of `kb` or `kb.pddl`.
        do: its method.
        arguments: its arguments by name: `{"pool": [...], "value": {"map": {...}}}`.
    """
    return [call(kb, kind, do, arguments, reads=False)]


class TransactionStep(BaseModel):
    """A step of a transaction that takes several requests, in one revision."""

    model_config = ConfigDict(extra="forbid")

    transaction: Annotated[
        str, Field(min_length=16, max_length=64, description="Chosen at random by the client.")
    ]
    number: Annotated[
        int, Field(ge=1, description="1, 2, 3 ...: a number that is repeated is executed once.")
    ]
    step: Annotated[Step, Field(description="`begin` within a transaction opens a nested block.")]
    kind: Annotated[Kind | None, Field(description="Of a call: the DAO.")] = None
    do: Annotated[str, Field(description="Of a call: its method.")] = ""
    arguments: Annotated[
        Any, Field(description="Of a call, as for `/api/dao`; of `begin`, of `kb.transaction`.")
    ] = None
    source: Annotated[Any, Field(description="Of `begin`: where it comes from, any JSON.")] = None


PATH_SCOPES[TRANSACTION_PATH] = "write"


@write_routes.post(TRANSACTION_PATH.removeprefix("/api"), response_model=dict[str, Any])
async def dao_transaction(
    request: Request, given: TransactionStep, kb_name: KbName = None
) -> Response:
    """Take a step of a transaction, which is rolled back after 10 seconds without another step."""
    store: OpenStore = request.app.state.writing
    transactions: Transactions = request.app.state.transactions
    token: Token = request.scope["token"]
    if is_read(given.do) and "read" not in token.scopes:
        return refusal(request.scope, 403, "the token has not the scope read")
    place = token.id, kb_name, given.transaction
    key = RequestKey.of(token.id, given.transaction, b"transaction")

    def lend() -> AbstractContextManager[KnowledgeBase]:
        return store.knowledge_base(store.choose(kb_name))

    work = partial(_take, given, token.actor, key)
    asked = transactions.ask(place, given.number, given.step, lend, work)
    if asked is None:
        found = await anyio.to_thread.run_sync(partial(_ended, lend, given.step, key))
    else:
        found = await asyncio.shield(asyncio.wrap_future(asked))
    return Response(json.dumps(found), media_type="application/json")


def _take(given: TransactionStep, actor: str, key: RequestKey, kb: KnowledgeBase) -> Any:
    if given.step == "begin":
        return _block(given, actor, key, kb)
    kind, reads = given.kind or "", is_read(given.do)
    result = call(kb, kind, given.do, given.arguments, reads=reads)
    return document(result) if reads else {"results": json_value([result])}


@contextmanager
def _block(
    given: TransactionStep, actor: str, key: RequestKey, kb: KnowledgeBase
) -> Iterator[None]:
    try:
        block = kb.transaction(actor=actor, source=given.source, **keywords(given.arguments))
    except TypeError as error:
        raise InvalidArgumentError(f"begin: {error}") from error
    with block:
        keep_request(open_transaction(kb), *key, [])
        yield


def _ended(lend: Lend, step: Step, key: RequestKey) -> Any:
    """Answer a step of a transaction that is not open any more, and may be committed."""
    if step == "commit":
        with lend() as kb, kb.transaction():
            if find_request(open_transaction(kb), key.key) is not None:
                return {}
    if step == "rollback":
        return {}
    raise ConnectionLostError(GONE)

"""Verification: started by readers, its progress and its findings; and anchors."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Annotated, NamedTuple
from urllib.parse import parse_qs

import anyio
from fastapi import Query, Request
from fastapi.responses import RedirectResponse, Response
from starlette.exceptions import HTTPException

from ...errors import InvalidArgumentError
from ...history.anchors import Anchor, AnchoredHead, parse_anchor
from ...json_values import JsonValue, json_value
from ..description import schema_of
from ..registry import KbName, Pages, VisibleJson
from ..rendering import link, render
from ..security import require_all
from ..stores import OpenStore, answer
from ..verifying import VerificationState

PAGES = Pages("verification")

# An anchor has about 200 bytes for each knowledge base.
LONGEST_ANCHOR = 16 << 20
MOST_FIELDS = 10

Cancel = Annotated[bool, Query(description="Whether to cancel the running verification.")]


class AnchorFile(NamedTuple):
    """The heads of all knowledge bases of the store, as `kant-sql anchor` writes them."""

    format: int
    made_at: str
    heads: list[AnchoredHead]


def _state(store: OpenStore, name: str | None) -> tuple[dict[str, JsonValue], str, int]:
    chosen = store.choose(name)
    with store.knowledge_base(chosen) as kb:
        head = kb.revision
    return _document(store, chosen), chosen, head


def _document(store: OpenStore, name: str) -> dict[str, JsonValue]:
    document = store.folders.hide_in(json_value(store.verifier.state(name)))
    assert isinstance(document, dict)
    return document


@PAGES.html.get("/verify")
async def verify_page(request: Request, kb_name: KbName = None) -> Response:
    """Show the last verification, and start another one."""
    store: OpenStore = request.app.state.store
    state, name, head = await answer(request, lambda: _state(store, kb_name))
    return render(request, "verify.html", {**state, "head": head}, name, head=head)


@PAGES.api.get("/verify", response_model=schema_of(VerificationState))
async def verify_state(request: Request, kb_name: KbName = None) -> Response:
    """Return the progress of a running verification, and the result of the last one.

    The server remembers them until it is stopped.
    """
    store: OpenStore = request.app.state.store
    return VisibleJson((await answer(request, lambda: _state(store, kb_name)))[0])


@PAGES.html.post("/verify")
async def verify_from_page(
    request: Request, kb_name: KbName = None, cancel: Cancel = False
) -> Response:
    """Start a verification, or cancel it, and redirect to its page."""
    body = await _body(request)
    name = await _start(request, kb_name, lambda: _anchor_of_form(body), cancel)
    return RedirectResponse(link("/verify", kb=name), 303)


@PAGES.api.post(
    "/verify",
    response_model=schema_of(VerificationState),
    openapi_extra={
        "requestBody": {
            "description": "An anchor to compare with; without one, the body is empty.",
            "content": {"application/json": {"schema": {"type": "object"}}},
        }
    },
)
async def start_verification(
    request: Request, kb_name: KbName = None, cancel: Cancel = False
) -> Response:
    """Start a verification, which recomputes every hash and compares all redundant data.

    One runs at a time for each knowledge base; the request returns at once. The body may be an
    anchor, to compare with.
    """
    store: OpenStore = request.app.state.store
    body = await _body(request)
    read = partial(body.decode, "utf-8", "replace")
    return VisibleJson(_document(store, await _start(request, kb_name, read, cancel)))


def _anchor_of_form(body: bytearray) -> str:
    try:
        form = parse_qs(body.decode("utf-8", "replace"), max_num_fields=MOST_FIELDS)
    except ValueError:
        raise InvalidArgumentError("this is not the form of a verification") from None
    return form.get("anchor", [""])[0]


async def _body(request: Request) -> bytearray:
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > LONGEST_ANCHOR:
            raise HTTPException(413, "this is too long to be an anchor")
    return body


async def _start(
    request: Request, kb_name: str | None, read: Callable[[], str], cancel: bool
) -> str:
    """Start or cancel a verification; return the name of the knowledge base.

    A thread reads the anchor, so other readers do not wait for a large one.
    """
    store: OpenStore = request.app.state.store

    def work() -> tuple[str, Anchor | None]:
        chosen = store.choose(kb_name)
        store.require(chosen)
        text = read().strip()
        return chosen, parse_anchor(text) if text else None

    chosen, anchor = await answer(request, work)
    if cancel:
        await anyio.to_thread.run_sync(store.verifier.cancel, chosen)
    else:
        store.verifier.start(chosen, anchor)
    return chosen


@PAGES.api.get("/anchor", response_model=schema_of(AnchorFile))
async def anchor(request: Request, kb_name: KbName = None) -> Response:
    """Return the heads of all knowledge bases of the store, as a file to keep elsewhere.

    Give this file to a later verification to find removed or rewritten revisions.
    """
    require_all(request)
    store: OpenStore = request.app.state.store

    def work() -> Anchor:
        names = [kb_name] if kb_name else store.read_catalog(lambda catalog: catalog.first_names(1))
        with store.knowledge_base(names[0] if names else store.choose(None)) as kb:
            return kb.store.anchor()

    made = await answer(request, work)
    day = made.made_at.partition(".")[0].replace(":", "-")
    headers = {"Content-Disposition": f'attachment; filename="anchor-{day}.json"'}
    return Response(f"{made.text()}\n", media_type="application/json", headers=headers)

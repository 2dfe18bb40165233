"""Registers pages: one function returns the data of a page and of its JSON under `/api/`."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable, Mapping, Sequence
from datetime import datetime
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, TypeVar

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, JSONResponse, Response

from .. import errors
from ..html import visible
from ..json_values import JsonValue, json_value
from ..knowledge_base import KnowledgeBase
from ..moment_text import is_now, parse_moment
from .description import schema_of
from .rendering import csv_text, render
from .security import require_all
from .stores import OpenStore, answer

F = TypeVar("F", bound=Callable[..., Any])
# Draws a result, with the parameters of its page.
Draw: TypeAlias = Callable[[Any, Mapping[str, Any]], JsonValue]

KB_DESCRIPTION = "The knowledge base's name; not needed in a store of one."
# Errors of a form's input: it is wrong, or names an element that never existed.
WRONG_INPUT = 400, 404
# The first match counts; other errors of the library are the server's.
_STATUS: tuple[tuple[type[errors.KantSqlError], int], ...] = (
    (errors.UnknownNameError, 404),
    (errors.ArchivedError, 410),
    (errors.UnknownRevisionError, 404),
    (errors.InvalidArgumentError, 400),
    (errors.InvalidKnowledgeError, 400),
    (errors.UnsupportedConstructError, 400),
    (errors.StoreBusyError, 503),
    (errors.StoreUnreachableError, 503),
    (errors.QuestionCancelledError, 503),
    (errors.StatementTimeoutError, 504),
    # Errors of writes only.
    (errors.StaleRevisionError, 412),
    (errors.ReadOnlyError, 403),
    (errors.ConflictError, 409),
    (errors.DependantsError, 409),
    (errors.NotApplicableError, 409),
    (errors.PlanError, 409),
    (errors.ReplicaError, 409),
    (errors.RuleViolatedError, 409),
    (errors.ConnectionLostError, 503),
    (errors.OutcomeUnknownError, 503),
    (errors.StoreReplacedError, 503),
    (errors.StoreFullError, 507),
)
# PostgreSQL stores no text with a NUL, and refuses to search for one.
NO_NUL = r"^[^\x00]*$"
KbName = Annotated[str | None, Query(alias="kb", description=KB_DESCRIPTION, pattern=NO_NUL)]


def status_of(error: errors.KantSqlError | type[errors.KantSqlError]) -> int:
    """Return the HTTP status of an error."""
    raised = error if isinstance(error, type) else type(error)
    return next((status for kind, status in _STATUS if issubclass(raised, kind)), 500)


class Pages:
    """The pages of a topic, as HTML and as JSON.

    Attributes:
        html: the routes of the pages.
        api: the routes of their JSON.
        first: the path of the first page, and the topic.
    """

    def __init__(self, topic: str) -> None:
        self.html = APIRouter(include_in_schema=False)
        self.api = APIRouter(prefix="/api", tags=[topic])
        self.first = "", topic

    def page(
        self,
        path: str,
        template: str,
        *,
        is_form: bool = False,
        rows: Sequence[str] = (),
        draw: Draw | None = None,
    ) -> Callable[[F], F]:
        """Register a function that returns a page's data.

        Its first argument is a knowledge base, or the store; the others are parameters of the
        query, by keyword, as FastAPI declares them. It returns a dataclass or a NamedTuple, whose
        JSON the template shows. Its docstring describes the page. A form shows errors of its input
        itself: its template gets `error`, and None as its `page`. `rows` are the lists in the data
        that `/csv` followed by the path returns, the first one with rows. `draw` makes additional
        markup from the data, which the template gets as `drawn`.
        """

        def register(function: F) -> F:
            self.json(path)(function)
            self.first = self.first[0] or path, self.first[1]
            respond = partial(_page, template=template, has_rows=bool(rows))
            if rows:
                listed = partial(_csv, rows=rows)
                self.html.get(f"/csv{path}", response_class=Response)(_endpoint(function, listed))
            refuse = partial(_form, template=template) if is_form else None
            self.html.get(path, response_class=HTMLResponse)(
                _endpoint(function, respond, refuse, draw)
            )
            return function

        return register

    def json(self, path: str) -> Callable[[F], F]:
        """Register a function that returns only JSON, below `/api/`."""

        def register(function: F) -> F:
            self.api.get(path)(_endpoint(function, _json))
            return function

        return register


class VisibleJson(JSONResponse):
    """JSON with hidden characters escaped: browsers show it as it is."""

    def render(self, content: object) -> bytes:
        """Return the document."""
        text: str = bytes(super().render(content)).decode()
        return visible(text).encode()


class _Answer(NamedTuple):
    """The data of a page as JSON, with its knowledge base and head.

    `head` is the last revision before the read; for a store, the number of all revisions.
    """

    data: JsonValue
    kb: str | None
    head: int
    drawn: JsonValue = None


async def _json(request: Request, found: _Answer) -> Response:
    return VisibleJson(found.data)


async def _page(request: Request, found: _Answer, template: str, has_rows: bool) -> HTMLResponse:
    assert isinstance(found.data, dict)
    return render(
        request,
        template,
        found.data,
        found.kb,
        head=found.head,
        has_rows=has_rows,
        drawn=found.drawn,
    )


async def _csv(request: Request, found: _Answer, rows: Sequence[str]) -> Response:
    name = request.url.path.rpartition("/")[2] or "knowledge-bases"
    headers = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
    return Response(csv_text(found.data, rows), media_type="text/csv", headers=headers)


async def _form(request: Request, error: errors.KantSqlError, template: str) -> HTMLResponse:
    kb = request.query_params.get("kb")
    said = request.app.state.store.folders.said(error)
    return render(request, template, None, kb, status=status_of(error), error=said)


def _check_texts(query: Mapping[str, object]) -> None:
    for name, value in query.items():
        if isinstance(value, str) and "\0" in value:
            raise errors.InvalidArgumentError(f"{name} has a NUL character, which no text can have")


def _endpoint(
    function: Callable[..., Any],
    respond: Callable[[Request, _Answer], Awaitable[Any]],
    refuse: Callable[[Request, errors.KantSqlError], Awaitable[Any]] | None = None,
    draw: Draw | None = None,
) -> Callable[..., Awaitable[Any]]:
    """Make an endpoint from a data function, with its parameters, the request and a store."""
    signature = inspect.signature(function, eval_str=True)
    first, *others = signature.parameters.values()
    of_store = first.annotation is OpenStore

    async def endpoint(request: Request, **query: Any) -> Any:
        store: OpenStore = request.app.state.store
        name = query.pop("kb_name", None)
        if of_store:
            require_all(request)

        is_asked = False

        def read(of: OpenStore | KnowledgeBase, kb: str | None, head: int) -> _Answer:
            found = function(of, **query)
            own = {name: text for name, text in request.query_params.items() if name in query}
            drawn = None if draw is None else draw(found, {**own, "kb": kb})
            hide = store.folders.hide_in
            return _Answer(hide(json_value(found)), kb, head, hide(drawn))

        def work() -> _Answer:
            nonlocal is_asked
            if of_store:
                head = store.read_catalog(lambda catalog: catalog.total())[1]
                return read(store, None, head)
            chosen = store.choose(name)
            with store.knowledge_base(chosen) as kb:
                head, is_asked = kb.revision, True
                return read(kb, chosen, head)

        try:
            _check_texts(query)
            found = await answer(request, work)
        except errors.KantSqlError as error:
            if refuse is None or not is_asked or status_of(error) not in WRONG_INPUT:
                raise
            return await refuse(request, error)
        return await respond(request, found)

    keyword = inspect.Parameter.KEYWORD_ONLY
    parameters = [inspect.Parameter("request", keyword, annotation=Request)]
    if not of_store:
        assert first.annotation is KnowledgeBase, function
        parameters.append(inspect.Parameter("kb_name", keyword, annotation=KbName, default=None))
    parameters += [other.replace(kind=keyword) for other in others]
    returned = (
        HTMLResponse if isinstance(respond, partial) else schema_of(signature.return_annotation)
    )
    endpoint.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        parameters, return_annotation=returned
    )
    endpoint.__name__, endpoint.__doc__ = function.__name__, function.__doc__
    return endpoint


_MOMENT = "a revision's number, a time as 2026-03-02T14:03:00Z (UTC unless it has a zone), `now`, "
_MOMENT += "`2 hours ago` or `yesterday 14:03`"
At = Annotated[str | None, Query(description=f"Which state: {_MOMENT}; by default the present.")]
Valid = Annotated[
    str | None,
    Query(
        description="The facts that were true at this time, as known in the state; empty: as known."
    ),
]
SinceMoment = Annotated[str | None, Query(description=f"Only from then on, inclusive: {_MOMENT}.")]
UntilMoment = Annotated[str | None, Query(description=f"Only up to then, inclusive: {_MOMENT}.")]
Clock = Annotated[
    Literal["committed", "valid"],
    Query(description="`committed`: by revisions; `valid`: by the times when it was true."),
]
Before = Annotated[
    int | None, Query(ge=0, description="Only revisions before this one: the next page.")
]
ElementText = Annotated[
    str | None, Query(description="Only elements whose text contains this, in any case.")
]
ObjectName = Annotated[str | None, Query(description="Only elements that name this object.")]
After = Annotated[str | None, Query(description="Where the page begins: `next` of the last one.")]
Offset = Annotated[
    int, Query(ge=0, le=2**53, description="How many come before the page: `next` of the last one.")
]


def past(kb: KnowledgeBase, at: str | None, valid: str | None) -> KnowledgeBase:
    """Open the state of a form: known at a revision or time, and true at a time."""
    known, time = moment(at), moment(valid)
    if known is None and time is None:
        return kb
    return kb.at(known=kb.revision if known is None else known, valid=time)


def moment(text: str | None) -> int | datetime | None:
    """Read a revision or a time; None for the present."""
    return None if is_now(text) else bound(text)


def bound(text: str | None) -> int | datetime | None:
    """Read a bound of a range, which may be now; None for an open end."""
    stripped = (text or "").strip()
    return parse_moment(stripped) if stripped else None

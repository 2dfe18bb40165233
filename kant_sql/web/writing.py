"""Writing over HTTP: functions of a knowledge base, each a `POST` below `/api`, with a token."""

from __future__ import annotations

import hashlib
import inspect
import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import timedelta
from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeAlias, TypeVar

import anyio
from fastapi import APIRouter, Header, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field, StrictFloat, StrictInt, create_model
from starlette.exceptions import HTTPException

from ..dao_calls import KINDS, LONGEST_BODY, MOST_CHANGES, dao_of, is_read
from ..errors import InvalidArgumentError, StaleRevisionError, StoreError, UnknownNameError
from ..history.revisions import Revision
from ..json_values import json_value
from ..knowledge_base import KnowledgeBase, state_of
from ..pddl.lexer import is_text
from ..store.requests import find_request, forget_requests, keep_request
from ..store.transaction import Transaction
from .description import schema_of, texts_of
from .registry import KbName, VisibleJson, status_of
from .stores import OpenStore
from .tokens import Token

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

# The maximum numbers of parallel writers, and of those that wait for a thread; others are refused.
MOST_WRITERS, MOST_WAITING = 8, 64
# How long a request can be repeated, and seconds between removals of older requests.
KEPT, LOOK = timedelta(days=7), 3600.0
_REUSED = "this Idempotency-Key was used for another request; choose one at random for each write"
# The maximum number of revisions in the answer to a stale `If-Match`.
MOST_SINCE = 50
_NUMBER = re.compile(r"[-+]?[0-9]+(?:[.][0-9]+)?")
_REVISION = re.compile(r'(?:W/)?"?([0-9]{1,18})"?')

# The result of a DAO's method: a truth value, the number of changes, or a number.
Result: TypeAlias = bool | int | Decimal | str | None
Text = Annotated[str, Field(max_length=LONGEST_BODY)]
Texts = Annotated[tuple[Text, ...], Field(max_length=MOST_CHANGES)]
# As for the DAOs, a truth value is not a number.
Number = StrictInt | StrictFloat | Text
if TYPE_CHECKING:
    Kind = str
    Do = str
else:
    Kind = Literal[(*KINDS,)]
    methods = {do for one in KINDS.values() for do in one.__abstractmethods__ if not is_read(do)}
    Do = Literal[(*sorted(methods),)]


class DaoCall(BaseModel):
    """A call of a DAO: one change of a transaction."""

    model_config = ConfigDict(extra="forbid")

    kind: Annotated[Kind, Field(description="The DAO, as an attribute of `kb` or `kb.pddl`.")]
    do: Annotated[Do, Field(description="Its method.")]
    element: Annotated[
        Text | Texts | None,
        Field(description="PDDL text, as `(robot_at rb1 wp1)` or `rb1 - robot`; or a list."),
    ] = None
    value: Annotated[
        Number | None, Field(description="Of a fluent: a number, as JSON or text, or an object.")
    ] = None
    by: Annotated[
        Number | None, Field(description="Of `increase`, `scale_up` and their opposites.")
    ] = None
    cascade: Annotated[
        bool, Field(description="Whether to retract what depends on the definition before.")
    ] = False


Changes = Annotated[tuple[DaoCall, ...], Field(max_length=MOST_CHANGES)]
Values = Annotated[dict[Text, Number], Field(max_length=MOST_CHANGES)]


class WriteAnswer(NamedTuple):
    """What a request has written.

    Attributes:
        revision: the revision that it made; None if it changed nothing.
        results: what each change returned, in order: true for `save`; else whether it changed
            something, or how many elements it changed, or a number's new value, exact, as text; of
            a step, the id of its execution.
        warnings: where loaded text deviates from the standard; not repeated.
        is_repeated: whether the request was written before, under its `Idempotency-Key`.
    """

    revision: int | None
    results: tuple[Result, ...]
    warnings: tuple[str, ...] = ()
    is_repeated: bool = False


class Stale(NamedTuple):
    """The answer to a request whose `If-Match` is not the last revision: nothing was written.

    Attributes:
        error: what is wrong, and the remedy.
        type: `StaleRevisionError`.
        revision: the last revision.
        since: the revisions after the expected one, the oldest first, at most 50.
    """

    error: str
    type: str
    revision: int
    since: tuple[Revision, ...]


class Refusal(NamedTuple):
    """The answer to a request that is refused or fails: nothing was written.

    Attributes:
        error: what is wrong, which element, and the remedy.
        type: the class of the error.
    """

    error: str
    type: str


class _Said(BaseModel):
    """What every request may say of its revision; the actor is the token's."""

    model_config = ConfigDict(extra="forbid")

    reason: Annotated[str | None, Field(description="Why.")] = None
    source: Annotated[Any, Field(description="Where it comes from: any JSON.")] = None
    observed_at: Annotated[
        str | None, Field(description="When it was sensed: a time, or `2 minutes ago`.")
    ] = None
    valid_from: Annotated[
        str | None, Field(description="Of facts and values: since when they are true.")
    ] = None
    valid_until: Annotated[
        str | None, Field(description="Of facts and values: until when they were true.")
    ] = None


# The requests that write, and the scope that each path requires.
write_routes = APIRouter(prefix="/api", tags=["writing"])
PATH_SCOPES: dict[str, str] = {}


def post(path: str, scope: str, did: str | None = None) -> Callable[[F], F]:
    """Register a function that writes: its keywords are the fields of the body."""
    # It runs in a transaction, which is one revision. It returns the results of its changes, and
    # warnings. `did` begins the reason, if none is given.

    def register(function: F) -> F:
        description, texts = texts_of(function, "Args")
        hints = inspect.signature(function, eval_str=True).parameters
        fields: dict[str, Any] = {
            name: (
                Annotated[one.annotation, Field(description=texts[name])],
                ... if one.default is inspect.Parameter.empty else one.default,
            )
            for name, one in [*hints.items()][1:]
        }
        name = f"{function.__name__.capitalize()}Body"
        body = create_model(name, __base__=_Said, __doc__=description, **fields)
        refused = {"model": schema_of(Refusal)}
        PATH_SCOPES[f"/api{path}"] = scope
        write_routes.post(
            path,
            name=function.__name__,
            description=f"{description} Needs the scope `{scope}`.",
            response_model=schema_of(WriteAnswer),
            responses={
                **dict.fromkeys((400, 401, 403, 404, 409, 413, 429, 503), refused),
                412: {"model": schema_of(Stale)},
            },
        )(_endpoint(function, body, did))
        return function

    return register


def _endpoint(function: Callable[..., Any], body: type[_Said], did: str | None) -> Any:
    async def endpoint(
        request: Request,
        given: Any,
        kb_name: KbName = None,
        if_match: Annotated[
            str | None,
            Header(description="The last revision that the writer has read, as `17`: else 412."),
        ] = None,
        idempotency_key: Annotated[
            str | None,
            Header(
                min_length=1,
                max_length=255,
                description="Chosen at random for each write: repeated, it is written once.",
            ),
        ] = None,
    ) -> Response:
        store: OpenStore = request.app.state.writing
        token: Token = request.scope["token"]
        fields = dict(given)
        said = {name: fields.pop(name) for name in _Said.model_fields}
        said["actor"], expected = token.actor, _expected(if_match)
        key = None
        if idempotency_key is not None:
            whole = request.url.path.encode(), await request.body()
            key = RequestKey.of(token.id, idempotency_key, b"\n".join(whole))
        if did is not None and said["reason"] is None:
            # The step, or the id of its execution, comes first.
            said["reason"] = f"{did} {' '.join(next(iter(fields.values())).split())}"

        def work() -> tuple[WriteAnswer | Stale, int]:
            with store.knowledge_base(store.choose(kb_name)) as kb:
                if key is not None:
                    _forget_old(request.app.state.looked, kb)
                try:
                    return write(kb, said, partial(function, **fields), expected, key)
                except StaleRevisionError as error:
                    return _stale(kb, error), error.actual

        written, head = await _run(request, work)
        status = status_of(StaleRevisionError) if isinstance(written, Stale) else 200
        document = store.folders.hide_in(json_value(written))
        return VisibleJson(document, status, {"ETag": f'"{head}"'})

    endpoint.__annotations__["given"] = body
    endpoint.__name__ = function.__name__
    return endpoint


def _forget_old(looked: dict[str, float], kb: KnowledgeBase) -> None:
    """Remove old requests from time to time, if the server's role may."""
    store, now = state_of(kb).store, time.monotonic()
    if now >= looked.get(store.name, 0) + LOOK:
        looked[store.name] = now
        with suppress(StoreError):
            forget_requests(store, KEPT)


def _expected(if_match: str | None) -> int | None:
    if if_match is None or if_match.strip() == "*":
        return None
    read = _REVISION.fullmatch(if_match.strip())
    if read is None:
        raise InvalidArgumentError('If-Match is not the number of a revision, as "17"')
    return int(read[1])


async def _run(request: Request, work: Callable[[], T]) -> T:
    limiter: anyio.CapacityLimiter = request.app.state.writers
    if limiter.statistics().tasks_waiting >= MOST_WAITING:
        message = "too many writers wait; nothing was written, try again"
        raise HTTPException(429, message, {"Retry-After": "1"})
    return await anyio.to_thread.run_sync(work, limiter=limiter)


class RequestKey(NamedTuple):
    """The key of a request, and its digest: neither reveals the request."""

    key: str
    digest: str

    @classmethod
    def of(cls, token: str, given: str, request: bytes) -> RequestKey:
        """Make the key of a request from the token's id, the client's key and its bytes."""
        # The digest includes the client's key, which is not kept, so nobody can test guesses.
        parts = f"{token}\n{given}".encode(), given.encode() + b"\n" + request
        return cls(*(hashlib.sha256(part).hexdigest() for part in parts))


def write(
    kb: KnowledgeBase,
    said: Mapping[str, Any],
    work: Callable[[KnowledgeBase], Any],
    expected: int | None = None,
    key: RequestKey | None = None,
) -> tuple[WriteAnswer, int]:
    """Write in one revision; return the answer and the last revision."""
    with kb.transaction(**said):
        transaction = open_transaction(kb)
        before = None if key is None else find_request(transaction, key.key)
        if key is not None and before is not None:
            if before.digest != key.digest:
                raise HTTPException(422, _REUSED)
            return WriteAnswer(before.number, (*before.results,), is_repeated=True), before.number
        # A repetition is not stale: the newer revision may be its own.
        with kb.transaction(expected_revision=expected):
            found = work(kb)
        results, warnings = found if isinstance(found, tuple) else (found, ())
        if key is not None:
            plain = json_value(results)
            assert isinstance(plain, list)
            keep_request(transaction, *key, plain)
    made = transaction.made
    return WriteAnswer(made, (*results,), (*warnings,)), made or transaction.head.revision


def open_transaction(kb: KnowledgeBase) -> Transaction:
    """Return the transaction that is open here."""
    found = state_of(kb).store.current()
    assert found is not None
    return found


def _stale(kb: KnowledgeBase, error: StaleRevisionError) -> Stale:
    since = kb.store.revisions(min(error.expected, error.actual), limit=MOST_SINCE)
    return Stale(str(error), type(error).__name__, error.actual, (*since,))


@post("/facts", "write")
def facts(
    kb: KnowledgeBase, *, delete: Texts = (), save: Texts = (), confirm: bool = False
) -> list[Result]:
    """Delete and save facts, in one revision; the results are two counts.

    Args:
        delete: the facts that no longer hold, as PDDL text.
        save: the facts that hold, as `(robot_at rb1 wp1)`. Their predicates and objects are known.
        confirm: whether to confirm a fact that holds already.
    """
    with kb.transaction(confirm=confirm):
        return [kb.propositions.delete_all(delete), kb.propositions.save_all(save)]


@post("/values", "write")
def values(kb: KnowledgeBase, *, unset: Texts = (), set: Values | None = None) -> list[Result]:
    """Set values of functions, in one revision; the results say of each whether it changed.

    Args:
        unset: fluents that have no value any more, as `(battery rb1)`.
        set: fluents with their values, as `{"(battery rb1)": 90}`; text is an exact number, or
            the name of an object.
    """
    dao = kb.function_values
    done: list[Result] = [dao.unset(fluent) for fluent in unset]
    return done + [dao.set(fluent, value=_number(value)) for fluent, value in (set or {}).items()]


@post("/transaction", "write")
def transaction(kb: KnowledgeBase, *, changes: Changes, confirm: bool = False) -> list[Result]:
    """Make changes of any kind, in order, in one revision: all or none of them.

    Args:
        changes: calls of DAOs; the results are what each returns.
        confirm: whether to confirm facts that hold already.
    """
    with kb.transaction(confirm=confirm):
        return [_call(kb, change) for change in changes]


def _number(given: int | float | str) -> int | float | Decimal | str:
    """Return text as an exact number, unless it is the name of an object."""
    if not isinstance(given, str) or not _NUMBER.fullmatch(given):
        return given
    return Decimal(given)


def _call(kb: KnowledgeBase, change: DaoCall) -> Result:
    method = getattr(dao_of(kb, change.kind), change.do, None)
    known = {} if method is None else inspect.signature(method).parameters
    given = {
        name: getattr(change, name) for name in change.model_fields_set - {"kind", "do", "element"}
    }
    if method is None or not given.keys() <= known.keys():
        what = change.do if method is None else f"{change.do} with {' and '.join(sorted(given))}"
        raise InvalidArgumentError(
            f"{change.kind} have no {what}; the reference of the DAOs lists what each kind has"
        )
    if change.element is None and change.do not in ("delete_all", "set"):
        raise InvalidArgumentError(f"{change.do} of {change.kind} needs an element: PDDL text")
    for name in {"value", "by"} & known.keys() - given.keys():
        raise InvalidArgumentError(f"{change.do} of {change.kind} needs {name}: a number")
    element = [*change.element] if isinstance(change.element, tuple) else change.element
    numbers = {name: _number(given[name]) for name in {"value", "by"} & given.keys()}
    result: Result = method(element, **{**given, **numbers})
    return result


@post("/apply", "apply", "applied")
def apply(kb: KnowledgeBase, *, step: Text) -> list[Result]:
    """Execute a step, if its conditions hold: `kb.apply`. There are no results.

    Args:
        step: an action with its arguments, as `(move rb1 hall kitchen)`.
    """
    kb.apply(step)
    return []


@post("/start", "apply", "started")
def start(kb: KnowledgeBase, *, step: Text) -> list[Result]:
    """Start a durative step: `kb.start`. The result is the id of its execution.

    Args:
        step: an action with its arguments; `[5]` behind it is a duration.
    """
    return [kb.start(step).id]


@post("/end", "apply", "ended")
def end(kb: KnowledgeBase, *, step: Text) -> list[Result]:
    """End a step that runs: `kb.end`. The result is the id of its execution.

    Args:
        step: an action with its arguments, as it was started.
    """
    return [kb.end(step).id]


@post("/abort", "apply", "aborted")
def abort(kb: KnowledgeBase, *, step: Text, undo: bool = False) -> list[Result]:
    """Abort a step that runs: `kb.abort`. The result is the id of its execution.

    Args:
        step: an action with its arguments, as it was started.
        undo: whether to take back what its start changed.
    """
    return [kb.abort(step, undo=undo).id]


@post("/fail", "apply", "failed")
def fail(
    kb: KnowledgeBase, *, execution: Text, code: Text | None = None, text: Text | None = None
) -> list[Result]:
    """Record that a step that runs has failed: `kb.fail`. The result is the id of its execution.

    Args:
        execution: the id of its execution, as `start` returned it.
        code: the code of the failure.
        text: a message.
    """
    found = kb.executions.get(execution)
    if found is None:
        raise UnknownNameError(f"this knowledge base has no execution {execution}")
    return [kb.fail(found, code=code, text=text).id]


@post("/load", "write")
def load(
    kb: KnowledgeBase,
    *,
    domain: Text | None = None,
    problem: Text | None = None,
    mode: Literal["replace", "merge"] = "replace",
) -> tuple[list[Result], list[str]]:
    """Load a domain, a problem or both, in one revision. There are no results.

    Args:
        domain: the PDDL text of the domain.
        problem: the PDDL text of the problem.
        mode: `replace` retracts what the text does not declare, `merge` keeps it.
    """
    warnings: list[str] = []
    for what, source in (("domain", domain), ("problem", problem)):
        if source is None:
            continue
        # A name would be a file of the server.
        if not is_text(source):
            raise InvalidArgumentError(f"the {what} is not PDDL text; it begins with '(define'")
        read = kb.load_domain if what == "domain" else kb.load_problem
        warnings += map(str, read(source, mode=mode).warnings)
    if domain is None and problem is None:
        raise InvalidArgumentError("there is nothing to load; give a domain, a problem, or both")
    return [], warnings

"""The DAO family of `http://` and `https://`: the DAOs of a server, `kant-sql serve`.

A write is repeated under one `Idempotency-Key` until there is an answer, so it is written once.
"""

from __future__ import annotations

import http.client
import inspect
import json
import os
import secrets
import time
from abc import update_abstractmethods
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from copy import copy
from decimal import Decimal
from functools import wraps
from itertools import islice
from threading import TIMEOUT_MAX
from typing import Any, NamedTuple, Self, cast
from urllib.parse import SplitResult, parse_qsl, quote, unquote, urlencode, urlsplit

from typing_extensions import override

from kant_sql import dao_calls, errors
from kant_sql.arguments import is_many, iterate, shown
from kant_sql.dao.base import past_error
from kant_sql.errors import InvalidArgumentError, InvalidUrlError, KantSqlError, StoreError
from kant_sql.factory import DaoFactory, daos_only
from kant_sql.knowledge.canonical import Metadata, make_metadata, read_source
from kant_sql.knowledge.sayings import COMMITTED
from kant_sql.knowledge_base import KnowledgeBase, PddlParts
from kant_sql.moment_text import When, read_when
from kant_sql.plans import PlanDao
from kant_sql.store.ownership import Block, block_ahead, own_block

TIMEOUT = 60.0
# Seconds before each repetition of an unanswered request.
PAUSES = (0.0, 0.1, 0.5, 2.0)
_URL = "https://:TOKEN@HOST:PORT/KNOWLEDGE_BASE"
_OPTIONS = ("timeout", "insecure")
# Methods that take any iterable.
_BULK = {"save_all", "delete_all", "confirm"}


class _Place(NamedTuple):
    """The server of a URL, with all options of the URL."""

    is_secure: bool
    host: str
    port: int | None
    folder: str
    name: str
    token: str | None
    timeout: float

    @property
    def address(self) -> str:
        """The URL without the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        port = "" if self.port is None else f":{self.port}"
        return f"http{'s' * self.is_secure}://{host}{port}{self.folder}"


def _place_of(url: str, knowledge_base: str) -> _Place:
    # Messages must not contain the part of the URL with the token.
    parts = urlsplit(url)
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    if not options.keys() <= {*_OPTIONS} or parts.fragment:
        raise InvalidUrlError(f"a URL of a server has the options {' and '.join(_OPTIONS)} only")
    host, port = _server_of(parts)
    timeout = options.get("timeout", str(TIMEOUT))
    if not timeout.replace(".", "", 1).isdecimal() or not 0 < float(timeout) <= TIMEOUT_MAX:
        raise InvalidUrlError(
            f"timeout is a number of seconds, more than 0, {TIMEOUT_MAX:.0f} at most"
        )
    folder, _, last = parts.path.rpartition("/")
    name = unquote(last) or knowledge_base
    if knowledge_base not in ("default", name):
        raise InvalidUrlError(
            f"the URL names the knowledge base {shown(name)}, and knowledge_base is "
            f"{shown(knowledge_base)}; leave one of them out"
        )
    own = os.environ.get(dao_calls.TOKEN_VARIABLE)
    given = own if parts.password is None else unquote(parts.password)
    token, is_secure = given or None, parts.scheme.lower() == "https"
    if token is not None and not (token.isascii() and token.isprintable()):
        raise InvalidUrlError("the token has characters that HTTP headers cannot carry")
    insecure = options.get("insecure") == "1"
    if token is not None and not (is_secure or insecure or dao_calls.is_loopback(host)):
        raise InvalidUrlError(
            f"http://{host} would carry the token in the clear; use https://, or add ?insecure=1 on"
            " a network that you trust"
        )
    return _Place(is_secure, host, port, folder, name, token, float(timeout))


def _server_of(parts: SplitResult) -> tuple[str, int | None]:
    """Read the host and the port, in the form for sockets and headers."""
    host = parts.hostname or ""
    with suppress(ValueError):
        # A port may not be a number, and a part of a name may be too long.
        if host.encode("idna") and host.isprintable() and " " not in host and not parts.username:
            return host, parts.port
    raise InvalidUrlError(f"this is not the URL of a server; write {_URL}")


class _BrokenError(Exception):
    """There was no complete answer; `is_sent` says whether the request may have arrived."""

    def __init__(self, error: Exception, is_sent: bool) -> None:
        super().__init__(str(error) or type(error).__name__)
        self.is_sent = is_sent


class _Link:
    """Sends requests over connections that threads use in turn."""

    def __init__(self, place: _Place) -> None:
        self.place = place
        self.is_closed = False
        self._idle: list[http.client.HTTPConnection] = []
        self._process = os.getpid()

    def close(self) -> None:
        self.is_closed = True
        self._drop()

    def _drop(self) -> None:
        while (connection := self._taken()) is not None:
            connection.close()

    def _taken(self) -> http.client.HTTPConnection | None:
        if self._process != os.getpid():
            # A child would read the answers of its parent.
            self._process, self._idle = os.getpid(), []
        with suppress(IndexError):
            return self._idle.pop()
        return None

    def get(self, **query: str) -> Any:
        """Send a request that reads."""
        target = f"{dao_calls.DAO_PATH}?{urlencode({'kb': self.place.name, **query})}"
        # The headers need a part of the maximum.
        if len(target) > (most := dao_calls.LONGEST_HEAD - 2_000):
            raise InvalidArgumentError(
                f"the call has {len(target):,} bytes as an address, more than {most:,}; "
                "ask in several"
            )
        return self._repeat("GET", target, None, {})

    def post(self, call: dict[str, object], path: str = dao_calls.DAO_PATH) -> Any:
        """Send a write, which the server writes once."""
        body = json.dumps(call).encode()
        if len(body) > dao_calls.LONGEST_BODY:
            raise InvalidArgumentError(
                f"the call has {len(body):,} bytes as JSON, more than {dao_calls.LONGEST_BODY:,}; "
                "write it in several"
            )
        headers = {"Content-Type": "application/json", "Idempotency-Key": secrets.token_hex(16)}
        target = f"{path}?{urlencode({'kb': self.place.name})}"
        return self._repeat("POST", target, body, headers)

    def _repeat(self, method: str, target: str, body: bytes | None, headers: dict[str, str]) -> Any:
        target, is_sent = f"{quote(self.place.folder)}{target}", False
        if self.place.token is not None:
            headers = {**headers, "Authorization": f"Bearer {self.place.token}"}
        for pause in (*PAUSES, None):
            if self.is_closed:
                raise errors.ClosedError("this knowledge base was closed; connect again")
            try:
                status, text = self._send(method, target, body, headers)
                return self._understood(status, text, body is not None)
            except _BrokenError as error:
                # The other connections are as old.
                self._drop()
                broken, is_sent = error, is_sent or error.is_sent
            if pause is None or isinstance(broken.__cause__, TimeoutError):
                break
            time.sleep(pause)
        address = self.place.address
        if not is_sent:
            raise errors.StoreUnreachableError(
                f"{address}: no connection ({broken}); nothing was written"
            )
        if body is None:
            raise errors.ConnectionLostError(f"{address}: no answer ({broken}); try again")
        raise errors.OutcomeUnknownError(
            f"{address}: no answer to a write ({broken}): whether it was written is not known; "
            "read the state before you write it again"
        )

    def _send(
        self, method: str, target: str, body: bytes | None, headers: dict[str, str]
    ) -> tuple[int, bytes]:
        is_sent = False
        connection = self._taken() or self._open()
        try:
            if connection.sock is None:
                connection.connect()
            is_sent = True
            connection.request(method, target, body, headers)
            with connection.getresponse() as answer:
                if answer.length is None and not answer.chunked:
                    # An answer that is cut within its head may seem complete and empty.
                    raise http.client.HTTPException("the answer has no length")
                text = answer.read()
        except BaseException as error:
            connection.close()
            if not isinstance(error, OSError | http.client.HTTPException):
                raise
            raise _BrokenError(error, is_sent) from error
        self._idle.append(connection)
        if self.is_closed:
            self._drop()
        return answer.status, text

    def _open(self) -> http.client.HTTPConnection:
        place = self.place
        kind = http.client.HTTPSConnection if place.is_secure else http.client.HTTPConnection
        return kind(place.host, place.port, timeout=place.timeout)

    def _understood(self, status: int, text: bytes, writes: bool) -> Any:
        """Read an answer, or raise its error."""
        try:
            found = json.loads(text)
        except (ValueError, RecursionError):
            found = None
        if status == 200 and isinstance(found, dict):
            return found
        address = self.place.address
        said, kind = (found.get("error"), found.get("type")) if isinstance(found, dict) else (0, 0)
        if not isinstance(said, str):
            said = shown(errors.printable(text[:200].decode("utf-8", "replace")), 200)
        if status in (401, 403) and kind in (0, "RefusedError"):
            raise errors.AuthenticationError(f"{address}: {said}")
        if kind == "RefusedError":
            raise StoreError(f"{address}: {said}")
        if status in (429, 503) and kind in (0, "HTTPException"):
            raise errors.StoreBusyError(f"{address}: {said}")
        made = getattr(errors, kind, None) if isinstance(kind, str) else None
        if isinstance(made, type) and issubclass(made, KantSqlError):
            raise _error(made, said, found.get("details"))
        if writes and status in (404, 405):
            raise errors.ReadOnlyStoreError(
                f"{address} takes no writes; start it with: kant-sql serve --write"
            )
        raise StoreError(
            f"{address} answers {status}, as no server of this version of kant_sql does: {said}"
        )


def _error(made: type[KantSqlError], message: str, details: object) -> KantSqlError:
    error = made.__new__(made, message)
    error.args = (message,)
    for name, value in details.items() if isinstance(details, dict) else ():
        if not name.startswith("_"):
            error.__dict__[name] = tuple(value) if isinstance(value, list) else value
    return error


class _Transaction:
    """A transaction that the server has open for a block of this thread."""

    def __init__(self, link: _Link, metadata: Metadata) -> None:
        self.name, self.metadata, self.revision = link.place.name, metadata, 0
        self._link = link
        self._id, self._number = secrets.token_hex(16), 0
        self._process = os.getpid()
        # Until a request is answered, its effect is unknown.
        self._is_broken = False

    def ask(self, step: str, **said: object) -> Any:
        """Send the next step."""
        # A child that was forked within the block leaves it to its parent.
        if (self._is_broken and step != "rollback") or self._process != os.getpid():
            raise self._lost()
        self._number += 1
        self._is_broken = True
        own = {"transaction": self._id, "number": self._number, "step": step, **said}
        try:
            answer = self._link.post(own, dao_calls.TRANSACTION_PATH)
        except errors.OutcomeUnknownError as error:
            if step == "commit":
                raise
            raise self._lost() from error
        except KantSqlError as error:
            self._is_broken = isinstance(error, errors.StoreUnreachableError)
            raise
        self._is_broken = False
        return answer

    def _lost(self) -> errors.ConnectionLostError:
        return errors.ConnectionLostError(
            f"{self._link.place.address}: a call of this transaction had no answer; nothing of it "
            "is written, begin it again"
        )


class _HttpDao:
    """A DAO of a server."""

    def __init__(self, factory: HttpDaoFactory) -> None:
        self._factory = factory


def _json(value: object) -> str:
    return json.dumps(dao_calls.document(value))


def _described(at: list[dict[str, Any]]) -> str:
    """Describe the past state of the last of some moments."""
    valid = next((one["valid"] for one in reversed(at) if "valid" in one), None)
    said = "" if valid is None else f", as it was true at {valid.isoformat()}"
    return f"revision {at[-1]['known']}{said}"


class HttpDaoFactory(DaoFactory):
    """The family over HTTP: the DAOs of a server, with a token."""

    @override
    def __init__(
        self,
        url: str,
        *,
        knowledge_base: str = "default",
        actor: str | None = None,
        read_only: bool = False,
        clock: str = COMMITTED,
    ) -> None:
        make_metadata(actor, None, None)
        if clock != COMMITTED:
            raise daos_only(self, "clocks")
        self._is_read_only = read_only
        # The arguments of each `at` that led to this past state.
        self._at: list[dict[str, Any]] = []
        self._link = _Link(_place_of(url, knowledge_base))
        self.name, self.address = self._link.place.name, self._link.place.address
        self.queue = self.address, self.name
        try:
            self._actor = self._link.get().get("actor")
            self._refuse_other(actor)
        except BaseException:
            self._link.close()
            raise

    def _refuse_other(self, actor: str | None) -> None:
        if actor is not None and self._actor is not None and actor != self._actor:
            raise InvalidArgumentError(
                f"the token writes as {shown(self._actor)}, not as {shown(actor)}; leave out "
                "actor, or get a token of this actor by 'kant-sql tokens add'"
            )

    @property
    @override
    def label(self) -> str:  # type: ignore[override]
        past = f" at {_described(self._at)}" if self._at else ""
        return f"{self.name!r} of {self.address}{past}{', closed' * self._link.is_closed}"

    @property
    @override
    def revision(self) -> int:
        if self._at:
            return int(self._at[-1]["known"])
        opened = self._opened()
        return int(self._link.get()["revision"]) if opened is None else opened.revision

    @override
    def close(self) -> None:
        if self._at:
            return
        opened = self._opened()
        if opened is not None:
            # Otherwise the server keeps it open, and other writers wait.
            with suppress(KantSqlError):
                opened.ask("rollback")
        self._link.close()

    @override
    def at(
        self, when: When | None = None, *, known: When | None = None, valid: When | None = None
    ) -> Self:
        given: dict[str, When | None] = {"when": when, "known": known, "valid": read_when(valid)}
        moments = {name: one for name, one in given.items() if one is not None}
        found = self._link.get(at=_json([*self._at, moments]))
        past = copy(self)
        # A relative text means this moment.
        of_valid = {name: one for name, one in moments.items() if name == "valid"}
        past._at = [*self._at, {"known": found["revision"], **of_valid}]
        return past

    @override
    @contextmanager
    def transaction(
        self, *, actor: str | None = None, source: object | None = None, **said: Any
    ) -> Iterator[None]:
        self._refuse_to_write()
        metadata = make_metadata(self._actor if actor is None else actor, None, source)
        self._refuse_other(actor)
        if said.get("execution") is not None:
            raise daos_only(self, "executions")
        outer = self._opened()
        if outer is None:
            self._wait_for_none()
        opened = outer or _Transaction(self._link, metadata)
        own = {"arguments": dao_calls.document(said), "source": read_source(metadata.source)}
        begun = opened.ask("begin", **own)
        block = None
        if outer is None:
            opened.revision = begun["revision"]
            block = Block(self, self.queue, cast(Any, opened))
        try:
            yield
        except BaseException:
            with suppress(KantSqlError):
                opened.ask("rollback")
            raise
        else:
            opened.ask("commit")
        finally:
            if block is not None:
                block.close()

    def _opened(self) -> _Transaction | None:
        """Find the open transaction of this thread, task and context."""
        block = own_block(self)
        return None if block is None else cast(_Transaction, block.transaction)

    def _wait_for_none(self) -> None:
        """Refuse to wait on the server for a block that this thread must end."""
        ahead = block_ahead(self.queue)
        if ahead is not None:
            raise ahead.refuse("to write")

    def _refuse_to_write(self) -> None:
        if self._at:
            raise past_error(self.name, _described(self._at))
        if self._is_read_only:
            raise errors.ReadOnlyError(
                f"{self.label} was opened for reading only; connect without it"
            )

    def call(self, kind: str, do: str, arguments: dict[str, Any]) -> Any:
        """Call a method of a DAO of the server."""
        reads = dao_calls.is_read(do)
        if not reads:
            self._refuse_to_write()
        if do in _BULK:
            arguments = {name: _listed(value, do) for name, value in arguments.items()}
        opened = self._opened()
        given = dao_calls.document(arguments)
        if opened is not None:
            answer = opened.ask("call", kind=kind, do=do, arguments=given)
        elif reads:
            at = {"at": _json(self._at)} if self._at else {}
            answer = self._link.get(kind=kind, do=do, arguments=json.dumps(given), **at)
        else:
            self._wait_for_none()
            answer = self._link.post({"kind": kind, "do": do, "arguments": given})
        if reads:
            try:
                return dao_calls.read(answer)
            except (InvalidArgumentError, errors.InvalidKnowledgeError) as error:
                raise self._unreadable() from error
        match answer.get("results"):
            case [bool() | int() as result]:
                return result
            case [str() as number]:
                return Decimal(number)
        raise self._unreadable()

    def _unreadable(self) -> StoreError:
        return StoreError(f"{self.address}: the answer is none of this version of kant_sql")

    @override
    def create_plan_dao(self) -> PlanDao:
        raise daos_only(self, "plans")


def _listed(value: Any, do: str) -> Any:
    """Make a list of any iterable, for one request to the server."""
    if is_many(value) or isinstance(value, str | bytes) or not isinstance(value, Iterable):
        return value
    given = [*islice(iterate(value, f"what {do} takes"), dao_calls.MOST_CHANGES + 1)]
    if len(given) > dao_calls.MOST_CHANGES:
        raise InvalidArgumentError(
            f"{do} takes up to {dao_calls.MOST_CHANGES:,} elements over HTTP; call it several times"
        )
    return given


def _forwarded(kind: str, interface: type, do: str) -> Callable[..., Any]:
    method = getattr(interface, do)
    signature = inspect.signature(method)

    @wraps(method)
    def forward(self: _HttpDao, *args: Any, **kwargs: Any) -> Any:
        given = signature.bind(self, *args, **kwargs).arguments
        return self._factory.call(kind, do, {name: given[name] for name in [*given][1:]})

    forward.__isabstractmethod__ = False  # type: ignore[attr-defined]
    return forward


def _creator(kind: str, interface: Any) -> Callable[[HttpDaoFactory], Any]:
    own = {do: _forwarded(kind, interface, do) for do in interface.__abstractmethods__}
    made = type(f"Http{interface.__name__}", (_HttpDao, interface), own)
    return lambda factory: made(factory)  # noqa: PLW0108  # a class would not be bound


for _kind, _interface in dao_calls.KINDS.items():
    _front: Any = KnowledgeBase if hasattr(KnowledgeBase, _kind) else PddlParts
    setattr(HttpDaoFactory, getattr(_front, _kind).func.__name__, _creator(_kind, _interface))
update_abstractmethods(HttpDaoFactory)  # type: ignore[type-abstract]

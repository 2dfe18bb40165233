"""Access: which readers, under which host names, and browser policies for the answers."""

from __future__ import annotations

import hmac
import ipaddress
import logging
import socket
from collections.abc import Iterable, Mapping
from urllib.parse import parse_qs, quote, unquote_to_bytes, urlencode, urlsplit

from fastapi.responses import JSONResponse, RedirectResponse, Response
from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.exceptions import HTTPException
from starlette.requests import Request, cookie_parser
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..arguments import shown
from ..dao_calls import LOOPBACK, is_loopback
from ..errors import printable
from ..html import visible
from .tokens import Token, TokenFile

logger = logging.getLogger("kant_sql.web")

TOKEN_COOKIE = "kant_sql_token"
LOGIN = "/token"
_LONGEST_FORM = 10_000
_WRONG = "the token is not the one of this server"
_NO_TOKEN = "give the token of this server: Authorization: Bearer TOKEN"
_UNKNOWN = "the token is unknown, or was revoked: get one by 'kant-sql tokens add'"
# No inline script or style, nothing from elsewhere, in no other page's frame.
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self'",
        "connect-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    )
)
_HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
# Pages change; a file whose address has its digest does not.
_NO_CACHE, _CACHE = "no-cache", "max-age=31536000, immutable"


def allowed_hosts(bound: str, others: Iterable[str] = ()) -> frozenset[str]:
    """Return the host names that a server bound to an address answers to."""
    # A page of somebody else can make its own name lead to this address ("DNS rebinding"), so names
    # are listed; nobody can redirect an address in digits.
    own = () if is_loopback(bound) else (bound, socket.gethostname(), socket.getfqdn())
    return frozenset(name.lower() for name in (*LOOPBACK, *own, *others))


class Programs:
    """Checks the tokens of programs: who may write, and what each may read."""

    def __init__(self, tokens: TokenFile, scopes: Mapping[str, str], longest: int) -> None:
        """Take the tokens, the scope for each path that writes, and the most bytes of a write."""
        self._tokens = tokens
        self._scopes = scopes
        self._longest = longest

    def admit(self, scope: Scope, headers: Headers) -> Response | None:
        """Set the token of a request as `scope["token"]`; return the answer if it is refused."""
        # Requests that only read without a token of the file are not judged here.
        writes = self._scopes.get(scope["path"]) if scope["method"] == "POST" else None
        given = _bearer(headers)
        token = None if given is None else self._tokens.find(given)
        if token is None:
            scope["refused_token"] = None if given is None else self._tokens.made(given)
            if writes is None:
                return None
            why = "a token is needed: Authorization: Bearer TOKEN, of 'kant-sql tokens add'"
            return refusal(scope, 401, why if given is None else _UNKNOWN)
        scope["token"] = token
        verifies = scope["path"].endswith("/verify") and scope["method"] == "POST"
        needed = writes or ("verify" if verifies else "read")
        if needed not in token.scopes:
            return refusal(scope, 403, f"the token has not the scope {needed}")
        return self._choose(scope, token) or self._bound(scope, headers, writes)

    def _choose(self, scope: Scope, token: Token) -> Response | None:
        """Check the knowledge base; for a token for only one, that is the default."""
        query = QueryParams(scope["query_string"])
        named = query.getlist("kb")
        for name in filter(None, (*named, *query.getlist("branch"))):
            if not token.is_for(name):
                return refusal(scope, 403, f"the token is not for the knowledge base {name!r}")
        # The last one counts, and an empty one counts as none.
        if not (any(named[-1:]) or token.is_for_all):
            if len(token.knowledge_bases) > 1:
                return refusal(scope, 403, "the token is for several knowledge bases: give kb=NAME")
            own = urlencode({"kb": token.knowledge_bases[0]}).encode()
            scope["query_string"] = b"&".join(filter(None, (scope["query_string"], own)))
        return None

    def _bound(self, scope: Scope, headers: Headers, writes: str | None) -> Response | None:
        length = headers.get("content-length", "0")
        if writes is None or (length.isdecimal() and int(length) <= self._longest):
            return None
        return refusal(scope, 413, self.too_long)

    @property
    def too_long(self) -> str:
        """The error for a request that is too long."""
        return f"the request has more than {self._longest:,} bytes; write it in several"

    def accepts(self, scope: Scope) -> bool:
        """Return whether the token of an admitted request still has its rights."""
        return "token" not in scope or self._tokens.has(scope["token"])

    def bounded(self, scope: Scope, receive: Receive) -> Receive:
        """Limit a body that comes in parts, without its length."""
        if "token" not in scope:
            return receive
        left = self._longest

        async def receive_bounded() -> Message:
            nonlocal left
            message = await receive()
            left -= len(message.get("body", b""))
            if left < 0:
                raise refused(scope, 413, self.too_long)
            # A client may take its time to send the body.
            if message["type"] == "http.request" and not self.accepts(scope):
                raise refused(scope, 401, _UNKNOWN)
            return message

        return receive_bounded


def _bearer(headers: Headers) -> str | None:
    scheme, _, given = headers.get("authorization", "").partition(" ")
    return given.strip() if scheme.lower() == "bearer" else None


def _given(headers: Headers) -> str:
    """Return the token of a request's header, or else of its cookie."""
    given = _bearer(headers)
    # `SimpleCookie` raises for names that other servers of this machine may have set.
    return (
        cookie_parser(headers.get("cookie", "")).get(TOKEN_COOKIE, "") if given is None else given
    )


def log_refusal(scope: Scope, status: int, why: str) -> None:
    """Log a refused request and the reason; never the token."""
    token: Token | None = scope.get("token") or scope.get("refused_token")
    who = "nobody" if token is None else f"token {token.id} of {token.actor}"
    client = (scope.get("client") or ("unknown",))[0]
    said = [printable(one) for one in (scope["path"], who, client, why)]
    logger.warning("refused %s %s to %s at %s: %d, %s", scope["method"], *said[:3], status, said[3])


def refused(scope: Scope, status: int, why: str) -> HTTPException:
    """Log a refusal and return its error, if no answer can be returned."""
    log_refusal(scope, status, why)
    return HTTPException(status, why)


def refusal(scope: Scope, status: int, why: str) -> Response:
    """Log a refusal and return its answer, in the form of the JSON API's errors."""
    log_refusal(scope, status, why)
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    document = {"error": visible(why), "type": "RefusedError"}
    return JSONResponse(document, status, headers)


def require_all(request: Request) -> None:
    """Refuse requests about the whole store if the token is for some knowledge bases only."""
    token: Token | None = request.scope.get("token")
    if token is not None and not token.is_for_all:
        why = f"the token is for {', '.join(token.knowledge_bases)} only, and this is about all"
        raise refused(request.scope, 403, why)


class Guard:
    """Refuses requests under a foreign name, from another site, or without the token."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        bound: str,
        hosts: frozenset[str],
        token: str | None,
        programs: Programs | None = None,
    ) -> None:
        self._app = app
        self._programs = programs
        self._hosts = hosts
        self._is_loopback = is_loopback(bound)
        self._token = None if token is None else token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                is_file = scope["path"].startswith("/static/") and message["status"] == 200
                headers = MutableHeaders(scope=message)
                cache = {"Cache-Control": _CACHE if is_file else _NO_CACHE}
                for name, value in (_HEADERS | cache).items():
                    headers.setdefault(name, value)
            await send(message)

        response = await self._refuse(scope, receive)
        if self._programs is not None:
            receive = self._programs.bounded(scope, receive)
        await (self._app if response is None else response)(scope, receive, send_guarded)

    async def _refuse(self, scope: Scope, receive: Receive) -> Response | None:
        """Return the answer to a request that must not reach the application."""
        headers = Headers(scope=scope)
        name = _host_name(headers.get("host", ""))
        if not self._is_known(name):
            return refusal(
                scope,
                400,
                f"this server is not known as {shown(name)}; start it with --allow-host NAME",
            )
        if not (_is_read(scope, headers) or _is_same_site(headers)):
            return refusal(scope, 403, "the request comes from another site")
        if not _is_text(scope["query_string"]):
            return refusal(scope, 400, "the query is not UTF-8, percent-encoded")
        if self._programs is not None:
            refused = self._programs.admit(scope, headers)
            if refused is not None or "token" in scope:
                return refused
        if self._token is None:
            is_unknown = self._programs is not None and _bearer(headers) is not None
            return refusal(scope, 401, _UNKNOWN) if is_unknown else None
        if scope["path"] == LOGIN and scope["method"] == "POST":
            return await self._log_in(Request(scope, receive))
        given = _given(headers)
        if self._is_token(given) or scope["path"].startswith("/static/"):
            return None
        return self._ask_for_token(scope, _WRONG if given else _NO_TOKEN)

    def _is_known(self, name: str) -> bool:
        if name in self._hosts:
            return True
        return is_loopback(name) if self._is_loopback else _is_address(name)

    def _is_token(self, given: str) -> bool:
        return self._token is not None and hmac.compare_digest(given.encode(), self._token)

    async def _log_in(self, request: Request) -> Response:
        """Give the token as a cookie to somebody who knows it."""
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > _LONGEST_FORM:
                return refusal(request.scope, 413, "the form is too long")
        form = parse_qs(body.decode("utf-8", "replace"), keep_blank_values=True)
        given, target = form.get("token", [""])[0], form.get("next", ["/"])[0]
        if not self._is_token(given):
            log_refusal(request.scope, 401, _WRONG)
            return _token_page(target, wrong=True)
        # Only an address of this server: `//other` and `/\other` would lead to another one.
        is_own = target.startswith("/") and target[1:2] not in ("/", "\\")
        response = RedirectResponse(target if is_own else "/", 303)
        response.set_cookie(TOKEN_COOKIE, given, httponly=True, samesite="lax", path="/")
        return response

    def _ask_for_token(self, scope: Scope, why: str) -> Response:
        is_stream = "text/event-stream" in Headers(scope=scope).get("accept", "")
        if scope["path"].startswith("/api/") or scope["path"] == "/live" or is_stream:
            return refusal(scope, 401, why)
        log_refusal(scope, 401, why)
        query = scope["query_string"].decode("latin-1")
        return _token_page(scope["path"] + (f"?{query}" if query else ""))


def _token_page(target: str, wrong: bool = False) -> Response:
    from .rendering import render_text

    page = render_text("token.html", {"target": target, "wrong": wrong, "action": LOGIN})
    return Response(page, 401, media_type="text/html")


def _host_name(host: str) -> str:
    """Return the name in a `Host` header, without the port."""
    try:
        parts = urlsplit(f"//{quote(host, safe=':[]%.-_')}")
        # Text that is not a port would become a part of the address that the application sees.
        return (parts.hostname or "") if parts.port != 0 else ""
    except ValueError:
        return ""


def _is_text(query: bytes) -> bool:
    # Invalid UTF-8 would be read as another text: each wrong byte as U+FFFD.
    try:
        unquote_to_bytes(query).decode()
    except UnicodeDecodeError:
        return False
    return True


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_read(scope: Scope, headers: Headers) -> bool:
    """Return whether a request only reads, and is not one that a foreign page may hide."""
    # A page of somebody else may link here, but may not ask slow questions as its images.
    if scope["method"] not in ("GET", "HEAD"):
        return False
    return headers.get("sec-fetch-dest", "document") == "document"


def _is_same_site(headers: Headers) -> bool:
    """Return whether a request comes from a page of this server."""
    # Browsers send the origin; other programs do not, and no page can make them ask.
    origin = headers.get("origin")
    if origin is not None:
        return origin.partition("://")[2].lower() == headers.get("host", "").lower()
    return headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none")

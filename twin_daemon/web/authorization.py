"""Who may do what on the page: reading is free on this machine, everything else needs a token.

From elsewhere reading needs one, too: that to work, or a second one that only looks. A browser cannot put a header on
the page's own address or on its stream, so the token is given once, to ENTER, for a cookie that reads and nothing else.

A page of another site must neither read nor change anything through the browser of somebody who has this page open.
So a request has to name this server (DNS rebinding) and, where a browser says who asks, come from this page; and what
changes something carries the token in a header, which no foreign page can set.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

ENTER = "/api/enter"
TOKEN_HEADER = "X-Twin-Token"
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_READING = ("GET", "HEAD")
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def new_token() -> str:
    """256 random bits, safe in a URL."""
    return secrets.token_urlsafe(32)


def looking_token(token: str) -> str:
    """The token that only looks, beside the one to work: who has this one has both."""
    return hmac.new(token.encode(), b"look", hashlib.sha256).hexdigest()


def looking_cookie(token: str) -> str:
    """Name of the cookie of one workbench: a browser gives those of all ports of a machine to each of them."""
    return f"twin-{hmac.new(token.encode(), b'cookie', hashlib.sha256).hexdigest()[:16]}"


class Authorization:
    """The gate before the application (ASGI). `hosts` are the names under which this server may be asked.

    `free` are paths that anybody may post to: stopping a hand must not fail for want of a token. `local` says that only
    this machine reaches the server: what is asked by a name of loopback is then free to read. Beginnings of paths in
    `public` have nothing of the hand, and are free to read for everybody; `entrance` is what somebody without a token
    sees in place of the page.
    """

    def __init__(
        self,
        app: ASGIApp,
        token: str,
        hosts: Iterable[str],
        free: Iterable[str] = (),
        *,
        local: bool = True,
        public: Iterable[str] = (),
        entrance: str = "",
    ) -> None:
        self._app = app
        self._token = token.encode()
        self._looks = looking_token(token).encode()
        self._cookie = looking_cookie(token)
        self._local = local
        self._public = tuple(public)
        self._entrance = entrance
        self._hosts = frozenset(host.lower() for host in hosts)
        self._free = frozenset(free)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refusal = self._refusal(scope, headers)
        if refusal is None:
            await self._app(scope, receive, _with_policy(send, headers.get("host", "")))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": refusal[1][:120]})
        else:
            status, why = refusal
            answer: Response = JSONResponse({"error": why}, status)
            if status == 401 and scope["path"] == "/" and scope["method"] in _READING:
                answer = HTMLResponse(self._entrance, status)
            await answer(scope, receive, _with_policy(send, headers.get("host", "") if status == 401 else ""))

    def _refusal(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        """(status, why), or None where the request may pass."""
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or _name(hosts[0]) not in self._hosts:
            allowed = ", ".join(sorted(self._hosts))
            return 403, f"this server is not called that. Allowed: {allowed}. Start it with --name to add another"
        if origins and origins != [f"http://{hosts[0]}"]:
            return 403, "the request comes from another page. Open the address that 'twin workbench' printed"
        if headers.get("sec-fetch-site") == "cross-site" and headers.get("sec-fetch-mode") != "navigate":
            return 403, "the request comes from another site"
        reads = scope["type"] == "websocket" or scope["method"] in _READING
        if scope["path"] in self._free or (reads and self._may_read(scope, headers, _name(hosts[0]))):
            return None
        given = headers.getlist(TOKEN_HEADER)
        enough = (self._token, self._looks) if reads or scope["path"] == ENTER else (self._token,)
        if len(given) == 1 and any(hmac.compare_digest(given[0].encode(), token) for token in enough):
            return None
        return 401, "this needs a token: open the page with the whole address that 'twin workbench' printed"

    def _may_read(self, scope: Scope, headers: Headers, host: str) -> bool:
        """Whether somebody without a token may read this: on this machine, with the cookie, or what says nothing."""
        if (self._local and host in LOOPBACK) or scope["path"].startswith(self._public or ("\0",)):
            return True
        given = HTTPConnection(scope).cookies.get(self._cookie, "")
        return hmac.compare_digest(given.encode(errors="replace"), self._looks)


def _name(host: str) -> str:
    """The host without its port; an IPv6 address keeps its brackets."""
    name, colon, port = host.rpartition(":")
    return (name if colon and port.isdigit() else host).lower()


def _with_policy(send: Send, host: str) -> Send:
    """Adds to each answer what a browser may do with it."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["Content-Security-Policy"] = _POLICY.format(host=host)
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Referrer-Policy"] = "no-referrer"
            headers["Cross-Origin-Resource-Policy"] = "same-origin"
            headers["Cross-Origin-Opener-Policy"] = "same-origin"
            headers.setdefault("Cache-Control", "no-store")
        await send(message)

    return sending

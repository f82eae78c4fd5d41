"""Who may do what on the page: reading is free on this machine, everything else needs the token.

A page of another site must neither read nor change anything through the browser of somebody who has this page open.
So a request has to name this server (DNS rebinding) and, where a browser says who asks, come from this page; and what
changes something carries the token in a header, which no foreign page can set.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN_HEADER = "X-Twin-Token"
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_READING = ("GET", "HEAD")
_POLICY = (
    # Plotly writes its own style rules; it runs nothing that is not in its file.
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def new_token() -> str:
    """256 random bits, safe in a URL."""
    return secrets.token_urlsafe(32)


class Allowance:
    """The gate before the application (ASGI). `hosts` are the names under which this server may be asked.

    `free` are paths that anybody may post to: stopping a hand must not fail for want of a token.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: Iterable[str], free: Iterable[str] = ()) -> None:
        self._app = app
        self._token = token.encode()
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
            await JSONResponse({"error": why}, status)(scope, receive, _with_policy(send, ""))

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
        if scope["type"] == "websocket" or scope["method"] in _READING or scope["path"] in self._free:
            return None
        given = headers.getlist(TOKEN_HEADER)
        if len(given) == 1 and hmac.compare_digest(given[0].encode(), self._token):
            return None
        return 401, "this needs an allowance: open the page with the whole address that 'twin workbench' printed"


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

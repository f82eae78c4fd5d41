"""The server: the page, its files, the live stream, and what the page can ask for."""

from __future__ import annotations

import contextlib
import json
import logging
from collections.abc import AsyncIterator, Callable, Iterable
from pathlib import Path
from typing import Any

import jinja2
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles

from twin_daemon.errors import BadInput, NoAnswer, Refused, TwinError, UsageError
from twin_daemon.hand import Hand
from twin_daemon.jsonable import plain
from twin_daemon.report.chart import in_script
from twin_daemon.services.stop_report import OWN_STOP
from twin_daemon.web.authorization import ENTER, Authorization, looking_cookie, looking_token
from twin_daemon.web.hands import Hands, View
from twin_daemon.web.stream import stream_of

log = logging.getLogger(__name__)

_HERE = Path(__file__).parent
_MOST_BYTES = 64 * 1024
_STATUS: dict[type[TwinError], int] = {UsageError: 400, BadInput: 400, Refused: 409, NoAnswer: 503}
_STOP = "/api/stop"
_CANCEL = "/api/cancel"

Answer = Callable[[dict[str, Any]], Any]
Ending = Callable[[], None]


def build(
    hand: Hand,
    hands: Hands,
    token: str,
    hosts: Iterable[str],
    more: Iterable[BaseRoute] = (),
    at_end: Iterable[Ending] = (),
    *,
    local: bool = True,
) -> Starlette:
    """The application. `more` are further routes, `at_end` is called when the server stops. Where others than this
    machine reach it (not `local`), reading needs a token as well."""

    @contextlib.asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        hands.start()
        try:
            yield
        finally:
            for end in (*at_end, hands.close):
                await run_in_threadpool(end)

    template = _template()

    async def index(request: Request) -> Response:
        try:
            view = await run_in_threadpool(hands.view, request.query_params.get("hand"))
        except (BadInput, NoAnswer):  # it may come yet, and the page lists those that are there
            if not request.query_params:
                raise
            return RedirectResponse("/", 303)
        return HTMLResponse(_page(template, hand, view, hands.fleet))

    async def enter(_request: Request) -> Response:
        answer = Response(status_code=204)
        answer.set_cookie(looking_cookie(token), looking_token(token), httponly=True, samesite="strict")
        return answer

    def stop(body: dict[str, Any]) -> dict[str, Any]:
        try:
            live = hands.addressed(body.get("hand"))
        except TwinError as error:
            raise NoAnswer(f"NOT stopped: {error.line()}", todo=OWN_STOP) from None
        return live.stop_hand(_reason(body, "from the workbench"))

    def release(body: dict[str, Any]) -> dict[str, Any]:
        name, key = (str(body.get(part) or "") for part in ("name", "key"))
        return hands.addressed(body.get("hand")).release_hand(_reason(body, ""), name, key)

    routes: list[BaseRoute] = [
        Route("/", index),
        Route(ENTER, enter, methods=["POST"]),
        WebSocketRoute("/live", stream_of(hands)),
        posting("/api/keep", lambda body: hands.addressed(body.get("hand")).keep()),
        posting(_STOP, stop),
        posting(_CANCEL, lambda body: hands.addressed(body.get("hand")).cancel(_reason(body, "from the workbench"))),
        posting("/api/release", release),
        *more,
        Mount("/static", StaticFiles(directory=_HERE / "static")),
    ]
    return Starlette(
        routes=routes,
        lifespan=lifespan,
        middleware=[
            Middleware(
                Authorization,
                token=token,
                hosts=tuple(hosts),
                free=(_STOP, _CANCEL),
                local=local,
                public=("/static/",),
                entrance=(_HERE / "templates" / "entrance.html").read_text(encoding="utf-8"),
            )
        ],
        exception_handlers={TwinError: _said, HTTPException: _said, Exception: _said},
    )


def posting(path: str, answer: Answer) -> Route:
    """A route that changes something: it gets the JSON object of the request, and works beside the server's loop."""

    async def end_point(request: Request) -> Response:
        body = await _body(request)
        return JSONResponse(plain(await run_in_threadpool(answer, body)))

    return Route(path, end_point, methods=["POST"])


def reading(path: str, answer: Callable[[Request], Any]) -> Route:
    """A route that only looks. What `answer` returns is sent as JSON, a Response as it is."""

    async def end_point(request: Request) -> Response:
        found = await run_in_threadpool(answer, request)
        return found if isinstance(found, Response) else JSONResponse(plain(found))

    return Route(path, end_point, methods=["GET"])


def _reason(body: dict[str, Any], default: str) -> str:
    return str(body.get("reason", default))[:400]


async def _body(request: Request) -> dict[str, Any]:
    content = b""
    async for part in request.stream():
        content += part
        if len(content) > _MOST_BYTES:
            raise BadInput(f"the request is larger than {_MOST_BYTES} bytes")
    try:
        value = json.loads(content or b"{}")
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, dict):
        raise BadInput("the request is no JSON object")
    return value


def _said(_request: Request, error: Exception) -> Response:
    """Every failure as one line that the page shows."""
    if isinstance(error, TwinError):
        status = next((code for kind, code in _STATUS.items() if isinstance(error, kind)), 500)
        return JSONResponse({"error": error.line()}, status)
    if isinstance(error, HTTPException):
        return JSONResponse({"error": f"{error.detail}."}, error.status_code)
    log.error("a request failed: %r", error)
    what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    return JSONResponse({"error": f"A bug in twin_daemon stopped this request ({what})."}, 500)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE / "templates"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template("workbench.html.j2")


def _page(template: jinja2.Template, hand: Hand, view: View, fleet: bool) -> str:
    """`hand` is the workbench's own, whose recordings and versions are here."""
    description = view.description
    facts = {
        "joints": list(description.joints),
        "hand": description.name,
        "kept_of": hand.name,
        "driver_stop": description.stop is not None,
        "scene": view.scene is not None,
        "namespace": description.namespace,
        "fleet": fleet,
        "own": view.own,
    }
    return template.render(namespace=description.namespace, facts=in_script(plain(facts)))

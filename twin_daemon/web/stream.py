"""The live stream of one browser: what is new, some thirty times a second."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket, WebSocketDisconnect

from twin_daemon.errors import TwinError
from twin_daemon.web.hands import Hands
from twin_daemon.web.numbers import listed
from twin_daemon.web.window import Piece

FRAMES_A_SECOND = 32  # motion looks smooth from thirty on
_ABOUT_EVERY = 16  # frames


def stream_of(hands: Hands) -> Callable[[WebSocket], Awaitable[None]]:
    """The end point of a websocket that sends frames until either side goes.

    A browser that reads slowly gets fewer frames, each with all that was new; nothing piles up here. With
    `?space=1` each frame has the poses of the bodies of measured and predicted hand as well, and with `&contacts=1`
    where they touch something. `?hand=` names which hand.
    """

    async def stream(socket: WebSocket) -> None:
        try:
            view = await run_in_threadpool(hands.view, socket.query_params.get("hand"))
        except TwinError as error:
            await socket.close(1008, error.line()[:120])
            return
        live = view.live
        await socket.accept()
        left = asyncio.ensure_future(_until_it_leaves(socket))
        loop = asyncio.get_running_loop()
        cursor, number, due_s = 0, 0, loop.time()
        space = view.scene if socket.query_params.get("space") == "1" else None
        touches = socket.query_params.get("contacts") == "1"
        try:
            while not left.done():
                piece = live.window.after(cursor)
                frame = _frame(piece)
                if space is not None and len(piece.time_s):
                    both = (space.poses(row[-1].astype(float)).ravel() for row in (piece.measured, piece.predicted))
                    frame["hands"] = [listed(points, 4) for points in both]
                    if touches:
                        rows = {"measured": piece.measured, "predicted": piece.predicted}
                        frame["contacts"] = {
                            name: listed(space.contacts(values[-1].astype(float)), 4) for name, values in rows.items()
                        }
                cursor = piece.cursor
                if number % _ABOUT_EVERY == 0:
                    frame |= {"about": live.about(), "rms": listed(live.window.rms_rad(), 6), "fleet": hands.listed()}
                number += 1
                await socket.send_text(json.dumps(frame, allow_nan=False, separators=(",", ":")))
                due_s = max(due_s + 1.0 / FRAMES_A_SECOND, loop.time())
                await asyncio.wait([left], timeout=due_s - loop.time())
        except (WebSocketDisconnect, RuntimeError):  # it left while something was sent
            pass
        finally:
            left.cancel()

    return stream


async def _until_it_leaves(socket: WebSocket) -> None:
    """Reads and forgets: the page says nothing on this channel."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass


def _frame(piece: Piece) -> dict[str, Any]:
    if not len(piece.time_s):
        return {"fresh": True} if piece.fresh and piece.cursor == 0 else {}
    return {
        "fresh": piece.fresh,
        "base_ns": str(piece.base_ns),  # more digits than a number of the page holds
        "t": np.round(piece.time_s, 4).tolist(),
        "measured": listed(piece.measured.T, 5),
        "predicted": listed(piece.predicted.T, 5),
    }

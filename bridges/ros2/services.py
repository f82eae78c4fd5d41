"""std_srvs/Trigger services that become commands to the daemon, and their answers."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from bridges.guard import Guard
from bridges.ros2.conversions import trigger_reply
from bridges.ros2.link import ZenohLink
from twin_daemon.hand import HandDescription

VERBS = ("recalibrate", "arm", "disarm", "stop")
ANSWER_S = 2.0


def offer_services(node: Node, link: ZenohLink, description: HandDescription, guard: Guard) -> None:
    """Offers twin/recalibrate, twin/arm, twin/disarm and twin/stop.

    A coroutine waits for the answer, so that joint states flow on meanwhile; for that the services need a callback
    group that lets other callbacks in.
    """
    group = ReentrantCallbackGroup()
    for verb in VERBS:
        serve = _service(link, description.key("command", verb=verb), guard, verb)
        node.create_service(Trigger, f"twin/{verb}", serve, callback_group=group)


def _service(link: ZenohLink, key: str, guard: Guard, verb: str) -> Any:
    async def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            answer = Future()
            link.ask(key, ANSWER_S, answer.set_result)
            response.success, response.message = trigger_reply(await answer, key, ANSWER_S)
        except Exception as error:
            guard.failed(f"the service {verb}", error)
            response.success, response.message = False, f"the bridge failed: {error!r:.200}"
        return response

    return serve

"""Goals of actions that the hand's controllers serve, such as FollowJointTrajectory: they move it past the gate.

A goal is a service call, which only its server hears. What becomes of it the server publishes, though, on the action's
status topic, reliably and for latecomers too: every action below a controller is watched there, from when its server is
seen. This bridge sends no goals, so that each is somebody else's.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import partial

from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.action.graph import get_action_client_names_and_types_by_node
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.qos import qos_profile_action_status_default
from rclpy.subscription import Subscription

from twin_daemon.services.guard import Guard

_PERIOD_S = 0.5
_STATUS = "/_action/status"
_STATUS_TYPE = "action_msgs/msg/GoalStatusArray"
_USUAL = "follow_joint_trajectory"
_ACTIVE = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)


class ActionGoals:
    """Calls `foreign` with words for who sent it when a controller has a new goal, and again while it has one.

    `topics` are the full names of the controllers' command topics; an action belongs to a controller where both have
    the same parent. Of a topic that stands in the node's own namespace only the usual name counts: what else is there
    need be no controller's.
    """

    def __init__(
        self, node: Node, topics: set[str], foreign: Callable[[str], None], guard: Guard, clock: Clock
    ) -> None:
        self._node = node
        own = node.get_namespace().rstrip("/")
        parents = {topic.rpartition("/")[0] for topic in topics}
        self._parents = parents - {own}
        self._named = {f"{own}/{_USUAL}"} if own in parents else set()
        self._foreign = foreign
        self._guard = guard
        self._heard: dict[str, Subscription] = {}
        self._active: dict[str, set[bytes]] = {}  # goals under way, by action
        node.create_timer(_PERIOD_S, guard.around("the goals of controllers", self._tend), clock=clock)

    def _tend(self) -> None:
        for topic, kinds in self._node.get_topic_names_and_types():
            action = topic.removesuffix(_STATUS)
            if action != topic and action not in self._heard and _STATUS_TYPE in kinds and self._is_watched(action):
                told = self._guard.around(f"the goals of {action}", partial(self._status, action))
                self._heard[action] = self._node.create_subscription(
                    GoalStatusArray, topic, told, qos_profile_action_status_default
                )
        for action, goals in self._active.items():
            if goals and not self._node.count_publishers(action + _STATUS):
                goals.clear()  # its server has gone, and says no more how they end
            if goals:
                self._foreign(self._by(action))

    def _is_watched(self, action: str) -> bool:
        return action in self._named or action.rpartition("/")[0] in self._parents

    def _status(self, action: str, message: GoalStatusArray) -> None:
        active = {bytes(one.goal_info.goal_id.uuid) for one in message.status_list if one.status in _ACTIVE}
        news = active - self._active.get(action, set())
        self._active[action] = active
        if news:
            self._foreign(self._by(action))

    def _by(self, action: str) -> str:
        """Who may have sent a goal, in words: a goal does not say who it is from. Its sender may have gone, or may have
        come so shortly before that the graph does not show it yet."""
        names = []
        for name, namespace in self._node.get_node_names_and_namespaces():
            with contextlib.suppress(RuntimeError):  # it has gone meanwhile
                if action in dict(get_action_client_names_and_types_by_node(self._node, name, namespace)):
                    names.append(f"{namespace.rstrip('/')}/{name}")
        who = {0: "a ROS 2 node that is not seen here", 1: "the ROS 2 node "}.get(len(names), "one of the ROS 2 nodes ")
        return f"a goal of {action} from {who}{', '.join(sorted(names))}"

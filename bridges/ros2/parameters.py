"""The node's parameters. What the command line says wins over --ros-args, which wins over the hand's description."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node

from bridges.session import choose_endpoint
from twin_daemon.errors import BadInput
from twin_daemon.hand import HandDescription, load_hand
from twin_daemon.hand.description import DEFAULT_HAND

PERIOD = "diagnostics_period_s"
_NAMESPACE_TODO = "Letters, digits, _ and -, with / between parts"


@dataclass(frozen=True)
class Parameters:
    """What the node works with; all but the period of the diagnostics are fixed while it runs."""

    description: HandDescription
    endpoint: str
    joint_states_topic: str
    joint_commands_topic: str
    trajectory_topic: str
    command_rate_hz: float
    diagnostics_period_s: float


def declare_parameters(node: Node) -> Parameters:
    """Declares every parameter with its description. Raises BadInput for a hand, namespace or endpoint of no use."""

    def fixed(name: str, default: Any, description: str) -> Any:
        return node.declare_parameter(name, default, ParameterDescriptor(description=description, read_only=True)).value

    hand = load_hand(fixed("hand", DEFAULT_HAND, "Hand description: a name in models/ or a YAML file.")).description
    namespace = fixed("namespace", hand.namespace, "First part of the twin's Zenoh keys.")
    rate = ParameterDescriptor(
        description="Targets per second while a trajectory is followed.",
        read_only=True,
        floating_point_range=[FloatingPointRange(from_value=1.0, to_value=1000.0)],
    )
    period = ParameterDescriptor(
        description="Seconds between two messages on /diagnostics.",
        floating_point_range=[FloatingPointRange(from_value=0.2, to_value=60.0)],
    )
    return Parameters(
        description=_renamed(hand, namespace),
        endpoint=choose_endpoint(fixed("endpoint", choose_endpoint(), "Zenoh endpoint of the twin.")),
        joint_states_topic=fixed("joint_states_topic", hand.topics.joint_states, "Measured joints, JointState."),
        joint_commands_topic=fixed("joint_commands_topic", hand.topics.joint_commands, "Position targets, JointState."),
        trajectory_topic=fixed("trajectory_topic", hand.topics.trajectory, "Position targets, JointTrajectory."),
        command_rate_hz=float(node.declare_parameter("command_rate_hz", hand.rate_hz, rate).value or hand.rate_hz),
        diagnostics_period_s=float(node.declare_parameter(PERIOD, 1.0, period).value or 1.0),
    )


def _renamed(description: HandDescription, namespace: str) -> HandDescription:
    raw = description.model_dump(by_alias=True) | {"namespace": namespace}
    try:
        return HandDescription.model_validate(raw)
    except ValidationError:
        raise BadInput(f"'{namespace}' is no namespace", where="--namespace", allowed=_NAMESPACE_TODO) from None

"""The node's parameters. What the command line says wins over --ros-args, which wins over the hand's description."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import ValidationError
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node

from bridges.zenoh.session import choose_endpoint
from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.settings import LONGEST_LEASE_S
from twin_daemon.hand import HandDescription, load_hand
from twin_daemon.hand.description import DEFAULT_HAND
from twin_daemon.hand.schema import CommandOutput
from twin_daemon.resources import state_dir
from twin_daemon.security.identity import keys_file, load_keyring
from twin_daemon.security.signer import Signer

PERIOD = "diagnostics_period_s"
ARM_REASON = "arm_reason"
LEASE = "lease_s"
AS_DESCRIBED = "as_described"
_OUTPUTS = get_args(CommandOutput)
_NAMESPACE_TODO = "Letters, digits, _ and -, with / between parts"


@dataclass(frozen=True)
class Parameters:
    """What the node works with. The period of the diagnostics and what twin/arm asks for can be changed later."""

    description: HandDescription
    endpoint: str
    joint_states_topic: str
    joint_commands_topic: str
    trajectory_topic: str
    command_rate_hz: float
    diagnostics_period_s: float
    identity: str
    signer: Signer
    command_output: str
    watch_controllers: bool


def declare_parameters(node: Node) -> Parameters:
    """Declares every parameter with its description. Raises BadInput for a value of no use."""

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
    identity = fixed("identity", os.environ.get("TWIN_AS", ""), "In whose name commands are asked for.")
    output = fixed("command_output", "none", f"What the gate sends, on ROS: {AS_DESCRIBED}, {', '.join(_OUTPUTS)}.")
    node.declare_parameter(
        ARM_REASON, "armed over ROS 2", ParameterDescriptor(description="What twin/arm gives as its reason.")
    )
    lease = ParameterDescriptor(
        description="Seconds that twin/arm asks for; 0 is what the daemon usually gives.",
        floating_point_range=[FloatingPointRange(from_value=0.0, to_value=LONGEST_LEASE_S)],
    )
    node.declare_parameter(LEASE, 0.0, lease)
    return Parameters(
        description=_renamed(hand, namespace),
        endpoint=choose_endpoint(fixed("endpoint", choose_endpoint(), "Zenoh endpoint of the twin.")),
        joint_states_topic=fixed("joint_states_topic", hand.topics.joint_states, "Measured joints, JointState."),
        joint_commands_topic=fixed("joint_commands_topic", hand.topics.joint_commands, "Position targets, JointState."),
        trajectory_topic=fixed("trajectory_topic", hand.topics.trajectory, "Position targets, JointTrajectory."),
        command_rate_hz=float(node.declare_parameter("command_rate_hz", hand.rate_hz, rate).value or hand.rate_hz),
        diagnostics_period_s=float(node.declare_parameter(PERIOD, 1.0, period).value or 1.0),
        identity=identity,
        signer=_signer(identity),
        command_output=_output(hand, output),
        watch_controllers=fixed(
            "watch_controllers", True, "Whether who else speaks to the hand's position controllers is heard."
        ),
    )


def _renamed(description: HandDescription, namespace: str) -> HandDescription:
    raw = description.model_dump(by_alias=True) | {"namespace": namespace}
    try:
        return HandDescription.model_validate(raw)
    except ValidationError:
        raise BadInput(f"'{namespace}' is no namespace", where="--namespace", allowed=_NAMESPACE_TODO) from None


def _signer(identity: str) -> Signer:
    if not identity:
        return Signer()
    path = keys_file(state_dir())
    keyring = load_keyring(path)
    if identity not in keyring:
        raise BadInput(f"no identity '{identity}'", where=path, todo=nearest(identity, keyring.names))
    return Signer(keyring, identity)


def _output(hand: HandDescription, asked: str) -> str:
    chosen = hand.command_output if asked == AS_DESCRIBED else asked
    if chosen not in _OUTPUTS:
        raise BadInput(
            f"'{asked}' is no way to command a hand",
            where="command_output",
            allowed=", ".join((AS_DESCRIBED, *_OUTPUTS)),
        )
    return chosen

"""sensor_msgs/JointState as CDR bytes, as any ROS 2 tool reads and writes them, without ROS installed."""

from __future__ import annotations

import numpy as np
from rosbags.typesys import Stores, get_typestore

from twin_daemon.daemon.messages import JointSample, MalformedPayload

JOINT_STATE = "sensor_msgs/msg/JointState"
MAX_BYTES = 256 * 1024
_STORE = get_typestore(Stores.ROS2_JAZZY)
_JointState = _STORE.types[JOINT_STATE]
_Header = _STORE.types["std_msgs/msg/Header"]
_Time = _STORE.types["builtin_interfaces/msg/Time"]
_SECOND_NS = 1_000_000_000


def encode(sample: JointSample, frame_id: str = "") -> bytes:
    """A joint sample as CDR."""
    seconds, nanoseconds = divmod(sample.stamp_ns, _SECOND_NS)
    message = _JointState(
        header=_Header(stamp=_Time(sec=int(seconds), nanosec=int(nanoseconds)), frame_id=frame_id),
        name=list(sample.names),
        position=_floats(sample.position),
        velocity=_floats(sample.velocity),
        effort=_floats(sample.effort),
    )
    return bytes(_STORE.serialize_cdr(message, JOINT_STATE))


def decode(payload: bytes) -> JointSample:
    """CDR bytes as a joint sample. Raises MalformedPayload, whatever is wrong with them."""
    if len(payload) > MAX_BYTES:
        raise MalformedPayload("too_large", f"{len(payload)} bytes, at most {MAX_BYTES} are read")
    try:
        message = _STORE.deserialize_cdr(payload, JOINT_STATE)
        stamp = message.header.stamp  # type: ignore[attr-defined]
        return JointSample(
            stamp_ns=int(stamp.sec) * _SECOND_NS + int(stamp.nanosec),
            names=tuple(message.name),  # type: ignore[attr-defined]
            position=np.array(message.position, dtype=float),  # type: ignore[attr-defined]
            velocity=np.array(message.velocity, dtype=float),  # type: ignore[attr-defined]
            effort=np.array(message.effort, dtype=float),  # type: ignore[attr-defined]
        )
    except Exception as error:  # foreign bytes break a decoder in every way there is
        raise MalformedPayload("malformed", f"not a JointState: {error!r:.200}") from None


def _floats(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float64)

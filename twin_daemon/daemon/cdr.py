"""sensor_msgs/JointState as CDR bytes, as any ROS 2 tool reads and writes them, without ROS installed.

A stream repeats its names in every message, and reading them is most of the work. So they are read once for each
layout; what is not in a known layout to the last byte is left to rosbags, which also says what is malformed.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple

import numpy as np
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from twin_daemon.daemon.messages import JointSample, MalformedPayload

JOINT_STATE = "sensor_msgs/msg/JointState"
MAX_BYTES = 256 * 1024
_DEFINITION = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
# These three alone: all of a distribution's messages are imported with those of six earlier ones, 0.15 s of each start.
_STORE = Typestore()
_STORE.register(get_types_from_msg(_DEFINITION, JOINT_STATE))
_STORE.get_msgdef(JOINT_STATE)  # writes and compiles the code for it, which the first message need not wait for
_JointState = _STORE.types[JOINT_STATE]
_Header = _STORE.types["std_msgs/msg/Header"]
_Time = _STORE.types["builtin_interfaces/msg/Time"]
_SECOND_NS = 1_000_000_000
_MAX_LAYOUTS = 64
_MAX_NAMES_BYTES = 16 * 1024

# Positions are counted from the first byte of the payload. CDR aligns from the fourth on, behind the encapsulation.
_LITTLE_ENDIAN = b"\x00\x01"
_START = Struct("<4siI")  # encapsulation, seconds, nanoseconds
_COUNT = Struct("<I")
_FLOAT = np.dtype("<f8")
_PADDING = bytes(4)
_NOTHING = np.zeros(0)


class _Layout(NamedTuple):
    """What a stream's messages have in common: the bytes from the frame's name to the last joint's, and the names."""

    head: bytes
    names: tuple[str, ...]


_read: dict[int, _Layout] = {}
"""The layout that a payload of this length had last."""
_written: dict[tuple[tuple[str, ...], str], bytes] = {}
"""The head of messages with these names and this frame."""


def encode(sample: JointSample, frame_id: str = "") -> bytes:
    """A joint sample as CDR."""
    seconds, nanoseconds = divmod(sample.stamp_ns, _SECOND_NS)
    names = tuple(sample.names)
    head = _written.get((names, frame_id))
    if head is None:
        head = _head(names, frame_id)
        if len(_written) >= _MAX_LAYOUTS:
            _written.clear()
        if len(head) <= _MAX_NAMES_BYTES:
            _written[names, frame_id] = head
    parts = [_START.pack(b"\x00\x01\x00\x00", seconds, nanoseconds), head]
    at = _START.size + len(head)
    for values in (sample.position, sample.velocity, sample.effort):
        count = len(values)
        parts.append(_COUNT.pack(count))
        at += 4
        if count:
            if at % 8 == 0:
                parts.append(_PADDING)
                at += 4
            parts.append(np.ascontiguousarray(values, dtype=_FLOAT).tobytes())
            at += 8 * count
    return b"".join(parts)


def decode(payload: bytes) -> JointSample:
    """CDR bytes as a joint sample. Raises MalformedPayload, whatever is wrong with them."""
    if len(payload) > MAX_BYTES:
        raise MalformedPayload("too_large", f"{len(payload)} bytes, at most {MAX_BYTES} are read")
    layout = _read.get(len(payload))
    if layout is not None and payload.startswith(_LITTLE_ENDIAN) and payload.startswith(layout.head, _START.size):
        known = _decode_known(payload, layout)
        if known is not None:
            return known
    return _decode_any(payload)


def _decode_known(payload: bytes, layout: _Layout) -> JointSample | None:
    """The rest of a message that begins as its layout says; None where it does not end with its last number."""
    _, seconds, nanoseconds = _START.unpack_from(payload)
    at = _START.size + len(layout.head)
    arrays = []
    for _ in range(3):
        if at + 4 > len(payload):
            return None
        count = _COUNT.unpack_from(payload, at)[0]
        at += 4
        if not count:
            arrays.append(_NOTHING)
            continue
        if at % 8 == 0:
            at += 4
        if at + 8 * count > len(payload):
            return None
        arrays.append(np.frombuffer(payload, _FLOAT, count, at).astype(float))
        at += 8 * count
    if at != len(payload):
        return None
    return JointSample(seconds * _SECOND_NS + nanoseconds, layout.names, *arrays)


def _decode_any(payload: bytes) -> JointSample:
    try:
        message = _STORE.deserialize_cdr(payload, JOINT_STATE)
        stamp = message.header.stamp  # type: ignore[attr-defined]
        sample = JointSample(
            stamp_ns=int(stamp.sec) * _SECOND_NS + int(stamp.nanosec),
            names=tuple(message.name),  # type: ignore[attr-defined]
            position=np.array(message.position, dtype=float),  # type: ignore[attr-defined]
            velocity=np.array(message.velocity, dtype=float),  # type: ignore[attr-defined]
            effort=np.array(message.effort, dtype=float),  # type: ignore[attr-defined]
        )
    except Exception as error:  # foreign bytes break a decoder in every way there is
        raise MalformedPayload("malformed", f"not a JointState: {error!r:.200}") from None
    if payload.startswith(_LITTLE_ENDIAN):
        _learn(payload, _head(sample.names, message.header.frame_id), sample.names)  # type: ignore[attr-defined]
    return sample


def _learn(payload: bytes, head: bytes, names: tuple[str, ...]) -> None:
    """Keeps a layout for the next message; a sender that invents names must not fill the memory."""
    if len(head) > _MAX_NAMES_BYTES:
        return
    if len(_read) >= _MAX_LAYOUTS:
        _read.clear()
    _read[len(payload)] = _Layout(head, names)


def _head(names: tuple[str, ...], frame_id: str) -> bytes:
    """The bytes of the frame's name and the joints' names, from rosbags itself."""
    nothing = np.zeros(0)
    message = _JointState(
        header=_Header(stamp=_Time(sec=0, nanosec=0), frame_id=frame_id),
        name=list(names),
        position=nothing,
        velocity=nothing,
        effort=nothing,
    )
    return bytes(_STORE.serialize_cdr(message, JOINT_STATE, little_endian=True))[_START.size : -3 * _COUNT.size]

"""From the twin's JSON to what ROS carries, and from a trajectory message to numbers. Plain values, no ROS."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from twin_daemon.daemon.messages import MalformedPayload
from twin_daemon.recordings.trajectory_commands import TrajectoryMessage

OK, WARN, ERROR = 0, 1, 2  # levels of diagnostic_msgs/DiagnosticStatus
MAX_POINTS = 10_000
_SECOND_NS = 1_000_000_000


def trigger_reply(payload: bytes | None, where: str, timeout_s: float) -> tuple[bool, str]:
    """(success, message) of a std_srvs/Trigger from the answer to a command; None is no answer."""
    if payload is None:
        return False, f"nothing answered at {where} within {timeout_s:g} s. Is 'twin run' running?"
    try:
        told = json.loads(payload)
        accepted, reason = told.get("accepted"), told.get("reason") or told.get("error") or ""
    except (ValueError, AttributeError):
        return False, f"the answer at {where} is not a JSON object: {payload[:80]!r}"
    return accepted is True, str(reason) or ("accepted" if accepted is True else "refused without a reason")


def diagnosis(payload: bytes | None, where: str) -> tuple[int, str, dict[str, str]]:
    """Level, message and key-values from the daemon's health; None is no answer."""
    if payload is None:
        return ERROR, f"no daemon answers at {where}", {}
    try:
        told = json.loads(payload)
        status, age_s = told["status"], told.get("age_s")
    except (ValueError, TypeError, KeyError):
        return ERROR, f"the answer at {where} is not the health of a twin", {}
    level, message = {
        "following": (OK, "following the hand"),
        "no_commands": (OK, "no commands yet: the model holds the pose"),
        "stale": (WARN, "stale: no joint states" + ("" if age_s is None else f" for {age_s:.1f} s")),
        "waiting": (WARN, "waiting for the first joint states"),
    }.get(status, (WARN, f"unknown status {status!r:.40}"))
    return level, message, key_values(told)


def key_values(told: dict[str, Any], before: str = "") -> dict[str, str]:
    """Nested counts as one level of text: {"joint_states.counts.malformed": "2"}. Events are left out."""
    found: dict[str, str] = {}
    for key, value in told.items():
        if isinstance(value, dict):
            found |= key_values(value, f"{before}{key}.")
        elif isinstance(value, list):
            if all(isinstance(item, str) for item in value):
                found[before + key] = ", ".join(value)
        elif key != "schema":
            found[before + key] = _text(value)
    return found


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def trajectory_message(message: Any, now_ns: int) -> TrajectoryMessage:
    """A trajectory_msgs/JointTrajectory, checked; without a stamp it starts now. Raises MalformedPayload."""
    names = tuple(message.joint_names)
    points = message.points
    if not names:
        raise MalformedPayload("empty", "no joint names")
    if len(set(names)) < len(names):
        raise MalformedPayload("duplicate_names", "a joint is named twice")
    if len(points) > MAX_POINTS:
        raise MalformedPayload("too_large", f"{len(points)} points, at most {MAX_POINTS} are followed")
    if any(len(point.positions) != len(names) for point in points):
        raise MalformedPayload("length_mismatch", f"a point has not {len(names)} positions")
    if any(not all(map(math.isfinite, point.positions)) for point in points):
        raise MalformedPayload("not_finite", "a position is not a number")
    times_ns = np.array([_nanoseconds(point.time_from_start) for point in points], dtype=np.int64)
    if times_ns.size and (times_ns[0] < 0 or (np.diff(times_ns) <= 0).any()):
        raise MalformedPayload("backward", "the times of the points do not rise")
    start_ns = _nanoseconds(message.header.stamp) or now_ns
    if times_ns.size and start_ns + int(times_ns[-1]) < now_ns:
        raise MalformedPayload("ended", "the trajectory ended before it arrived")
    position = np.array([point.positions for point in points], dtype=float).reshape(len(points), len(names))
    return TrajectoryMessage(start_ns, names, times_ns, position)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * _SECOND_NS + int(time.nanosec)

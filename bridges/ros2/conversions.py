"""From the twin's JSON to what ROS carries, and from messages to requests and numbers. Plain values, no ROS."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np

from twin_daemon.daemon.messages import MalformedPayload
from twin_daemon.recordings.trajectory_commands import TrajectoryMessage
from twin_daemon.services.stop_report import in_words, is_safe

OK, WARN, ERROR = 0, 1, 2  # levels of diagnostic_msgs/DiagnosticStatus
MAX_POINTS = 10_000
_SECOND_NS = 1_000_000_000


def gate_answer(payload: bytes | None, where: str, timeout_s: float) -> dict[str, Any]:
    """The gate's reply as it is; a refusal in its form where there is none, or none that can be read."""
    if payload is None:
        return _no_reply(f"nothing answered at {where} within {timeout_s:g} s", "a running daemon: 'twin run'")
    try:
        told = json.loads(payload)
    except ValueError:
        told = None
    if not isinstance(told, dict):
        return _no_reply(f"the answer at {where} is not a JSON object: {payload[:80]!r}", "the gate of a twin")
    return told


def _no_reply(why: str, allowed: str) -> dict[str, Any]:
    return {
        "accepted": False,
        "check": "no_answer",
        "why": why,
        "allowed": allowed,
        "consequence": "nobody knows whether it was done",
    }


def refusal_line(answer: dict[str, Any]) -> str:
    """What, what is allowed, and what follows, in one line."""
    why = answer.get("why") or answer.get("error") or "refused without a reason"
    allowed = f". Allowed: {answer['allowed']}" if answer.get("allowed") else ""
    consequence = f"; {answer['consequence']}" if answer.get("consequence") else ""
    return f"{why}{allowed}{consequence}"


def trigger_reply(verb: str, answer: dict[str, Any]) -> tuple[bool, str]:
    """(success, message) of a std_srvs/Trigger from the gate's reply to a verb; of a stop from its report."""
    if verb == "stop" and "latched" in answer:
        return is_safe(answer), in_words(answer) + ". This is no certified stop"
    if answer.get("accepted") is not True:
        end = ". The hand may go on: use its own emergency stop" if verb == "stop" else ""
        return False, refusal_line(answer) + end
    gate = answer.get("gate") or {}
    lease_s = gate.get("lease_left_s")
    return True, {
        "arm": "armed" if lease_s is None else f"armed for {lease_s:.0f} s, as {gate.get('commander')}",
        "disarm": "disarmed; what moved comes to rest, and the hand holds",
        "release": "released; not armed",
    }.get(verb, str(answer.get("why") or "accepted"))


def target_body(message: Any) -> dict[str, Any]:
    """A sensor_msgs/JointState as a streamed target. Raises MalformedPayload for what no request can say."""
    names, position = list(message.name), message.position
    if len(position) != len(names):
        raise MalformedPayload("length_mismatch", f"{len(names)} names and {len(position)} positions")
    if len(set(names)) < len(names):
        raise MalformedPayload("duplicate_names", "a joint is named twice")
    return {"targets": dict(zip(names, map(float, position), strict=True))}


def trajectory_body(message: Any) -> dict[str, Any]:
    """A trajectory_msgs/JointTrajectory as a request; it begins when the gate accepts it, from where the hand is.

    The time of its first point is that of the way there; 0 leaves it to the gate. Raises MalformedPayload.
    """
    told = checked_trajectory(message)
    lead_s = float(told.times_ns[0] * 1e-9)
    body = {
        "name": "trajectory over ROS 2",
        "joints": list(told.names),
        "times_s": ((told.times_ns - told.times_ns[0]) * 1e-9).tolist(),
        "positions": told.position.tolist(),
    }
    return body | ({"lead_s": lead_s} if lead_s > 0.0 else {})


def gate_diagnosis(status: dict[str, Any]) -> tuple[int, str, dict[str, str]]:
    """Level, message and key-values from the gate's status."""
    lease_s = status.get("lease_left_s")
    message = {
        "read_only": "read-only: nothing is armed",
        "armed": f"armed by {status.get('commander')}" + ("" if lease_s is None else f", for {lease_s:.0f} s more"),
        "stopped": f"stopped: {status.get('ended')}",
    }.get(status["mode"], f"unknown mode {status['mode']!r:.40}")
    hidden = ("session",)
    values = key_values({key: value for key, value in status.items() if key not in hidden})
    return OK if status["mode"] in ("read_only", "armed") else WARN, message, values


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
    changed = told.get("changed")
    if level == OK and isinstance(changed, list) and changed:
        level, message = WARN, f"the hand has changed: {'; '.join(map(str, changed))}"
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
    told = checked_trajectory(message)
    if told.times_ns.size and (told.start_ns or now_ns) + int(told.times_ns[-1]) < now_ns:
        raise MalformedPayload("ended", "the trajectory ended before it arrived")
    return replace(told, start_ns=told.start_ns or now_ns)


def checked_trajectory(message: Any) -> TrajectoryMessage:
    """A trajectory_msgs/JointTrajectory whose parts fit together. Raises MalformedPayload."""
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
    position = np.array([point.positions for point in points], dtype=float).reshape(len(points), len(names))
    return TrajectoryMessage(_nanoseconds(message.header.stamp), names, times_ns, position)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * _SECOND_NS + int(time.nanosec)

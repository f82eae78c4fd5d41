"""Trajectory files: waypoints as people write them, and the points in time that they mean.

A file has groups of trajectories (`hand_trajectories: {name: [waypoint, ...]}`), in two forms that may be mixed:

    hand_trajectories:
      dense:                                  # angles in the hand's order, or in `hand_joints_order` of the file
        - {joint_angles: [0.0, ...], interpolate_time: 3}
      sparse:
        description: what it is for
        interpolation: linear                 # or cubic: at rest at each waypoint
        start: {rh_FFJ3: 0.0}                 # where the hand is at time 0; rest (0 rad) where nothing is said
        joints: [rh_FFJ3, rh_FFJ0]            # order of joint_angles, if used
        waypoints:
          - {positions: {rh_FFJ3: 0.5}, interpolate_time: 0.4, hold: 1.0}

The motion begins in the start pose at time 0. Each waypoint is reached `interpolate_time` seconds after the one before
(the first: after the start), then stays for `hold` seconds. A first waypoint with interpolate_time 0 is the start pose.
Joints that a waypoint does not name keep their last target.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from twin_daemon.errors import BadInput, nearest
from twin_daemon.hand.description import Hand
from twin_daemon.hand.naming import match

MIN_STEP_S = 1e-3
"""Two waypoints cannot be nearer in time: positions would jump."""

CUBIC_STEP_S = 0.01

Angle = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Seconds = Annotated[float, Field(strict=True, ge=0, le=3600)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Waypoint(_Strict):
    """A pose, the time it takes to get there, and how long it is held."""

    interpolate_time: Seconds
    joint_angles: list[Angle] | None = None
    positions: dict[str, Angle] | None = None
    hold: Seconds = 0.0

    @model_validator(mode="after")
    def _one_form(self) -> Waypoint:
        if (self.joint_angles is None) == (self.positions is None):
            raise ValueError("give either joint_angles (a list) or positions (a mapping)")
        return self


class Motion(_Strict):
    """One trajectory of a file."""

    description: str = ""
    interpolation: Literal["linear", "cubic"] = "linear"
    joints: list[str] | None = None
    start: dict[str, Angle] = Field(default_factory=dict)
    waypoints: Annotated[list[Waypoint], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _bare_list(cls, raw: Any) -> Any:
        return {"waypoints": raw} if isinstance(raw, list) else raw


@dataclass(frozen=True)
class Points:
    """The points in time of a motion: names (j), labels (w) for messages, times_s (w,), positions (w, j) rad."""

    names: tuple[str, ...]
    labels: tuple[str, ...]
    times_s: np.ndarray
    positions: np.ndarray


def points(motion: Motion, order: list[str], hand: Hand, where: str) -> Points:
    """The points that `motion` means for this hand; `order` names the numbers of `joint_angles`. Raises BadInput."""
    listed = motion.joints if motion.joints is not None else order
    start = _resolved(motion.start, hand, where)
    sparse = [
        _resolved(_by_name(waypoint, listed, number, where), hand, where)
        for number, waypoint in enumerate(motion.waypoints, start=1)
    ]
    names = tuple(dict.fromkeys(name for targets in (start, *sparse) for name in targets))
    if not names:
        raise BadInput("it names no joint", where=where, todo="Give positions: {joint: angle}")
    column = {name: index for index, name in enumerate(names)}
    pose = np.array([start.get(name, _rest(name, hand)) for name in names])
    labels, times, rows = ["the start pose"], [0.0], [pose]
    for number, (waypoint, targets) in enumerate(zip(motion.waypoints, sparse, strict=True), start=1):
        pose = pose.copy()
        for name, angle in targets.items():
            pose[column[name]] = angle
        label = f"waypoint {number}"
        if number == 1 and waypoint.interpolate_time == 0:
            labels, rows = [label], [pose]
        elif waypoint.interpolate_time < MIN_STEP_S:
            raise BadInput(
                f"{label}: interpolate_time is {waypoint.interpolate_time:g} s",
                where=where,
                allowed=f"{MIN_STEP_S:g} s or more (0 only for the first: it is the start pose then)",
            )
        else:
            labels.append(label)
            times.append(times[-1] + waypoint.interpolate_time)
            rows.append(pose)
        if waypoint.hold >= MIN_STEP_S:
            labels.append(label)
            times.append(times[-1] + waypoint.hold)
            rows.append(pose)
    if len(times) < 2:
        raise BadInput("it lasts 0 s", where=where, todo="Give a second waypoint, an interpolate_time or a hold")
    return Points(names, tuple(labels), np.array(times), np.stack(rows))


def smoothed(times_s: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cubic segments, at rest at each point, written out as straight pieces of about 10 ms: (W,) s and (W, j) rad."""
    times, rows = [times_s[:1]], [positions[:1]]
    for index in range(len(times_s) - 1):
        duration = times_s[index + 1] - times_s[index]
        share = np.linspace(0.0, 1.0, max(2, int(np.ceil(duration / CUBIC_STEP_S)) + 1))[1:]
        times.append(times_s[index] + share * duration)
        blend = (3 - 2 * share[:, None]) * share[:, None] ** 2
        rows.append(positions[index] + blend * (positions[index + 1] - positions[index]))
    return np.concatenate(times), np.concatenate(rows)


def _by_name(waypoint: Waypoint, listed: list[str], number: int, where: str) -> dict[str, float]:
    if waypoint.positions is not None:
        return waypoint.positions
    angles = waypoint.joint_angles or []
    if len(angles) != len(listed):
        raise BadInput(
            f"waypoint {number}: joint_angles has {len(angles)} numbers",
            where=where,
            allowed=f"{len(listed)}, in the order {', '.join(listed[:4])}, ...",
        )
    return dict(zip(listed, angles, strict=True))


def _resolved(targets: Mapping[str, float], hand: Hand, where: str) -> dict[str, float]:
    """`targets` by the names of the hand, whatever spelling the file uses."""
    known = list(dict.fromkeys((*hand.joints, *hand.commands)))
    resolved: dict[str, float] = {}
    for name, angle in targets.items():
        found = match(name, known)
        if found is None:
            raise BadInput(
                f"no joint or command '{name}' in hand '{hand.name}'", where=where, todo=nearest(name, known)
            )
        if found in resolved:
            raise BadInput(f"'{found}' is named in two spellings", where=where, todo="Give it one target")
        resolved[found] = angle
    return resolved


def _rest(name: str, hand: Hand) -> float:
    """0 rad, or the nearest angle that the joint can have."""
    low, high = hand.joint_range_rad.get(name, hand.command_range_rad.get(name, (-np.inf, np.inf)))
    return float(np.clip(0.0, low, high))

"""Whether the hand would run into itself, by the twin's geometry, before it is sent there."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from twin_daemon.hand import Hand
from twin_daemon.simulation.touches import touches
from twin_daemon.simulation.twin import TwinModel

RESOLUTION_RAD = 0.05
"""Farthest between two poses that are looked at."""
_SAME_M = 1e-9  # rounding; more would let a hand creep into itself, turn by turn


@dataclass(frozen=True)
class Collision:
    """Two bodies that would overlap by `depth_m` at `share` (0 to 1) of the way."""

    bodies: tuple[str, str]
    depth_m: float
    share: float = 1.0

    def __str__(self) -> str:
        return f"{self.bodies[0]} and {self.bodies[1]} would overlap by {self.depth_m * 1e3:.1f} mm"


class Preview:
    """Looks for overlaps of the hand's own bodies that are deeper than `depth_m` and than they are now.

    A motor that pulls several joints may divide its angle between them in any way; the two extremes that are known
    of tendon-driven fingers are looked at: in equal parts, and one joint after the other in the order described.
    """

    def __init__(self, twin: TwinModel, depth_m: float) -> None:
        self._model = twin.base_model
        self._data = mujoco.MjData(self._model)
        self._depth_m = depth_m
        hand = twin.hand
        self._address = np.array([_address(self._model, hand, joint) for joint in twin.joints], dtype=int)
        index = {joint: i for i, joint in enumerate(twin.joints)}
        driven = [[index[joint] for joint in info.joints] for info in hand.description.commands.values()]
        self._alone = [(c, joints[0]) for c, joints in enumerate(driven) if len(joints) == 1]
        self._shared = [
            (c, joints, [hand.joint_range_rad[twin.joints[j]] for j in joints])
            for c, joints in enumerate(driven)
            if len(joints) > 1
        ]

    def first_collision(
        self, measured: np.ndarray, begin: np.ndarray, end: np.ndarray, resolution_rad: float = RESOLUTION_RAD
    ) -> Collision | None:
        """The first on the straight way between two sets of targets (c,); joints (j,) without one are as measured."""
        way = float(np.fmax.reduce(np.abs(end - begin), initial=0.0))
        if way <= resolution_rad:
            return self.along(measured, end[None], now=begin)
        count = int(np.ceil(way / resolution_rad))
        shares = np.arange(1, count + 1) / count
        return self.along(measured, begin[None] + shares[:, None] * (end - begin)[None], now=begin)

    def along(self, measured: np.ndarray, path: np.ndarray, now: np.ndarray) -> Collision | None:
        """The first collision on a path (n, c) of targets; `now` (c,) are those of the present."""
        before: dict[tuple[int, int], float] | None = None
        rest = np.where(np.isfinite(measured), measured, 0.0).tolist()
        for number, targets in enumerate(path):
            for pose in self._poses(rest, targets):
                for bodies, depth_m in self._overlaps(pose).items():
                    if depth_m <= self._depth_m:
                        continue
                    if before is None:
                        before = self._worst(self._poses(rest, now))
                    if depth_m > before.get(bodies, 0.0) + _SAME_M:
                        names = (self._model.body(bodies[0]).name, self._model.body(bodies[1]).name)
                        return Collision(names, depth_m, (number + 1) / len(path))
        return None

    def _worst(self, poses: list[list[float]]) -> dict[tuple[int, int], float]:
        worst: dict[tuple[int, int], float] = {}
        for pose in poses:
            for bodies, depth_m in self._overlaps(pose).items():
                worst[bodies] = max(depth_m, worst.get(bodies, 0.0))
        return worst

    def _poses(self, rest: list[float], targets: np.ndarray) -> list[list[float]]:
        """Angles (j,) rad, those of `rest` without a target. Plain numbers: some twenty of them are faster one by one
        than as arrays."""
        pose, row, known = rest.copy(), targets.tolist(), np.isfinite(targets).tolist()
        for command, joint in self._alone:
            if known[command]:
                pose[joint] = row[command]
        after = pose.copy()
        for command, joints, ranges in self._shared:
            if not known[command]:
                continue
            left = row[command]
            for joint, (low, high) in zip(joints, ranges, strict=True):
                pose[joint] = row[command] / len(joints)
                after[joint] = min(max(left, low), high)
                left -= after[joint]
        return [pose] if after == pose else [pose, after]

    def _overlaps(self, pose: list[float]) -> dict[tuple[int, int], float]:
        model, data = self._model, self._data
        data.qpos[self._address] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found: dict[tuple[int, int], float] = {}
        for touch in touches(model, data):
            if touch.distance_m < 0.0:
                first, second = sorted(touch.bodies)
                found[first, second] = max(-touch.distance_m, found.get((first, second), 0.0))
        return found


def _address(model: mujoco.MjModel, hand: Hand, joint: str) -> int:
    return int(model.joint(hand.description.joints[joint].joint).qposadr[0])

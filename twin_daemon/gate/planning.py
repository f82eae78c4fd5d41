"""From a request to the motion that it would be, and what that motion would do: collide, pull, lag behind."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.gate.asked import Asked
from twin_daemon.gate.limits import Limits
from twin_daemon.gate.motion import Motion, along, commands_of, smooth_move, to_target
from twin_daemon.gate.preview import RESOLUTION_RAD, Collision, Preview
from twin_daemon.gate.rehearsal import rehearse
from twin_daemon.gate.requests import Follow, Move, Request, Target
from twin_daemon.gate.settings import GateSettings
from twin_daemon.signals.trajectory import Trajectory
from twin_daemon.simulation.twin import TwinModel

LONGEST_S = 600.0


class Planner:
    """Plans with one twin. Safe to use from several threads, one after the other."""

    def __init__(self, twin: TwinModel, limits: Limits, settings: GateSettings) -> None:
        self._twin = twin
        self._limits = limits
        self._settings = settings
        self._dt_s = 1.0 / settings.rate_hz
        self._preview = Preview(twin, settings.collision_depth_m)
        self._looking = threading.Lock()

    def plan(self, asked: Asked, request: Request, begin: np.ndarray, measured: np.ndarray) -> Asked:
        """`asked` with the motion from setpoints `begin` (c,) while the joints (j,) are measured; without one where its
        numbers are none. Raises BadInput for what does not fit the hand."""
        limits, hand, share = self._limits, self._twin.hand, self._settings.move_speed
        if isinstance(request, Follow):
            plan = trajectory_of(request)
            targets = dict(zip(plan.joints, plan.positions.sum(axis=0).tolist(), strict=True))
            if not np.isfinite(plan.positions).all():
                return replace(asked, targets=targets)
            motion = along(limits, hand, begin, plan, request.lead_s, share, self._dt_s)
        elif isinstance(request, (Move, Target)):
            targets = dict(request.targets)
            if not targets or not np.isfinite(list(targets.values())).all():
                return replace(asked, targets=targets)
            row = commands_of(hand, targets)
            if isinstance(request, Move):
                motion = smooth_move(limits, begin, row, request.seconds, share, self._dt_s)
            else:
                motion = to_target(limits, row, self._dt_s)
        else:
            raise TypeError(f"{asked.verb} is no motion")
        return replace(
            asked, targets=targets, motion=motion, collision=lambda: self._collision(motion, begin, measured)
        )

    def _collision(self, motion: Motion, begin: np.ndarray, measured: np.ndarray) -> Collision | None:
        path = np.vstack([begin, np.where(motion.moved, motion.table, begin)])
        with self._looking:
            return self._preview.along(measured, _thinned(path), now=begin)

    def rehearse(self, motion: Motion, begin: np.ndarray, measured: np.ndarray) -> dict[str, Any]:
        """What the twin does when it is driven so."""
        return rehearse(self._twin, self._limits, begin, measured, motion)


def trajectory_of(request: Follow) -> Trajectory:
    """The trajectory of a request. Raises BadInput where its parts do not fit together."""
    times, rows = np.array(request.times_s), request.positions
    if len(rows) != len(times) or any(len(row) != len(request.joints) for row in rows):
        raise BadInput("times_s, positions and joints do not fit", allowed="one row a time, one number a joint")
    if not np.isfinite(times).all() or times[0] != 0.0 or (np.diff(times) <= 0.0).any():
        raise BadInput("times_s do not grow from 0", todo="Begin at 0 and go forward")
    if times[-1] > LONGEST_S:
        raise BadInput(f"it lasts {times[-1]:.0f} s", allowed=f"{LONGEST_S:g} s at most")
    return Trajectory(request.name, tuple(request.joints), times, np.array(rows, float))


def _thinned(path: np.ndarray) -> np.ndarray:
    """Rows of a path (n, c), the first left out, that lie no farther apart than the preview's resolution."""
    kept = [path[0]]
    for number, row in enumerate(path[1:], start=1):
        way = float(np.fmax.reduce(np.abs(row - kept[-1]), initial=0.0))
        if way > RESOLUTION_RAD or number == len(path) - 1:
            count = max(1, int(np.ceil(way / RESOLUTION_RAD)))
            begin = kept[-1]
            kept += [begin + share * (row - begin) for share in np.arange(1, count + 1) / count]
    return np.array(kept[1:])

"""Trajectories as the stream of targets that a trajectory controller would track."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_daemon.daemon.messages import JointSample, MalformedPayload
from twin_daemon.recordings.trajectory_commands import Knot, TrajectoryMessage, replace_rest, sampled

_MOST_NAMES = 256


class TrajectoryFollower:
    """Says the target of each moment, linear between the points.

    A later trajectory replaces what remains of an earlier one, joint by joint. It sets out from the target in force at
    its start or, where there was none, from where the joint is. One without points stops the joints where they are.
    Recorded trajectories become commands by the same rules.
    """

    def __init__(self) -> None:
        self._plans: dict[str, list[Knot]] = {}
        self._held: dict[str, float] = {}  # where the last trajectory of a joint ended, rad

    @property
    def active(self) -> bool:
        return bool(self._plans)

    def forget(self) -> None:
        """Somebody else commands as well: what a finished trajectory left is no longer in force."""
        self._held.clear()

    def accept(self, message: TrajectoryMessage, measured: Callable[[str], float | None]) -> None:
        """Follows `message`; `measured` says where a joint is, rad, or None. MalformedPayload if too many move."""
        if len(self._plans.keys() | self._held.keys() | set(message.names)) > _MOST_NAMES:
            raise MalformedPayload("too_many_names", f"more than {_MOST_NAMES} joints have trajectories")
        for column, name in enumerate(message.names):
            times_ns = (message.start_ns + message.times_ns).tolist()
            points = list(zip(times_ns, message.position[:, column].tolist(), strict=True))
            plan = self._plans.pop(name, [])
            replace_rest(plan, message.start_ns, points, self._held[name] if name in self._held else measured(name))
            if plan:
                self._plans[name] = plan

    def sample(self, now_ns: int) -> JointSample | None:
        """The targets in force, each once more at its end; None while nothing is."""
        targets: dict[str, float] = {}
        for name, plan in list(self._plans.items()):
            while len(plan) > 1 and plan[1][0] <= now_ns:
                del plan[0]
            value = float(sampled(plan, np.array([now_ns]))[0])
            if np.isnan(value):
                continue
            targets[name] = value
            if len(plan) == 1:
                self._held[name] = self._plans.pop(name)[0][1]
        if not targets:
            return None
        return JointSample(now_ns, tuple(targets), np.array(list(targets.values())))

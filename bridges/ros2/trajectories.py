"""Trajectories as the stream of targets that a trajectory controller would track."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin_daemon.daemon.messages import JointSample, MalformedPayload

_MOST_NAMES = 256
Knot = tuple[int, float]  # stamp in ns, target in rad


@dataclass(frozen=True)
class TrajectoryMessage:
    """A checked trajectory that starts at `start_ns`: `times_ns` (w,) from then on, `position` (w, k) rad."""

    start_ns: int
    names: tuple[str, ...]
    times_ns: np.ndarray
    position: np.ndarray


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
            in_force = _value(self._plans.get(name, []), message.start_ns)
            if in_force is None:
                in_force = self._held[name] if name in self._held else measured(name)
            plan = [knot for knot in self._plans.pop(name, []) if knot[0] < message.start_ns]
            # without this knot the target would slope from the last old point; a first point at once is a step
            hold_ns = message.start_ns - 1 if points and points[0][0] <= message.start_ns else message.start_ns
            if in_force is not None and (not plan or plan[-1][0] < hold_ns):
                plan.append((hold_ns, in_force))
            if plan := plan + points:
                self._plans[name] = plan

    def sample(self, now_ns: int) -> JointSample | None:
        """The targets in force, each once more at its end; None while nothing is."""
        targets: dict[str, float] = {}
        for name, plan in list(self._plans.items()):
            while len(plan) > 1 and plan[1][0] <= now_ns:
                del plan[0]
            value = _value(plan, now_ns)
            if value is None:
                continue
            targets[name] = value
            if len(plan) == 1:
                self._held[name] = self._plans.pop(name)[0][1]
        if not targets:
            return None
        return JointSample(now_ns, tuple(targets), np.array(list(targets.values())))


def _value(plan: list[Knot], stamp_ns: int) -> float | None:
    """The plan at a moment: None before its first knot, held after its last."""
    if not plan or stamp_ns < plan[0][0]:
        return None
    base = plan[0][0]  # since 1970 in ns does not fit a float exactly, since the first knot does
    return float(np.interp(stamp_ns - base, [at - base for at, _ in plan], [value for _, value in plan]))

"""JointTrajectory messages as one command signal: what a trajectory controller was tracking at each moment."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.recordings.recording import Commands

Knot = tuple[int, float]
"""A stamp in ns, and the target in rad at it."""


@dataclass(frozen=True)
class TrajectoryMessage:
    """A trajectory that starts at `start_ns`: `times_ns` (w,) from then on, `position` (w, k) rad."""

    start_ns: int
    names: tuple[str, ...]
    times_ns: np.ndarray
    position: np.ndarray


def expand_trajectories(
    messages: Sequence[TrajectoryMessage],
    measured: Callable[[str, int], float | None],
    dropped: Counter[str],
) -> Commands | None:
    """All trajectories, in order of arrival, as one signal that is linear between its knots.

    A later trajectory replaces what remains of an earlier one, joint by joint. It sets out from the target in force at
    its start or, where there was none, from where the joint was (`measured`), as trajectory controllers do. One without
    points stops the motion where it is.
    """
    plans: dict[str, list[Knot]] = {}
    for message in messages:
        if not _usable(message, dropped):
            continue
        for column, name in enumerate(message.names):
            times_ns, values = message.start_ns + message.times_ns, message.position[:, column]
            finite = np.isfinite(values)
            dropped["nan"] += int((~finite).sum())
            points = list(zip(times_ns[finite].tolist(), values[finite].tolist(), strict=True))
            plan = plans.setdefault(name, [])
            replace_rest(plan, message.start_ns, points, measured(name, message.start_ns))
    plans = {name: plan for name, plan in plans.items() if plan}
    if not plans:
        return None
    stamp_ns = np.unique(np.concatenate([np.array([at for at, _ in plan], dtype=np.int64) for plan in plans.values()]))
    position = np.column_stack([sampled(plan, stamp_ns) for plan in plans.values()])
    return Commands(stamp_ns, tuple(plans), position, "linear")


def _usable(message: TrajectoryMessage, dropped: Counter[str]) -> bool:
    if not message.names:
        dropped["empty"] += 1
    elif len(set(message.names)) != len(message.names):
        dropped["repeated_names"] += 1
    elif message.times_ns.size and ((np.diff(message.times_ns) <= 0).any() or message.times_ns[0] < 0):
        dropped["backward"] += 1
    else:
        return True
    return False


def replace_rest(plan: list[Knot], start_ns: int, points: list[Knot], measured: float | None) -> None:
    """Lets a plan go on with `points` from `start_ns`; it sets out from `measured` (rad) where none was in force."""
    in_force = float(sampled(plan, np.array([start_ns]))[0]) if plan and plan[0][0] <= start_ns else measured
    while plan and plan[-1][0] >= start_ns:
        plan.pop()
    # Without this knot the signal would slope from the last old point; a first point at once is a step.
    hold_ns = start_ns - 1 if points and points[0][0] <= start_ns else start_ns
    if in_force is not None and np.isfinite(in_force) and (not plan or plan[-1][0] < hold_ns):
        plan.append((hold_ns, in_force))
    plan.extend(points)


def sampled(plan: list[Knot], stamp_ns: np.ndarray) -> np.ndarray:
    """The plan at the given stamps; NaN before its first knot, held after its last."""
    base = plan[0][0]  # since 1970 in ns does not fit a float exactly, since the first knot does
    at = np.array([knot - base for knot, _ in plan], dtype=float)
    return np.interp((stamp_ns - base).astype(float), at, [value for _, value in plan], left=np.nan)

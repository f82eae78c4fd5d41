"""What the error of one joint depends on: its residual over position, velocity, load and time since a reversal.

Beside the measured points stand curves: what each candidate says that the residual should be, which is what the twin
with it predicts less what the twin without it predicts. Friction, play, springs and delays each look different there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from twin_daemon.comparison.compare import Comparison
from twin_daemon.comparison.conditions import directions, smooth_speed
from twin_daemon.simulation.twin import TwinModel

WAYS = {"moving up": 1.0, "moving down": -1.0}
POINTS = 400
"""Of one direction, as many as a small plot shows."""

_BINS = 24
_FEWEST = 4  # samples in a bin of which a median can be told

Curve = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Axis:
    """One quantity (n,) of each sample, in its unit."""

    name: str
    unit: str
    values: np.ndarray


@dataclass(frozen=True)
class Plot:
    """Residuals (mrad) over one quantity, by direction: `points` as measured, and of each candidate the medians that
    it predicts, NaN where too few samples are."""

    name: str
    unit: str
    points: dict[str, Curve]
    curves: dict[str, dict[str, Curve]]


def dependence(
    twin: TwinModel, found: Comparison, joint: str, candidates: Mapping[str, np.ndarray], most: int = POINTS
) -> list[Plot]:
    """The plots of a joint that moves. `candidates` are what others predict of it (n,) rad, by name; `most` is how
    many points of one direction are kept."""
    column = found.aligned.joints.index(joint)
    known = np.flatnonzero(np.isfinite(found.aligned.measured[:, column]))
    axes, way = quantities(twin, found, column)
    expected = {name: predicted - found.predicted[:, column] for name, predicted in candidates.items()}
    residual = found.residual[:, column]
    return [_plot(axis, way, residual, expected, known, most) for axis in axes]


def quantities(twin: TwinModel, found: Comparison, column: int) -> tuple[list[Axis], np.ndarray]:
    """(position, velocity, load, time since the last reversal of one joint, its direction (n,) as +1, 0, -1)."""
    time_s, position = found.aligned.time_s, found.aligned.measured[:, column]
    speed = smooth_speed(time_s, position)
    way = directions(speed)
    turns = reversals(time_s, way)
    latest = np.searchsorted(turns, time_s, side="right") - 1
    since = np.where(latest >= 0, time_s - turns[np.maximum(latest, 0)], np.nan) if turns.size else time_s * np.nan
    axes = [Axis("position", "rad", position), Axis("velocity", "rad/s", speed)]
    load = servo_load(twin, found, column)
    if load is not None:
        axes.append(Axis("load", "N m", load))
    return [*axes, Axis("time since a reversal", "s", since)], way


def reversals(time_s: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(k,) s: when a direction (n,) of +1, 0, -1 becomes the opposite one, with or without a rest between."""
    moving = np.flatnonzero(way != 0)
    return time_s[moving[1:][np.diff(way[moving]) != 0]]


def servo_load(twin: TwinModel, found: Comparison, column: int) -> np.ndarray | None:
    """(n,) N m: what the joint's position servo gives for the command and the measured angles; None without one."""
    drivers = np.flatnonzero(twin.drive[:, column])
    if not len(drivers):
        return None
    row = int(drivers[0])
    actuator = int(mujoco.mj_name2id(twin.model, mujoco.mjtObj.mjOBJ_ACTUATOR, _actuator_name(twin, row)))
    if actuator < 0:
        return None
    aligned = found.aligned
    command = aligned.controls(twin, aligned.time_s)[:, row]
    actuated = np.nan_to_num(aligned.measured) @ twin.drive[row]
    gain, bias = twin.model.actuator_gainprm[actuator], twin.model.actuator_biasprm[actuator]
    force = gain[0] * command + bias[0] + bias[1] * actuated
    if twin.model.actuator_forcelimited[actuator]:
        force = np.clip(force, *twin.model.actuator_forcerange[actuator])
    return force * twin.drive[row, column]


def _actuator_name(twin: TwinModel, row: int) -> str:
    return str(twin.place(twin.actuators[row]).actuator)


def _plot(
    axis: Axis, way: np.ndarray, residual: np.ndarray, expected: dict[str, np.ndarray], known: np.ndarray, most: int
) -> Plot:
    plot = Plot(axis.name, axis.unit, {}, {name: {} for name in expected})
    usable = known[np.isfinite(axis.values[known])]
    if not len(usable):
        return plot
    edges = np.linspace(axis.values[usable].min(), axis.values[usable].max(), _BINS + 1)
    for name, sign in WAYS.items():
        chosen = usable[way[usable] == sign]
        shown = chosen[:: max(-(-len(chosen) // most), 1)]
        plot.points[name] = (axis.values[shown], 1e3 * residual[shown])
        for candidate, values in expected.items():
            plot.curves[candidate][name] = _median(edges, axis.values[chosen], 1e3 * values[chosen])
    return plot


def _median(edges: np.ndarray, x: np.ndarray, y: np.ndarray) -> Curve:
    place = np.clip(np.digitize(x, edges) - 1, 0, _BINS - 1)
    values = np.full(_BINS, np.nan)
    for index in range(_BINS):
        inside = y[place == index]
        if inside.size >= _FEWEST:
            values[index] = np.median(inside)
    return 0.5 * (edges[1:] + edges[:-1]), values

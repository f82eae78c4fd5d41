"""What the error of one joint depends on: its residual over position, velocity, load and time since a reversal.

Beside the measured points stand curves: what each candidate says that the residual should be, which is what the twin
with it predicts less what the twin without it predicts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from starlette.requests import Request
from starlette.routing import BaseRoute

from twin_daemon.comparison.compare import Comparison
from twin_daemon.comparison.conditions import directions, smooth_speed
from twin_daemon.diagnosis.free_rollout import with_finding
from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.errors import BadInput
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.web.app import reading
from twin_daemon.web.jobs import Jobs
from twin_daemon.web.library import Library
from twin_daemon.web.model_cache import ModelCache
from twin_daemon.web.numbers import listed
from twin_daemon.web.queries import lag, onset

_POINTS = 400  # of one direction
_BINS = 24
_FEWEST = 4  # samples in a bin of which a median can be told
_MOST_CANDIDATES = 3
_MOST_TURNS = 200


@dataclass(frozen=True)
class Axis:
    """One quantity (n,) of each sample, in its unit."""

    name: str
    unit: str
    values: np.ndarray


class Dependence:
    """The question of the panel. Candidates are those that the last diagnosis of the same data found."""

    def __init__(self, library: Library, cache: ModelCache, jobs: Jobs) -> None:
        self._library, self._cache, self._jobs = library, cache, jobs

    @property
    def routes(self) -> list[BaseRoute]:
        return [reading("/api/dependence", self._answer), reading("/api/reversals", self._reversals)]

    def _answer(self, request: Request) -> dict[str, Any]:
        query = request.query_params
        path, joint = self._library.path(query.get("recording", "")), query.get("joint", "")
        version = self._cache.version_id(query.get("version", "nominal"))
        begins, lag_s = onset(request), lag(request)
        found = self._cache.comparison(path, version, begins, lag_s=lag_s)
        if found is None:
            return {"pending": True}
        if joint not in found.joints or not found.joints[joint].moves:
            raise BadInput(f"'{joint}' does not move in this recording")
        column = found.aligned.joints.index(joint)
        known = np.flatnonzero(np.isfinite(found.aligned.measured[:, column]))
        axes, way = quantities(self._cache.twin(version), found, column)
        others: dict[str, np.ndarray] = {}
        pending = False
        for name in query.getlist("against")[:_MOST_CANDIDATES]:
            other = self._cache.comparison(path, self._cache.version_id(name), begins, lag_s=lag_s)
            pending |= other is None
            if other is not None:
                others[name] = other.predicted[:, column]
        for one in self._candidates(query.get("recording", ""), version):
            other = self._cache.comparison(path, version, begins, with_finding(self._cache.twin(version), one), lag_s)
            pending |= other is None
            if other is not None:
                others[one.name] = other.predicted[:, column]
        expected = {name: predicted - found.predicted[:, column] for name, predicted in others.items()}
        residual = found.residual[:, column]
        return {
            "pending": False,
            "curves_pending": pending,
            "joint": joint,
            "plots": [_plot(axis, way, residual, expected, known) for axis in axes],
        }

    def _reversals(self, request: Request) -> dict[str, Any]:
        """When a joint turned back (s); of many that many of the first."""
        query = request.query_params
        aligned = self._cache.recording(self._library.path(query.get("recording", "")))
        joint = query.get("joint", "")
        if joint not in aligned.joints:
            raise BadInput(f"no joint '{joint:.60}'", allowed=", ".join(aligned.joints))
        position = aligned.measured[:, aligned.joints.index(joint)]
        turns = reversals(aligned.time_s, directions(smooth_speed(aligned.time_s, position)))
        return {"count": len(turns), "times": listed(turns[:_MOST_TURNS], 4)}

    def _candidates(self, recording: str, version: str) -> list[Finding]:
        job = self._jobs.latest("diagnose")
        if job is None or job.result is None:
            return []
        if (job.about["recording_id"], job.about["version"]) != (recording, version):
            return []
        return [Finding.model_validate(one) for one in job.result["findings"][:_MOST_CANDIDATES]]


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
    axis: Axis, way: np.ndarray, residual: np.ndarray, expected: dict[str, np.ndarray], known: np.ndarray
) -> dict[str, Any]:
    """Points of two directions, and the median of each candidate's curve by direction; residuals in mrad."""
    points, curves = {}, {name: {} for name in expected}
    usable = known[np.isfinite(axis.values[known])]
    if not len(usable):
        return {"name": axis.name, "unit": axis.unit, "points": points, "curves": curves}
    edges = np.linspace(axis.values[usable].min(), axis.values[usable].max(), _BINS + 1)
    for sign, name in ((1.0, "moving up"), (-1.0, "moving down")):
        chosen = usable[way[usable] == sign]
        shown = chosen[:: max(len(chosen) // _POINTS, 1)]
        points[name] = [listed(axis.values[shown], 5), listed(1e3 * residual[shown], 3)]
        for candidate, values in expected.items():
            curves[candidate][name] = _median(edges, axis.values[chosen], 1e3 * values[chosen])
    return {"name": axis.name, "unit": axis.unit, "points": points, "curves": curves}


def _median(edges: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[list[Any]]:
    place = np.clip(np.digitize(x, edges) - 1, 0, _BINS - 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    values = np.full(_BINS, np.nan)
    for index in range(_BINS):
        inside = y[place == index]
        if inside.size >= _FEWEST:
            values[index] = np.median(inside)
    return [listed(middle, 5), listed(values, 3)]

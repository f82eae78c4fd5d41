"""The region that a version was fitted in: where each joint was, how fast, under which load; and what lies outside.

A fit says how the robot moves where it was fitted. Beyond that it extrapolates: a friction that grows with the load
cannot be seen where nothing loads the joint. Quantities are taken by joint, each on its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import mujoco
import numpy as np
from pydantic import BaseModel, ConfigDict

from twin_daemon.comparison.conditions import smooth_speed
from twin_daemon.simulation.alignment import MOVING_RAD, Aligned
from twin_daemon.simulation.twin import TwinModel

Quantity = Literal["position", "speed", "load"]
UNITS: dict[Quantity, str] = {"position": "rad", "speed": "rad/s", "load": "N m"}

_TRIMMED = 0.005  # of the samples at each end: single readings are no region
_MARGIN = 0.1  # of a range's width: so little beyond it a smooth law still holds
_LEAST = {"position": MOVING_RAD, "speed": 0.05, "load": 0.0}  # a joint that holds still jitters by as much
_SAME_LOAD = 0.05  # of the largest load that was seen: a model's masses are not known better
_OFTEN = 0.05  # of the time, from which on a motion counts as outside; by trimming a fit's own leaves 1 %
_POSES = 2000  # of a recording, evenly spread, at which the load is computed


class JointRegion(BaseModel):
    """What one joint went through, each as (lowest, highest): rad, rad/s without sign, N m."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    position: tuple[float, float]
    speed: tuple[float, float]
    load: tuple[float, float]
    """The torque with which gravity and springs pull at the joint where it is, at rest."""


class Region(BaseModel):
    """What each joint went through in the recordings of a fit, by joint."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    joints: dict[str, JointRegion]

    def beside(self, earlier: Region | None, moved: Sequence[str]) -> Region:
        """The region of a fit on top of an earlier one: joints that have not `moved` are as that one knew them."""
        if earlier is None:
            return self
        kept = {name: one for name, one in earlier.joints.items() if name not in moved}
        return Region(joints={**self.joints, **kept})


class Outside(BaseModel):
    """One quantity of one joint that leaves the region for more than a twentieth of the time."""

    model_config = ConfigDict(frozen=True)

    joint: str
    quantity: Quantity
    unit: str
    share: float
    """Of the time."""
    seen: tuple[float, float]
    """What the version was fitted in."""
    here: tuple[float, float]
    """What the motion has."""

    def __str__(self) -> str:
        (low, high), (least, most) = self.seen, self.here
        return (
            f"{self.joint}: {self.quantity} {least:.3g} to {most:.3g} {self.unit}, fitted in {low:.3g} to {high:.3g}, "
            f"outside for {self.share:.0%} of the time"
        )


def quantities(twin: TwinModel, recording: Aligned) -> dict[Quantity, np.ndarray]:
    """(m, j) of up to 2000 samples of a recording in the order of the twin's joints; NaN where nothing was measured."""
    rows = np.unique(np.linspace(0, len(recording.time_s) - 1, _POSES).round().astype(int))
    states = recording.measured
    speed = np.full_like(states, np.nan)
    for column in np.flatnonzero(np.isfinite(states).sum(axis=0) > 2):
        speed[:, column] = np.abs(smooth_speed(recording.time_s, states[:, column]))
    speed[~np.isfinite(states)] = np.nan
    start = np.nan_to_num(recording.start_position)
    poses = np.where(np.isfinite(recording.states[rows]), recording.states[rows], start)
    load = static_load(twin, twin.measurement.invert(twin.joints, poses))
    load[~np.isfinite(states[rows])] = np.nan
    return {"position": states[rows], "speed": speed[rows], "load": load}


def static_load(twin: TwinModel, poses: np.ndarray, data: mujoco.MjData | None = None) -> np.ndarray:
    """(m, j) N m: what gravity and springs pull each joint with at poses (m, j) rad, at rest. Uses `data`, if given."""
    model = twin.model
    at: Any = mujoco.MjData(model) if data is None else data
    found = np.empty((len(poses), len(twin.joints)))
    for row, pose in enumerate(poses):
        at.qpos[twin.qpos_adr] = pose
        mujoco.mj_fwdPosition(model, at)
        mujoco.mj_fwdVelocity(model, at)
        found[row] = (at.qfrc_passive - at.qfrc_bias)[twin.dof_adr]
    return found


def region_of(twin: TwinModel, recordings: Sequence[Aligned]) -> Region | None:
    """The region of recordings, by the twin that was fitted to them; None of none."""
    if not recordings:
        return None
    each = [quantities(twin, recording) for recording in recordings]
    joints = {}
    for column, name in enumerate(twin.joints):
        columns = {quantity: np.concatenate([one[quantity][:, column] for one in each]) for quantity in UNITS}
        if np.isfinite(columns["position"]).any():
            joints[name] = JointRegion(**{quantity: _range(values) for quantity, values in columns.items()})
    return Region(joints=joints)


def outside(twin: TwinModel, region: Region, recordings: Sequence[Aligned]) -> list[Outside]:
    """What of the recordings lies outside of a region, the longest first."""
    each = [quantities(twin, recording) for recording in recordings]
    found = []
    for column, name in enumerate(twin.joints):
        for quantity, unit in UNITS.items():
            values = np.concatenate([one[quantity][:, column] for one in each]) if each else np.empty(0)
            values = values[np.isfinite(values)]
            if not values.size or name not in region.joints:
                continue
            seen = getattr(region.joints[name], quantity)
            share = float(beyond(seen, quantity, values).mean())
            if share > _OFTEN:
                here = _range(values)
                found.append(Outside(joint=name, quantity=quantity, unit=unit, share=share, seen=seen, here=here))
    return sorted(found, key=lambda one: -one.share)


def beyond(seen: tuple[float, float], quantity: Quantity, values: np.ndarray) -> np.ndarray:
    """(n,) bool: which values of a quantity lie further outside of a range than a smooth law may be trusted."""
    low, high = seen
    margin = max(_MARGIN * (high - low), _LEAST[quantity])
    if quantity == "load":
        margin = max(margin, _SAME_LOAD * max(abs(low), abs(high)))
    under = np.zeros(len(values), bool) if quantity == "speed" else values < low - margin  # slower is no extrapolation
    return under | (values > high + margin)


def region_report(twin: TwinModel, region: Region | None, recordings: Sequence[Aligned]) -> dict[str, Any]:
    """What a command writes: whether a version's region is known, and what of the recordings lies outside of it."""
    found = [] if region is None else outside(twin, region, recordings)
    return {"known": region is not None, "outside": [one.model_dump() for one in found]}


def _range(values: np.ndarray) -> tuple[float, float]:
    low, high = np.nanquantile(values, [_TRIMMED, 1.0 - _TRIMMED])
    return float(low), float(high)

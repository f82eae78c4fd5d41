"""Before any fit: what the data are worth, and what each parameter would get from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.calibration.spaces import Space, objective_of, variables_of
from twin_daemon.estimation.subproblems import reduced_problems
from twin_daemon.estimation.thresholds import (
    MODEL_ERROR_RAD,
    SATURATED_SHARE,
)
from twin_daemon.estimation.uncertainty import Estimate, estimates
from twin_daemon.estimation.windows import excerpts
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.twin import TwinModel

ADVICE = {
    "damping": "move at two clearly different speeds",
    "tendon_damping": "move at two clearly different speeds",
    "frictionloss": "add small slow reversals",
    "friction_softness": "hold still where friction keeps the joint from its target",
    "tendon_frictionloss": "add small slow reversals of the coupled pair",
    "armature": "add steps, so that the joint accelerates hard",
    "stiffness": "hold at several angles over the range",
    "springref": "hold at several angles over the range",
    "preload": "hold at several angles and approach each from both sides",
    "kp": "hold against a known load, or at several angles under gravity",
    "range_lower": "drive gently into the lower end stop",
    "range_upper": "drive gently into the upper end stop",
    "mass": "hold at several angles under gravity",
    "inertia": "add steps, so that the body accelerates hard",
    "com_x": "hold at several angles under gravity",
    "com_y": "hold at several angles under gravity",
    "com_z": "hold at several angles under gravity",
}
"""The motion that tells a kind of parameter."""


def prospects(twin: TwinModel, recordings: Sequence[Aligned], space: Space) -> dict[str, Estimate]:
    """What the data would say of each parameter of the space, from the sensitivity of the twin's roll-out.

    The value is the present one, its interval the one to expect.
    """
    moving = moving_joints(recordings)
    if not moving:
        return {}
    variables = variables_of(space, twin, moving)
    objective = objective_of(space, twin, moving)
    found: dict[str, Estimate] = {}
    for sub in reduced_problems(twin, excerpts(recordings), variables, objective, separable=True):
        expected = estimates(sub.problem, sub.problem.start, error_floor_rad=MODEL_ERROR_RAD, expected=True)
        found |= zip((v.name for v in sub.problem.variables), expected, strict=True)
    return found


def advice(name: str, prospect: Estimate) -> str | None:
    """The motion that would tell a parameter; None where these data tell it, or nothing is known to."""
    return None if prospect.identifiable == "identifiable" else ADVICE.get(name.rpartition(".")[2])


def saturated_joints(twin: TwinModel, recording: Aligned) -> list[str]:
    """Joints whose command lies at or beyond the end of its actuator's range for a while."""
    limited = twin.model.actuator_ctrllimited.astype(bool)
    low, high = twin.model.actuator_ctrlrange.T
    controls = recording.controls(twin, recording.time_s)
    outside = ((controls > high + 1e-3) | (controls < low - 1e-3)) & limited
    share = outside.mean(axis=0)
    return [twin.actuators[i] for i in np.flatnonzero(share > SATURATED_SHARE)]

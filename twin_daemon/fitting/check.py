"""Before any fit: what the data are worth, and what each parameter would get from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.fitting.excerpts import excerpts
from twin_daemon.fitting.intervals import Identifiability, intervals
from twin_daemon.fitting.reduce import reduced_problems
from twin_daemon.fitting.spaces import Space, knobs_of, objective_of
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

MODEL_ERROR_RAD = 2e-3
"""What even a good model of a hand is off by, from the time step and the sensors: the error to reckon with."""

_SATURATED_SHARE = 0.02

ADVICE = {
    "damping": "move at two clearly different speeds",
    "tendon_damping": "move at two clearly different speeds",
    "frictionloss": "add small slow reversals",
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


@dataclass(frozen=True)
class Prospect:
    """What the data would say of one parameter. `sigma` is its expected 95 % half-width, in `unit`."""

    verdict: Identifiability
    unit: str
    ci95_width: float
    confused_with: str | None
    advice: str | None


def prospects(twin: TwinModel, recordings: Sequence[Aligned], space: Space) -> dict[str, Prospect]:
    """For each parameter of the space, from the sensitivity of the twin's roll-out at its present values."""
    moving = moving_joints(twin, recordings)
    if not moving:
        return {}
    knobs = knobs_of(space, twin, moving)
    objective = objective_of(space, twin, moving)
    out: dict[str, Prospect] = {}
    for sub in reduced_problems(twin, excerpts(recordings), knobs, objective, separable=True):
        spans = intervals(sub.problem, sub.problem.start, error_floor_rad=MODEL_ERROR_RAD, expected=True)
        for knob, span in zip(sub.problem.knobs, spans, strict=True):
            kind = knob.name.rpartition(".")[2]
            advice = None if span.identifiability == "identifiable" else ADVICE.get(kind)
            out[knob.name] = Prospect(
                span.identifiability, knob.unit, span.upper - span.lower, span.confused_with, advice
            )
    return out


def moving_joints(twin: TwinModel, recordings: Sequence[Aligned]) -> tuple[str, ...]:
    """The joints that move in any of the recordings."""
    return tuple(name for i, name in enumerate(twin.joints) if any(r.moving[i] for r in recordings))


def saturated_joints(twin: TwinModel, recording: Aligned) -> list[str]:
    """Joints whose command lies at or beyond the end of its actuator's range for a while."""
    limited = twin.model.actuator_ctrllimited.astype(bool)
    low, high = twin.model.actuator_ctrlrange.T
    controls = recording.controls(twin, recording.time_s)
    outside = ((controls > high + 1e-3) | (controls < low - 1e-3)) & limited
    share = outside.mean(axis=0)
    return [twin.actuators[i] for i in np.flatnonzero(share > _SATURATED_SHARE)]

"""What is uncertain about any nominal model, and how uncertain: the nuisances of a diagnosis.

Every candidate is fitted together with them, so that a friction which is 10 % off does not become a "missing
effect"; their priors keep them from standing in for one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.fitting.knobs import Knob, Prior
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

PARAMETER_SIGMA = 0.12
"""Of the logarithm of a nominal parameter: +-20 % is within 1.7 sigma."""

DELAY_SIGMA_S = 0.003
"""Of the command's time where it was recorded: half a period of a stream, which is held or interpolated."""

FREE_ONSET_SIGMA_S = 0.05
OFFSET_SIGMA_RAD = 1.5e-3

_KINDS = ("damping", "frictionloss", "armature")
_REACH = 6.0  # of the parameters, as a factor: far enough for a nuisance to betray that it has to move

# The nuisance that a candidate itself moves is dropped for it: the candidate speaks for it.
OWN = {
    "viscous_friction": "damping",
    "coulomb_friction": "frictionloss",
    "armature": "armature",
    "actuator_gain": "kp",
}


def nuisance_knobs(twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str]) -> tuple[Knob, ...]:
    """Scale factors of the moving joints' parameters and of their servos' gains, and each recording's delay."""
    knobs = []
    for kind in _KINDS:
        for joint in joints:
            name = f"{joint}.{kind}"
            if twin.parameter(name).read(twin.model) > 0.0:
                knobs.append(_scale(name, joint))
    for actuator, row in zip(twin.actuators, twin.drive, strict=True):
        driven = [twin.joints[j] for j in np.flatnonzero(row)]
        if set(driven) & set(joints) and twin.parameter(f"{actuator}.kp").read(twin.model) > 0.0:
            knobs.append(_scale(f"{actuator}.kp", *driven))
    for number, (_, members) in enumerate(_by_recording(recordings).items()):
        sigma = FREE_ONSET_SIGMA_S if recordings[members[0]].onset_free else DELAY_SIGMA_S
        writes = tuple(("onset", str(index)) for index in members)
        reach = 8.0 * sigma
        knobs.append(Knob(f"delay.{number}", "s", -reach, reach, 0.0, False, writes, prior=Prior(0.0, sigma)))
    return tuple(knobs)


def _by_recording(pieces: Sequence[Aligned]) -> dict[str, list[int]]:
    """Indices of the pieces that come from one recording: they share its clock."""
    out: dict[str, list[int]] = {}
    for index, piece in enumerate(pieces):
        out.setdefault(piece.recording.sha256, []).append(index)
    return out


def _scale(name: str, *joints: str) -> Knob:
    return Knob(
        name=name,
        unit="of nominal",
        lower=1.0 / _REACH,
        upper=_REACH,
        start=1.0,
        log=True,
        writes=(("parameter", name),),
        mode="scale",
        prior=Prior(0.0, PARAMETER_SIGMA),
        joints=joints,
    )


def sigmas(knob: Knob, unit: float) -> float:
    """How many sigma a knob at a unit coordinate is from its prior."""
    if knob.prior is None:
        return 0.0
    return (knob.low + unit * (knob.high - knob.low) - knob.prior.mean) / knob.prior.sigma

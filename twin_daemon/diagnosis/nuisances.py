"""What is uncertain about any nominal model, and how uncertain: the nuisances of a diagnosis.

Every candidate is fitted together with them, so that a friction which is 10 % off does not become a "missing
effect"; their priors keep them from standing in for one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

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
_DELAY_REACH = 3.0  # of its sigma: all joints share it, so that one late joint must not spoil the others
_REACH = 12.0  # of the parameters, as a factor: far enough for a nuisance to betray that it has to move

# The nuisance that a candidate itself moves is dropped for it: the candidate speaks for it.
OWN = {
    "viscous_friction": "damping",
    "coulomb_friction": "frictionloss",
    "armature": "armature",
    "actuator_gain": "kp",
}


def nuisance_knobs(twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str]) -> tuple[Knob, ...]:
    """Scale factors of the moving joints' parameters and of their servos' gains, and each recording's delay.

    A servo that is twice as strong before twice the friction and inertia moves the same, but for gravity. So that a
    search may walk along this valley, a servo's factor scales what it drives as well, and the factors of damping,
    friction and armature are what they have beyond it. Priors are about the whole factor of each parameter.
    """
    driven_by = {f"{actuator}.kp": driven for actuator, driven in zip(twin.actuators, twin.driven, strict=True)}
    known = {
        name: joint
        for kind in _KINDS
        for joint in joints
        if twin.parameter(name := f"{joint}.{kind}").read(twin.model) > 0.0
    }
    knobs = [_scale(name, (name,), joint) for name, joint in known.items()]
    for servo, driven in driven_by.items():
        if set(driven) & set(joints) and twin.parameter(servo).read(twin.model) > 0.0:
            along = [name for name, joint in known.items() if joint in driven]
            knobs.append(_scale(servo, (servo, *along), *driven))
    for number, (_, members) in enumerate(_by_recording(recordings).items()):
        sigma = FREE_ONSET_SIGMA_S if recordings[members[0]].onset_free else DELAY_SIGMA_S
        writes = tuple(("onset", str(index)) for index in members)
        reach = _DELAY_REACH * sigma
        knobs.append(Knob(f"delay.{number}", "s", -reach, reach, 0.0, False, writes, prior=Prior(0.0, sigma)))
    return tuple(knobs)


def beside(knobs: Sequence[Knob], spoken: Collection[str]) -> tuple[Knob, ...]:
    """The nuisances beside candidates that speak for some of them: without these, and without turning what they turn.

    An effect adds to what the model has. If a servo's factor went on scaling that, the effect's value would count from
    a friction or armature that nobody has stated.
    """
    kept = [knob for knob in knobs if knob.name not in spoken]
    return tuple(replace(k, writes=tuple(w for w in k.writes if w[-1] not in spoken)) for k in kept)


def factors(knobs: Sequence[Knob], values: Mapping[str, float]) -> dict[str, float]:
    """The whole factor on each nominal parameter, by name: factors on one parameter multiply. `values` by knob."""
    found: dict[str, float] = {}
    for knob in knobs:
        for kind, name, *_ in knob.writes:
            if kind == "parameter":
                found[name] = found.get(name, 1.0) * values[knob.name]
    return found


def _by_recording(pieces: Sequence[Aligned]) -> dict[str, list[int]]:
    """Indices of the pieces that come from one recording: they share its clock."""
    out: dict[str, list[int]] = {}
    for index, piece in enumerate(pieces):
        out.setdefault(piece.recording.sha256, []).append(index)
    return out


def _scale(name: str, parameters: tuple[str, ...], *joints: str) -> Knob:
    return Knob(
        name=name,
        unit="of nominal",
        lower=1.0 / _REACH,
        upper=_REACH,
        start=1.0,
        log=True,
        writes=tuple(("parameter", parameter) for parameter in parameters),
        mode="scale",
        prior=Prior(0.0, PARAMETER_SIGMA),
        joints=joints,
    )

"""What is uncertain about any nominal model, and how uncertain: the nuisances of a diagnosis.

Every candidate is fitted together with them, so that a friction which is 10 % off does not become a "missing
effect"; their priors keep them from standing in for one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.thresholds import (
    DELAY_CYCLES,
    DELAY_REACH,
    FREE_ONSET_SIGMA_S,
    NUISANCE_REACH,
    SHARED_SPREAD,
)
from twin_daemon.estimation.variables import LinkVariable, OnsetVariable, ParameterVariable, Prior, Variable
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

_KINDS = ("damping", "frictionloss", "armature")
NOMINAL_KINDS = (*_KINDS, "kp")


def nuisance_variables(twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str]) -> tuple[Variable, ...]:
    """Scale factors of the moving joints' parameters and of their servos' gains, and each recording's delay.

    A servo that is twice as strong before twice the friction and inertia moves the same, but for gravity. So that a
    search may walk along this valley, a servo's factor scales what it drives as well, and the factors of damping,
    friction and armature are what they have beyond it. Priors are about the whole factor of each parameter; beside a
    cause that all joints share they are as much wider as joints of one robot differ in it.
    """
    spread = _spread(twin)
    assumed = twin.hand.description.nominal_uncertainty
    driven_by = {f"{actuator}.kp": driven for actuator, driven in zip(twin.actuators, twin.driven, strict=True)}
    known = {
        name: joint
        for kind in _KINDS
        for joint in joints
        if twin.parameter(name := f"{joint}.{kind}").read(twin.base_model) > 0.0
    }
    found: list[Variable] = [
        _factor(name, (name,), sigma, joint)
        for name, joint in known.items()
        if (sigma := float(np.hypot(assumed.of(name), spread.get(name, 0.0)))) > 0.0
    ]
    for servo, driven in driven_by.items():
        sigma = assumed.of(servo)
        if sigma > 0.0 and set(driven) & set(joints) and twin.parameter(servo).read(twin.base_model) > 0.0:
            along = [v.name for v in found if set(v.joints) <= set(driven)]
            found.append(_factor(servo, (servo, *along), sigma, *driven))
    for number, (_, members) in enumerate(_by_recording(recordings).items()):
        sigma = _delay_sigma_s(recordings[members[0]])
        reach = DELAY_REACH * sigma
        prior = Prior(0.0, sigma)
        found.append(OnsetVariable(f"delay.{number}", "s", -reach, reach, 0.0, recordings=tuple(members), prior=prior))
    return (*found, *_link_variables(recordings, joints))


def _spread(twin: TwinModel) -> dict[str, float]:
    """By name of a parameter: sigma of the logarithm of what its joint has more or less of what all joints have.

    Cold grease gives no two joints the same share of their friction.
    """
    shared = [(t, LIBRARY[t.effect]) for t in twin.terms.effects]
    return {
        f"{term.target}.{effect.stands_for}": SHARED_SPREAD * abs(float(np.log1p(term.values[effect.everywhere])))
        for term, effect in shared
        if effect.everywhere
    }


def _delay_sigma_s(recording: Aligned) -> float:
    """How well the time at which a command takes effect is known: within a cycle of the robot, where it is recorded."""
    if recording.onset_sigma_s is not None:
        return recording.onset_sigma_s
    if recording.onset_free:
        return FREE_ONSET_SIGMA_S
    return DELAY_CYCLES * float(np.median(np.diff(recording.time_s)))


def _link_variables(recordings: Sequence[Aligned], joints: Sequence[str]) -> list[LinkVariable]:
    """Combinations of uncertain link masses, where the recordings carry what these do."""
    reaction = recordings[0].reaction if recordings else None
    if reaction is None or reaction.links is None:
        return []
    return [
        LinkVariable(
            name=f"{joints[0]}.link_masses_{number + 1}",
            unit="sigma",
            lower=-NUISANCE_REACH,
            upper=NUISANCE_REACH,
            start=0.0,
            prior=Prior(0.0, 1.0),
            number=number,
        )
        for number in range(reaction.links.torque.shape[2])
    ]


def beside(variables: Sequence[Variable], spoken: Collection[str]) -> tuple[Variable, ...]:
    """The nuisances beside candidates that speak for some of them: without these, and without what they multiply.

    An effect adds to what the model has. If a servo's factor went on scaling that, the effect's value would count from
    a friction or armature that nobody has stated.
    """
    return tuple(v.without(spoken) for v in variables if v.name not in spoken)


def factors(variables: Sequence[Variable], values: Mapping[str, float]) -> dict[str, float]:
    """The whole factor on each nominal parameter, by name: factors on one parameter multiply. `values` by variable."""
    found: dict[str, float] = {}
    for variable in variables:
        for name in variable.factors:
            found[name] = found.get(name, 1.0) * values[variable.name]
    return found


def carried_over(
    variables: Sequence[Variable], point: np.ndarray, recordings: Sequence[Aligned]
) -> tuple[list[int], list[Aligned]]:
    """What a fit at a point (p,) says of other recordings: (where the variables are that these share, the recordings).

    Onsets are a recording's own: the commands of the others come as much later as those of the fit did on average.
    """
    kept = [index for index, v in enumerate(variables) if not isinstance(v, OnsetVariable)]
    shifts = [v.value(point[index]) for index, v in enumerate(variables) if isinstance(v, OnsetVariable)]
    shift_s = float(np.mean(shifts)) if shifts else 0.0
    return kept, [r.with_onset(r.onset_s + shift_s) for r in recordings]


def between_sessions(twin: TwinModel, variables: Sequence[Variable]) -> np.ndarray:
    """(p,) one sigma of what a value may have more or less in another session, in unit coordinates; 0 for most."""
    share = twin.hand.description.nominal_uncertainty.between_sessions
    uncertain = [isinstance(v, ParameterVariable) and v.factor and v.prior is not None for v in variables]
    return np.array([share / (v.high - v.low) if one else 0.0 for one, v in zip(uncertain, variables, strict=True)])


def _by_recording(pieces: Sequence[Aligned]) -> dict[str, list[int]]:
    """Indices of the pieces that come from one recording: they share its clock."""
    out: dict[str, list[int]] = {}
    for index, piece in enumerate(pieces):
        out.setdefault(piece.recording.sha256, []).append(index)
    return out


def _factor(name: str, parameters: tuple[str, ...], sigma: float, *joints: str) -> ParameterVariable:
    return ParameterVariable(
        name=name,
        unit="of nominal",
        lower=1.0 / NUISANCE_REACH,
        upper=NUISANCE_REACH,
        start=1.0,
        log=True,
        parameters=parameters,
        factor=True,
        prior=Prior(0.0, sigma),
        joints=joints,
    )

"""What may change between two sessions in one group of joints, each on a scale of its own."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.changes.thresholds import (
    ABSENT,
    CREEPS,
    DAMPING_SHARE,
    DAMPING_SHARE_SIGMA,
    LOAD_FRICTION_ERROR,
    MOTOR_SHARE,
    SHARED_SIGMA,
    SHARED_UNITS,
    SLAB,
    SLAB_UNITS,
    SPIKE,
    SPIKE_UNITS,
    TENDON_ERROR,
    VISIBLE,
    VISIBLE_UNITS,
)
from twin_daemon.effects import LIBRARY
from twin_daemon.simulation.parameters import KINDS
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

STANDS_FOR = {"damping": "viscous_friction", "frictionloss": "coulomb_friction", "kp": "actuator_gain"}
"""The effect under whose key the change of a parameter is a finding, by the parameter's kind."""

_KEPT = ("armature",)  # kinds that are uncertain, and do not wear
_LAW_ERRORS = {"load_friction": LOAD_FRICTION_ERROR, "tendon_elasticity": TENDON_ERROR}
_OF_JOINTS = ("load_friction", "sensor_offset", "sensor_gain", "spring", "nonlinear_spring")


@dataclass(frozen=True)
class Quantity:
    """One number of the robot that both sessions have, as a coordinate z which is 0 where the model is.

    A parameter's z is the logarithm of its factor. An effect's is its amount beside `nominal` in units of a typical
    one, `typical`; that of a compliance is over the stiffness. `wears` says that its change is a candidate. `beside`
    names the quantity without which it says nothing, such as the spring that has this preload: it is there, and has
    changed, where that one is and has.
    """

    name: str
    effect: str
    target: str
    joints: tuple[str, ...]
    unit: str
    nominal: float
    typical: float = 1.0
    parameter: str | None = None
    signed: bool = False
    beside: str = ""
    wears: bool = True
    shared_sigma: float = SHARED_SIGMA
    spike: float = SPIKE
    slab: float = SLAB
    visible: float = VISIBLE
    motor_share: float = MOTOR_SHARE
    creep: float = 0.0

    @property
    def law_error(self) -> float:
        """How far an effect's amount is off whatever the recordings say, one sigma of its logarithm."""
        return _LAW_ERRORS.get(self.effect, 0.0)

    @property
    def is_parameter(self) -> bool:
        return self.parameter is None

    @property
    def grows(self) -> bool:
        """Whether it is an effect of which there is none or some, as a play."""
        return not self.is_parameter and not self.signed

    @property
    def may_only_pull(self) -> bool:
        """Whether it may be there with none of its own amount, as a spring that has a preload."""
        return self.grows and len(LIBRARY[self.effect].presence) > 1

    def value(self, z: float) -> float | None:
        """In `unit`; None for the stiffness of what is rigid."""
        if self.is_parameter:
            return float(self.nominal * np.exp(z))
        if self.parameter == "stiffness" and self.effect == "tendon_elasticity":
            return float(self.typical / z) if z > 0.0 else None
        return float(self.nominal + z * self.typical)

    def laws(self) -> tuple[Quantity, ...]:
        """It by every law that it may follow: friction that grows with the load holds at rest, or creeps."""
        if self.effect == "load_friction":
            return tuple(replace(self, creep=float(creep)) for creep in CREEPS)
        return (self,)

    def term(self, z: float, beside: Mapping[str, float] | None = None) -> EffectTerm:
        """An effect at an amount with the values `beside` it, its others as they usually are."""
        effect = LIBRARY[self.effect]
        amount = self.value(z)
        assert self.parameter is not None
        values = effect.neutral() | {p.name: p.default for p in effect.parameters if p.log or p.held}
        own = {"motor_share": self.motor_share, "creep": self.creep}
        values |= {name: float(one) for name, one in own.items() if name in values}
        values |= beside or {}
        values[self.parameter] = effect.neutral()[self.parameter] if amount is None else amount
        return EffectTerm(effect=self.effect, target=self.target, values=effect.complete(effect.clipped(values)))


def quantities(twin: TwinModel, joints: Sequence[str], spread: float = SPIKE) -> tuple[Quantity, ...]:
    """Everything that a group's joints and servos have: what the model states, and what may be there beside it.

    `spread` is how much a parameter differs between sessions without wear, one sigma of its logarithm.
    """
    found: list[Quantity] = []
    driving = [(a, d) for a, d in zip(twin.actuators, twin.driven, strict=True) if set(d) & set(joints)]
    missing: list[tuple[str, str]] = []
    for joint in joints:
        for kind in ("damping", "frictionloss", "armature"):
            name = f"{joint}.{kind}"
            nominal = twin.parameter(name).read(twin.base_model)
            if nominal > 0.0:
                found.append(_parameter(name, joint, (joint,), kind, nominal, spread))
            elif kind not in _KEPT:
                missing.append((STANDS_FOR[kind], joint))
    for servo, driven in driving:
        nominal = twin.parameter(f"{servo}.kp").read(twin.base_model)
        if nominal > 0.0:
            found.append(_parameter(f"{servo}.kp", servo, driven, "kp", nominal, spread))
    places = [*missing, *((key, joint) for joint in joints for key in _OF_JOINTS)]
    places += [(key, servo) for servo, _ in driving for key in ("backlash", "tendon_elasticity")]
    present = {(term.effect, term.target) for term in twin.terms.effects}
    for key, target in places:
        if (key, target) not in present and LIBRARY[key].applies(twin.place(target)):
            effect = _effect(twin, key, target, joints)
            found += [effect, *_beside(twin, effect)]
    return tuple(found)


def term_of(every: Sequence[Quantity], index: int, amounts: Mapping[int, float] | np.ndarray) -> EffectTerm:
    """An effect with what is said beside it, at the amounts that all effects have by their index."""
    owner = every[index]
    beside = {
        q.parameter or "": q.value(float(amounts[i])) or 0.0 for i, q in enumerate(every) if q.beside == owner.name
    }
    return owner.term(max(float(amounts[index]), 0.0) if owner.grows else float(amounts[index]), beside)


def with_companions(every: Sequence[Quantity], some: Collection[int]) -> frozenset[int]:
    """The indices `some` and those of the quantities that are said beside them."""
    names = {every[i].name for i in some}
    return frozenset({*some, *(i for i, quantity in enumerate(every) if quantity.beside in names)})


def _parameter(name: str, target: str, joints: tuple[str, ...], kind: str, nominal: float, spread: float) -> Quantity:
    return Quantity(
        name=name,
        effect=STANDS_FOR.get(kind, kind),
        target=target,
        joints=joints,
        unit=KINDS[kind].unit,
        nominal=nominal,
        wears=kind not in _KEPT,
        spike=spread,
    )


def _effect(twin: TwinModel, key: str, target: str, joints: Sequence[str]) -> Quantity:
    effect, scale = LIBRARY[key], twin.scale(target)
    typical, parameter, signed = {
        "load_friction": (0.2, "coefficient", False),
        "sensor_offset": (0.02, "offset", True),
        "sensor_gain": (0.05, "factor", True),
        "spring": (0.03 * scale.kp, "stiffness", False),
        "nonlinear_spring": (0.1 * scale.kp / max(0.5 * scale.span, 1e-3) ** 2, "cubic", False),
        "backlash": (0.02, "gap", False),
        "tendon_elasticity": (4.0 * scale.kp, "stiffness", False),
        "viscous_friction": (0.02 * scale.kp, "damping", False),
        "coulomb_friction": (0.01 * scale.kp, "friction", False),
    }[key]
    return Quantity(
        name=f"{key}:{target}.{parameter}",
        effect=key,
        target=target,
        joints=tuple(joint for joint in twin.joints_of(target) if joint in joints),
        unit=_unit(key, parameter),
        nominal=effect.neutral()[parameter] if signed else 0.0,
        typical=typical,
        parameter=parameter,
        signed=signed,
        shared_sigma=SHARED_UNITS,
        spike=SPIKE_UNITS,
        slab=SLAB_UNITS,
        visible=VISIBLE_UNITS,
    )


def _beside(twin: TwinModel, owner: Quantity) -> tuple[Quantity, ...]:
    """What else says how an effect acts: a spring's preload, the angle about which one that stiffens is slack, and how
    much of a joint's damping is on the motor's side of what gives."""
    scale = twin.scale(owner.target)
    if owner.effect == "spring":
        return (_companion(owner, "preload", 0.01 * scale.kp, 0.0, SPIKE_UNITS, SLAB_UNITS),)
    if owner.effect == "nonlinear_spring":
        middle = 0.5 * (scale.lower + scale.upper)
        return (_companion(owner, "centre", 0.25 * scale.span, middle, ABSENT, ABSENT),)
    if owner.effect == "tendon_elasticity":
        return (_companion(owner, "damping_share", DAMPING_SHARE_SIGMA, DAMPING_SHARE, ABSENT, ABSENT),)
    return ()


def _companion(owner: Quantity, parameter: str, typical: float, nominal: float, spike: float, slab: float) -> Quantity:
    return replace(
        owner,
        name=f"{owner.effect}:{owner.target}.{parameter}",
        parameter=parameter,
        unit=_unit(owner.effect, parameter),
        nominal=nominal,
        typical=typical,
        signed=True,
        wears=False,
        beside=owner.name,
        spike=spike,
        slab=slab,
    )


def _unit(effect: str, parameter: str) -> str:
    return next(p.unit for p in LIBRARY[effect].parameters if p.name == parameter)

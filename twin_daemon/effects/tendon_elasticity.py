"""The transmission gives: the motor is not where the joint is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Story
from twin_daemon.effects.transmission import DAMPING_SHARE, MOTOR_SHARE, implicit_spring, motor_side

_RIGID = 1e5
_LOSS_S = 0.002  # damping over stiffness of the material


class TendonElasticity(Effect):
    """A spring in series between the motor, which the servo controls, and the joint, which is measured."""

    key = "tendon_elasticity"
    title = "an elastic tendon"
    acts_on = "actuator"
    rank = 210
    dissipative = True
    neutral_within_rad = 5e-4  # a rigid link is a very stiff one: see above
    parameters = (
        Parameter(
            "stiffness",
            "N m/rad",
            0.1,
            _RIGID,
            _RIGID,
            20.0,
            "stiffness between motor and joint",
            log=True,
            reach=Reach("kp", 1e4),  # the range above is that of a servo of 10 N m/rad
        ),
        MOTOR_SHARE,
        DAMPING_SHARE,
    )
    story = Story(
        what="The servo holds the motor, and between motor and joint something stretches.",
        shows="The joint yields under load although the servo does its work; it rings after steps.",
        cause="A tendon that has lengthened or frayed, a soft coupling, a cracked part.",
        remedy="Renew or retension the tendon.",
        excitation="steps and holds under different loads",
    )
    confusable = ("actuator_gain", "backlash", "viscous_friction", "payload", "spring")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        link = motor_side(spec, place, values)
        stiffness = values["stiffness"]
        solref, solimp = implicit_spring(spec, link.tendon, stiffness, _LOSS_S * stiffness)
        tie = spec.add_equality(name=link.tendon, type=mujoco.mjtEq.mjEQ_TENDON, name1=link.tendon)
        tie.objtype = mujoco.mjtObj.mjOBJ_TENDON
        tie.solref, tie.solimp = solref, solimp

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"stiffness": factor * scale.kp, "motor_share": 0.5} for factor in (0.5, 2.0, 8.0, 32.0))

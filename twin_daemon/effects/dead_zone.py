"""A controller that is silent near its target."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Seen, Story, silent_joint
from twin_daemon.effects.edits import servo_damping, servo_stiffness
from twin_daemon.effects.transmission import implicit_step, pulled_joints

_STIFF = 1000.0  # the ends of the band over the servo
_LOSS_STEPS = 0.2  # damping over stiffness at these ends, in time steps: they are met without rebound
_LIGHT = 0.2  # inertia of what yields within the band, over what the servo moves in one time step
_NEVER = 1e3  # rad: an error that no servo has
_OVERLAP = 5e-4  # rad: each end begins this early, so that a closed band is held from both sides at once
_CLOSED = 1e-9  # rad: MuJoCo wants an upper limit above the lower one


class DeadZone(Effect):
    """The servo acts on `joint + s`, where `s` yields to it freely within the band: torque = stiffness * (error - s).

    So it pulls with nothing inside of the band and with its own stiffness, from zero, outside of it, within the limits
    that it has. `s` has hardly any inertia, and as much damping as brings it to the error within one time step.

    Play behind a motor that weighs nothing is the same law, as within its gap such a motor goes to the target at once:
    backlash with a small `motor_share`. Only a motor whose own inertia and damping show tells the two apart.
    """

    key = "dead_zone"
    title = "a controller that is silent near its target"
    acts_on = "actuator"
    rank = 230
    neutral_within_rad = 5e-4  # a closed band is a very stiff one: see above
    parameters = (Parameter("band", "rad", 0.0, 0.5, 0.0, 0.03, "error, either way, up to which it gives no torque"),)
    story = Story(
        what="The controller gives no torque while the joint is within a band about its target.",
        shows="The joint comes to rest anywhere within the band, on the side that it came from or where its load pulls "
        "it, and lags by the band while it moves.",
        cause="A dead zone among the controller's settings, as low-cost servos have it so that they do not hum.",
        remedy="Set the controller's dead zone smaller, or add integral action; command past the target where neither "
        "can be had.",
        excitation="holds reached from both sides, under two loads",
    )
    limit_of = ("backlash",)
    confusable = ("backlash", "coulomb_friction", "hysteresis", "sensor_offset")

    def as_limit_of(self, values: Mapping[str, float]) -> dict[str, float]:
        """A band as wide as the play."""
        return {"band": 0.5 * values["gap"]}

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        actuator, band, step = spec.actuator(place.actuator), values["band"], float(spec.option.timestep)
        driven, gear = pulled_joints(spec, actuator), float(actuator.gear[0])
        stiffness = servo_stiffness(spec, place) * gear**2
        body = spec.worldbody.add_body(name=silent_joint(place))
        body.explicitinertial = True
        body.mass = 1e-6
        body.ipos = np.zeros(3)
        body.inertia = np.full(3, 1e-15)
        joint = body.add_joint(name=silent_joint(place), type=mujoco.mjtJoint.mjJNT_HINGE)
        joint.axis = np.array([0.0, 0.0, 1.0])
        # beside a derivative gain, which MuJoCo's step takes explicitly, less inertia would oscillate
        joint.armature = _LIGHT * step**2 * stiffness + step * servo_damping(spec, place) * gear**2
        joint.stiffness = joint.damping = np.zeros(3)
        # a friction that never gives way is a damper, and one within the solver: it knows of the ends
        joint.frictionloss = _NEVER * stiffness
        joint.solref_friction, joint.solimp_friction = implicit_step(step, 1.0 / joint.armature, 0.0, step * stiffness)
        ends = _STIFF * stiffness
        joint.solref_limit, joint.solimp_limit = implicit_step(
            step, 1.0 / joint.armature, ends, _LOSS_STEPS * step * ends
        )
        half = band + _OVERLAP * band / (band + _OVERLAP) + _CLOSED
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range, joint.margin = np.array([-half, half]), _OVERLAP
        tendon = spec.add_tendon(name=f"{place.actuator}_with_silence")
        for name, coefficient in driven.items():
            tendon.wrap_joint(name, coefficient)
        tendon.wrap_joint(joint.name, 1.0)
        actuator.trntype = mujoco.mjtTrn.mjTRN_TENDON
        actuator.target = tendon.name

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"band": band} for band in (0.01, 0.03, 0.1))

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """Bands of the size of the error: at rest a joint lies up to the band from its target to either side."""
        low, high = np.percentile(seen.gap, [10.0, 90.0])
        size = 0.5 * float(high - low)
        return tuple({"band": share * size} for share in (0.5, 1.0, 2.0)) if size > 0.0 else ()

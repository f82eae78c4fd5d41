"""Friction that grows with the load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Story
from twin_daemon.effects.edits import servo_stiffness
from twin_daemon.effects.transmission import pulled_joints

_PRESS = 10.0  # N/rad: force on the brake by error of the servo, so that weak and strong servos press alike
_THICK_M = 0.005
_SHOE_KG = 1e-6


class LoadFriction(Effect):
    """A brake that the servo's own torque presses: friction = coefficient * |torque of the servo|.

    The servo pulls a tendon over its joint and, beside it, a slide along the joint's axis. The slide is held
    between two plates of the parent link, so that it cannot give way: the joint gets the whole torque, a plate
    is pressed in proportion, and their contact resists turning about the axis (torsional friction).
    MuJoCo's contacts lift off a little as they slide; with a heavily damped shoe on soft plates the mean of the
    friction is right to 1 % up to a coefficient of 0.3, and to 15 % above. Without friction the shoe still moves by
    its softness: a coefficient of 0 is the model without the effect to 0.2 mrad rms, 2 mrad in a full step.
    """

    key = "load_friction"
    title = "friction that grows with the load"
    acts_on = "joint"
    rank = 190
    dissipative = True
    neutral_within_rad = 3e-3  # the shoe moves by its softness: see above
    parameters = (
        Parameter("coefficient", "1", 0.0, 0.8, 0.0, 0.2, "friction torque over the torque that the servo transmits"),
    )
    story = Story(
        what="The harder the servo pulls, the more the transmission rubs.",
        shows="More sticking and more sag where gravity or a spring loads the joint; free motion is healthy.",
        cause="Tendons in bent sheaths (capstan friction), gears and screws under load, a bent shaft.",
        remedy="Straighten or grease the sheath; check gear and bearings.",
        excitation="reversals with and without load, at several angles",
    )
    confusable = ("coulomb_friction", "stribeck_friction", "hysteresis", "actuator_gain")

    def applies(self, place: Place) -> bool:
        return place.joint is not None and place.actuator is not None

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        model = spec.compile()
        press = _PRESS / servo_stiffness(spec, place)  # 1/m: newtons on a plate by newton metre of the servo
        joint = spec.joint(place.joint)
        link = model.body(joint.parent.name)
        compiled = model.jnt_axis[model.joint(place.joint).id]
        anchor = model.jnt_pos[model.joint(place.joint).id]
        along = np.empty(4)
        mujoco.mju_quatZ2Vec(along, compiled)

        shoe = joint.parent.add_body(name=f"{place.joint}_brake", pos=anchor, quat=along)
        shoe.explicitinertial = True
        shoe.mass, shoe.ipos, shoe.inertia = _SHOE_KG, np.zeros(3), np.full(3, 1e-10)
        slide = shoe.add_joint(name=f"{place.joint}_brake", type=mujoco.mjtJoint.mjJNT_SLIDE)
        slide.axis = np.array([0.0, 0.0, 1.0])
        slide.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        slide.armature, slide.damping, slide.frictionloss = 0.01, np.array([10.0, 0.0, 0.0]), 0.0
        _solid(shoe, f"{place.joint}_brake", mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, _THICK_M))
        # what rubs lifts off in proportion, and what is soft stays on; what does not rub may be hard
        firm = 1.0 / (1.001 + 0.11 * min(1.0, values["coefficient"] / 0.1))
        turned, centre = np.empty(4), np.empty(3)
        mujoco.mju_mulQuat(turned, link.quat, along)
        for side, name in ((1.0, "over"), (-1.0, "under")):
            mujoco.mju_rotVecQuat(centre, anchor + side * 2.0 * _THICK_M * compiled, link.quat)
            plate = _solid(
                joint.parent.parent,
                f"{place.joint}_brake_{name}",
                mujoco.mjtGeom.mjGEOM_BOX,
                np.array([4.0 * _THICK_M, 4.0 * _THICK_M, _THICK_M]),
            )
            plate.pos, plate.quat = link.pos + centre, turned
            touch = spec.add_pair(name=plate.name, geomname1=f"{place.joint}_brake", geomname2=plate.name)
            touch.condim = 4
            touch.friction = np.array([1e-5, 1e-5, max(values["coefficient"] / press, 1e-7), 1e-5, 1e-5])
            touch.solref, touch.solimp = np.array([0.02, 1.0]), np.array([firm, firm, 0.001, 0.5, 2.0])
        self._press(spec, place, slide.name, press)

    @staticmethod
    def _press(spec: Any, place: Place, slide: str, press: float) -> None:
        actuator = spec.actuator(place.actuator)
        if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON:
            pull = spec.add_tendon(name=f"{place.actuator}_pull")
            for name, coefficient in pulled_joints(spec, actuator).items():
                pull.wrap_joint(name, coefficient)
            actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_TENDON, pull.name
        spec.tendon(actuator.target).wrap_joint(slide, press)

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"coefficient": coefficient} for coefficient in (0.05, 0.2, 0.5))


def _solid(body: Any, name: str, kind: Any, size: np.ndarray) -> Any:
    """A geom that weighs nothing, is not seen, and touches only what it is paired with."""
    geom = body.add_geom(name=name, type=kind, size=size)
    geom.mass = 0.0
    geom.contype = geom.conaffinity = 0
    geom.group = 5
    geom.rgba = np.zeros(4)
    return geom

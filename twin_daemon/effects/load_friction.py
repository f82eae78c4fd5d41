"""Friction that grows with the load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Story
from twin_daemon.effects.edits import impedance_of, linear, servo_stiffness, softness
from twin_daemon.effects.transmission import pulled_joints

_PRESS = 13.0  # 1/m by the root of the coefficient: force on the brake by torque of the servo
_LEAST_PRESS = 1.0  # 1/m
_SHOE_KG = 0.03  # by N m/rad of the servo, so that weak and strong servos press alike
_SHOE_DAMPING = 20.0  # N s/m by the same
_SOFT, _SOFT_FROM = 1.0, 0.1  # (1 - d) / d of the plates' impedance d, from this coefficient on
_THICK_M = 0.005
_GAP_M = 1e-6  # between the shoe and each plate: a shoe that touches both is jammed, and brakes without any load
_UNLIMITED_M = 10.0  # of travel, where a slide has no range
_WEIGHTLESS_KG = 1e-6
_HARD = 1e-5  # sliding friction of a brake that holds for ever: MuJoCo's pyramids are as soft as its square
_HELD_RAD = 0.03  # of servo error at which a joint is typically held, where two frictions share a load
_SOFTEST = 10.0  # times the joint's own friction may become softer for that


class LoadFriction(Effect):
    """A brake that the servo's own torque presses: friction = coefficient * |torque of the servo|.

    The servo pulls a tendon over its joint and, beside it, a slide along the joint's axis. The slide is held
    between two plates of the parent link, so that it cannot give way: the joint gets the whole torque, a plate
    is pressed in proportion, and their contact resists turning about the axis (torsional friction). Along a slide it
    is pressed from the side, and the contact's sliding friction does the same: to 6 % of what the friction does up to
    a coefficient of 0.2, to 12 % at 0.5.
    MuJoCo's contacts lift off a little as they slide; with a damped shoe the mean of the friction is right to 1 % up to
    a coefficient of 0.3, and to 15 % above. Without friction the shoe still moves by its softness: a coefficient of 0
    is the model without the effect to 0.1 mrad rms, 2 mrad in a full step. What the law is off by on the way of a hand
    or an arm at 1 to 4 ms a step is up to 12 % of what the friction does, from a coefficient of 0.02 to one of 0.4.

    `frictionloss` of MuJoCo is soft and creeps under a load below its limit, by (1 - d) / (d m b) rad/s by N m (d its
    impedance, m the inertia, b its damping rate: MuJoCo's documentation, Computation). A plant whose `frictionloss`
    is set by the load does the same, a real sheath stays: `creep` is how fast the brake gives way, in that of the
    joint's own friction. Both share a load at rest and would hold it twice as firmly: each is softer by what the other
    takes, so that together they give way as one does, exactly where the servo is off by a typical 0.03 rad. Where it
    is about to slide, a brake gives way by the softness of one edge of a pyramid, 2 mu^2 (1 + mu^2) times that of the
    normal over `impratio`. The sliding friction mu turns nothing here, as the contact lies on the axis: it sets the
    creep.
    """

    key = "load_friction"
    title = "friction that grows with the load"
    acts_on = "joint"
    rank = 190
    dissipative = True
    neutral_within_rad = 2e-3  # the shoe moves by its softness: see above
    parameters = (
        Parameter("coefficient", "1", 0.0, 0.8, 0.0, 0.2, "friction torque over the torque that the servo transmits"),
        Parameter("creep", "1", 0.0, 3.0, 0.0, 0.0, "how fast it gives way at rest: 1 as the model's own friction"),
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
        stiffness = servo_stiffness(spec, place)
        joint = spec.joint(place.joint)
        link = model.body(joint.parent.name)
        compiled = model.jnt_axis[model.joint(place.joint).id]
        anchor = model.jnt_pos[model.joint(place.joint).id]
        turns = joint.type == mujoco.mjtJoint.mjJNT_HINGE
        pressed = compiled if turns else _across(compiled)  # the way that the shoe goes
        along = np.empty(4)
        mujoco.mju_quatZ2Vec(along, pressed)

        shoe = joint.parent.add_body(name=f"{place.joint}_brake", pos=anchor, quat=along)
        shoe.explicitinertial = True
        shoe.mass, shoe.ipos, shoe.inertia = _WEIGHTLESS_KG, np.zeros(3), np.full(3, 1e-10)
        slide = shoe.add_joint(name=f"{place.joint}_brake", type=mujoco.mjtJoint.mjJNT_SLIDE)
        slide.axis = np.array([0.0, 0.0, 1.0])
        slide.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        slide.armature, slide.frictionloss = _SHOE_KG * stiffness, 0.0
        slide.damping = np.array([_SHOE_DAMPING * stiffness, 0.0, 0.0])
        _solid(shoe, f"{place.joint}_brake", mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, _THICK_M))
        own = linear(joint, "frictionloss") / (_HELD_RAD * stiffness)  # as a coefficient
        least, rubs = float(joint.solimp_friction[0]), max(values["coefficient"], 1e-6)
        softer = 1.0 + values["creep"] * min(rubs / max(own, 1e-6), _SOFTEST)
        joint.solimp_friction[0] = least / (least + (1.0 - least) * softer)
        creep = values["creep"] * (1.0 + own / rubs)
        contact = _Contact(model, place, values["coefficient"], slide.armature)
        rubbing, firm, firm_s = contact.turning(creep) if turns else contact.sliding(creep)
        wide = 4.0 * _THICK_M if turns else 4.0 * _THICK_M + _travel(model, place)
        turned, centre = np.empty(4), np.empty(3)
        mujoco.mju_mulQuat(turned, link.quat, along)
        for side, name in ((1.0, "over"), (-1.0, "under")):
            mujoco.mju_rotVecQuat(centre, anchor + side * (2.0 * _THICK_M + _GAP_M) * pressed, link.quat)
            plate = _solid(
                joint.parent.parent,
                f"{place.joint}_brake_{name}",
                mujoco.mjtGeom.mjGEOM_BOX,
                np.array([wide, wide, _THICK_M]),
            )
            plate.pos, plate.quat = link.pos + centre, turned
            touch = spec.add_pair(name=plate.name, geomname1=f"{place.joint}_brake", geomname2=plate.name)
            touch.condim = 4
            touch.friction = np.array([rubbing[0], rubbing[0], rubbing[1], 1e-5, 1e-5])
            touch.solref, touch.solimp = np.array([firm_s, 1.0]), np.array([firm, firm, 0.001, 0.5, 2.0])
        self._press(spec, place, slide.name, contact.pressing)

    @staticmethod
    def _press(spec: Any, place: Place, slide: str, force: float) -> None:
        actuator = spec.actuator(place.actuator)
        if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON:
            pull = spec.add_tendon(name=f"{place.actuator}_pull")
            for name, coefficient in pulled_joints(spec, actuator).items():
                pull.wrap_joint(name, coefficient)
            actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_TENDON, pull.name
        spec.tendon(actuator.target).wrap_joint(slide, force)

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        holds = tuple({"coefficient": coefficient, "creep": 0.0} for coefficient in (0.05, 0.2, 0.5))
        return (*holds, {"coefficient": 0.2, "creep": 1.0})


class _Contact:
    """What is between the brake and a plate, so that it rubs and gives way as asked."""

    def __init__(self, model: mujoco.MjModel, place: Place, coefficient: float, shoe_kg: float) -> None:
        joint = model.joint(place.joint)
        link = int(model.jnt_bodyid[joint.id])
        dof = int(model.jnt_dofadr[joint.id])
        self._coefficient, self._impratio = coefficient, float(model.opt.impratio)
        self.pressing = _pressing(coefficient)
        constant_s, _ = model.dof_solref[dof]
        least, most = model.dof_solimp[dof][:2]
        self._time_s = float(most * constant_s)
        # 1/(kg m2) or 1/kg: softness of the joint's own friction
        self._own = softness(least) * float(model.dof_invweight0[dof])
        # by MuJoCo a contact is as soft as its bodies are light: 1/kg, along three directions of which the shoe has one
        self._weight = 1.0 / (3.0 * shoe_kg) + 2.0 * float(model.body_invweight0[model.body_parentid[link], 0])

    def turning(self, creep: float) -> tuple[tuple[float, float], float, float]:
        """((sliding friction 1, torsional friction m), impedance, time constant s) of a brake about a hinge."""
        lever = max(self._coefficient / self.pressing, 1e-7)
        plates = self._soft()
        asked = creep * self._own * lever**2 / (2.0 * plates * self._weight / self._impratio)
        sliding = max(float(np.sqrt(0.5 * (np.sqrt(1.0 + 4.0 * asked) - 1.0))), _HARD)
        return ((sliding, lever), *self._firm(plates))

    def sliding(self, creep: float) -> tuple[tuple[float, float], float, float]:
        """As `turning`, of a brake along a slide: the friction that rubs is the one that sets how it gives way."""
        sliding = max(self._coefficient / self.pressing, _HARD)
        plates = creep * self._own / (2.0 * (1.0 + sliding**2)) * self._impratio / self._weight
        return ((sliding, _HARD), *self._firm(float(np.clip(plates, 1e-3, self._soft()))))

    def _soft(self) -> float:
        """What rubs lifts off in proportion, and what is soft stays on; what does not rub may be hard."""
        return 1e-3 + _SOFT * min(self._coefficient / _SOFT_FROM, 1.0)

    def _firm(self, plates: float) -> tuple[float, float]:
        firm = impedance_of(plates)
        return firm, self._time_s / firm


def _pressing(coefficient: float) -> float:
    """1/m: force on the brake by torque of the servo.

    The shoe gives way under its force, and the servo loses the square of it; the less force, the more friction a plate
    needs for the same torque, and the further the shoe lifts off. Both are small where the force goes with the root:
    with 10 or 18 instead of 13 times that the law is off by up to a fifth of what the friction does, not an eighth.
    """
    return max(_PRESS * float(np.sqrt(coefficient)), _LEAST_PRESS)


def _across(axis: np.ndarray) -> np.ndarray:
    """(3,) a unit vector at right angles to an axis (3,)."""
    other = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    return other / np.linalg.norm(other)


def _travel(model: mujoco.MjModel, place: Place) -> float:
    """m: how far a slide gets from where it is at 0."""
    joint = model.joint(place.joint).id
    return float(np.abs(model.jnt_range[joint]).max()) if model.jnt_limited[joint] else _UNLIMITED_M


def _solid(body: Any, name: str, kind: Any, size: np.ndarray) -> Any:
    """A geom that weighs nothing, is not seen, and touches only what it is paired with."""
    geom = body.add_geom(name=name, type=kind, size=size)
    geom.mass = 0.0
    geom.contype = geom.conaffinity = 0
    geom.group = 5
    geom.rgba = np.zeros(4)
    return geom

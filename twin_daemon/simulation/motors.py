"""Where a motor stands, and how fast it turns, behind a transmission that gives or has play, when a roll-out begins."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from twin_daemon.effects.base import Place, link_tendon, motor_joint
from twin_daemon.effects.transmission import implicit_law, motor_brake

_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)


@dataclass(frozen=True)
class Motor:
    """Ids of a motor's actuator, position, degree of freedom and link, and of the constraints that are an elastic link
    (-1 where it has play, whose ends hold) and its brake (-1 for none)."""

    actuator: int
    position: int
    dof: int
    link: int
    tie: int
    brake: int


def motors(model: mujoco.MjModel) -> list[Motor]:
    """The motors of their own that stand behind a transmission."""
    found = []
    if not model.neq and not model.tendon_limited.any():
        return found  # asked of every roll-out
    for actuator in np.flatnonzero(model.actuator_trntype == _JOINT):
        joint = int(model.actuator_trnid[actuator, 0])
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator)
        place = Place(target=name, actuator=name)
        if mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) != motor_joint(place):
            continue
        link = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, link_tendon(place))
        tie = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_EQUALITY, link_tendon(place))
        brake = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_EQUALITY, motor_brake(place))
        if link >= 0 and (tie >= 0 or model.tendon_limited[link]):
            position, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            found.append(Motor(int(actuator), position, dof, link, tie, brake))
    return found


def unstretched(model: mujoco.MjModel, motor: Motor, angle: float, told: float | None) -> float:
    """rad at which a motor carries nothing of what it drives, which is at `angle`: there, or within the play that its
    link has, where the target that it is told holds it."""
    if told is None or not model.tendon_limited[motor.link]:
        return angle
    least, most = model.tendon_range[motor.link]
    return float(np.clip(told, angle + least, angle + most))


def settle_motors(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Brings motors to where servo, link and their own damping balance, at the speed of the joints that they drive.

    `data` has the joints' positions and speeds. Begun where its link is not stretched, a motor takes this to what it
    carries within milliseconds, and the joint feels that as a jerk. Within its play it is where its servo holds it.
    """
    for motor in motors(model):
        angle = _driven(model, motor, data.qpos, model.jnt_qposadr)
        speed = _driven(model, motor, data.qvel, model.jnt_dofadr)
        told = _told(model, data, motor.actuator)
        begin = unstretched(model, motor, angle, told)
        data.qpos[motor.position] = begin
        if motor.tie >= 0 or begin != told:
            data.qpos[motor.position] += _stretched(model, motor, told, begin, speed)
            data.qvel[motor.dof] = speed


def _stretched(model: mujoco.MjModel, motor: Motor, told: float, begin: float, speed: float) -> float:
    """rad by which a motor is ahead of where its link carries nothing, `begin`, on a steady way."""
    stiffness, gear = _stiffness(model, motor), float(model.actuator_gear[motor.actuator, 0])
    gain, bias = float(model.actuator_gainprm[motor.actuator, 0]), model.actuator_biasprm[motor.actuator]
    braked, slope = _damping(model, motor) * speed, -float(bias[1]) * gear**2
    torque = gear * (gain * told + bias[0] + bias[2] * gear * speed) - slope * begin  # of the servo there
    stretched = (torque - braked) / (stiffness + slope)
    if model.actuator_forcelimited[motor.actuator]:
        least, most = np.sort(gear * model.actuator_forcerange[motor.actuator])
        given = torque - slope * stretched
        if not least <= given <= most:
            stretched = (float(np.clip(given, least, most)) - braked) / stiffness
    return stretched


def _driven(model: mujoco.MjModel, motor: Motor, values: np.ndarray, addresses: np.ndarray) -> float:
    """What the motor drives, of the joints' positions or speeds: its link's length is the motor's own less that."""
    begin, count = int(model.tendon_adr[motor.link]), int(model.tendon_num[motor.link])
    joints, sizes = model.wrap_objid[begin : begin + count], model.wrap_prm[begin : begin + count]
    own = model.actuator_trnid[motor.actuator, 0]
    return -float(sum(s * values[addresses[j]] for s, j in zip(sizes, joints, strict=True) if j != own))


def _told(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """The target that the servo sees, behind its filter if it has one."""
    if model.actuator_actadr[actuator] >= 0:
        return float(data.act[model.actuator_actadr[actuator]])
    told = float(data.ctrl[actuator])
    return float(np.clip(told, *model.actuator_ctrlrange[actuator])) if model.actuator_ctrllimited[actuator] else told


def _stiffness(model: mujoco.MjModel, motor: Motor) -> float:
    """N m/rad of its link."""
    if motor.tie < 0:
        solref, solimp = model.tendon_solref_lim[motor.link], model.tendon_solimp_lim[motor.link]
    else:
        solref, solimp = model.eq_solref[motor.tie], model.eq_solimp[motor.tie]
    inverse_inertia = float(model.tendon_invweight0[motor.link])
    return implicit_law(solref, solimp, float(model.opt.timestep), inverse_inertia)[0]


def _damping(model: mujoco.MjModel, motor: Motor) -> float:
    """N m s/rad that brakes the motor itself."""
    own = float(model.dof_damping[motor.dof])
    if motor.brake < 0 or not model.eq_active0[motor.brake]:
        return own
    solref, solimp = model.eq_solref[motor.brake], model.eq_solimp[motor.brake]
    step_s, inverse_inertia = float(model.opt.timestep), float(model.dof_invweight0[motor.dof])
    return own + implicit_law(solref, solimp, step_s, inverse_inertia)[1]

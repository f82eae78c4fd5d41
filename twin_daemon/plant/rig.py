"""The bare machine under the plant: the hand's MJCF with its servos taken out and driven by torque instead.

MuJoCo keeps rigid bodies, contacts, limits, joint damping and joint friction. Everything between a command and a torque
is computed by the plant, so that gaps, lags and losses can sit where they do in a real drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.hand import Hand

from .kinds import Scale

REFERENCE_STEP_S = 0.0005
"""Contact-like stiffnesses are chosen for this step whatever the real one, so that refining the step converges."""


class Rig:
    """Model, data and index arrays. `j` data joints, `c` commands, both in the order of the description."""

    def __init__(
        self,
        hand: Hand,
        *,
        step_s: float,
        spread: float = 0.0,
        seed: int = 0,
        edit: Callable[[mujoco.MjSpec, Rig], None] | None = None,
    ) -> None:
        self.hand = hand
        self.step_s = step_s
        self.seed = seed
        spec = mujoco.MjSpec.from_file(str(hand.model_path))
        self.model: mujoco.MjModel = spec.compile()
        self._index()
        self._read_servos()
        self._mass_matrix()
        self.scales = {name: self._scale(name) for name in {*self.joints, *self.commands}}
        for info in hand.description.commands.values():
            _without_dynamics(spec.actuator(info.actuator))
        if edit is not None:
            edit(spec, self)
        self.model = spec.compile()
        self._free_servos()
        self.factors = self._spread(spread, seed)
        self.model.opt.timestep = step_s
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # damping implicit; the nominal uses another one
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # MuJoCo 4.0.0 errs in the sparse form
        self.data = mujoco.MjData(self.model)
        self.refresh()

    def refresh(self) -> None:
        """Derived constants after an edit of inertia or mass; the state is kept."""
        qpos, qvel = self.data.qpos.copy(), self.data.qvel.copy()
        mujoco.mj_setConst(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = qpos, qvel

    def _index(self) -> None:
        description, model = self.hand.description, self.model
        self.joints = self.hand.joints
        self.commands = self.hand.commands
        if not self.commands:
            raise BadInput("the model has no position servo to command", where=self.hand.model_path)
        ids = [model.joint(info.joint).id for info in description.joints.values()]
        self.qpos_of = model.jnt_qposadr[ids].astype(int)  # (j,)
        self.dof_of = model.jnt_dofadr[ids].astype(int)  # (j,)
        self.body_of = model.jnt_bodyid[ids].astype(int)  # (j,)
        self.actuator_of = np.array([model.actuator(i.actuator).id for i in description.commands.values()])  # (c,)
        self.joint_index = {name: i for i, name in enumerate(self.joints)}
        self.command_index = {name: i for i, name in enumerate(self.commands)}
        self.command_of = np.full(len(self.joints), -1)  # (j,) the command that moves each joint, or -1
        for index, info in enumerate(description.commands.values()):
            for joint in info.joints:
                self.command_of[self.joint_index[joint]] = index

    def _read_servos(self) -> None:
        """Servo constants (c,): torque = gain * target + bias + pull * angle + brake * speed, within the limits."""
        model, act = self.model, self.actuator_of
        fixed = model.actuator_gaintype[act] == mujoco.mjtGain.mjGAIN_FIXED
        plain = np.isin(model.actuator_dyntype[act], (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTEREXACT))
        if not np.all(fixed & plain):
            name = self.commands[int(np.flatnonzero(~(fixed & plain))[0])]
            raise BadInput(f"the servo of '{name}' is no plain position servo", where=self.hand.model_path)
        filtered = model.actuator_dyntype[act] == mujoco.mjtDyn.mjDYN_FILTEREXACT
        self.servo_lag_s = np.where(filtered, model.actuator_dynprm[act, 0], 0.0)
        self.servo_delay_s = model.actuator_delay[act].copy()
        self.gain = model.actuator_gainprm[act, 0].copy()
        self.bias = model.actuator_biasprm[act, 0].copy()
        self.pull = model.actuator_biasprm[act, 1].copy()
        self.brake = model.actuator_biasprm[act, 2].copy()
        force_limited = model.actuator_forcelimited[act].astype(bool)
        self.force_low = np.where(force_limited, model.actuator_forcerange[act, 0], -np.inf)
        self.force_high = np.where(force_limited, model.actuator_forcerange[act, 1], np.inf)
        limited = model.actuator_ctrllimited[act].astype(bool)
        self.target_low = np.where(limited, model.actuator_ctrlrange[act, 0], -np.inf)
        self.target_high = np.where(limited, model.actuator_ctrlrange[act, 1], np.inf)

    def _free_servos(self) -> None:
        """From here on the number that MuJoCo gets for a servo is its torque."""
        model, act = self.model, self.actuator_of
        model.actuator_gaintype[act] = mujoco.mjtGain.mjGAIN_FIXED
        model.actuator_biastype[act] = mujoco.mjtBias.mjBIAS_NONE
        model.actuator_gainprm[act] = 0.0
        model.actuator_gainprm[act, 0] = 1.0
        model.actuator_biasprm[act] = 0.0
        model.actuator_ctrllimited[act] = 0
        model.actuator_forcelimited[act] = 0

    def _mass_matrix(self) -> None:
        """(nv, nv) inverse mass matrix at the model's reference pose, and the servos' moment arms (c, nv)."""
        self._reference = data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, data)
        nv = self.model.nv
        mass = np.zeros((nv, nv))
        mujoco.mj_fullM(self.model, data, mass)
        self.inverse_mass = np.linalg.inv(mass)
        self.arms = np.zeros((len(self.commands), nv))
        weights = self.hand.description.commands.values()
        for row, info in enumerate(weights):
            for joint in info.joints:
                self.arms[row, self.dof_of[self.joint_index[joint]]] = self._arm(row, joint)

    def _arm(self, row: int, joint: str) -> float:
        """d(servo angle)/d(joint angle), by moving the joint a little."""
        data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, data)
        before = float(data.actuator_length[self.actuator_of[row]])
        data.qpos[self.qpos_of[self.joint_index[joint]]] += 1e-4
        mujoco.mj_forward(self.model, data)
        return round((float(data.actuator_length[self.actuator_of[row]]) - before) / 1e-4, 6)

    def joint_angle(self, command: str, joint: str, angle: float) -> float:
        """rad of a joint at which its command's servo has moved by `angle`, within the joint's range."""
        row = self.joint_index[joint]
        arm = float(self.arms[self.command_index[command], self.dof_of[row]])
        low, high = self.hand.joint_range_rad[joint]
        return min(max(angle / arm, low), high)

    def inertia_at(self, name: str) -> float:
        """kg m2 that a torque at this joint (or along this command's tendon) feels, the rest being free."""
        if name in self.joint_index:
            dof = self.dof_of[self.joint_index[name]]
            return 1.0 / float(self.inverse_mass[dof, dof])
        arm = self.arms[self.command_index[name]]
        return 1.0 / float(arm @ self.inverse_mass @ arm)

    def lumped(self, per_dof: np.ndarray, command: int) -> float:
        """A damping or inertia of the joints (nv,) as the servo sees it along its tendon: softest first, in series."""
        used = np.flatnonzero(self.arms[command])
        values = per_dof[used]
        return 0.0 if np.any(values <= 0.0) else 1.0 / float(np.sum(self.arms[command, used] ** 2 / values))

    def link_of(self, name: str) -> int:
        """The body that a joint moves (of a pair the fingertip's), or the next one if that is a mere pin."""
        joints = [name] if name in self.joint_index else self.hand.description.commands[name].joints
        body = max(int(self.body_of[self.joint_index[joint]]) for joint in joints)
        while np.linalg.norm(self.model.body_ipos[body]) < 1e-3:
            children = np.flatnonzero(self.model.body_parentid == body)
            if not children.size:
                break
            body = int(children[0])
        return body

    def _scale(self, name: str) -> Scale:
        joint = self.joint_index.get(name)
        command = int(self.command_of[joint]) if joint is not None else self.command_index[name]
        low, high = self.hand.joint_range_rad[name] if joint is not None else self.hand.command_range_rad[name]
        span = high - low if math.isfinite(high - low) else 2 * math.pi
        kp = -float(self.pull[command]) if command >= 0 else 1.0
        limit = min(kp * span, float(self.force_high[command]) if command >= 0 else math.inf)
        damping = self.lumped(self.model.dof_damping, command) if command >= 0 else 0.0
        arm = max(self._bearing_arm(name, kp), 0.02)
        return Scale(kp, span, limit, damping, self.inertia_at(name), arm)

    def _bearing_arm(self, name: str, kp: float) -> float:
        """m: lever of a load at the end of the link, at the joint (of those that bear it) that it bends most.

        Levers of other joints are in parts of their stiffness: a mass that a finger carries may bend a weak wrist.
        """
        model, data = self.model, self._reference
        body = self.link_of(name)
        end = data.xpos[body] + data.xmat[body].reshape(3, 3) @ (2.0 * model.body_ipos[body])
        arm = 0.0
        while body:
            for row in np.flatnonzero(self.body_of == body):
                joint = model.joint(self.hand.description.joints[self.joints[row]].joint).id
                lever = end - data.xanchor[joint]
                lever = lever - data.xaxis[joint] * (lever @ data.xaxis[joint])
                command = int(self.command_of[row])
                share = kp / -float(self.pull[command]) if command >= 0 else 1.0
                arm = max(arm, share * float(np.linalg.norm(lever)))
            body = int(model.body_parentid[body])
        return arm

    def _spread(self, spread: float, seed: int) -> dict[str, np.ndarray]:
        """Scales the nominal parameters by factors within 1 +- spread, and returns the factors."""
        model, random = self.model, np.random.default_rng([seed, 1])
        sizes = {
            "damping": model.nv,
            "frictionloss": model.nv,
            "armature": model.nv,
            "kp": len(self.commands),
            "tendon_damping": model.ntendon,
            "tendon_frictionloss": model.ntendon,
        }
        factors = {name: 1.0 + spread * random.uniform(-1.0, 1.0, size) for name, size in sizes.items()}
        model.dof_damping[:] = model.dof_damping * factors["damping"]
        model.dof_frictionloss[:] = model.dof_frictionloss * factors["frictionloss"]
        model.dof_armature[:] = model.dof_armature * factors["armature"]
        model.tendon_damping[:] = model.tendon_damping * factors["tendon_damping"]
        model.tendon_frictionloss[:] = model.tendon_frictionloss * factors["tendon_frictionloss"]
        self.gain *= factors["kp"]
        self.bias *= factors["kp"]
        self.pull *= factors["kp"]
        return factors


def _without_dynamics(actuator: mujoco.MjsActuator) -> None:
    """Lag and delay of a servo are computed before it, by the plant; they must not act on the torque."""
    actuator.dyntype = mujoco.mjtDyn.mjDYN_NONE
    actuator.delay = 0.0
    actuator.nsample = 0

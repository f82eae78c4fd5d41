"""Pairs of recordings of one hand, healthy and later: made with MuJoCo alone, and read by `bench.changes`.

Each plant is a Shadow Hand (a third-party MJCF) whose damping, dry friction and servo gains are up to 20 % off the
file, in some cases with friction that grows with the load or with an elastic tendon at one finger. The later recording
shows another motion of the same hand, on which one thing has changed, or nothing; every parameter is a percent off
between the two. Plants run at 0.5 ms, sensors are noisy and quantised, stamps jitter.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from bench.random_robots.cases import Recording
from bench.random_robots.export import write_bag

STEP_S, RATE_HZ = 0.0005, 125.0
FINGERS = ("FF", "MF", "RF", "LF")
MOVED = [f"rh_{f}J{j}" for f in FINGERS for j in (3, 0)] + ["rh_THJ4", "rh_THJ1", "rh_WRJ1"]
SPREAD, BETWEEN_SESSIONS = 0.2, 0.01
LOAD_FRICTION, TENDON_SHARE, GAP_RAD, CUBIC_CENTRE_RAD = 0.3, 1.5, 0.015, 0.6
NOISE_RAD, RESOLUTION_RAD, JITTER_S = 0.0008, float(np.deg2rad(0.2)), 1e-4
WEEK_S = 7 * 86400

CHANGES = {
    "nothing": None,
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
    "weak": "actuator_gain",
    "load": "load_friction",
    "slack": "tendon_elasticity",
    "play": "backlash",
}
"""What changes in a case, and the key of the effect that is right."""


@dataclass(frozen=True)
class Case:
    """A planted change (a key of CHANGES) at the J3 of a finger: the files, and the joints that are right."""

    name: str
    change: str
    joint: str
    baseline: Path
    recording: Path

    @property
    def effect(self) -> str | None:
        return CHANGES[self.change]

    @classmethod
    def read(cls, folder: Path, name: str) -> Case:
        """A case that `make` has written."""
        truth = json.loads((folder / f"{name}.truth.json").read_text())
        return cls(name, truth["change"], truth["finger_joint"], folder / f"{name}_healthy", folder / f"{name}_now")


@dataclass
class Plant:
    """The compiled hand with what MuJoCo has no field for, at one joint: load friction, elastic tendon, play, a spring.

    Its servo gives no more than its `forcerange`. `gain` and `offset_rad` are of the joint's reading.
    """

    model: mujoco.MjModel
    joint: int
    actuator: int
    load_friction: float = 0.0
    tendon: float | None = None
    gap_rad: float = 0.0
    cubic: float = 0.0
    gain: float = 1.0
    offset_rad: float = 0.0

    @property
    def _torques(self) -> tuple[float, float]:
        """N m: the least and the most that the servo gives."""
        limited = self.model.actuator_forcelimited[self.actuator]
        least, most = self.model.actuator_forcerange[self.actuator] if limited else (-np.inf, np.inf)
        return float(least), float(most)

    def moved(self, commands: np.ndarray) -> np.ndarray:
        """Commands (n, nu) at RATE_HZ -> joint angles (n, nj) in rad."""
        m = self.model
        data = mujoco.MjData(m)
        dof, adr = int(m.jnt_dofadr[self.joint]), int(m.jnt_qposadr[self.joint])
        kp = float(m.actuator_gainprm[self.actuator, 0])
        least, most = self._torques
        dry, damping = float(m.dof_frictionloss[dof]), float(m.dof_damping[dof])
        motor = None
        if self.tendon is not None:
            m.actuator_gainprm[self.actuator, 0] = m.actuator_biasprm[self.actuator, 1] = 0.0
            m.dof_damping[dof] = 0.5 * damping
            motor = 0.0
        found = np.zeros((len(commands), m.njnt))
        settle, per_sample = round(2.0 / STEP_S), round(1.0 / RATE_HZ / STEP_S)
        for index, target in enumerate(commands):
            for _ in range(settle if index == 0 else per_sample):
                error = float(target[self.actuator] - data.qpos[adr])
                torque = servo = min(max(kp * error, least), most)
                data.qfrc_applied[dof] = 0.0
                if self.tendon is not None and motor is not None:
                    lossy = 0.5 * damping / STEP_S
                    held, other = lossy * motor + self.tendon * data.qpos[adr], lossy + self.tendon
                    aim = float(target[self.actuator])
                    motor = (held + kp * aim) / (other + kp)
                    if not least <= kp * (aim - motor) <= most:  # the servo gives what it can
                        motor = (held + (most if aim > motor else least)) / other
                    torque = self.tendon * (motor - data.qpos[adr])
                    data.qfrc_applied[dof] = torque
                elif self.gap_rad:
                    pulls = kp * float(np.sign(error) * max(abs(error) - 0.5 * self.gap_rad, 0.0))
                    torque = min(max(pulls, least), most)
                    data.qfrc_applied[dof] = torque - servo
                data.qfrc_applied[dof] -= self.cubic * (data.qpos[adr] - CUBIC_CENTRE_RAD) ** 3
                m.dof_frictionloss[dof] = dry + self.load_friction * abs(torque)
                data.ctrl[:] = target
                mujoco.mj_step(m, data)
            found[index] = data.qpos[m.jnt_qposadr]
        return found


def make(folder: Path, model: Path, change: str, seed: int, seconds: float = 20.0) -> Case:
    """Writes the two recordings of a case, and what was planted beside them. The same seed makes the same case."""
    rng = np.random.default_rng([seed, list(CHANGES).index(change)])
    finger = str(rng.choice(FINGERS))
    joint = f"rh_{finger}J3"
    names = {path: folder / f"{change}_{seed}_{path}" for path in ("healthy", "now")}
    case = Case(f"{change}_{seed}", change, joint, names["healthy"], names["now"])
    body = rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, (3, 64))
    for week, (tag, path) in enumerate(names.items()):
        session = rng.normal(1.0, BETWEEN_SESSIONS, (3, 64))
        plant = plant_of(model, joint, body * session)
        if change == "load":
            plant.load_friction = LOAD_FRICTION
        if change == "slack":
            plant.tendon = TENDON_SHARE * float(plant.model.actuator_gainprm[plant.actuator, 0])
        if tag == "now":
            _worn(plant, change)
        record(plant, path, week, int(rng.integers(1 << 30)), seconds, rng)
    joints = [joint] if case.effect else []
    truth = {"model": str(model), "effect": case.effect, "joints": joints, "change": change, "finger_joint": joint}
    (folder / f"{case.name}.truth.json").write_text(json.dumps(truth))
    return case


def record(
    plant: Plant, path: Path, week: int, seed: int, seconds: float, rng: np.random.Generator, *, slow: bool = False
) -> None:
    """Writes what a plant shows of a motion in a week."""
    time_s, commands = (_closing if slow else _motion)(plant.model, seed, seconds)
    angles = plant.moved(commands)
    angles[:, plant.joint] = plant.gain * angles[:, plant.joint] + plant.offset_rad
    stamps = time_s + 1.0 / RATE_HZ + rng.normal(0.0, JITTER_S, len(time_s))
    read = np.round((angles + rng.normal(0.0, NOISE_RAD, angles.shape)) / RESOLUTION_RAD) * RESOLUTION_RAD
    joints = [plant.model.joint(i).name for i in range(plant.model.njnt)]
    servos = [plant.model.actuator(i).name.replace("_A_", "_") for i in range(plant.model.nu)]
    recording = Recording(time_s, commands, stamps, read)
    write_bag(path, recording, joints, servos, began_s=1_700_000_000 + week * WEEK_S)


def plant_of(model: Path, joint: str, factors: np.ndarray) -> Plant:
    """The hand with its damping, dry friction and servo gains times factors (3, at least nv)."""
    spec = mujoco.MjSpec.from_file(str(model))
    spec.option.timestep = STEP_S
    m = spec.compile()
    m.dof_damping *= factors[0, : m.nv]
    m.dof_frictionloss *= factors[1, : m.nv]
    m.actuator_gainprm[:, 0] *= factors[2, : m.nu]
    m.actuator_biasprm[:, 1] *= factors[2, : m.nu]
    return Plant(m, m.joint(joint).id, m.actuator(joint.replace("rh_", "rh_A_")).id)


def _worn(plant: Plant, change: str) -> None:
    m, dof = plant.model, int(plant.model.jnt_dofadr[plant.joint])
    if change == "viscous":
        m.dof_damping[dof] *= 1.3
    if change == "coulomb":
        m.dof_frictionloss[dof] *= 2.0
    if change == "weak":
        m.actuator_gainprm[plant.actuator, 0] *= 0.75
        m.actuator_biasprm[plant.actuator, 1] *= 0.75
    if change == "load":
        plant.load_friction *= 1.4
    if change == "slack" and plant.tendon is not None:
        plant.tendon *= 0.7
    if change == "play":
        plant.gap_rad = GAP_RAD


def _moved(m: mujoco.MjModel) -> np.ndarray:
    """(nu,) bool: the servos that a motion moves."""
    return np.array([m.actuator(a).name.replace("_A_", "_") in MOVED for a in range(m.nu)])


def _closing(m: mujoco.MjModel, seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """((n,) s, (n, nu) rad): open, closed slowly, held and opened again, as a hand at work does."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    low, high = m.actuator_ctrlrange.T
    open_s, closing_s, held_s = rng.uniform(0.06, 0.1) * seconds, rng.uniform(0.3, 0.36) * seconds, 0.12 * seconds
    closed = rng.uniform(0.75, 0.85)
    ends = np.cumsum([0.0, open_s, closing_s, held_s, closing_s])
    share = np.interp(time_s, ends, [0.1, 0.1, closed, closed, 0.1])
    rest = np.clip(0.0, low, high)
    return time_s, np.where(_moved(m), low + share[:, None] * (high - low), rest)


def _motion(m: mujoco.MjModel, seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """((n,) s, (n, nu) rad): a slow ramp, held steps and a sum of sines, a third each."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    low, high = m.actuator_ctrlrange.T
    moved = _moved(m)
    commands = np.tile(np.where(moved, 0.5 * (low + high), np.clip(0.0, low, high)), (len(time_s), 1))
    third = seconds / 3.0
    for a in np.flatnonzero(moved):
        ramp = 1.0 - 4.0 * np.abs(((time_s / (third / 2.0)) % 1.0) - 0.5)
        steps = rng.uniform(-1.0, 1.0, int(seconds / 1.25) + 1)[(time_s / 1.25).astype(int)]
        frequency, phase = rng.uniform(0.1, 1.6, 5), rng.uniform(0.0, 2.0 * np.pi, 5)
        sines = np.sin(2.0 * np.pi * np.outer(time_s, frequency) + phase).sum(axis=1) / 3.2
        share = np.where(time_s < third, ramp, np.where(time_s < 2.0 * third, steps, sines))
        commands[:, a] += 0.4 * (high[a] - low[a]) * np.clip(share, -1.0, 1.0)
    return time_s, commands

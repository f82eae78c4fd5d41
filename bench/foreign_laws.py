"""A small arm with laws that no effect of the library describes, written down where they act: torque, servo, reading.

The laws are this file's own; nothing of the package's effects or proposals is used. The plant steps at half a
millisecond, its damping, friction, armature and gain are off the nominal ones by up to `spread`, and its readings have
noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

RATE_HZ = 100
NOISE_RAD = 5e-4
JOINTS = ("shoulder", "elbow")
KP = {"shoulder": 20.0, "elbow": 8.0}
_STEP_S = 0.0005

_XML = """<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" range="-2 2" damping="0.6" armature="0.01"
frictionloss="0.05"/><geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.3" contype="0" conaffinity="0"/>
<body name="fore" pos="0.25 0 0"><joint name="elbow" axis="0 1 0" range="-2 2" damping="0.25" armature="0.006"
frictionloss="0.03"/><geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/>
</body></body></worldbody><actuator><position name="shoulder" joint="shoulder" kp="20" ctrlrange="-2 2"/>
<position name="elbow" joint="elbow" kp="8" ctrlrange="-2 2"/></actuator></mujoco>"""


@dataclass
class Now:
    """What a law sees at the elbow: angle, speed, target, servo error (rad), the shoulder's angle, the time (s)."""

    time_s: float
    q: float
    v: float
    target: float
    error: float
    neighbour: float
    torque: float
    step_s: float


Torque = Callable[[Now], float]


@dataclass(frozen=True)
class Law:
    """One law at the elbow: N m beside the servo's torque, a factor on the servo's torque, rad added to the reading.

    `answers` are ports with a variable that a proposal should name; several may be as right. `make` makes the three
    anew for each run, since some remember.
    """

    key: str
    answers: tuple[tuple[str, str], ...]
    make: Callable[[], tuple[Torque | None, Torque | None, Torque | None]]


def _of(torque: Torque | None = None, gain: Torque | None = None, reading: Torque | None = None):
    return lambda: (torque, gain, reading)


def _notch(now: Now) -> float:
    u = (now.q - 0.3) / 0.06
    return -0.35 * u * float(np.exp(0.5 - 0.5 * u * u))


def _relaxation():
    state = {"x": 0.0, "q": None}

    def torque(now: Now) -> float:
        before = now.q if state["q"] is None else state["q"]
        state["x"] = state["x"] * np.exp(-now.step_s / 1.5) + (now.q - before)
        state["q"] = now.q
        return -1.2 * state["x"]

    return torque, None, None


def _creep():
    state = {"x": 0.0}

    def gain(now: Now) -> float:
        state["x"] += now.step_s / 3.0 * (now.error - state["x"])
        return 1.0 - 0.5 * state["x"] / now.error if abs(now.error) > 1e-6 else 1.0

    return None, gain, None


LAWS: dict[str, Law] = {
    law.key: law
    for law in (
        Law("eccentric_sensor", (("reading", "position"),),
            _of(reading=lambda n: 0.05 * float(np.sin(9.0 * n.q + 0.7)))),
        Law("notch", (("torque", "position"),), _of(torque=_notch)),
        Law("fading_gain", (("command", "time"),),
            _of(gain=lambda n: 1.0 - 0.6 * (1.0 - float(np.exp(-n.time_s / 8.0))))),
        Law("temperature_ramp", (("torque", "velocity"), ("torque", "time")),
            _of(torque=lambda n: -n.v * 0.25 * max(0.0, 2.0 - 0.1 * n.time_s))),
        Law("quadratic_drag", (("torque", "velocity"),), _of(torque=lambda n: -0.25 * n.v * abs(n.v))),
        Law("asymmetric_friction", (("torque", "velocity"),),
            _of(torque=lambda n: -0.25 * float(np.tanh(n.v / 0.02)) if n.v > 0.0 else 0.0)),
        Law("magnetic_hold", (("torque", "position"),),
            _of(torque=lambda n: -2.0 * (n.q - 0.2) * float(np.exp(-(((n.q - 0.2) / 0.15) ** 2))))),
        Law("crosstalk", (("reading", "shoulder"),), _of(reading=lambda n: 0.05 * n.neighbour)),
        Law("neighbour_pull", (("torque", "shoulder"),), _of(torque=lambda n: 0.35 * n.neighbour)),
        Law("neighbour_friction", (("torque", "shoulder"),),
            _of(torque=lambda n: -0.3 * abs(n.neighbour) * float(np.tanh(n.v / 0.02)))),
        Law("sticky_patch", (("torque", "position"),),
            _of(torque=lambda n: -0.35 * float(np.tanh(n.v / 0.02)) * (abs(n.q - 0.2) < 0.15))),
        Law("cam", (("command", "position"), ("torque", "position"), ("command", "command")),
            _of(gain=lambda n: 1.0 + 0.5 * float(np.sin(3.0 * n.q)))),
        Law("relaxation", (("torque", "velocity"),), _relaxation),
        Law("creep", (("command", "error"),), _creep),
        Law("sound", (), _of()),
    )
}  # fmt: skip
"""Every law by its key; `sound` is none at all."""


PAIRS = (
    ("eccentric_sensor", "quadratic_drag"),
    ("notch", "temperature_ramp"),
    ("crosstalk", "magnetic_hold"),
    ("fading_gain", "neighbour_pull"),
    ("asymmetric_friction", "crosstalk"),
    ("neighbour_friction", "eccentric_sensor"),
    ("quadratic_drag", "notch"),
    ("relaxation", "crosstalk"),
)
"""Laws that act together: no two at the same port over the same variable."""


def pair(one: Law, other: Law) -> Law:
    """Both laws at once."""

    def make() -> tuple[Torque | None, Torque | None, Torque | None]:
        (torque, gain, reading), (torque_2, gain_2, reading_2) = one.make(), other.make()
        return (
            _sum(torque, torque_2),
            (lambda now: gain(now) * gain_2(now)) if gain and gain_2 else gain or gain_2,
            _sum(reading, reading_2),
        )

    return Law(f"{one.key}+{other.key}", (*one.answers, *other.answers), make)


def _sum(one: Torque | None, other: Torque | None) -> Torque | None:
    return (lambda now: one(now) + other(now)) if one and other else one or other


def arm_model(folder: Path) -> Path:
    """Writes the nominal arm and returns its file."""
    path = folder / "arm.xml"
    path.write_text(_XML, encoding="utf-8")
    return path


def targets(seconds: float, seed: int, fastest: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """((n,) s, (n, 2) rad): steps, slow and fast ramps, small reversals and holds of both joints."""
    random = np.random.default_rng(seed)
    grid, tracks = np.arange(0.0, seconds, 1.0 / RATE_HZ), []
    for _ in JOINTS:
        times, angles = [0.0, 0.4], [0.0, 0.0]
        while times[-1] < seconds:
            here = angles[-1]
            goal = float(random.uniform(-0.9, 1.1))
            kind = int(random.integers(4))
            if kind == 0:
                times += [times[-1] + 0.02, times[-1] + 0.6]
                angles += [here + 0.4 * (goal - here), here + 0.4 * (goal - here)]
            elif kind == 1:
                times.append(times[-1] + abs(goal - here) / (0.4 * fastest) + 0.1)
                angles.append(goal)
            elif kind == 2:
                times.append(times[-1] + abs(goal - here) / (2.0 * fastest) + 0.1)
                angles.append(goal)
            else:
                for side in (0.08, 0.0, 0.08, 0.0):
                    times.append(times[-1] + 0.2)
                    angles.append(float(np.clip(here + side, -1.2, 1.3)))
        tracks.append(np.interp(grid, times, angles))
    return grid, np.stack(tracks, axis=1)


def record(law: Law, path: Path, *, seconds: float, seed: int, spread: float = 0.1, fastest: float = 1.0) -> Path:
    """Runs the arm with a law at its elbow and writes what was commanded and read as an MCAP file."""
    from twin_daemon.recordings.writer import McapWriter

    model = _plant(spread)
    data = mujoco.MjData(model)
    torque, gain, reading = law.make()
    time_s, wanted = targets(seconds, seed, fastest)
    random = np.random.default_rng([seed, 7])
    per_sample = round(1.0 / RATE_HZ / _STEP_S)
    kp = np.array([model.actuator_gainprm[i, 0] for i in range(2)])
    begin_ns = 1_700_000_000_000_000_000

    def now(target: float, at_s: float) -> Now:
        q, v = float(data.qpos[1]), float(data.qvel[1])
        return Now(at_s, q, v, target, target - q, float(data.qpos[0]), kp[1] * (target - q), _STEP_S)

    with McapWriter(path) as bag:
        for index, target in enumerate(wanted):
            stamp = begin_ns + round(time_s[index] * 1e9)
            bag.joint_commands(stamp, JOINTS, target)
            seen = now(target[1], time_s[index])
            read = data.qpos.copy()
            read[1] += reading(seen) if reading else 0.0
            bag.joint_states(stamp, JOINTS, read + NOISE_RAD * random.standard_normal(2))
            data.ctrl[:] = target
            for step in range(per_sample):
                seen = now(target[1], time_s[index] + step * _STEP_S)
                beside = torque(seen) if torque else 0.0
                beside += (gain(seen) - 1.0) * seen.torque if gain else 0.0
                data.qfrc_applied[1] = beside
                mujoco.mj_step(model, data)
    return path


def _plant(spread: float) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(_XML)
    spec.option.timestep = _STEP_S
    model = spec.compile()
    random = np.random.default_rng(11)
    for values in (model.dof_damping, model.dof_frictionloss, model.dof_armature):
        values *= random.uniform(1.0 - spread, 1.0 + spread, 2)
    factor = random.uniform(1.0 - 0.5 * spread, 1.0 + 0.5 * spread, 2)
    model.actuator_gainprm[:, 0] *= factor
    model.actuator_biasprm[:, 1] *= factor
    return model

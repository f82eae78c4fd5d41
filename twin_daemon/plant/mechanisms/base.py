"""What all mechanisms share: the state they see, the places they act on, and the stages of a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import mujoco
import numpy as np

if TYPE_CHECKING:
    from ..rig import Rig


@dataclass
class State:
    """One step of the plant. `c` commands, `j` joints; arrays are changed in place from stage to stage."""

    time_s: float
    step_s: float
    qpos: np.ndarray  # MuJoCo's own, by address
    qvel: np.ndarray  # MuJoCo's own, by dof
    target: np.ndarray  # (c,) rad
    angle: np.ndarray  # (c,) rad, of the tendon or joint at its servo
    speed: np.ndarray  # (c,) rad/s
    servo_angle: np.ndarray  # (c,) rad, what the servo sees
    servo_speed: np.ndarray  # (c,) rad/s
    torque: np.ndarray  # (c,) N m, of the servo
    drag: np.ndarray  # (c,) N m along the tendon, beside the servo's
    joint_torque: np.ndarray  # (nv,) N m


@dataclass(frozen=True)
class Placed:
    """An effect at its place, with numbers instead of names for how strong it is."""

    name: str  # joint or command as the data name it; "" for the whole hand
    value: float
    more: dict[str, float]


class Mechanism:
    """All hidden effects of one key, vectorised over their places. Override the stages that it takes part in."""

    stages: ClassVar[tuple[str, ...]] = ()
    """Names of the overridden stages: command, transmission, drive, output, joint, sense."""

    def __init__(self, rig: Rig, placed: list[Placed]) -> None:
        self.rig = rig
        self.names = [one.name for one in placed]
        self.value = np.array([one.value for one in placed], dtype=float)
        keys = placed[0].more.keys()
        self.more = {key: np.array([one.more[key] for one in placed], dtype=float) for key in keys}
        self.prepare()
        self.update()
        self.reset()

    @classmethod
    def edit_spec(cls, spec: mujoco.MjSpec, rig: Rig, placed: list[Placed]) -> None:
        """Structure that must be there before the model is compiled."""

    def prepare(self) -> None:
        """Index arrays and constants that follow from the place."""

    def update(self) -> None:
        """What follows from `value`, after it was changed (wear)."""

    def reset(self) -> None:
        """Forget the past."""

    def command(self, state: State) -> None:
        """Change `target` between the bus and the servo."""

    def transmission(self, state: State) -> None:
        """Change what the servo sees of the joint."""

    def drive(self, state: State) -> None:
        """Change the servo's torque."""

    def output(self, state: State) -> None:
        """Change what arrives of the servo's torque at the joint side."""

    def joint(self, state: State) -> None:
        """Add torques at joints and tendons."""

    def sense(self, time_s: float, position: np.ndarray) -> None:
        """Change the measured angles (j,) before noise and quantisation."""

    def command_rows(self) -> np.ndarray:
        return np.array([self.rig.command_index[name] for name in self.names])

    def joint_rows(self) -> np.ndarray:
        return np.array([self.rig.joint_index[name] for name in self.names])


class Ports:
    """Places where a torque opposes a motion: joints first, then tendons (a command of several joints)."""

    def __init__(self, rig: Rig, names: list[str]) -> None:
        at_joint = [name in rig.joint_index for name in names]
        joints = [i for i, is_joint in enumerate(at_joint) if is_joint]
        tendons = [i for i, is_joint in enumerate(at_joint) if not is_joint]
        self.order = np.array(joints + tendons)  # own order -> order of `names`
        self.split = len(joints)
        rows = [rig.joint_index[names[i]] for i in joints]
        self.qpos = rig.qpos_of[rows]
        self.dof = rig.dof_of[rows]
        self.command = np.array([rig.command_index[names[i]] for i in tendons], dtype=int)
        ordered = [names[i] for i in self.order]
        self.inertia = np.array([rig.inertia_at(name) for name in ordered])  # (p,)
        by_joint = rig.command_of[rows] if rows else np.zeros(0, dtype=int)
        self.driven_by = np.concatenate([by_joint, self.command]).astype(int)  # (p,) command, or -1
        ranges = [rig.hand.joint_range_rad.get(n) or rig.hand.command_range_rad[n] for n in ordered]
        self.low = np.array([low for low, _ in ranges])
        self.high = np.array([high for _, high in ranges])

    def angle(self, state: State) -> np.ndarray:
        """(p,) rad"""
        if not self.command.size:
            return state.qpos[self.qpos]
        return np.concatenate([state.qpos[self.qpos], state.angle[self.command]])

    def speed(self, state: State) -> np.ndarray:
        """(p,) rad/s"""
        if not self.command.size:
            return state.qvel[self.dof]
        return np.concatenate([state.qvel[self.dof], state.speed[self.command]])

    def add(self, state: State, torque: np.ndarray) -> None:
        """Applies (p,) N m."""
        state.joint_torque[self.dof] += torque[: self.split]
        if self.command.size:
            state.drag[self.command] += torque[self.split :]


class AtPorts(Mechanism):
    """A mechanism at joints or tendons; its values are in the order of `ports`."""

    stages = ("joint",)

    def prepare(self) -> None:
        self.ports = Ports(self.rig, self.names)

    def ordered(self, values: np.ndarray) -> np.ndarray:
        return values[self.ports.order]

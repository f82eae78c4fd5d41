"""A stand-in for the real hand: uncertain, imperfect, and not written by the hand of its diagnostician.

It shares no code with the effects that the twin tries on: another integrator, a finer step, and every hidden effect
computed from first principles where it sits (`mechanisms/`). Same seed and same calls give the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from twin_daemon.errors import BadInput, TwinError, nearest
from twin_daemon.hand import Hand, match

from .hidden import Hidden, check_value, resolve_joint
from .kinds import Kind, Scale
from .mechanisms import MECHANISMS, Mechanism
from .mechanisms.base import Placed, State
from .mechanisms.commands import CommandDelay, CommandLag
from .rig import Rig

_STAGES = ("command", "transmission", "drive", "output", "joint", "sense")
_VELOCITY_FILTER_S = 0.015


class Plant:
    """A hand that takes position targets and gives measured angles.

    `spread` scales damping, friction, armature and kp of every joint by seeded factors within 1 +- spread: what a
    nominal model does not know. `ideal_sensors` leaves out noise and quantisation.
    """

    def __init__(
        self,
        hand: Hand,
        *,
        seed: int = 0,
        hidden: Sequence[Hidden] = (),
        spread: float = 0.0,
        step_s: float = 0.0005,
        ideal_sensors: bool = False,
    ) -> None:
        if not 0.0 <= spread < 1.0:
            raise BadInput(f"a spread of {spread:g} would make parameters negative", allowed="0 or more, below 1")
        if not 1e-5 <= step_s <= 0.002:
            raise BadInput(f"the plant cannot step by {step_s:g} s", allowed="0.00001 to 0.002 s")
        self.hand = hand
        self.seed = seed
        self.ideal_sensors = ideal_sensors
        wanted = [resolve_joint(one, hand) for one in hidden]
        _refuse_clashes(wanted)
        self._placed: dict[str, list[Placed]] = {}

        def edit(spec: mujoco.MjSpec, rig: Rig) -> None:
            """Values follow from the nominal model, and some structure must be there before it is compiled."""
            for one in wanted:
                self._placed.setdefault(one.key, []).append(_placed(one, rig))
            for key, placed in self._placed.items():
                MECHANISMS[key].edit_spec(spec, rig, placed)

        self.rig = Rig(hand, step_s=step_s, spread=spread, seed=seed, edit=edit)
        self._mechanisms = {
            key: kind(self.rig, self._placed[key]) for key, kind in MECHANISMS.items() if key in self._placed
        }
        chain = _servo_dynamics(self.rig) + list(self._mechanisms.values())
        self._chain = chain
        self._stage = {stage: [getattr(one, stage) for one in chain if stage in one.stages] for stage in _STAGES}
        info = hand.description.joints.values()
        self._noise = np.array([one.noise_rad for one in info])
        self._resolution = np.array([one.resolution_rad for one in info])
        self.reset()

    @property
    def joints(self) -> tuple[str, ...]:
        return self.rig.joints

    @property
    def commands(self) -> tuple[str, ...]:
        return self.rig.commands

    @property
    def time_s(self) -> float:
        """Time since the last reset."""
        return self._steps * self.rig.step_s

    @property
    def clock_s(self) -> float:
        """Time that was asked for since the last reset; `time_s` is the nearest whole step to it."""
        return self._due_s

    @property
    def hidden(self) -> tuple[Hidden, ...]:
        """The answer: what is hidden, where, and how strong it is now."""
        return tuple(
            Hidden(key, name or None, float(value), dict(placed.more))
            for key, one in self._mechanisms.items()
            for name, value, placed in zip(one.names, one.value, self._placed[key], strict=True)
        )

    @property
    def position(self) -> np.ndarray:
        """(j,) rad: where the joints truly are, which no sensor says."""
        return self.rig.data.qpos[self.rig.qpos_of].copy()

    @property
    def targets(self) -> np.ndarray:
        """(c,) rad: the targets in force, as the bus carried them."""
        return self._requested.copy()

    def set_hidden(self, key: str, value: float, joint: str | None = None) -> None:
        """Changes the strength of an effect that is hidden already: wear. `joint` None means all of its places."""
        if key not in self._mechanisms:
            raise BadInput(f"'{key}' is not hidden in this plant", todo=nearest(key, self._mechanisms))
        mechanism = self._mechanisms[key]
        check_value(Hidden(key, joint, value))
        found = None if joint is None else match(joint, mechanism.names)
        if joint is not None and found is None:
            raise BadInput(f"{key} is not hidden at '{joint}'", todo=nearest(joint, mechanism.names))
        for index, name in enumerate(mechanism.names):
            if found is None or name == found:
                mechanism.value[index] = value
        mechanism.update()

    def reset(self, position: Mapping[str, float] | np.ndarray | None = None) -> None:
        """At rest at `position` ({joint: rad} or (j,); missing joints at the model's pose), targets where it stands."""
        rig, model, data = self.rig, self.rig.model, self.rig.data
        mujoco.mj_resetData(model, data)
        if isinstance(position, Mapping):
            for name, angle in position.items():
                data.qpos[rig.qpos_of[_row(name, rig.joint_index)]] = angle
        elif position is not None:
            data.qpos[rig.qpos_of] = np.asarray(position, dtype=float)
        if not np.isfinite(data.qpos).all():
            raise BadInput("a start angle is not finite", todo="Give every joint a number in rad")
        mujoco.mj_forward(model, data)
        commands = len(rig.commands)
        self._requested = np.clip(data.actuator_length[rig.actuator_of], rig.target_low, rig.target_high)
        self._state = State(
            time_s=0.0,
            step_s=rig.step_s,
            qpos=data.qpos,
            qvel=data.qvel,
            target=self._requested.copy(),
            angle=np.zeros(commands),
            speed=np.zeros(commands),
            servo_angle=np.zeros(commands),
            servo_speed=np.zeros(commands),
            torque=np.zeros(commands),
            drag=np.zeros(commands),
            joint_torque=data.qfrc_applied,
        )
        for one in self._chain:
            one.reset()
        self._steps = 0
        self._due_s = 0.0
        self._random = np.random.default_rng([self.seed, 2])
        self._seen: tuple[float, np.ndarray, np.ndarray] | None = None

    def set_targets(self, targets: Mapping[str, float]) -> None:
        """New position targets by command name (rad), held until the next; cut to the servo's range like a driver."""
        rig = self.rig
        for name, target in targets.items():
            if not math.isfinite(target):
                raise BadInput(f"{name}: the target {target} is no angle", allowed="a finite number in rad")
            row = _row(name, rig.command_index)
            self._requested[row] = min(max(target, rig.target_low[row]), rig.target_high[row])

    def advance(self, dt_s: float) -> None:
        """Lets time pass. Fractions of a step are carried over, so calls of any length keep the clock."""
        self._due_s += dt_s
        steps = round(self._due_s / self.rig.step_s) - self._steps
        self._run(steps)
        if not np.isfinite(self.rig.data.qpos).all() or self.rig.data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise TwinError(
                f"the plant became unstable {self.time_s:.3f} s after its start",
                where=", ".join(map(str, self.hidden)) or "nominal",
                todo="Hide a milder effect, or use a finer step",
            )

    def _run(self, steps: int) -> None:
        rig, state, stage = self.rig, self._state, self._stage
        model, data, rows = rig.model, rig.data, rig.actuator_of
        ctrl, lengths, speeds, applied = data.ctrl, data.actuator_length, data.actuator_velocity, state.joint_torque
        gain, bias, pull, brake = rig.gain, rig.bias, rig.pull, rig.brake
        low, high = rig.force_low, rig.force_high
        on_command, on_transmission, on_drive = stage["command"], stage["transmission"], stage["drive"]
        on_output, on_joint = stage["output"], stage["joint"]
        for _ in range(steps):
            mujoco.mj_step1(model, data)
            state.time_s = self.time_s
            state.target[:] = self._requested
            for act in on_command:
                act(state)
            state.angle = lengths[rows]
            state.speed = speeds[rows]
            state.servo_angle = state.angle.copy()
            state.servo_speed = state.speed.copy()
            for act in on_transmission:
                act(state)
            torque = gain * state.target + bias + pull * state.servo_angle + brake * state.servo_speed
            state.torque = np.minimum(np.maximum(torque, low), high)
            for act in on_drive:
                act(state)
            for act in on_output:
                act(state)
            if on_joint:
                applied[:] = 0.0
                state.drag[:] = 0.0
                for act in on_joint:
                    act(state)
                ctrl[rows] = state.torque + state.drag
            else:
                ctrl[rows] = state.torque
            mujoco.mj_step2(model, data)
            self._steps += 1

    def measure(self) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, np.ndarray]:
        """(names, position, velocity, effort), each (j,): rad, rad/s, N m, as the hand's driver would tell them.

        Velocity is the driver's: the filtered difference of measured angles. Joints that share a motor share their
        velocity (that of their sum) and effort (that of the motor), as on the real hand.
        """
        rig = self.rig
        position = rig.data.qpos[rig.qpos_of].copy()
        for act in self._stage["sense"]:
            act(self.time_s, position)
        noise = self._random.standard_normal(len(position))
        if not self.ideal_sensors:
            position += self._noise * noise
            fine = self._resolution > 0.0
            position[fine] = np.round(position[fine] / self._resolution[fine]) * self._resolution[fine]
        velocity = self._velocity(position)
        effort = np.zeros_like(position)
        driven = rig.command_of >= 0
        along = np.zeros(len(rig.commands))
        np.add.at(along, rig.command_of[driven], velocity[driven])
        velocity[driven] = along[rig.command_of[driven]]
        effort[driven] = self._state.torque[rig.command_of[driven]]
        return rig.joints, position, velocity, effort

    def _velocity(self, position: np.ndarray) -> np.ndarray:
        """(j,) rad/s from this measurement and the ones before."""
        now = self.time_s
        if self._seen is None or now < self._seen[0]:
            velocity = np.zeros_like(position)
        elif now == self._seen[0]:
            return self._seen[2].copy()
        else:
            before, angle, velocity = self._seen
            keep = math.exp(-(now - before) / _VELOCITY_FILTER_S)
            velocity = keep * velocity + (1.0 - keep) * (position - angle) / (now - before)
        self._seen = (now, position.copy(), velocity)
        return velocity.copy()


def _placed(hidden: Hidden, rig: Rig) -> Placed:
    """Numbers for the defaults, scaled to the place."""
    kind, name = hidden.kind, hidden.joint or ""
    scale = rig.scales[name] if name else next(iter(rig.scales.values()))
    given = hidden.value
    value = given if isinstance(given, float | int) else default_value(kind, scale, given or "mild")
    more = {key: factor * scale.amount(unit) for key, (factor, unit) in kind.more.items()}
    return Placed(name, float(value), {**more, **hidden.more})


def default_value(kind: Kind, scale: Scale, strength: str) -> float:
    """What "mild" or "severe" means at a place, in the kind's unit."""
    factor = kind.severe if strength == "severe" else kind.mild
    return factor if kind.acts_on == "hand" else factor * scale.amount(kind.unit)


def _refuse_clashes(hidden: Sequence[Hidden]) -> None:
    """One drive is either loose or soft, and every effect stands once at a place."""
    seen: set[tuple[str, str | None]] = set()
    for one in hidden:
        where = one.joint or "the hand"
        if (one.key, one.joint) in seen:
            raise BadInput(f"{one.key} is hidden twice at '{where}'", todo="Give it once, with one value")
        seen.add((one.key, one.joint))
        if {("backlash", one.joint), ("tendon_elasticity", one.joint)} <= seen:
            raise BadInput(
                f"'{where}' cannot have both backlash and tendon_elasticity", todo="Hide them on different joints"
            )


def _servo_dynamics(rig: Rig) -> list[Mechanism]:
    """Delay and lag that the nominal servos have themselves."""
    chain: list[Mechanism] = []
    for kind, values in ((CommandDelay, rig.servo_delay_s), (CommandLag, rig.servo_lag_s)):
        placed = [Placed(name, float(v), {}) for name, v in zip(rig.commands, values, strict=True) if v > 0.0]
        if placed:
            chain.append(kind(rig, placed))
    return chain


def _row(name: str, index: Mapping[str, int]) -> int:
    found = name if name in index else match(name, index)
    if found is None:
        raise BadInput(f"the hand has no '{name}'", todo=nearest(name, index))
    return index[found]

"""A planned motion: positions at points in time, with straight lines between them. Files are read by waypoints.py."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from twin_daemon.errors import BadInput, nearest
from twin_daemon.files import write_atomically
from twin_daemon.hand.description import Hand
from twin_daemon.hand.validation import read_yaml, validated
from twin_daemon.resources import trajectories_dir
from twin_daemon.signals.waypoints import Motion, points, smoothed

GROUP_SUFFIX = "_trajectories"

RANGE_TOLERANCE_RAD = 1e-3
"""Files round pi/2 to 1.5708 or 1.571: so much beyond a limit is clipped and noted, more is refused."""


@dataclass(frozen=True, eq=False)  # arrays have no single truth
class Trajectory:
    """What a hand is told to do, from time 0 (the start pose, where the hand is assumed to be) to the last point.

    `joints` are names as in the data: joints (rh_FFJ2) or commands (rh_FFJ0, the sum of J1 and J2). Joints that it
    does not name are left where they are. `notes` say what was adjusted on loading.
    """

    name: str
    joints: tuple[str, ...]
    times_s: np.ndarray  # (w,) strictly increasing, from 0
    positions: np.ndarray  # (w, j) rad
    notes: tuple[str, ...] = ()

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1])

    def sample(self, times_s: np.ndarray) -> np.ndarray:
        """Positions (T, j) at `times_s` (T,). Before the start and after the end the first and last pose hold."""
        when = np.atleast_1d(np.asarray(times_s, dtype=float))
        return np.stack([np.interp(when, self.times_s, column) for column in self.positions.T], axis=1)

    def starting_at(self, pose_rad: Mapping[str, float]) -> Trajectory:
        """The same motion from another start pose, such as the measured one; joints not in `pose_rad` stay."""
        positions = self.positions.copy()
        positions[0] = [pose_rad.get(joint, float(old)) for joint, old in zip(self.joints, positions[0], strict=True)]
        return Trajectory(self.name, self.joints, self.times_s, positions, self.notes)

    def by_command(self, hand: Hand, where: str | None = None) -> Trajectory:
        """The same motion by command: J1 and J2 become their sum J0. BadInput where only one of a pair is given.

        Joints that no command drives are left out. `where` names the source in messages.
        """
        where = where or self.name
        index = {joint: column for column, joint in enumerate(self.joints)}
        names: list[str] = []
        columns: list[np.ndarray] = []
        notes = list(self.notes)
        labels = [f"at {time_s:.3f} s" for time_s in self.times_s]
        for command, info in hand.description.commands.items():
            driven = [joint for joint in info.joints if joint in index]
            alone = len(info.joints) == 1
            if command in index and (alone or not driven):
                column = self.positions[:, index[command]]
            elif command in index:
                raise BadInput(
                    f"'{command}' and '{driven[0]}' are both given, but the one drives the other",
                    where=where,
                    todo="Give the command or the joints, not both",
                )
            elif not driven:
                continue
            elif len(driven) < len(info.joints):
                missing = ", ".join(sorted(set(info.joints) - set(driven)))
                raise BadInput(
                    f"'{driven[0]}' is given without {missing}: one motor drives them together",
                    where=where,
                    todo=f"Give them all, or the command '{command}'",
                )
            else:
                column = np.sum([self.positions[:, index[joint]] for joint in driven], axis=0)
            names.append(command)
            columns.append(_within(column, command, hand, where, labels, notes))
        if not names:
            raise BadInput("none of its joints is driven by a command", where=where)
        return Trajectory(self.name, tuple(names), self.times_s, np.stack(columns, axis=1), tuple(notes))


def allowed_range(name: str, hand: Hand) -> tuple[float, float]:
    """Range (rad) that a target of joint or command `name` may have: the joint's, within that of its own motor."""
    low, high = hand.joint_range_rad.get(name, (-np.inf, np.inf))
    for command, info in hand.description.commands.items():
        if command == name or info.joints == [name]:
            least, most = hand.command_range_rad.get(command, (-np.inf, np.inf))
            low, high = max(low, least), min(high, most)
    return low, high


def _within(
    column: np.ndarray, name: str, hand: Hand, where: str, labels: Sequence[str], notes: list[str]
) -> np.ndarray:
    """`column` (w,) clipped to the range of `name`. BadInput beyond the tolerance, naming the point by its label."""
    low, high = allowed_range(name, hand)
    clipped = np.clip(column, low, high)
    excess = np.abs(column - clipped)
    worst = int(np.argmax(excess > RANGE_TOLERANCE_RAD))
    if excess[worst] > RANGE_TOLERANCE_RAD:
        raise BadInput(
            f"{labels[worst]}: {name} is {column[worst]:.4f} rad",
            where=where,
            allowed=f"{low:.4f} to {high:.4f} rad",
            todo="Nothing has been moved; correct the trajectory",
        )
    if excess.any():
        notes.append(f"{name}: clipped by up to {excess.max() * 1e3:.2g} mrad to its range")
    return clipped


def load_trajectory(ref: str | Path, hand: Hand) -> Trajectory:
    """The trajectory `ref`: "FILE.yaml:NAME", FILE.yaml with a single one, or the NAME of one that comes with the hand.

    Only the chosen one is checked against the hand's names and ranges. Raises BadInput.
    """
    path, name = _locate(str(ref))
    motions, orders = _read(path, hand)
    if name is None:
        if len(motions) != 1:
            raise BadInput(
                f"{len(motions)} trajectories in this file",
                where=path,
                todo=f"Choose: {path}:NAME. " + nearest("", motions),
            )
        name = next(iter(motions))
    if name not in motions:
        raise BadInput(f"no trajectory '{name}'", where=path, todo=nearest(name, motions))
    where = f"{path}:{name}"
    raw = motions[name]
    motion = validated(Motion, raw if isinstance(raw, dict) else {"waypoints": raw}, where)
    plan = points(motion, orders[name], hand, where)
    notes: list[str] = []
    columns = [
        _within(column, joint, hand, where, plan.labels, notes)
        for joint, column in zip(plan.names, plan.positions.T, strict=True)
    ]
    times_s, positions = plan.times_s, np.stack(columns, axis=1)
    trajectory = Trajectory(name, plan.names, times_s, positions, tuple(notes))
    if hand.commands:
        trajectory.by_command(hand, where)  # refuses half a coupled pair, and sums beyond the motor's range
    if motion.interpolation == "cubic":
        times_s, positions = smoothed(times_s, positions)
        trajectory = Trajectory(name, plan.names, times_s, positions, tuple(notes))
    return trajectory


def trajectory_file(ref: str | Path) -> Path:
    """The file that holds the trajectory which `load_trajectory` reads for `ref`. Raises BadInput."""
    return _locate(str(ref))[0]


def known_trajectories() -> dict[str, Path]:
    """Names of the trajectories that come with this installation, and their files."""
    found: dict[str, Path] = {}
    for path in sorted(trajectories_dir().glob("*.yaml")):
        for group, motions in read_yaml(path, "a trajectory file").items():
            if isinstance(motions, dict) and group.endswith(GROUP_SUFFIX):
                found.update({str(name): path for name in motions if name not in found})
    return found


def save_trajectory(path: str | Path, trajectory: Trajectory | Sequence[Trajectory]) -> None:
    """Writes one or more trajectories, whole or not at all. They load back the same to 1 ns and 1e-12 rad."""
    several = [trajectory] if isinstance(trajectory, Trajectory) else list(trajectory)
    content = {f"hand{GROUP_SUFFIX}": {each.name: _as_written(each) for each in several}}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=118)
    target = Path(path)
    try:
        write_atomically(target, text.encode())
    except OSError as error:
        raise BadInput(f"cannot write the trajectory: {error.strerror or error}", where=target) from error


def _as_written(trajectory: Trajectory) -> dict[str, Any]:
    """The sparse form: the start pose, then for each point only the joints that changed."""
    rows = np.round(trajectory.positions, 12)
    steps_s = np.diff(np.round(trajectory.times_s, 9))
    waypoints = []
    for index, step_s in enumerate(steps_s, start=1):
        changed = np.flatnonzero(rows[index] != rows[index - 1])
        moved = {trajectory.joints[column]: float(rows[index, column]) for column in changed}
        waypoints.append({"positions": moved, "interpolate_time": round(float(step_s), 9)})
    return {"start": dict(zip(trajectory.joints, rows[0].tolist(), strict=True)), "waypoints": waypoints}


def _locate(ref: str) -> tuple[Path, str | None]:
    """File and name (None: the only one in the file) that `ref` means."""
    if Path(ref).is_file():
        return Path(ref), None
    file, colon, name = ref.rpartition(":")
    if colon and name:
        if not Path(file).is_file():
            raise BadInput("no such trajectory file", where=file, todo="Give FILE.yaml:NAME")
        return Path(file), name
    known = known_trajectories()
    if ref in known:
        return known[ref], ref
    if Path(ref).suffix or len(Path(ref).parts) > 1:
        raise BadInput("no such trajectory file", where=ref, todo="Give FILE.yaml:NAME")
    raise BadInput(f"no trajectory '{ref}'", todo=nearest(ref, known))


def _read(path: Path, hand: Hand) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """The trajectories of a file, unchecked, by name, and for each the order of its joint_angles.

    `hand_joints_order` beside `hand_trajectories` gives the order of that group; without it the hand's own holds.
    A name that stands in two groups means the first.
    """
    motions: dict[str, Any] = {}
    orders: dict[str, list[str]] = {}
    content = read_yaml(path, "a trajectory file")
    for group, members in content.items():
        if not isinstance(group, str) or not group.endswith(GROUP_SUFFIX) or not isinstance(members, dict):
            continue
        order = content.get(f"{group.removesuffix(GROUP_SUFFIX)}_joints_order", hand.description.trajectory_order)
        for name, motion in members.items():
            if str(name) not in motions:
                motions[str(name)] = motion
                orders[str(name)] = [str(joint) for joint in order] if isinstance(order, list) else []
    if not motions:
        raise BadInput("no trajectories in this file", where=path, allowed=f"hand{GROUP_SUFFIX}: {{name: [waypoints]}}")
    return motions, orders

"""From a name, a YAML file or an MJCF alone to a hand that is known to fit its model."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from twin_daemon import resources
from twin_daemon.errors import BadInput, nearest

from .mjcf import ModelNames, Servo, compile_model, read_names
from .naming import canonical, match, side
from .schema import CommandInfo, HandDescription, JointInfo
from .validation import read_yaml, validated

DEFAULT_HAND = "shadow_hand"

__all__ = ["DEFAULT_HAND", "CommandInfo", "Hand", "HandDescription", "JointInfo", "known_hands", "load_hand"]


@dataclass(frozen=True)
class Hand:
    """A description that fits its model: every joint and actuator it names is there. `load_hand` makes them.

    Ranges are infinite where the model sets no limit. For a command that drives several joints the range, velocity
    and acceleration are those of their sum (the J0 of a finger: J1 + J2).
    """

    description: HandDescription
    model_path: Path
    joint_range_rad: dict[str, tuple[float, float]] = field(default_factory=dict)
    command_range_rad: dict[str, tuple[float, float]] = field(default_factory=dict)
    slides: frozenset[str] = frozenset()
    """Joints that slide: what is rad of others is m of theirs."""

    @property
    def name(self) -> str:
        return self.description.name

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints as the data name them, in the order of the description."""
        return tuple(self.description.joints)

    @property
    def commands(self) -> tuple[str, ...]:
        """Commands as the data name them, in the order of the description."""
        return tuple(self.description.commands)

    def unit(self, command: str) -> str:
        """rad, or m for what slides."""
        return "m" if self.slides & set(self.description.commands[command].joints) else "rad"

    def velocity_limit_rad_s(self, command: str) -> float:
        """Infinite where the description gives none."""
        joints = self.description.commands[command].joints
        return sum(self.description.joints[joint].velocity_limit for joint in joints)

    def hold_margin_rad(self, command: str) -> float:
        joints = self.description.commands[command].joints
        return sum(self.description.joints[joint].hold_margin_rad for joint in joints)

    def acceleration_limit_rad_s2(self, command: str) -> float:
        joints = self.description.commands[command].joints
        return sum(self.description.joints[joint].acceleration_limit for joint in joints)


def load_hand(hand: str | Path | None = None, model: Path | str | None = None) -> Hand:
    """The hand called `hand` (a name in models/, a YAML file or its folder), with the MJCF `model` if one is given.

    Without both it is the Shadow Hand. With `model` alone the description is derived from that MJCF. Raises BadInput.
    """
    if hand is None and model is not None:
        return _derive(Path(model))
    path = _find(hand if hand is not None else DEFAULT_HAND)
    description = validated(HandDescription, read_yaml(path, "a hand description"), path)
    model_path = Path(model) if model is not None else path.parent / description.model
    return _fit(description, model_path.resolve(), path)


def known_hands() -> list[str]:
    """Names of the hands that come with this installation."""
    return sorted(path.parent.name for path in resources.models_dir().glob("*/hand.yaml"))


def _find(hand: str | Path) -> Path:
    """The description's file. A name in models/ wins over a file of that name in the working directory."""
    name = str(hand)
    if name in known_hands():
        return resources.models_dir() / name / "hand.yaml"
    path = Path(hand).expanduser()
    if path.is_dir():
        path = path / "hand.yaml"
    if path.is_file():
        if path.suffix.lower() in (".xml", ".mjcf"):
            raise BadInput("this is a model, not a hand description", where=path, todo=f"Use --model {path}")
        return path
    if path.name == name and not path.suffix:
        raise BadInput(f"no hand '{name}'", todo=nearest(name, known_hands()))
    names = ", ".join(known_hands())
    raise BadInput("no such hand description", where=path, todo=f"Give a YAML file, or a name: {names}")


def _fit(description: HandDescription, model_path: Path, path: Path) -> Hand:
    """`description` with the names as this model spells them. BadInput where the model lacks one."""
    names = read_names(compile_model(model_path), description.name)
    joints: dict[str, JointInfo] = {}
    joint_range: dict[str, tuple[float, float]] = {}
    for joint, info in description.joints.items():
        found = _must_match(info.joint, list(names.joint_range_rad), f"joints.{joint}: no joint", model_path, path)
        joints[joint] = info.model_copy(update={"joint": found})
        joint_range[joint] = _range(joint, info, found, names, path)
    data_name = {info.joint: joint for joint, info in joints.items()}
    commands: dict[str, CommandInfo] = {}
    command_range: dict[str, tuple[float, float]] = {}
    for command, info in description.commands.items():
        what = f"commands.{command}: no position servo"
        found = _must_match(info.actuator, list(names.servos), what, model_path, path)
        servo = names.servos[found]
        moved = {data_name.get(joint, joint) for joint in servo.joints}
        if moved != set(info.joints):
            raise BadInput(
                f"commands.{command}: actuator '{found}' moves {', '.join(sorted(moved))}, "
                f"not {', '.join(sorted(info.joints))}",
                where=path,
                todo=f"Correct the joints of the command, or the model {model_path}",
            )
        commands[command] = info.model_copy(update={"actuator": found})
        command_range[command] = _within_joints(servo, {info.joint: joint_range[j] for j, info in joints.items()})
    fitted = description.model_copy(update={"joints": joints, "commands": commands})
    slides = frozenset(joint for joint, info in joints.items() if info.joint in names.slides)
    return Hand(fitted, model_path, joint_range, command_range, slides)


def _range(joint: str, info: JointInfo, found: str, names: ModelNames, path: Path) -> tuple[float, float]:
    """The range of a joint: what the description gives, within that of the model. Raises BadInput."""
    slides = found in names.slides
    wrong = info.wrong_unit(slides)
    if wrong is not None:
        kind = "slides: its limits are in m (lower_m, velocity_limit_m_s ...)"
        raise BadInput(
            f"joints.{joint}.{wrong}: {joint} {kind if slides else 'turns: its limits are in rad'}",
            where=path,
            todo="Give them in its own unit",
        )
    (low, high), (least, most) = info.range, names.joint_range_rad[found]
    unit = "m" if slides else "rad"
    for key, value, beyond in (("lower", low, low < least), ("upper", high, high > most)):
        if math.isfinite(value) and beyond:
            raise BadInput(
                f"joints.{joint}.{key}_{unit}: {value:g} {unit} does not tighten the model's range",
                where=path,
                allowed=f"{least:.4f} to {most:.4f} {unit}",
                todo="Correct it, or leave it out. Angles are in rad: 30 degrees are 0.5236",
            )
    low, high = max(low, least), min(high, most)
    if low >= high:
        raise BadInput(f"joints.{joint}: nothing is left between {low:g} and {high:g} {unit}", where=path)
    return low, high


def _within_joints(servo: Servo, joint_range: dict[str, tuple[float, float]]) -> tuple[float, float]:
    """The range of a servo, within what its joints allow."""
    low, high = servo.range_rad
    ends = [joint_range.get(joint, (-math.inf, math.inf)) for joint in servo.joints]
    sums = [sorted((w * a, w * b)) for w, (a, b) in zip(servo.weights, ends, strict=True)]
    return (
        max(low, sum(end[0] for end in sums)) if math.isinf(low) else low,
        min(high, sum(end[1] for end in sums)) if math.isinf(high) else high,
    )


def _must_match(name: str, known: list[str], what: str, model_path: Path, path: Path) -> str:
    found = match(name, known)
    if found is None:
        raise BadInput(f"{what} '{name}' in {model_path.name}", where=path, todo=nearest(name, known))
    return found


def _derive(model_path: Path) -> Hand:
    """A hand that follows from an MJCF: its 1-dof joints by their own names, its position servos as commands."""
    names = read_names(compile_model(model_path), re.sub(r"[^A-Za-z0-9_\-]+", "_", model_path.stem)[:64] or "hand")
    if not names.joint_range_rad:
        raise BadInput("the model has no named hinge or slide joint", where=model_path, todo="Name its joints")
    commands = {_command_name(servo, names): servo for servo in names.servos.values()}
    if len(commands) < len(names.servos):
        commands = names.servos  # two servos on one joint: only their own names tell them apart
    raw = {
        "schema": 1,
        "name": names.name,
        "model": model_path.name,
        "joints": {joint: {} for joint in sorted(names.joint_range_rad)},
        "commands": {
            command: {"actuator": servo.name, "joints": list(servo.joints)} for command, servo in commands.items()
        },
    }
    description = validated(HandDescription, raw, model_path)
    ranges = {joint: names.joint_range_rad[joint] for joint in description.joints}
    moves = {command: servo.range_rad for command, servo in commands.items()}
    return Hand(description, model_path.resolve(), ranges, moves, names.slides)


def _command_name(servo: Servo, names: ModelNames) -> str:
    """rh_FFJ3 for an actuator rh_A_FFJ3 or FFJ3 on the joint rh_FFJ3; rh_FFJ0 for one on the tendon of J1 and J2."""
    joint = servo.joints[0]
    bare = canonical(servo.name)
    if len(servo.joints) == 1 and canonical(joint) == bare:
        return joint
    return (side(servo.name) or side(joint)) + bare

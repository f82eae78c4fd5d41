"""The description of a hand: what stands in models/<name>/hand.yaml, checked field by field."""

from __future__ import annotations

import math
import string
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from twin_daemon.errors import nearest

from .groups import derive_groups
from .naming import canonical

Name = Annotated[str, Field(min_length=1, max_length=200)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Number = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

FULL_SPEED_S = 0.1
_HINGE, _SLIDE = ("_rad", "_rad_s", "_rad_s2"), ("_m", "_m_s", "_m_s2")

NAMESPACE = r"^[A-Za-z0-9_\-]+(/[A-Za-z0-9_\-]+)*$"
"""What a hand may be called on the network: it becomes part of keys and of folders."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class JointInfo(_Strict):
    """One joint as the data name it."""

    joint: Name
    """The joint of the MJCF."""
    noise_rad: NotNegative = 0.0003
    """Standard deviation of the sensor at rest, quantisation aside."""
    resolution_rad: NotNegative = 0.0010
    """Quantisation step of the sensor; 0 where none can be seen."""
    lower_rad: Number | None = None
    upper_rad: Number | None = None
    """Range of a hinge; it counts within that of the MJCF. A joint without one is not commanded."""
    velocity_limit_rad_s: Positive | None = None
    """Of a hinge. A joint without one is not commanded."""
    acceleration_limit_rad_s2: Positive | None = None
    """Of a hinge; without it full speed takes 0.1 s."""
    lower_m: Number | None = None
    upper_m: Number | None = None
    velocity_limit_m_s: Positive | None = None
    acceleration_limit_m_s2: Positive | None = None
    """The same four of a slide."""
    range_tolerance_rad: NotNegative = 0.2
    """How far beyond its range a sound joint may read: sensors and end stops give a little."""
    hold_margin_rad: NotNegative = 0.01
    """How far the target stays ahead of the measured angle after a stop of any kind: what holds the link up."""

    @property
    def range(self) -> tuple[float, float]:
        """The range that the description gives, rad or m; infinite where it gives none."""
        low = self.lower_rad if self.lower_m is None else self.lower_m
        high = self.upper_rad if self.upper_m is None else self.upper_m
        return -math.inf if low is None else low, math.inf if high is None else high

    @property
    def velocity_limit(self) -> float:
        """rad/s or m/s; infinite where none is given."""
        given = self.velocity_limit_rad_s or self.velocity_limit_m_s
        return math.inf if given is None else given

    @property
    def acceleration_limit(self) -> float:
        """rad/s^2 or m/s^2; infinite where no velocity limit is given either."""
        return self.acceleration_limit_rad_s2 or self.acceleration_limit_m_s2 or self.velocity_limit / FULL_SPEED_S

    def wrong_unit(self, slides: bool) -> str | None:
        """The first key that is set for the other kind of joint."""
        for key in ("lower", "upper", "velocity_limit", "acceleration_limit"):
            for name in (f"{key}{unit}" for unit in (_HINGE if slides else _SLIDE)):
                if getattr(self, name, None) is not None:
                    return name
        return None


class CommandInfo(_Strict):
    """One command as the data name it: the actuator it goes to and the joints of the data that it moves."""

    actuator: Name
    joints: Annotated[list[Name], Field(min_length=1)]


CommandOutput = Literal["none", "joint_commands", "trajectory", "position_controllers"]


class DriverStop(_Strict):
    """The stop that the hand's own driver offers, called with every stop of the gate. Releasing it is the driver's."""

    zenoh_key: Annotated[str, Field(pattern=r"^[^/*#?$\s][^*#?$\s]*$", max_length=200)] | None = None
    """Put to on a stop."""
    zenoh_payload: Annotated[str, Field(max_length=1000)] = "stop"
    ros_service: Name | None = None
    """Called on a stop, through the ROS 2 bridge."""
    ros_type: Literal["std_srvs/Trigger", "std_srvs/SetBool"] = "std_srvs/Trigger"
    set_bool: bool = True
    """What a SetBool is called with to stop."""

    @model_validator(mode="after")
    def _something_to_call(self) -> DriverStop:
        if self.zenoh_key is None and self.ros_service is None:
            raise ValueError("name a zenoh_key, a ros_service, or both")
        return self

    def in_words(self) -> str:
        """What is called, for people."""
        named = (self.zenoh_key and f"key {self.zenoh_key}", self.ros_service and f"service {self.ros_service}")
        return " and ".join(filter(None, named))


class Topics(_Strict):
    """Names of the ROS topics. {joint} in position_controller is the bare command in lower case: ffj3, ffj0."""

    joint_states: Name = "joint_states"
    joint_commands: Name = "joint_commands"
    trajectory: Name = "joint_trajectory"
    position_controller: Name = "{joint}_position_controller/command"

    @field_validator("position_controller")
    @classmethod
    def _one_joint(cls, text: str) -> str:
        return _template(text, {"joint"})


class Keys(_Strict):
    """Zenoh key expressions; {ns} is the namespace of the hand, {verb} a command such as move."""

    joint_states: Name = "{ns}/joint_states"
    joint_commands: Name = "{ns}/joint_commands"
    twin_joint_states: Name = "twin/{ns}/joint_states"
    residual: Name = "twin/{ns}/residual"
    events: Name = "twin/{ns}/events"
    health: Name = "twin/{ns}/health"
    state: Name = "twin/{ns}/state"
    version: Name = "twin/{ns}/version"
    versions: Name = "twin/{ns}/versions/**"
    drift: Name = "twin/{ns}/drift"
    model: Name = "twin/{ns}/model"
    diagnose: Name = "twin/{ns}/diagnose"
    diagnosis: Name = "twin/{ns}/diagnosis"
    recalibration: Name = "twin/{ns}/recalibration"
    announcement: Name = "twin/{ns}/announcement"
    command: Name = "twin/{ns}/command/{verb}"
    driver_stop: Name = "twin/{ns}/driver/stop"
    gate: Name = "twin/{ns}/gate/{verb}"
    keep: Name = "twin/{ns}/keep"
    alive: Name = "twin/{ns}/alive"

    @model_validator(mode="after")
    def _placeholders(self) -> Keys:
        for key, text in self:
            _template(text, {"ns", "verb"} if key in ("command", "gate") else {"ns"})
        return self


class NominalUncertainty(_Strict):
    """How far a model's own numbers may be off, as a share of each (one standard deviation); 0 for what is exact."""

    damping: Annotated[float, Field(ge=0, le=1)] = 0.12
    frictionloss: Annotated[float, Field(ge=0, le=1)] = 0.12
    armature: Annotated[float, Field(ge=0, le=1)] = 0.12
    gain: Annotated[float, Field(ge=0, le=1)] = 0.12
    mass: Annotated[float, Field(ge=0, le=1)] = 0.03
    """Of each link: its mass, its inertia, and its centre of mass as a share of the distance from the link's origin."""
    ends: Annotated[float, Field(ge=0, le=1)] = 0.12
    """Of the time in which the end of a joint's travel pushes it back: a number of the simulator's."""
    between_sessions: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Of damping, friction, inertia and gain: what validation data of another session may have more or less."""
    parameters: dict[Name, Annotated[float, Field(ge=0, le=1)]] = Field(default_factory=dict)
    """Of single parameters, by names such as `rh_FFJ3.damping` or `rh_A_FFJ3.kp`, in the place of their kind's."""

    def of(self, parameter: str) -> float:
        """That of a parameter, whose name ends with its kind: "damping", "frictionloss", "armature" or "kp"."""
        if parameter in self.parameters:
            return self.parameters[parameter]
        kind = parameter.rpartition(".")[2]
        return getattr(self, "gain" if kind == "kp" else kind)


class Limit(_Strict):
    """Where a value of the hand stops being acceptable, in that value's own unit."""

    lower: Number | None = None
    upper: Number | None = None


class HandDescription(_Strict):
    """A hand: its model, the names in its data, what drives what, its sensors, limits, topics, keys and groups."""

    schema_: Literal[1] = Field(1, alias="schema")
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]{1,64}$")]
    model: Name
    """Path of the MJCF, relative to the description's folder."""
    namespace: Annotated[str, Field(pattern=NAMESPACE, max_length=100)]
    rate_hz: Annotated[float, Field(gt=0, le=10_000)] = 125.0
    joint_defaults: dict[str, float] = Field(default_factory=dict)
    """Fields of JointInfo for every joint that does not set its own; merged into `joints` on reading."""
    joints: Annotated[dict[Name, JointInfo], Field(min_length=1)]
    commands: dict[Name, CommandInfo] = Field(default_factory=dict)
    groups: dict[Name, Annotated[list[Name], Field(min_length=1)]] = Field(default_factory=dict)
    topics: Topics = Field(default_factory=Topics)
    command_output: CommandOutput = "none"
    """As what a hand behind ROS takes commands, on the topic of that name."""
    stop: DriverStop | None = None
    """The driver's own stop; without one a stop latches the gate and no more."""
    keys: Keys = Field(default_factory=Keys)
    trajectory_order: list[Name] = Field(default_factory=list)
    """Joints of the numbers in a waypoint's `joint_angles`."""
    nominal_uncertainty: NominalUncertainty = Field(default_factory=NominalUncertainty)
    tolerance_rad: Annotated[float, Field(gt=0, le=1)] | None = None
    """Errors up to this do not matter to a diagnosis; by default what the sensors' noise leaves of a right model."""

    limits: dict[Name, Limit] = Field(default_factory=dict)
    """By a parameter (FFJ3.damping) or an effect's value (backlash:FFJ3.gap): when the history reaches it is told."""
    alarm_ratio: Annotated[float, Field(gt=1, allow_inf_nan=False)] = 1.5
    """So many times what it was, or so much less: a change that recalibration follows is told as an alarm as well."""

    @property
    def bands(self) -> dict[str, tuple[float | None, float | None]]:
        """The limits as (lower, upper) by name."""
        return {name: (one.lower, one.upper) for name, one in self.limits.items()}

    def assuming(self, fields: Mapping[str, Any]) -> HandDescription:
        """The same description with other values of some fields; of a section those that are given."""
        sections = {n: getattr(self, n).model_copy(update=v) for n, v in fields.items() if isinstance(v, dict)}
        return self.model_copy(update={**fields, **sections})

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, raw: Any) -> Any:
        """What follows from the rest: namespace from the name, each joint its own MJCF joint, groups, order."""
        if not isinstance(raw, dict):
            return raw
        filled: dict[Any, Any] = dict(raw)
        common = filled.get("joint_defaults") or {}
        joints = filled.get("joints")
        if isinstance(joints, dict) and isinstance(common, dict):
            filled["joints"] = {
                name: {"joint": name} | common | (info or {}) if isinstance(info, dict | None) else info
                for name, info in joints.items()
            }
            if all(isinstance(name, str) for name in joints):
                given = filled.get("groups")
                if given is None or isinstance(given, dict):
                    filled["groups"] = derive_groups(joints) | (given or {})
                filled.setdefault("trajectory_order", list(joints))
        if "name" in filled:
            filled.setdefault("namespace", filled["name"])
        return filled

    @model_validator(mode="after")
    def _names_are_known(self) -> HandDescription:
        for command, info in self.commands.items():
            self._known(info.joints, f"commands.{command}.joints")
        for group, members in self.groups.items():
            self._known(members, f"groups.{group}")
        self._known(self.trajectory_order, "trajectory_order")
        return self

    def _known(self, names: list[str], where: str) -> None:
        for name in names:
            if name not in self.joints:
                raise ValueError(f"{where}: no joint '{name}'. {nearest(name, self.joints)}")
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ValueError(f"{where}: '{twice}' stands there twice")

    def key(self, name: str, **values: str) -> str:
        """The Zenoh key `name` of this hand: key("command", verb="move") -> "twin/shadow_hand/command/move"."""
        return getattr(self.keys, name).format(ns=self.namespace, **values)

    def position_topic(self, command: str) -> str:
        """The topic of the position controller of one command."""
        return self.topics.position_controller.format(joint=canonical(command).lower())


def _template(text: str, allowed: set[str]) -> str:
    """`text`, if its placeholders are among `allowed` and well formed."""
    try:
        found = {field for _, field, _, _ in string.Formatter().parse(text) if field is not None}
    except ValueError as error:
        raise ValueError(f"'{text}' is no template: {error}") from error
    if not found <= allowed:
        raise ValueError(f"'{text}' has unknown placeholders; allowed are {sorted(allowed)}")
    return text

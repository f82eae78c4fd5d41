"""What an effect is: named parameters, a place, an edit of the MJCF, or a line in the measurement model."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.places import HAND, ROBOT

ActsOn = Literal["joint", "tendon", "actuator", "sensor", "hand"]
StandsFor = Literal["damping", "frictionloss", "armature", "kp", "offset"]
"""What is uncertain about any nominal model: kinds of its parameters, and the constant offset of a joint's reading."""

_STILL_SHARE = 0.05  # of the fastest speed: what is slower stands still
_FAR = 1e3  # times the bounds on a small robot


@dataclass(frozen=True)
class Place:
    """Where an effect acts. `joint`, `actuator`, `tendon` are MJCF names; `command` is the data's.

    `driven` are the MJCF joints that the actuator moves (two for an underactuated finger's J0). `inertia` is what the
    joint has of links in the model's first pose while all others are free, beside its armature, kg m^2 (kg of a slide).
    The joint's link ends at `end` (m), in the frame of the body `end_body`. `order` counts the model's joints from its
    base.
    """

    target: str
    joint: str | None = None
    actuator: str | None = None
    command: str | None = None
    tendon: str | None = None
    driven: tuple[str, ...] = ()
    inertia: float = 0.0
    end_body: str | None = None
    end: tuple[float, float, float] = (0.0, 0.0, 0.0)
    order: int = -1


def motor_joint(place: Place) -> str:
    """The name of the motor-side joint that stands between an actuator and what it drives, where there is one."""
    return f"{place.actuator}_motor"


def link_tendon(place: Place) -> str:
    """The name of the tendon that measures how far the motor side and what it drives are apart."""
    return f"{place.actuator}_link"


def silent_joint(place: Place) -> str:
    """The name of the joint that yields to a servo which is silent near its target, where there is one."""
    return f"{place.actuator}_silent"


@dataclass(frozen=True)
class ReadingCurve:
    """What is added to a joint's reading over its own angle, or over that of a joint `over`: linear between its knots
    (rad), flat beyond them."""

    over: str
    knots: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, angle: np.ndarray) -> np.ndarray:
        """rad to add where the angle is (...,) rad."""
        return np.interp(angle, self.knots, self.values)


INVERTED = 60  # rounds: a curve is less steep than the angle itself, so that each comes nearer


@dataclass
class Measurement:
    """What lies between a joint and its reading: measured = gain * angle + offset + curves, by joint name in data."""

    gain: dict[str, float] = field(default_factory=dict)
    offset_rad: dict[str, float] = field(default_factory=dict)
    curves: dict[str, tuple[ReadingCurve, ...]] = field(default_factory=dict)

    def factors(self, joints: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Gain (j,) and offset (j,) in rad of some joints."""
        gain = np.array([self.gain.get(name, 1.0) for name in joints])
        return gain, np.array([self.offset_rad.get(name, 0.0) for name in joints])

    def apply(self, joints: tuple[str, ...], position: np.ndarray) -> np.ndarray:
        """True angles (..., j) -> readings (..., j), in rad."""
        gain, offset = self.factors(joints)
        return position * gain + offset + self.added(joints, position)

    def invert(self, joints: tuple[str, ...], reading: np.ndarray) -> np.ndarray:
        """Readings (..., j) -> true angles (..., j), in rad."""
        gain, offset = self.factors(joints)
        found = (reading - offset) / gain
        if not any(joint in self.curves for joint in joints):
            return found
        for _ in range(INVERTED):
            found = (reading - offset - self.added(joints, found)) / gain
        return found

    def added(self, joints: tuple[str, ...], position: np.ndarray) -> np.ndarray | float:
        """(..., j) rad that curves add to readings; a neighbour that is not among the joints adds nothing."""
        if not self.curves:
            return 0.0
        found = [(joints.index(joint), curve) for joint, own in self.curves.items() if joint in joints for curve in own]
        if not found:
            return 0.0
        out = np.zeros_like(position)
        for column, curve in found:
            over = curve.over or joints[column]
            if over in joints:
                out[..., column] += curve.at(position[..., joints.index(over)])
        return out


@dataclass(frozen=True)
class Scale:
    """How strong things are at a place, in the model without the effect: what is small and what is large there.

    `kp` N m/rad of the actuator that drives it, `force_nm` its limit (or kp times 0.1 rad where it has none),
    `damping` N m s/rad, `frictionloss` N m, `inertia` kg m2 about the joint at rest with its `armature`, `lower` and
    `upper` rad the range of the joint or of the actuated quantity, `step_s` the model's time step, `kv` N m s/rad the
    actuator's derivative gain, `length` m that of the joint's link. A model without damping or friction has what a
    servo of its kind would show: a tenth of critical, a thousandth of its stiffness.
    """

    kp: float
    force_nm: float
    damping: float
    frictionloss: float
    inertia: float
    armature: float
    lower: float
    upper: float
    step_s: float
    kv: float = 0.0
    length: float = 0.0

    @property
    def span(self) -> float:
        """rad or m: the whole range."""
        return self.upper - self.lower


@dataclass(frozen=True)
class Seen:
    """What a place measured, and what is wrong there without an effect: what a candidate's starts are read off.

    `angle` (n,) rad, its `speed` (n,) rad/s, and the `gap` (n,) rad: measured minus predicted. `time_s` (n,) begins
    again with each stretch of motion; None where it is not known.
    """

    angle: np.ndarray
    speed: np.ndarray
    gap: np.ndarray
    time_s: np.ndarray | None = None

    def response(self, scale: Scale) -> Callable[[np.ndarray], np.ndarray]:
        """Of a torque (n,) N m along the motion: (n,) rad, where it takes the joint from where its servo holds it.

        The servo is a spring with the joint's damping and inertia: what comes faster than it follows arrives late and
        weakened. A spring alone where times are not known.
        """
        if self.time_s is None or len(self.time_s) < 2:
            return lambda torque: torque / scale.kp
        from scipy.signal import bilinear, lfilter, lfilter_zi  # a daemon starts without it, half a second earlier

        steps = np.diff(self.time_s)
        rate_hz = 1.0 / float(np.median(steps[steps > 0.0]))
        ahead, back = bilinear([1.0], [scale.inertia, scale.damping + scale.kv, scale.kp], rate_hz)
        at_rest = lfilter_zi(ahead, back)
        begins = np.flatnonzero(steps <= 0.0) + 1

        def moved(torque: np.ndarray) -> np.ndarray:
            stretches = np.split(torque, begins)
            return np.concatenate([lfilter(ahead, back, one, zi=at_rest * one[0])[0] for one in stretches])

        return moved

    @property
    def _moves(self) -> np.ndarray:
        """(n,) bool: all but the slowest samples."""
        sizes = np.abs(self.speed)
        return sizes > _STILL_SHARE * float(sizes.max(initial=0.0))

    @property
    def moving(self) -> np.ndarray:
        """(m,) rad/s: the sizes of the speeds of all but the slowest samples, which are holds."""
        return np.abs(self.speed)[self._moves]

    @property
    def held_off(self) -> float:
        """rad: how far the joint is kept from where it should be while it stands still, more than at most times."""
        still = self.gap[~self._moves]
        return float(np.quantile(np.abs(still - np.median(self.gap)), 0.9)) if still.size else 0.0

    @property
    def late_s(self) -> float:
        """How much later than predicted the motion is, by least squares; negative if it is early."""
        return -float(self.gap @ self.speed) / max(float(self.speed @ self.speed), 1e-30)


@dataclass(frozen=True)
class Reach:
    """How far a value may be looked for at a place: so many times a quantity of its scale, in the value's unit."""

    of: Literal["kp", "force_nm", "damping", "frictionloss", "inertia", "span", "length"]
    times: float

    def at(self, scale: Scale) -> float:
        return self.times * getattr(scale, self.of)


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. At `neutral` the effect changes nothing; `default` is a typical visible value.

    `lower` and `upper` are its bounds on a small robot; with `reach` they are wider where the robot is stronger, and
    a logarithmic one is looked for over as many decades where it is weaker.
    `held` says that fits stay near where it is set: it counts something, and an error has many hollows over it.
    `fixed` says that fits leave it as it is set: it says which of several laws it is.
    `place` says that it is the angle where something is: of half the strength the effect is at the same one.
    `refines` says that fits leave it at neutral until the others are found, and move it where that is worth its price.
    """

    name: str
    unit: str
    lower: float
    upper: float
    neutral: float
    default: float
    meaning: str
    log: bool = False
    held: bool = False
    fixed: bool = False
    place: bool = False
    refines: bool = False
    reach: Reach | None = None

    def bounds(self, scale: Scale) -> tuple[float, float]:
        """Where it is looked for at a place, in its unit: as strong and weak as that is, and within its limits."""
        if self.reach is None:
            return self.lower, self.upper
        far, (least, most) = self.reach.at(scale), self.limits
        if self.lower < 0.0:
            lower = max(min(self.lower, -far), least)
        else:
            lower = max(min(self.lower, far * self.lower / self.upper), least) if self.log else self.lower
        return lower, min(max(self.upper, far), most)

    @property
    def limits(self) -> tuple[float, float]:
        """What is accepted at all: beyond it no robot has such a value."""
        if self.reach is None:
            return self.lower, self.upper
        lower = self.lower / _FAR if self.log else min(_FAR * self.lower, self.lower)
        return lower, _FAR * self.upper


@dataclass(frozen=True)
class Story:
    """An effect in words: what it is, how it shows in data, what causes it, what a mechanic would do."""

    what: str
    shows: str
    cause: str
    remedy: str
    excitation: str  # the motion that tells it from its neighbours

    @property
    def explanation(self) -> str:
        """What the effect is, how it shows, where it comes from and what to do about it."""
        return f"{self.what} {self.shows} Likely cause: {self.cause} What to do: {self.remedy}"


class Effect(ABC):
    """One physical effect. A subclass is one file; its docstring names the mechanism and its source.

    `rank` is its place in the library: cheaper explanations first, what rebuilds the transmission last, because it
    divides what the others have written. `confusable` lists keys that similar motion may not tell apart from it.
    `contains` lists simpler effects that it becomes at a bound of its parameters; where both explain the data the
    simpler one is reported. `excludes` lists those that have no room beside it at one place.
    """

    key: ClassVar[str]
    title: ClassVar[str]
    acts_on: ClassVar[ActsOn]
    parameters: ClassVar[tuple[Parameter, ...]]
    story: ClassVar[Story]
    confusable: ClassVar[tuple[str, ...]] = ()
    contains: ClassVar[tuple[str, ...]] = ()
    shared: ClassVar[Literal["servos", "joints", "load"] | None] = None
    """What makes several joints feel it: all servos or all joints have it alike, or it weighs on all that carry it."""
    everywhere: ClassVar[str] = ""
    """The parameter that says how strong it is where all joints have it, when the others are in units of one joint."""
    amplitudes: ClassVar[tuple[str, ...]] = ()
    """The parameters that say whether the effect is there at all; the first one where none is named."""
    rank: ClassVar[int] = 1000
    dissipative: ClassVar[bool] = False
    """Whether it only ever takes energy out of a motion."""
    stands_for: ClassVar[StandsFor | None] = None
    """What is uncertain about any nominal model and moves in its place: a fit of the effect holds it."""
    as_nominal: ClassVar[Mapping[str, float]] = {}
    """Values of the others at which its first parameter adds to what it stands for, and does nothing else."""
    excludes: ClassVar[tuple[str, ...]] = ()
    limit_of: ClassVar[tuple[str, ...]] = ()
    """Laws that become this one at a bound of theirs, where no position data tell them apart: these are named first."""
    reads_nominal_error: ClassVar[bool] = False
    """Whether `suggested` is given the error of the nominal model, not what its uncertain parameters leave of that."""
    leaves_out: ClassVar[str] = ""
    """What of the effect an MJCF cannot have, in words; empty where nothing is left out."""
    neutral_within_rad: ClassVar[float] = 1e-6
    """How far a motion may change by the effect at neutral values."""

    def __reduce__(self) -> tuple[Callable[[str], Effect], tuple[str]]:
        return _by_key, (self.key,)  # an effect is its key, in another process, too

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:  # noqa: B027
        """Writes the effect into the MjSpec. Effects of the sensor leave the model as it is."""

    def measure(self, measurement: Measurement, place: Place, values: Mapping[str, float]) -> None:  # noqa: B027
        """Writes the effect into the measurement model. Effects of the mechanics leave it as it is."""

    def applies(self, place: Place) -> bool:
        """Whether the effect can act at this place at all."""
        if self.acts_on == "hand":
            return place.target == HAND
        if place.target == ROBOT:
            return self.acts_on == "actuator" or self.shared == "joints"
        if self.acts_on == "tendon":
            return place.tendon is not None and place.command == place.target
        if self.acts_on == "actuator":
            return place.command == place.target
        return place.joint is not None

    def acts_at(self, place: Place) -> str:
        """What it acts on there: at two places with the same it is one and the same effect."""
        return place.target

    def distinct(self, places: Iterable[Place]) -> list[Place]:
        """Those of some places at which it can act, and of several at which it is the same the last from the base."""
        able = [place for place in places if self.applies(place)]
        last = {self.acts_at(place): place for place in sorted(able, key=lambda place: place.order)}
        return [place for place in able if last[self.acts_at(place)] is place]

    @abstractmethod
    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        """Finite-size values to start fits from, mild and strong, both signs where signs exist.

        Effects such as backlash or dry friction are not smooth at zero: a fit that starts there goes nowhere.
        """

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """Starts that data suggest, instead of the usual ones; none where the effect has nothing to read off."""
        return ()

    def as_limit_of(self, values: Mapping[str, float]) -> dict[str, float]:
        """This effect's values where one of `limit_of` at the given values comes to its bound."""
        raise NotImplementedError(f"{self.key} is no limit of another effect")

    def as_law_at_limit(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values of one of `limit_of` at the bound where it does what this effect does at the given ones."""
        raise NotImplementedError(f"{self.key} is no limit of another effect")

    def starts_everywhere(self) -> tuple[dict[str, float], ...]:
        """Finite-size values to start from where all joints have it alike; none where no joint's scale is needed."""
        return ()

    def as_factor(self, factor: float) -> dict[str, float]:
        """The values that do what the nominal parameter does which it `stands_for`, times so much."""
        return self.neutral() | {self.parameters[0].name: factor}

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values by name with defaults filled in. Raises BadInput on unknown names or unphysical values."""
        known = {parameter.name: parameter for parameter in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise BadInput(f"'{self.key}' has no parameter '{name}'", todo=nearest(name, known))
            parameter = known[name]
            lower, upper = parameter.limits
            if not lower <= value <= upper:
                raise BadInput(
                    f"{self.key}: {name} = {value:g} {parameter.unit} is outside physics",
                    allowed=f"{lower:g} to {upper:g} {parameter.unit}",
                )
        return {name: float(values.get(name, parameter.default)) for name, parameter in known.items()}

    def clipped(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values within what is accepted at all."""
        limits = {parameter.name: parameter.limits for parameter in self.parameters}
        return {name: float(min(max(value, limits[name][0]), limits[name][1])) for name, value in values.items()}

    def bounds(self, scale: Scale) -> dict[str, tuple[float, float]]:
        """Where each parameter is looked for at a place, in its unit."""
        return {parameter.name: parameter.bounds(scale) for parameter in self.parameters}

    @property
    def competes_with(self) -> str | None:
        """The kind of nominal parameter that it stands for; None for none, and for the offset of a reading."""
        return None if self.stands_for == "offset" else self.stands_for

    @property
    def presence(self) -> tuple[str, ...]:
        """The parameters that say whether the effect is there at all."""
        return self.amplitudes or (self.parameters[0].name,)

    def neutral(self) -> dict[str, float]:
        """The values at which the effect changes nothing."""
        return {parameter.name: parameter.neutral for parameter in self.parameters}


def _by_key(key: str) -> Effect:
    from twin_daemon.effects import LIBRARY  # it is made of what stands here

    return LIBRARY[key]

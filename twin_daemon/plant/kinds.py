"""The table of everything that the plant can hide: keys, units, neutral values, and how big mild and severe are.

A default value is a factor times a scale of the place where the effect sits (`Scale`), so that "mild" means about the
same visible error on a finger with kp 1, on one with kp 10 and on an arm. A place is a joint, a sensor (joints only), a
command, a finger (the command of a J1/J2 pair), or the whole hand. An effect that acts on a joint may also be put on
the command of a pair (FFJ0): it then acts along their tendon, on J1 + J2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

ActsOn = Literal["joint", "command", "finger", "sensor", "hand"]


@dataclass(frozen=True)
class Scale:
    """What is typical of one joint or command of the nominal model."""

    kp: float  # N m/rad of the servo that moves it
    span_rad: float  # width of its range
    force_limit_nm: float  # what the servo can give: its force range, or kp times the span
    damping: float  # N m s/rad, as the servo sees it
    inertia: float  # kg m2, as the servo sees it
    arm_m: float  # from the joint's axis to the end of its link

    @property
    def reach(self) -> float:
        """1 for a finger joint of 1.8 rad, less for joints that move less."""
        return min(max(self.span_rad / 1.8, 0.25), 1.0)

    def amount(self, unit: str) -> float:
        """What a factor of 1 means for a value in `unit`."""
        amounts = {
            "N m": self.kp * self.reach,
            "rad": self.reach,
            "rad/s": self.reach,
            "N m/rad": self.kp,
            "N m/rad^3": self.kp / self.reach**2,
            "N m s/rad": self.kp,
            "rad/(N m)": 1.0 / self.kp,
            "kg m^2": max(self.damping**2 / self.kp, self.inertia),
            "kg": self.kp / (9.81 * self.arm_m),
            "N m (limit)": self.force_limit_nm,
        }
        return amounts.get(unit, 1.0)


@dataclass(frozen=True)
class Kind:
    """One hidden effect: what its value means and which values are possible."""

    key: str
    meaning: str
    unit: str
    neutral: float
    mild: float
    severe: float
    acts_on: ActsOn
    lower: float = 0.0
    upper: float = math.inf
    more: dict[str, tuple[float, str]] = field(default_factory=dict)
    """Further numbers that may be set: name -> (factor or plain default, unit)."""


_ALL = (
    Kind("viscous_friction", "extra friction proportional to speed", "N m s/rad", 0.0, 0.006, 0.03, "joint"),
    Kind("coulomb_friction", "extra dry friction, the same at every speed", "N m", 0.0, 0.012, 0.04, "joint"),
    Kind(
        "stribeck_friction",
        "extra friction near standstill that fades with speed (LuGre)",
        "N m",
        0.0,
        0.02,
        0.05,
        "joint",
        more={"velocity": (0.1, "rad/s")},
    ),
    Kind(
        "load_friction",
        "dry friction as a share of the transmitted torque",
        "N m/(N m)",
        0.0,
        0.15,
        0.4,
        "joint",
        upper=0.95,
    ),
    Kind("backlash", "width of the free gap between motor and joint", "rad", 0.0, 0.025, 0.08, "command", upper=1.0),
    Kind(
        "hysteresis",
        "yield torque of an elasto-plastic strand beside the joint (Bouc-Wen)",
        "N m",
        0.0,
        0.015,
        0.05,
        "joint",
        more={"yield_angle": (0.1, "rad")},
    ),
    Kind("tendon_elasticity", "compliance between motor and joint", "rad/(N m)", 0.0, 1.0, 4.0, "command"),
    Kind(
        "coupling",
        "preload that keeps J1 open, with springs on J1 and J2 in the real hand's ratio",
        "N m",
        0.0,
        0.01,
        0.05,
        "finger",
        more={"spring_j1": (0.29, "1/rad"), "spring_j2": (0.46, "1/rad")},
    ),
    Kind("spring", "stiffness of a spring at the joint", "N m/rad", 0.0, 0.02, 0.1, "joint", more={"ref": (0.0, "-")}),
    Kind(
        "nonlinear_spring",
        "cubic stiffness of a spring at the joint",
        "N m/rad^3",
        0.0,
        0.02,
        0.08,
        "joint",
        more={"ref": (0.0, "-")},
    ),
    Kind(
        "joint_stop",
        "how much earlier a soft upper end stop begins",
        "rad",
        0.0,
        0.3,
        0.7,
        "joint",
        more={"stiffness": (1.0, "N m/rad")},
    ),
    Kind("armature", "extra inertia at the joint", "kg m^2", 0.0, 1.0, 4.0, "joint"),
    Kind("payload", "mass fixed to the end of the joint's link", "kg", 0.0, 0.012, 0.04, "joint"),
    Kind(
        "gravity_tilt",
        "angle by which gravity is turned about a horizontal axis",
        "rad",
        0.0,
        0.5,
        1.2,
        "hand",
        lower=-math.pi,
        upper=math.pi,
        more={"azimuth": (0.0, "-")},
    ),
    Kind("actuator_gain", "factor on the torque of the servo", "1", 1.0, 0.75, 0.4, "command", upper=10.0),
    Kind("actuator_saturation", "largest torque of the servo", "N m (limit)", math.inf, 0.3, 0.1, "command"),
    Kind("actuator_lag", "time constant of a first-order lag of the command", "s", 0.0, 0.03, 0.1, "command"),
    Kind("rate_limit", "fastest change of the command that is followed", "rad/s", math.inf, 3.0, 0.8, "command"),
    Kind("dead_zone", "error, either way, up to which the servo gives no torque", "rad", 0.0, 0.012, 0.04, "command"),
    Kind("command_delay", "time from command to servo", "s", 0.0, 0.02, 0.08, "command", upper=2.0),
    Kind(
        "torque_ripple",
        "amplitude of a cogging torque, periodic in the motor's angle",
        "N m",
        0.0,
        0.01,
        0.03,
        "command",
        more={"cycles": (25.0, "-"), "phase": (0.0, "-")},
    ),
    Kind("sensor_offset", "added to the measured angle", "rad", 0.0, 0.02, 0.06, "sensor", lower=-math.pi),
    Kind("sensor_gain", "factor on the measured angle", "1", 1.0, 1.03, 1.1, "sensor", lower=0.1, upper=10.0),
    # What real hands also do and no effect library of this project describes.
    Kind(
        "x_sticky_patch",
        "dry friction within one band of angles only: grit",
        "N m",
        0.0,
        0.03,
        0.08,
        "joint",
        more={"center": (0.5, "-"), "width": (0.15, "-")},
    ),
    Kind(
        "x_creep",
        "slow stretch of the tendon under load (Kelvin-Voigt compliance)",
        "rad/(N m)",
        0.0,
        5.0,
        15.0,
        "command",
        more={"time": (8.0, "s")},
    ),
    Kind(
        "x_thermal_fade",
        "share of torque lost when hot; heat follows the mean square torque",
        "1",
        0.0,
        0.5,
        0.9,
        "command",
        upper=0.95,
        more={"time": (6.0, "s"), "hot": (0.1, "N m (limit)")},
    ),
    Kind(
        "x_sensor_stick",
        "share of the time in which the encoder repeats its last value",
        "1",
        0.0,
        0.06,
        0.2,
        "sensor",
        upper=0.9,
        more={"hold": (0.2, "s")},
    ),
    Kind(
        "x_crosstalk",
        "share of the neighbour joint's motion that leaks into the sensor",
        "1",
        0.0,
        0.03,
        0.1,
        "sensor",
        lower=-1.0,
        upper=1.0,
    ),
    Kind(
        "x_dead_band_controller",
        "error below which the servo gives no torque, and above which all of it",
        "rad",
        0.0,
        0.02,
        0.06,
        "command",
    ),
    Kind(
        "x_slip",
        "step by which the tendon slips on its pulley at high torque",
        "rad",
        0.0,
        0.01,
        0.03,
        "command",
        more={"threshold": (0.5, "N m (limit)"), "pause": (0.1, "s")},
    ),
    Kind(
        "x_asymmetric_gain",
        "how much stronger the servo pulls (+) than it releases (-)",
        "1",
        0.0,
        0.25,
        0.6,
        "command",
        lower=-0.95,
        upper=0.95,
    ),
)

HIDDEN: dict[str, Kind] = {kind.key: kind for kind in _ALL}
FOREIGN: tuple[str, ...] = tuple(key for key in HIDDEN if key.startswith("x_"))
"""Effects that nothing in this project models: a diagnosis is right to call them unexplained."""

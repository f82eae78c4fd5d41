"""The home suite: which plants of the Shadow Hand there are, what is hidden in each, and which answer is right.

The plants know the physics, the recordings carry what a bus would have carried, and the answers stay here: the
diagnosis runs in a process of its own, which is told nothing but where the recordings are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from twin_daemon.effects import BUILT_IN
from twin_daemon.plant import FOREIGN, Hidden

FINGER = ("FFJ0", "FFJ3", "FFJ4")
WRIST = ("WRJ1", "WRJ2", "FFJ3")


@dataclass(frozen=True)
class Case:
    """One plant and the motion that it makes. `hidden` is written as `twin hand --hidden` takes it."""

    name: str
    hidden: tuple[str, ...]
    kind: str  # none, single, pair, foreign, poor
    seed: int
    joints: tuple[str, ...] = FINGER
    seconds: float = 16.0
    motion: str = "rich"
    noise: float = 1.0
    """Times the noise and the resolution of the hand's sensors."""


def _place(key: str) -> str:
    if key in ("coupling", "coulomb_friction_pair"):
        return ":FFJ0"
    return "" if key == "gravity_tilt" else ":FFJ3"


def singles() -> list[Case]:
    """Every effect of the library alone, mild and severe; each plant has other parameters."""
    out = []
    for number, key in enumerate(sorted(BUILT_IN)):
        for strength in ("mild", "severe"):
            joints = WRIST if key == "gravity_tilt" else FINGER
            hidden = (f"{key}{_place(key)}={strength}",)
            out.append(Case(f"{key}-{strength}", hidden, "single", 100 + 2 * number + (strength == "severe"), joints))
    return out


PAIRS = (
    ("backlash:FFJ3=severe", "viscous_friction:FFJ4=severe"),
    ("sensor_offset:FFJ3=severe", "coulomb_friction:FFJ4=severe"),
    ("command_delay:FFJ3=severe", "spring:FFJ4=severe"),
    ("coupling:FFJ0=severe", "sensor_gain:FFJ3=severe"),
    ("spring:FFJ3=severe", "sensor_offset:FFJ3=severe"),
    ("backlash:FFJ3=severe", "sensor_gain:FFJ3=severe"),
    ("viscous_friction:FFJ3=severe", "sensor_offset:FFJ3=severe"),
    ("coulomb_friction:FFJ3=severe", "armature:FFJ4=severe"),
)


def cases() -> list[Case]:
    """All of them, in a fixed order."""
    out = [Case(f"none-{seed}", (), "none", seed) for seed in range(1, 7)]
    out += singles()
    out += [Case("+".join(h.partition("=")[0] for h in pair), pair, "pair", 300 + i) for i, pair in enumerate(PAIRS)]
    out += [
        Case(f"{key}-{strength}", (f"{key}={strength}",), "foreign", 400 + 2 * i + (strength == "severe"))
        for i, key in enumerate(FOREIGN)
        for strength in ("mild", "severe")
    ]
    poor = ("viscous_friction:FFJ3=severe", "coulomb_friction:FFJ3=severe", "armature:FFJ3=severe",
            "actuator_lag:FFJ3=mild", "command_delay:FFJ3=mild", "sensor_gain:FFJ3=severe")  # fmt: skip
    out += [Case(f"poor-{h.partition(':')[0]}", (h,), "poor", 500 + i, motion="slow") for i, h in enumerate(poor)]
    return out


_CONDITIONS: dict[str, dict[str, Any]] = {
    "as in the suite": {},
    "another plant": {},
    "noise and resolution times 3": {"noise": 3.0},
    "half the time": {"seconds": 8.0},
}
_UNDER_CONDITIONS = (
    "",
    "backlash:FFJ3=severe",
    "viscous_friction:FFJ3=severe",
    "sensor_gain:FFJ3=severe",
    "x_creep:FFJ3=severe",
)


def conditions() -> dict[str, list[Case]]:
    """The same hidden effects under each condition: another plant and motion, worse sensors, less time."""
    found: dict[str, list[Case]] = {}
    for number, (condition, how) in enumerate(_CONDITIONS.items()):
        for hidden in _UNDER_CONDITIONS:
            kind = "none" if not hidden else "foreign" if hidden.startswith("x_") else "single"
            name = f"under-{number}-{hidden.partition(':')[0] or 'none'}"
            case = Case(name, (hidden,) if hidden else (), kind, 600 + number)
            found.setdefault(condition, []).append(replace(case, **how))
    return found


PLANTED: dict[str, tuple[str, Callable[[float], float]]] = {
    "viscous_friction": ("damping", lambda v: v),
    "coulomb_friction": ("friction", lambda v: v),
    "stribeck_friction": ("breakaway", lambda v: v),
    "load_friction": ("coefficient", lambda v: v),
    "backlash": ("gap", lambda v: v),
    "dead_zone": ("band", lambda v: v),
    "hysteresis": ("torque", lambda v: v),
    "tendon_elasticity": ("stiffness", lambda v: 1.0 / v),
    "coupling": ("preload", lambda v: v),
    "spring": ("stiffness", lambda v: v),
    "nonlinear_spring": ("cubic", lambda v: v),
    "joint_stop": ("upper", lambda v: v),
    "armature": ("armature", lambda v: v),
    "payload": ("mass", lambda v: v),
    "actuator_gain": ("factor", lambda v: v),
    "actuator_saturation": ("limit", lambda v: v),
    "actuator_lag": ("tau", lambda v: v),
    "rate_limit": ("rate", lambda v: v),
    "command_delay": ("delay", lambda v: v),
    "torque_ripple": ("amplitude", lambda v: v),
    "sensor_offset": ("offset", lambda v: v),
    "sensor_gain": ("factor", lambda v: v),
}
"""Which fitted parameter a plant's value is, and how it follows from it. A tilt has two angles and is not compared."""


def planted(hidden: Hidden) -> tuple[str, float] | None:
    """(parameter, value) that a diagnosis should find for what is hidden; None where there is no such number."""
    if hidden.key not in PLANTED or not isinstance(hidden.value, float):
        return None
    name, value = PLANTED[hidden.key]
    return name, value(hidden.value)

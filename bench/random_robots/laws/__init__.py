"""The laws that a plant may obey: the 23 effects of the product's library, written again, and laws of no library."""

from __future__ import annotations

from .base import Law, Site
from .bodies import Armature, Payload, Tilt
from .drives import DeadZone, DriftingRipple, Fading, Gain, LooseTendon, Ripple, Saturation
from .everywhere import CoulombEverywhere, DelayEverywhere, GainEverywhere, LagEverywhere, ViscousEverywhere
from .friction import Coulomb, Fluid, Load, OneWay, Patch, SquareRoot, Stribeck, Viscous, Warming
from .sensors import Crosstalk, Eccentric, Offset, Scale
from .springs import Coupling, Cubic, Hysteresis, Notch, Spring, Stop
from .targets import Delay, Lag, RateLimit, Stairs
from .transmission import Backlash, Creep, Elasticity, ServoPlay

LIBRARY: tuple[tuple[type[Law], ...], ...] = (
    (Viscous,), (Coulomb,), (Stribeck,), (Load,), (Backlash, ServoPlay), (Hysteresis,), (Elasticity,), (Coupling,),
    (Spring,), (Cubic,), (Stop,), (Armature,), (Payload,), (Tilt,), (Gain,), (Saturation,), (Lag,), (RateLimit,),
    (Delay,), (Ripple,), (Offset,), (Scale,), (DeadZone,),
)  # fmt: skip
"""The effects that the product knows by name, each in one or more forms that a robot may have it in."""

EVERYWHERE: tuple[type[Law], ...] = (
    DelayEverywhere, LagEverywhere, GainEverywhere, ViscousEverywhere, CoulombEverywhere,
)  # fmt: skip
"""One cause at all joints."""

FOREIGN: tuple[type[Law], ...] = (
    Eccentric, Notch, Fading, DriftingRipple, SquareRoot, LooseTendon, Warming, Stairs, Crosstalk, Patch, Fluid, OneWay,
    Creep,
)  # fmt: skip
"""Laws that no library has."""

__all__ = ["EVERYWHERE", "FOREIGN", "LIBRARY", "Law", "Site"]

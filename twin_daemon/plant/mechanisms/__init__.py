"""What can be wrong with a hand, each mechanism computed from first principles at the place where it sits."""

from __future__ import annotations

from .base import Mechanism
from .bodies import Armature, GravityTilt, Payload
from .commands import CommandDelay, CommandLag, DeadBand, DeadZone, RateLimit
from .drive import AsymmetricGain, Gain, Ripple, Saturation, ThermalFade
from .friction import CoulombFriction, LoadFriction, StickyPatch, StribeckFriction, ViscousFriction
from .sensing import Crosstalk, SensorGain, SensorOffset, SensorStick
from .springs import Coupling, CubicSpring, Hysteresis, SoftStop, Spring
from .transmission import Backlash, Creep, Elasticity, Slip

# The order within a stage is the order from the command to the joint and on to the sensor.
MECHANISMS: dict[str, type[Mechanism]] = {
    "command_delay": CommandDelay,
    "rate_limit": RateLimit,
    "actuator_lag": CommandLag,
    "x_creep": Creep,
    "x_slip": Slip,
    "backlash": Backlash,
    "tendon_elasticity": Elasticity,
    "dead_zone": DeadZone,
    "x_dead_band_controller": DeadBand,
    "actuator_gain": Gain,
    "x_asymmetric_gain": AsymmetricGain,
    "x_thermal_fade": ThermalFade,
    "actuator_saturation": Saturation,
    "torque_ripple": Ripple,
    "viscous_friction": ViscousFriction,
    "coulomb_friction": CoulombFriction,
    "stribeck_friction": StribeckFriction,
    "load_friction": LoadFriction,
    "x_sticky_patch": StickyPatch,
    "hysteresis": Hysteresis,
    "spring": Spring,
    "nonlinear_spring": CubicSpring,
    "joint_stop": SoftStop,
    "coupling": Coupling,
    "armature": Armature,
    "payload": Payload,
    "gravity_tilt": GravityTilt,
    "sensor_gain": SensorGain,
    "sensor_offset": SensorOffset,
    "x_crosstalk": Crosstalk,
    "x_sensor_stick": SensorStick,
}

__all__ = ["MECHANISMS", "Mechanism"]

"""The library of physical effects: a readable list, cheapest explanation first."""

from __future__ import annotations

from twin_daemon.effects.actuator_gain import ActuatorGain
from twin_daemon.effects.actuator_lag import ActuatorLag
from twin_daemon.effects.actuator_saturation import ActuatorSaturation
from twin_daemon.effects.armature import Armature
from twin_daemon.effects.backlash import Backlash
from twin_daemon.effects.base import Effect
from twin_daemon.effects.command_delay import CommandDelay
from twin_daemon.effects.coulomb_friction import CoulombFriction
from twin_daemon.effects.coupling import Coupling
from twin_daemon.effects.gravity_tilt import GravityTilt
from twin_daemon.effects.hysteresis import Hysteresis
from twin_daemon.effects.joint_stop import JointStop
from twin_daemon.effects.load_friction import LoadFriction
from twin_daemon.effects.nonlinear_spring import NonlinearSpring
from twin_daemon.effects.payload import Payload
from twin_daemon.effects.rate_limit import RateLimit
from twin_daemon.effects.sensor_gain import SensorGain
from twin_daemon.effects.sensor_offset import SensorOffset
from twin_daemon.effects.spring import Spring
from twin_daemon.effects.stribeck_friction import StribeckFriction
from twin_daemon.effects.tendon_elasticity import TendonElasticity
from twin_daemon.effects.torque_ripple import TorqueRipple
from twin_daemon.effects.viscous_friction import ViscousFriction

# One parameter before two, what the model has before what it lacks. Effects that rebuild the transmission come
# last: they divide what the others have written.
_EFFECTS: tuple[Effect, ...] = (
    SensorOffset(),
    SensorGain(),
    ViscousFriction(),
    CoulombFriction(),
    Armature(),
    Payload(),
    ActuatorGain(),
    ActuatorSaturation(),
    CommandDelay(),
    ActuatorLag(),
    RateLimit(),
    GravityTilt(),
    Spring(),
    StribeckFriction(),
    Hysteresis(),
    NonlinearSpring(),
    JointStop(),
    TorqueRipple(),
    LoadFriction(),
    Coupling(),
    TendonElasticity(),
    Backlash(),
)

LIBRARY: dict[str, Effect] = {effect.key: effect for effect in _EFFECTS}
"""Every effect by its key. The order is the order in which effects are written into a model."""

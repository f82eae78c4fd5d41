"""What position data of such motions cannot tell apart, with the reason: there, `ambiguous` with all names is right."""

from __future__ import annotations

import numpy as np

from .laws import Law
from .laws.transmission import ServoPlay

_SERVO = "a servo of stiffness kp answers a torque t by the angle t / kp: "

_ALWAYS: dict[str, dict[str, str]] = {
    "sensor_offset": {"spring": _SERVO + "a constant pull moves the joint as a wrong zero moves the reading"},
    "sensor_gain": {
        "spring": _SERVO + "a pull that grows with the angle scales the motion as a wrong scale the reading"
    },
    "spring": {
        "sensor_gain": _SERVO + "a wrong scale of the reading is a pull that grows with the angle",
        "sensor_offset": _SERVO + "a wrong zero of the reading is a constant pull",
    },
    "tendon_elasticity": {
        "actuator_gain": "servo and shaft in series are a weaker servo up to the motor's own inertia",
    },
}
_LIGHT_MOTOR = "within its play a motor that weighs nothing goes to its target at once: the servo is silent there"
_PASSIVE: dict[str, dict[str, str]] = {
    "spring": {"coupling": "a spring at one joint of a coupled pair is a part of the law of the split"},
    "coulomb_friction": {"coupling": "dry friction at one joint of a coupled pair is a part of the law of the split"},
    "joint_stop": {"coupling": "a stop of one joint of a coupled pair is a part of the law of the split"},
}


_TIMES = {"command_delay": "actuator_lag", "actuator_lag": "command_delay"}
_UNSEEN = 1.0  # over the floor


def ties(law: Law, strength: float) -> dict[str, str]:
    """Keys of the effects that cannot be told from the law where it is, each with its reason.

    `strength` is its rms response over the floor.
    """
    found = dict(_ALWAYS.get(law.key, {}))
    robot, joint = law.site.robot, law.site.joint
    if len(robot.servos[robot.servo_of(joint)].joints) > 1:
        found |= _PASSIVE.get(law.key, {})
    if law.key in _TIMES:
        # a lag is a delay plus half its square times the acceleration
        speed = np.gradient(law.site.command) * robot.rate_hz
        quick = float(np.std(np.gradient(speed) * robot.rate_hz) / np.std(speed))  # rad/s
        if 0.5 * next(iter(law.values().values())) * quick * strength < _UNSEEN:
            found[_TIMES[law.key]] = "to first order both shift the motion in time; the second order is below the floor"
    if law.key == "dead_zone":
        found["backlash"] = _LIGHT_MOTOR
    if isinstance(law, ServoPlay):
        found["dead_zone"] = _LIGHT_MOTOR
    sag = float(robot.gravity_load[joint])
    if law.key == "backlash" and sag < 1e-3 * law.site.kp * law.site.unit:
        found["dead_zone"] = "without a load a joint in its play and a servo in its silence both stay where they are"
    return found

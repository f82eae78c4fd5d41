"""Play between the motor and the joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Seen, Story
from twin_daemon.effects.edits import servo_stiffness
from twin_daemon.effects.silence import brakes_itself, separate_derivative, silent_within
from twin_daemon.effects.transmission import DAMPING_SHARE, MOTOR_SHARE, OVERLAP, implicit_spring, motor_side, moved_out

_STIFF = 1000.0  # the ends of the gap over the servo
_LOSS_STEPS = 5.0  # damping over stiffness at these ends, in time steps: they meet without rebound


class Backlash(Effect):
    """A motor of its own, and a limited tendon `motor - joint`: free within the gap, stiff at its ends.

    The ends are a thousand times as stiff as the servo, or as stiff as the tendon where that is elastic, too.

    In models of arms a derivative gain often stands for what brakes the joint as well. Where that acts on the joint
    itself (`braked`), the motor is taken to weigh nothing: then it is in place at once, and within the gap the servo
    only brakes. Without a derivative gain it does nothing there; a motor of its own that is as light would need a
    smaller time step.
    """

    key = "backlash"
    title = "play in the transmission"
    acts_on = "actuator"
    rank = 220
    dissipative = True
    neutral_within_rad = 5e-4  # a rigid link is a very stiff one: see above
    parameters = (
        Parameter("gap", "rad", 0.0, 1.0, 0.0, 0.06, "angle that the motor turns at a reversal for nothing"),
        MOTOR_SHARE,
        DAMPING_SHARE,
        Parameter(
            "braked",
            "1",
            0.0,
            1.0,
            0.0,
            0.0,
            "1 where the motor weighs nothing, and the servo's derivative gain acts on the joint itself",
            fixed=True,
        ),
    )
    story = Story(
        what="At a reversal the motor turns through a gap before it takes the joint along.",
        shows="The joint stays where it is at reversals, then follows with a constant shift that changes sign.",
        cause="Worn gear teeth, a slack tendon, a loose pin or key.",
        remedy="Retension the tendon; renew gear or pin.",
        excitation="small slow reversals at several angles, with load from either side",
    )
    confusable = ("coulomb_friction", "hysteresis", "tendon_elasticity", "sensor_offset")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        if values["braked"] > 0.5:
            if brakes_itself(spec, place):
                separate_derivative(spec, place)
            silent_within(spec, place, 0.5 * values["gap"])
            return
        link = motor_side(spec, place, values)
        tie = spec.equality(link.tendon)
        if tie is None:
            stiffness = _STIFF * servo_stiffness(spec, place)
            solref, solimp = implicit_spring(
                spec, link.tendon, stiffness, _LOSS_STEPS * spec.option.timestep * stiffness
            )
        else:  # an elastic tendon with play: its spring acts at the ends of the gap
            solref, solimp = np.array(tie.solref), np.array(tie.solimp)
            spec.delete(tie)
        tendon = spec.tendon(link.tendon)
        gap = values["gap"]
        half = 0.5 * gap + moved_out(gap)
        tendon.range = np.array([-half, half])
        tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        tendon.margin = OVERLAP
        tendon.solref_limit, tendon.solimp_limit = solref, solimp

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"gap": gap, "motor_share": 0.2, **law} for gap in (0.02, 0.06, 0.2) for law in _laws(scale))

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """Gaps of the size of the error: at rest a joint lies up to half of its play to either side."""
        low, high = np.percentile(seen.gap, [10.0, 90.0])
        size = float(high - low)
        if size <= 0.0:
            return ()
        sizes = [(share * size, part) for share in (0.7, 2.0) for part in (0.05, 0.3)]
        return tuple({"gap": gap, "motor_share": part, **law} for law in _laws(scale) for gap, part in sizes)


def _laws(scale: Scale) -> list[dict[str, float]]:
    """What a derivative gain may act on: the motor, or the joint itself."""
    return [{"braked": float(joint)} for joint in range(2 if scale.kv > 0.0 else 1)]

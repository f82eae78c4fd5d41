"""Friction that is highest at rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_passive_motor, bristle_stiffness

_FLOOR = 1e-9  # N m: LuGre divides by its friction


class StribeckFriction(Effect):
    """Breakaway friction beside the model's own, as breakaway * exp(-(speed / velocity)^2).

    The LuGre law (Canudas de Wit et al. 1995) of a `dcmotor` without input, whose bristle MuJoCo integrates
    exactly.
    """

    key = "stribeck_friction"
    title = "friction that is highest at rest (stick-slip)"
    acts_on = "joint"
    rank = 140
    dissipative = True
    parameters = (
        Parameter(
            "breakaway", "N m", 0.0, 5.0, 0.0, 0.1, "friction at rest beside the model's own", reach=Reach("kp", 0.5)
        ),
        Parameter("velocity", "rad/s", 1e-5, 100.0, 0.1, 0.1, "speed at which a third of it is left", log=True),
    )
    story = Story(
        what="Dry friction that holds at rest and lets go once the joint moves.",
        shows="The joint sticks, jumps and sticks again in slow motion; fast motion is healthy.",
        cause="Lubricant that is squeezed out at rest, a worn seal, a tendon that sticks in its sheath.",
        remedy="Clean and grease; renew the seal or the sheath.",
        excitation="very slow motion beside fast motion, and starts from rest",
    )
    confusable = ("coulomb_friction", "hysteresis", "load_friction", "backlash")
    contains = ("coulomb_friction",)

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        stiffness = bristle_stiffness(spec, place)
        motor = add_passive_motor(spec, f"{place.joint}_stribeck", mujoco.mjtTrn.mjTRN_JOINT, place.joint)
        motor.biasprm = np.array([0, 0, 0, _FLOOR, _FLOOR + values["breakaway"], values["velocity"], *np.zeros(4)])
        motor.dynprm = np.array([0, 0, 0, 0, 0, stiffness, 0, 0, 0, 0], float)
        motor.actdim = 1

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """Friction that fades within the speeds that the motion has, early or late.

        At rest it keeps the joint as far from its target as it bends the servo: up to the breakaway over kp.
        """
        if not seen.moving.size:
            return ()
        usual, holds = float(np.median(seen.moving)), scale.kp * seen.held_off
        strengths = tuple(share * holds for share in (0.25, 0.6, 1.2)) if holds > 0.0 else _usual(scale)
        return _within(strengths, (0.1 * usual, 0.6 * usual))

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return _within(_usual(scale), (0.06, 0.35))


def _usual(scale: Scale) -> tuple[float, ...]:
    return tuple(share * scale.kp for share in (0.005, 0.02, 0.04))


def _within(strengths: tuple[float, ...], velocities: tuple[float, ...]) -> tuple[dict[str, float], ...]:
    return tuple({"breakaway": strength, "velocity": v} for strength in strengths for v in velocities)

"""What a twin needs of any MJCF model: names, rad, damping taken implicitly, and which joints an actuator moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from twin_daemon.simulation.radians import in_radians


def prepare(spec: Any) -> None:
    """What a twin needs of any model: names of bodies and tendons, rad, and steps that take damping implicitly.

    MuJoCo's Runge-Kutta takes all of them explicitly: at a usual step dry friction, play or an elastic tendon then runs
    away. What the change costs is an error of the time step like any other's (`Posterior.corrections_at`).
    """
    in_radians(spec)
    _name(spec.bodies, "body")
    _name(spec.tendons, "tendon")
    if spec.option.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST


def _name(elements: Sequence[Any], kind: str) -> None:
    """Gives elements that their author left without a name one: masses, loads and parts are told by it."""
    taken = {element.name for element in elements}
    for index, element in enumerate(elements):
        if not element.name:
            name = f"{kind}_{index}"
            while name in taken:
                name += "_"
            element.name = name
            taken.add(name)


def driven_joints(model: mujoco.MjModel, actuator: int) -> list[tuple[int, float]]:
    """The joints that an actuator moves, each with the derivative of the actuated length by its angle."""
    gear = float(model.actuator_gear[actuator, 0])
    target = int(model.actuator_trnid[actuator, 0])
    kind = model.actuator_trntype[actuator]
    if kind == mujoco.mjtTrn.mjTRN_JOINT:
        return [(target, gear)]
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        start, count = int(model.tendon_adr[target]), int(model.tendon_num[target])
        wraps = range(start, start + count)
        joints = [w for w in wraps if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT]
        return [(int(model.wrap_objid[w]), gear * float(model.wrap_prm[w])) for w in joints]
    return []


def far_end(model: mujoco.MjModel, body: int) -> tuple[int, np.ndarray]:
    """(body, (3,) m in its frame): where a link ends. One that is a single point ends where the link it carries does.

    The last link of a chain is as far again as its centre of mass.
    """
    children = np.flatnonzero(model.body_parentid == body)
    away = [child for child in children if np.linalg.norm(model.body_pos[child]) > 1e-6]
    if away:
        return body, model.body_pos[away].mean(axis=0)
    if children.size:
        return far_end(model, int(children[0]))
    return body, 2.0 * model.body_ipos[body]


def make_inertia_explicit(body: Any, compiled: Any) -> None:
    """Writes into a spec's body the mass and inertia that MuJoCo derived from its geoms."""
    if not body.explicitinertial:
        body.explicitinertial = True
        body.mass, body.ipos, body.iquat = float(compiled.mass[0]), compiled.ipos, compiled.iquat
        body.inertia = compiled.inertia

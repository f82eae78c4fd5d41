"""Parts of a hand that move on their own: a finger, the thumb, the wrist, or a whole arm.

A roll-out of one finger costs a fraction of the whole hand's, and what happens in one finger says nothing
about another. A part is a branch of the kinematic tree; the trunk below it (a wrist) stays in the part's model
when it moves, and is welded where it stands when it does not.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.sparse.csgraph import connected_components

from twin_daemon.effects.edits import keep_softness
from twin_daemon.hand.description import Hand
from twin_daemon.simulation.model_elements import driven_joints, make_inertia_explicit
from twin_daemon.simulation.parameters import KINDS
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Part:
    """`joints` are the data's names that belong to the part, `trunk` those it stands on (base first)."""

    name: str
    joints: tuple[str, ...]
    trunk: tuple[str, ...]


def parts(twin: TwinModel) -> tuple[Part, ...]:
    """The branches of the hand: joints that share a chain or an actuator belong together."""
    bodies, ancestors = _standing(twin)
    above = {a: [b for b in bodies if b != a and bodies[a] in ancestors[b]] for a in bodies}
    # a trunk joint carries joints of at least two branches that do not carry each other
    forks = {a for a, carried in above.items() if _branches(carried, bodies, ancestors)}
    trunk = {a for a, carried in above.items() if a in forks or forks & set(carried)}
    free = [name for name in twin.joints if name not in trunk]
    driven = [set(names) for names in twin.driven]
    related = [[b in above[a] or any({a, b} <= names for names in driven) for b in free] for a in free]
    found = []
    if trunk:
        found.append(Part("trunk", tuple(n for n in twin.joints if n in trunk), ()))
    for places in _connected(related):
        members = tuple(free[place] for place in places)
        under = [n for n in trunk if any(bodies[n] in ancestors[m] for m in members)]
        base_first = tuple(sorted(under, key=lambda n: (len(ancestors[n]), n)))
        found.append(Part(_part_name(twin, members), members, base_first))
    return tuple(found)


def drive_groups(twin: TwinModel) -> tuple[Part, ...]:
    """The smallest parts: the joints that one actuator moves together, and each other joint alone.

    With what the rest of the robot does to them as prescribed torques, they move on their own.
    """
    taken: set[str] = set()
    found = []
    for name in twin.joints:
        if name not in taken:
            members = {name}
            while (more := set(with_coupled(twin, members))) != members:
                members = more
            taken |= members
            joints = tuple(n for n in twin.joints if n in members)
            found.append(Part(_part_name(twin, joints), joints, ()))
    return tuple(found)


def linked(twin: TwinModel, groups: Sequence[Sequence[str]]) -> list[list[int]]:
    """Which groups of joints hang together: one of them carries another, or is carried by it."""
    body, ancestors = _standing(twin)
    bodies = [{body[joint] for joint in joints} for joints in groups]
    above = [set[int]().union(*(ancestors[joint] for joint in joints)) for joints in groups]
    return _connected([[bool(own & up) for up in above] for own in bodies])


def _connected(related: Sequence[Sequence[bool]]) -> list[list[int]]:
    """Places of what is related, directly or by others, the first of each group first; rows (n, n) of a relation."""
    count = len(related)
    number, label = connected_components(np.array(related, bool).reshape(count, count), directed=False)
    groups = [[place for place in range(count) if label[place] == which] for which in range(number)]
    return sorted(groups)


def _part_name(twin: TwinModel, members: tuple[str, ...]) -> str:
    """The smallest named group that holds all of the part's joints."""
    fitting = [(len(g), name) for name, g in twin.hand.description.groups.items() if set(members) <= set(g)]
    return min(fitting)[1] if fitting and len(members) > 1 else next(iter(members))


def _branches(carried: list[str], bodies: dict[str, int], ancestors: dict[str, set[int]]) -> bool:
    heads = [c for c in carried if not any(bodies[o] in ancestors[c] and bodies[o] != bodies[c] for o in carried)]
    return len({bodies[h] for h in heads}) > 1


def upwards(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and all that it stands on, the world last."""
    chain = [body]
    while body:
        body = int(model.body_parentid[body])
        chain.append(body)
    return chain


def carried_by_all(twin: TwinModel, joints: Sequence[str]) -> tuple[str, ...]:
    """The other joints that each of these carries, in the twin's order."""
    bodies, ancestors = _standing(twin)
    under = {name for name in twin.joints if all(bodies[one] in ancestors[name] for one in joints)}
    return tuple(name for name in twin.joints if name in under.difference(joints))


def _standing(twin: TwinModel) -> tuple[dict[str, int], dict[str, set[int]]]:
    """(the body that a joint moves, that body with all that it stands on) by joint."""
    model = twin.model
    bodies = {name: int(model.dof_bodyid[dof]) for name, dof in zip(twin.joints, twin.dof_adr, strict=True)}
    return bodies, {name: set(upwards(model, body)) for name, body in bodies.items()}


def with_coupled(twin: TwinModel, joints: Collection[str]) -> tuple[str, ...]:
    """The joints and those that share an actuator with one of them, in the twin's order."""
    keep = set(joints)
    for driven in twin.driven:
        if keep.intersection(driven):
            keep.update(driven)
    return tuple(n for n in twin.joints if n in keep)


def submodel(
    twin: TwinModel, keep: tuple[str, ...], position: np.ndarray, *, contacts: bool = False, bodies: bool = False
) -> TwinModel:
    """The twin reduced to some joints; the others are welded at `position` (j,) rad, and what they carry goes.

    Without `contacts` there are no geoms: for motions in which nothing touches. The terms of joints and
    commands that are gone are dropped. With `bodies`, and where a term is about one, bodies that are welded together
    remain, each with its own mass; else they are one.
    """
    fused = not (contacts or bodies or any(map(is_of_body, twin.terms.parameters)))
    reduced = _without_terms(twin, keep, position, contacts, fused)
    names = {reduced.place(n).target for n in (*reduced.joints, *reduced.actuators)}
    present = {reduced.model.body(i).name for i in range(1, reduced.model.nbody)}
    parameters = {n: v for n, v in twin.terms.parameters.items() if _is_there(n, names, present)}
    effects = tuple(t for t in twin.terms.effects if t.target in names or t.target == "hand")
    return reduced.changed(Terms(parameters=parameters, effects=effects))


def is_of_body(parameter: str) -> bool:
    """Whether a parameter is a body's: its mass, its inertia or its centre of mass."""
    return KINDS[parameter.rpartition(".")[2]].element == "body"


def _is_there(parameter: str, names: Collection[str], bodies: Collection[str]) -> bool:
    """Whether a parameter's joint, command or body is; a joint and the body of another one may share a name."""
    return parameter.rpartition(".")[0] in (bodies if is_of_body(parameter) else names)


def _without_terms(
    twin: TwinModel, keep: tuple[str, ...], position: np.ndarray, contacts: bool, fused: bool
) -> TwinModel:
    spec = twin.nominal.copy()
    joints = {name: info.joint for name, info in twin.hand.description.joints.items() if name in twin.joints}
    kept = {joints[name] for name in keep}
    for key in list(spec.keys):
        spec.delete(key)
    _delete_actuators(spec, twin, kept)
    _delete_tendons(spec, kept)
    for equality in list(spec.equalities):
        spec.delete(equality)
    for index, name in enumerate(twin.joints):
        if name not in keep:
            angle = float(position[index]) if np.isfinite(position[index]) else 0.0
            _weld(spec, joints[name], angle)
    if not contacts:
        _strip(spec, twin.base_model)
    # before static bodies are fused: a spec that has been fused loses its last bit when it is written
    keep_softness(spec, twin.nominal_model, sorted(kept), [tendon.name for tendon in spec.tendons])
    spec.compiler.fusestatic = spec.compiler.fusestatic or fused
    description = twin.hand.description
    smaller = description.model_copy(update={"joints": {n: description.joints[n] for n in twin.joints if n in keep}})
    reduced = TwinModel(Hand(smaller, twin.hand.model_path), spec, Terms())
    reduced.made_by = _without_terms, (twin, keep, position, contacts, fused)
    return reduced


def _delete_actuators(spec: Any, twin: TwinModel, kept: set[str]) -> None:
    base = twin.base_model
    for index in range(base.nu):
        driven = [base.joint(j).name for j, _ in driven_joints(base, index)]
        if not driven or not set(driven) <= kept:
            spec.delete(spec.actuator(base.actuator(index).name))
    for sensor in list(spec.sensors):
        spec.delete(sensor)


def _delete_tendons(spec: Any, kept: set[str]) -> None:
    for tendon in list(spec.tendons):
        joints = [wrap.target.name for wrap in tendon.path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT]
        if not joints or not set(joints) <= kept:
            spec.delete(tendon)


def _weld(spec: Any, joint_name: str, angle: float) -> None:
    joint = spec.joint(joint_name)
    body = joint.parent
    quat = np.array(body.quat, float)
    turn, shift = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
        mujoco.mju_axisAngle2Quat(turn, np.asarray(joint.axis, float) / np.linalg.norm(joint.axis), angle)
        anchor = np.array(joint.pos, float)
        moved = np.empty(3)
        mujoco.mju_rotVecQuat(moved, anchor, turn)
        shift = anchor - moved
    else:
        shift = np.asarray(joint.axis, float) * angle
    world = np.empty(3)
    mujoco.mju_rotVecQuat(world, shift, quat)
    combined = np.empty(4)
    mujoco.mju_mulQuat(combined, quat, turn)
    body.pos = np.asarray(body.pos) + world
    body.quat = combined
    spec.delete(joint)


def _strip(spec: Any, model: mujoco.MjModel) -> None:
    for body in spec.bodies[1:]:
        make_inertia_explicit(body, model.body(body.name))
    for element in [
        *spec.excludes,
        *spec.pairs,
        *spec.geoms,
        *spec.meshes,
        *spec.cameras,
        *spec.lights,
        *spec.materials,
        *spec.textures,
    ]:
        spec.delete(element)

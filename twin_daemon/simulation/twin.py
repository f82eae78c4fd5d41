"""The twin of one hand: its nominal MJCF, changed by terms, compiled, with the data's names mapped onto it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Measurement, Place
from twin_daemon.errors import BadInput, nearest
from twin_daemon.hand.description import Hand
from twin_daemon.hand.naming import match
from twin_daemon.simulation.parameters import KINDS, ParameterKind
from twin_daemon.simulation.selfcontained import inline_meshes
from twin_daemon.simulation.terms import Terms


@dataclass(frozen=True)
class ParameterRef:
    """Where one parameter lives in a compiled model: its kind and the id of its element."""

    name: str
    kind: ParameterKind
    element: str
    id: int

    def read(self, model: mujoco.MjModel) -> float:
        return self.kind.read(model, self.id)

    def write(self, model: mujoco.MjModel, value: float) -> None:
        self.kind.write(model, self.id, value)


class TwinModel:
    """A compiled twin.

    `joints` are the joint names of the data that the model has, in the hand description's order; `qpos_adr`
    and `dof_adr` (j,) are where they live. `actuators` (nu,) is the command name of each actuator.
    """

    def __init__(self, hand: Hand, spec: Any, terms: Terms) -> None:
        self.hand = hand
        self.terms = terms
        self._nominal = spec
        self.spec = spec.copy()
        self.measurement = Measurement()
        try:
            self._apply(terms)
            self.model = self.spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise BadInput(
                f"the MJCF does not compile: {error}", where=hand.model_path, todo="Mend the model or the terms"
            ) from None
        self._map_names()

    @classmethod
    def load(cls, hand: Hand, terms: Terms | None = None) -> TwinModel:
        """The hand's own MJCF with terms applied. Raises BadInput where either cannot be used."""
        try:
            spec = mujoco.MjSpec.from_file(str(hand.model_path))
        except (ValueError, OSError, mujoco.FatalError) as error:
            raise BadInput(f"not a usable MJCF: {error}", where=hand.model_path) from None
        return cls(hand, spec, terms or Terms())

    @classmethod
    def from_mjcf(cls, hand: Hand, mjcf: str, terms: Terms | None = None) -> TwinModel:
        """A twin from the text of one plain MJCF, such as a stored version's."""
        try:
            spec = mujoco.MjSpec.from_string(mjcf)
        except (ValueError, mujoco.FatalError) as error:
            raise BadInput(f"not a usable MJCF: {error}", where=f"stored model of {hand.description.name}") from None
        return cls(hand, spec, terms or Terms())

    def changed(self, terms: Terms) -> TwinModel:
        """Another twin of the same hand: the same nominal model with other terms."""
        return TwinModel(self.hand, self._nominal, terms)

    # -- names ---------------------------------------------------------------------------------------------

    def _map_names(self) -> None:
        description, model = self.hand.description, self.model
        present = [(name, info) for name, info in description.joints.items() if self._id("joint", info.joint) >= 0]
        self.joints = tuple(name for name, _ in present)
        ids = np.array([self._id("joint", info.joint) for _, info in present], dtype=int)
        self.qpos_adr = model.jnt_qposadr[ids].astype(int)
        self.dof_adr = model.jnt_dofadr[ids].astype(int)
        by_actuator = {info.actuator: name for name, info in description.commands.items()}
        names = [model.actuator(i).name for i in range(model.nu)]
        self.actuators = tuple(by_actuator.get(name, name) for name in names)

    def _id(self, element: str, name: str) -> int:
        return mujoco.mj_name2id(self.model, getattr(mujoco.mjtObj, f"mjOBJ_{element.upper()}"), name)

    @cached_property
    def drive(self) -> np.ndarray:
        """(nu, j): the actuated quantity (joint angle, or the sum a tendon pulls) as a linear map of the joints."""
        drive = np.zeros((self.model.nu, len(self.joints)))
        column = {int(adr): i for i, adr in enumerate(self.dof_adr)}
        for actuator in range(self.model.nu):
            for joint, coefficient in driven_joints(self.model, actuator):
                dof = int(self.model.jnt_dofadr[joint])
                if dof in column:
                    drive[actuator, column[dof]] = coefficient
        return drive

    def place(self, target: str) -> Place:
        """Where an effect acts, from the name of a joint or of a command as in the data ('hand' for the whole)."""
        if target == "hand":
            return Place(target=target)
        joint_name = match(target, self.joints)
        command = match(target, self.actuators)
        if joint_name is None and command is None:
            known = [*self.joints, *(a for a in self.actuators if a not in self.joints)]
            raise BadInput(f"no joint or command '{target}'", where=self.hand.description.name, todo=nearest(target, known))
        return self._places[joint_name or command or ""]

    @cached_property
    def _places(self) -> dict[str, Place]:
        places = {}
        for index, name in enumerate(self.joints):
            joint = self.hand.description.joints[name].joint
            drivers = np.flatnonzero(self.drive[:, index])
            actuator = int(drivers[0]) if drivers.size else None
            places[name] = self._place(name, joint, actuator)
        for index, name in enumerate(self.actuators):
            if name not in places:
                places[name] = self._place(name, None, index)
        return places

    def _place(self, name: str, joint: str | None, actuator: int | None) -> Place:
        if actuator is None:
            return Place(target=name, joint=joint)
        model = self.model
        tendon = None
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON:
            tendon = model.tendon(int(model.actuator_trnid[actuator, 0])).name
        driven = tuple(model.joint(j).name for j, _ in driven_joints(model, actuator))
        return Place(name, joint, model.actuator(actuator).name, self.actuators[actuator], tendon, driven)

    # -- parameters ----------------------------------------------------------------------------------------

    def parameter(self, name: str) -> ParameterRef:
        """Finds `<joint, command or body>.<kind>`. Raises BadInput with the nearest known name."""
        target, _, key = name.rpartition(".")
        kind = KINDS.get(key)
        if kind is None or not target:
            raise BadInput(f"no parameter kind '{key}' in '{name}'", todo=nearest(key, KINDS))
        if kind.element == "body":
            element = target
            bodies = [self.model.body(i).name for i in range(1, self.model.nbody)]
            if element not in bodies:
                raise BadInput(f"no body '{target}' for '{name}'", todo=nearest(target, bodies))
        else:
            place = self.place(target)
            element = {"joint": place.joint, "actuator": place.actuator, "tendon": place.tendon}[kind.element]
            if element is None:
                raise BadInput(f"'{target}' has no {kind.element}, so no '{key}'")
        return ParameterRef(name, kind, element, self._id(kind.element, element))

    def _apply(self, terms: Terms) -> None:
        """Edits the spec: effects need names, names need a compiled model, so parameters come first."""
        if terms.parameters or terms.effects:
            self.model = self.spec.compile()
            self._map_names()
        order = list(KINDS)
        for name in sorted(terms.parameters, key=lambda n: (order.index(self.parameter(n).kind.key), n)):
            self._edit(self.parameter(name), terms.parameters[name])
        for term in sorted(terms.effects, key=lambda t: (list(LIBRARY).index(_known(t.effect)), t.target)):
            effect, place = LIBRARY[term.effect], self.place(term.target)
            values = effect.complete(term.values)
            effect.edit(self.spec, place, values)
            effect.measure(self.measurement, place, values)

    def _edit(self, ref: ParameterRef, value: float) -> None:
        if not ref.kind.lower <= value <= ref.kind.upper:
            raise BadInput(
                f"{ref.name} = {value:g} {ref.kind.unit} is not physical",
                allowed=f"{ref.kind.lower:g} to {ref.kind.upper:g} {ref.kind.unit}",
            )
        element = getattr(self.spec, ref.kind.element)(ref.element)
        if ref.kind.element == "body" and not element.explicitinertial:
            body = self.model.body(ref.element)
            element.explicitinertial = True
            element.mass, element.ipos, element.iquat = float(body.mass[0]), body.ipos, body.iquat
            element.inertia = body.inertia
        ref.kind.edit(element, value)

    # -- signals -------------------------------------------------------------------------------------------

    def unknown_commands(self, names: Sequence[str]) -> list[str]:
        """Command names that drive nothing in this model."""
        mapping, _ = self.command_map(tuple(names))
        return [name for i, name in enumerate(names) if not mapping[:, i].any()]

    def command_map(self, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        """((nu, k) linear map from targets by name to controls, (nu,) which actuators the names determine).

        A name matches an actuator's command; a tendon without a command of its own takes the sum over its
        joints, once all of them are commanded.
        """
        mapping = np.zeros((len(self.actuators), len(names)))
        for actuator, command in enumerate(self.actuators):
            found = match(command, names)
            if found is not None:
                mapping[actuator, names.index(found)] = 1.0
                continue
            driven = np.flatnonzero(self.drive[actuator])
            sources = [match(self.joints[j], names) for j in driven]
            if sources and all(source is not None for source in sources):
                for j, source in zip(driven, sources, strict=True):
                    mapping[actuator, names.index(source)] = self.drive[actuator, j]
        return mapping, mapping.any(axis=1)

    def control(self, names: Sequence[str], position: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """Controls (nu,) after a message with targets (k,) by name; what it does not say stays as `previous`."""
        return self.controls(tuple(names), np.asarray(position, float)[None], previous)[0]

    def controls(self, names: tuple[str, ...], position: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Targets (T, k) by name -> controls (T, nu); actuators that the targets do not determine keep `rest`."""
        mapping, determined = self.command_map(names)
        used = mapping.any(axis=0)
        controls = np.where(used, position, 0.0) @ mapping.T
        missing = (~np.isfinite(controls)) | ~determined
        return np.where(missing, rest, controls)

    def initial_qpos(self, position: np.ndarray) -> np.ndarray:
        """A model configuration (nq,) with the measured joints (j,) set; NaN leaves the model's default."""
        qpos = self.model.qpos0.copy()
        known = np.isfinite(position)
        qpos[self.qpos_adr[known]] = np.asarray(position)[known]
        return qpos

    def mjcf(self) -> str:
        """This twin as one plain, self-contained MJCF."""
        return inline_meshes(self.spec, self.model).to_xml()


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


def _known(effect: str) -> str:
    if effect not in LIBRARY:
        raise BadInput(f"no effect '{effect}'", todo=nearest(effect, LIBRARY))
    return effect

"""The twin of one hand: its nominal MJCF, changed by terms, compiled, with the data's names mapped onto it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects import LIBRARY, reload_files
from twin_daemon.effects.base import Measurement, Place, Scale, silent_joint
from twin_daemon.effects.mjcf_text import mjcf_text
from twin_daemon.errors import BadInput, nearest
from twin_daemon.hand.description import Hand
from twin_daemon.hand.naming import match
from twin_daemon.places import HAND, ROBOT
from twin_daemon.processes import never_changes
from twin_daemon.simulation.model_elements import driven_joints, far_end, make_inertia_explicit, prepare
from twin_daemon.simulation.motors import motors, unstretched
from twin_daemon.simulation.parameters import KINDS, ParameterKind
from twin_daemon.simulation.selfcontained import inline_meshes
from twin_daemon.simulation.terms import EffectTerm, Terms


@dataclass(frozen=True)
class ParameterRef:
    """Where one parameter lives in a compiled model: its kind, the id of its element, and what is accepted there."""

    name: str
    kind: ParameterKind
    element: str
    id: int
    limits: tuple[float, float]

    def read(self, model: mujoco.MjModel) -> float:
        return self.kind.read(model, self.id)

    def write(self, model: mujoco.MjModel, value: float) -> None:
        self.kind.write(model, self.id, value)


@never_changes
class TwinModel:
    """A compiled twin.

    `joints` are the joint names of the data that the model has, in the hand description's order; `qpos_adr`
    and `dof_adr` (j,) are where they live. `actuators` (nu,) is the command name of each actuator. `nominal`
    is the MjSpec without terms, which twins share and nobody edits; `base_model` the compiled one with parameters
    and without effects. `terms` are those given, with what is at the whole robot written out for each servo.
    `made_by` is the function and arguments that make the same twin from another one, bit by bit, where there is one.
    """

    def __init__(
        self, hand: Hand, nominal: Any, terms: Terms, compiled: tuple[Any, mujoco.MjModel] | None = None
    ) -> None:
        """`compiled` is a copy of `nominal` that has been compiled and its model, where another twin has them."""
        self.hand = hand
        self.nominal = nominal
        self.made_by: tuple[Callable[..., TwinModel], tuple[Any, ...]] | None = None
        try:
            # effects edit a spec that was compiled: until then it does not say what its defaults come to
            self._compiled = compiled or _copied_and_compiled(nominal)
            self._base, self.base_model = self._compiled
            self._map_names()
            self.terms = terms = terms.written_out(self.actuators, self.joints)
            if terms.parameters:
                self._base = self._base.copy()
                self._edit_parameters(terms.parameters)
                self.base_model = self._base.compile()
            self.spec, self.measurement = self.build(terms.effects)
            self.model = self.spec.compile() if terms.effects else self.base_model
        except (ValueError, mujoco.FatalError) as error:
            raise BadInput(
                f"the MJCF does not compile: {error}", where=hand.model_path, todo="Mend the model or the terms"
            ) from None
        ids = [self.model.joint(name).id for name in self._joint_names]
        self.qpos_adr = self.model.jnt_qposadr[ids].astype(int)
        self.dof_adr = self.model.jnt_dofadr[ids].astype(int)

    @classmethod
    def load(cls, hand: Hand, terms: Terms | None = None) -> TwinModel:
        """The hand's own MJCF with terms applied. Raises BadInput where either cannot be used."""
        try:
            spec = mujoco.MjSpec.from_file(str(hand.model_path))
        except (ValueError, OSError, mujoco.FatalError) as error:
            raise BadInput(f"not a usable MJCF: {error}", where=hand.model_path) from None
        prepare(spec)
        return cls(hand, spec, terms or Terms())

    @classmethod
    def from_mjcf(cls, hand: Hand, mjcf: str, terms: Terms | None = None) -> TwinModel:
        """A twin from the text of one plain MJCF, such as a stored version's."""
        try:
            spec = mujoco.MjSpec.from_string(mjcf)
        except (ValueError, mujoco.FatalError) as error:
            raise BadInput(f"not a usable MJCF: {error}", where=f"stored model of {hand.description.name}") from None
        prepare(spec)
        return cls(hand, spec, terms or Terms())

    def __reduce__(self) -> tuple[Callable[..., TwinModel], tuple[Any, ...]]:
        """In another process a twin is built anew, from the text of its nominal model and its terms.

        Bodies are fused there, not here: what is fused and then written has lost its last bit. And the text has
        the lengths at which tendons rest, which are to follow from the terms.
        """
        nominal = self.nominal.copy()
        nominal.compiler.fusestatic = False
        text = mjcf_text(inline_meshes(nominal, nominal.compile()))
        lengths = {tendon.name: np.array(tendon.springlength) for tendon in self.nominal.tendons}
        return _rebuilt, (self.hand, text, bool(self.nominal.compiler.fusestatic), lengths, self.terms)

    @property
    def nominal_model(self) -> mujoco.MjModel:
        """The compiled model without any terms."""
        return self._compiled[1]

    def changed(self, terms: Terms) -> TwinModel:
        """Another twin of the same hand: the same nominal model with other terms."""
        other = TwinModel(self.hand, self.nominal, terms, self._compiled)
        # of a chain of changes only the first is kept for it
        made = self.made_by
        first = made[1][0] if made is not None and made[0] is TwinModel.changed else self
        other.made_by = TwinModel.changed, (first, terms)
        return other

    def at_step(self, step_s: float) -> TwinModel:
        """The same twin at another time step."""
        nominal = self.nominal.copy()
        nominal.option.timestep = step_s
        other = TwinModel(self.hand, nominal, self.terms)
        other.made_by = TwinModel.at_step, (self, step_s)
        return other

    def with_softer_ends(self, times: float) -> TwinModel:
        """The same twin whose joints take so many times as long to come back from beyond the ends of their travel."""
        nominal = self.nominal.copy()
        for joint in nominal.joints:
            time_constant = joint.solref_limit[0] > 0.0  # else a stiffness and a damping, both negative
            joint.solref_limit *= np.array([times, 1.0] if time_constant else [times**-2, 1.0 / times])
        other = TwinModel(self.hand, nominal, self.terms)
        other.made_by = TwinModel.with_softer_ends, (self, times)
        return other

    # -- names ---------------------------------------------------------------------------------------------

    def _map_names(self) -> None:
        description, model = self.hand.description, self.base_model
        known = {model.joint(i).name for i in range(model.njnt)}
        present = [(name, info.joint) for name, info in description.joints.items() if info.joint in known]
        self.joints = tuple(name for name, _ in present)
        self._joint_names = tuple(joint for _, joint in present)
        by_actuator = {info.actuator: name for name, info in description.commands.items()}
        names = [str(model.actuator(i).name) for i in range(model.nu)]
        self.actuators = tuple(by_actuator.get(name, name) for name in names)

    @cached_property
    def drive(self) -> np.ndarray:
        """(nu, j): the actuated quantity (joint angle, or the sum a tendon pulls) as a linear map of the joints."""
        drive = np.zeros((len(self.actuators), len(self.joints)))
        column = {joint: i for i, joint in enumerate(self._joint_names)}
        for actuator in range(len(self.actuators)):
            for joint, coefficient in driven_joints(self.base_model, actuator):
                name = self.base_model.joint(joint).name
                if name in column:
                    drive[actuator, column[name]] = coefficient
        return drive

    @cached_property
    def driven(self) -> tuple[tuple[str, ...], ...]:
        """The joints that each actuator moves, in the order of `actuators`."""
        return tuple(tuple(self.joints[i] for i in np.flatnonzero(row)) for row in self.drive)

    def joints_of(self, target: str) -> tuple[str, ...]:
        """The joints that a target stands for: itself, what the command drives, or for the whole robot what any does.

        None for an effect of the whole hand, which acts on its base.
        """
        if target == ROBOT:
            return tuple(self.joints[i] for i in np.flatnonzero(self.drive.any(axis=0)))
        if target in self.joints:
            return (target,)
        return self.driven[self.actuators.index(target)] if target in self.actuators else ()

    def joints_of_all(self, targets: Sequence[str]) -> tuple[str, ...]:
        """The joints that several targets stand for, each once."""
        return tuple(dict.fromkeys(joint for target in targets for joint in self.joints_of(target)))

    def place(self, target: str) -> Place:
        """Where an effect acts, from the name of a joint or of a command as in the data.

        'hand' is the whole, on its base, and 'robot' all its servos alike.
        """
        if target in (HAND, ROBOT):
            return Place(target=target)
        joint_name = match(target, self.joints)
        command = match(target, self.actuators)
        if joint_name is None and command is None:
            known = [*self.joints, *(a for a in self.actuators if a not in self.joints)]
            raise BadInput(
                f"no joint or command '{target}'", where=self.hand.description.name, todo=nearest(target, known)
            )
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
        model, tendon = self.base_model, None
        found = Place(name, joint)
        if joint is not None:
            at = model.joint(joint)
            dof = int(at.dofadr[0])
            inertia = max(1.0 / float(model.dof_invweight0[dof]) - float(model.dof_armature[dof]), 0.0)
            carrier, end = far_end(model, int(at.bodyid[0]))
            x, y, z = end.tolist()
            end_body = model.body(carrier).name
            found = replace(found, inertia=inertia, end_body=end_body, end=(x, y, z), order=int(at.id))
        if actuator is None:
            return found
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON:
            tendon = model.tendon(int(model.actuator_trnid[actuator, 0])).name
        driven = tuple(model.joint(j).name for j, _ in driven_joints(model, actuator))
        servo, command = model.actuator(actuator).name, self.actuators[actuator]
        return replace(found, actuator=servo, command=command, tendon=tendon, driven=driven)

    def scale(self, target: str) -> Scale:
        """How strong things are at a place of the parametrised model, for effects to start from."""
        place, model = self.place(target), self.base_model
        actuator = model.actuator(place.actuator).id if place.actuator else None
        names = list(place.driven) or [place.joint]
        joints = [model.joint(name).id for name in ([place.joint] if place.joint else names) if name]
        dofs = [int(model.jnt_dofadr[joint]) for joint in joints]
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        kp = float(model.actuator_gainprm[actuator, 0]) if actuator is not None else 1.0
        limited = actuator is not None and model.actuator_forcelimited[actuator]
        force = float(model.actuator_forcerange[actuator, 1]) if limited else 0.1 * kp
        low, high = model.jnt_range[joints].sum(axis=0) if joints else (-np.pi, np.pi)
        inertia = float(np.diag(mass)[dofs].max(initial=1e-12))
        return Scale(
            kp=kp,
            force_nm=force,
            damping=float(model.dof_damping[dofs].max(initial=0.0)) or 0.2 * float(np.sqrt(kp * inertia)),
            frictionloss=float(model.dof_frictionloss[dofs].max(initial=0.0)) or 1e-3 * kp,
            inertia=inertia,
            armature=float(model.dof_armature[dofs].max(initial=0.0)),
            lower=float(low),
            upper=float(high),
            step_s=float(model.opt.timestep),
            kv=float(max(-model.actuator_biasprm[actuator, 2], 0.0)) if actuator is not None else 0.0,
            length=float(np.linalg.norm(place.end)),
        )

    # -- parameters ----------------------------------------------------------------------------------------

    def parameter(self, name: str) -> ParameterRef:
        """Finds `<joint, command or body>.<kind>`. Raises BadInput with the nearest known name."""
        target, _, key = name.rpartition(".")
        kind = KINDS.get(key)
        if kind is None or not target:
            raise BadInput(f"no parameter kind '{key}' in '{name}'", todo=nearest(key, KINDS))
        if kind.element == "body":
            element = target
            bodies = [self.base_model.body(i).name for i in range(1, self.base_model.nbody)]
            if element not in bodies:
                raise BadInput(f"no body '{target}' for '{name}'", todo=nearest(target, bodies))
        else:
            place = self.place(target)
            element = {"joint": place.joint, "actuator": place.actuator, "tendon": place.tendon}[kind.element]
            if element is None:
                raise BadInput(f"'{target}' has no {kind.element}, so no '{key}'")
        found = getattr(self.base_model, kind.element)(element).id
        return ParameterRef(name, kind, element, found, kind.limits(kind.read(self.nominal_model, found)))

    def _edit_parameters(self, parameters: Mapping[str, float]) -> None:
        order = list(KINDS)
        refs = [self.parameter(name) for name in parameters]
        # a spring's stiffness before its preload, a body's mass before its inertia
        for ref in sorted(refs, key=lambda ref: (order.index(ref.kind.key), ref.name)):
            value = parameters[ref.name]
            lower, upper = ref.limits
            if not lower <= value <= upper:
                raise BadInput(
                    f"{ref.name} = {value:g} {ref.kind.unit} is not physical",
                    allowed=f"{lower:g} to {upper:g} {ref.kind.unit}",
                )
            element = getattr(self._base, ref.kind.element)(ref.element)
            if ref.kind.element == "body":
                make_inertia_explicit(element, self.base_model.body(ref.element))
            ref.kind.edit(element, value)

    def build(self, effects: Sequence[EffectTerm]) -> tuple[Any, Measurement]:
        """This twin's parametrised spec with effects, not yet compiled, and its measurement model.

        Effects are applied in the library's order, whatever the order in which they were added.
        """
        spec = self._base.copy() if effects else self._base
        measurement = Measurement()
        for term in effects:
            _require_known(term.effect)
        for term in sorted(effects, key=lambda term: (LIBRARY[term.effect].rank, term.effect, term.target)):
            effect, place = LIBRARY[term.effect], self.place(term.target)
            values = effect.complete(term.values)
            effect.edit(spec, place, values)
            effect.measure(measurement, place, values)
        return spec, measurement

    # -- signals -------------------------------------------------------------------------------------------

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
        return mapping, np.any(mapping, axis=1)

    def control(self, names: Sequence[str], position: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """Controls (nu,) after a message with targets (k,) by name; what it does not say stays as `previous`."""
        return self.controls(tuple(names), np.asarray(position, float)[None], previous)[0]

    def controls(self, names: tuple[str, ...], position: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Targets (T, k) by name -> controls (T, nu); actuators that the targets do not determine keep `rest`."""
        mapping, determined = self.command_map(names)
        controls = np.zeros((len(position), len(self.actuators)))
        # term by term: a matrix product over so few columns waits longer for its threads than it computes
        for actuator, column in np.argwhere(mapping):
            controls[:, actuator] += mapping[actuator, column] * position[:, column]
        missing = (~np.isfinite(controls)) | ~determined
        return np.where(missing, rest, controls)

    def initial_qpos(self, position: np.ndarray, control: np.ndarray | None = None) -> np.ndarray:
        """A model configuration (nq,) with the measured joints (j,) set; NaN leaves the model's default.

        A motor-side joint that an effect has added starts where its transmission is at rest: at the joint, or,
        within the play that the transmission has, where the controls (nu,) hold it. What a silent servo leaves of the
        error is there from the start.
        """
        qpos = self.model.qpos0.copy()
        known = np.isfinite(position)
        qpos[self.qpos_adr[known]] = np.asarray(position)[known]
        actuated = self.drive @ np.where(known, position, 0.0)
        for motor in motors(self.model):
            told = None if control is None else float(control[motor.actuator])
            qpos[motor.position] = unstretched(self.model, motor, float(actuated[motor.actuator]), told)
        for index, name in enumerate(self.actuators):
            silent = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, silent_joint(self.place(name)))
            if control is not None and silent >= 0:
                # just beyond where its ends begin, so that they bear from the first step
                band = max(0.0, float(self.model.jnt_range[silent, 1] - self.model.jnt_margin[silent])) + 1e-6
                start = float(np.clip(control[index] - actuated[index], -band, band))
                qpos[self.model.jnt_qposadr[silent]] = start
        return qpos

    def mjcf(self) -> str:
        """This twin as one plain, self-contained MJCF."""
        return mjcf_text(inline_meshes(self.spec, self.model))


def _copied_and_compiled(nominal: Any) -> tuple[Any, mujoco.MjModel]:
    spec = nominal.copy()
    return spec, spec.compile()


def _rebuilt(hand: Hand, text: str, fusestatic: bool, lengths: dict[str, np.ndarray], terms: Terms) -> TwinModel:
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = fusestatic
    for name, length in lengths.items():
        spec.tendon(name).springlength = length
    return TwinModel(hand, spec, terms)


def _require_known(effect: str) -> None:
    if effect not in LIBRARY and effect in (broken := reload_files()):
        raise BadInput(f"the effect '{effect}' cannot be used: {broken[effect]}")
    if effect not in LIBRARY:
        raise BadInput(f"no effect '{effect}'", todo=nearest(effect, LIBRARY))

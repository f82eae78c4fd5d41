"""The error of a twin as a function: unit coordinates of variables in, residuals out, many points at once."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from twin_daemon.effects.base import Measurement
from twin_daemon.errors import BadInput
from twin_daemon.estimation.thresholds import (
    DIVERGED_RAD,
    PAST_S,
)
from twin_daemon.estimation.variables import LinkVariable, Settings, Variable
from twin_daemon.processor_time import check_time
from twin_daemon.simulation.alignment import Aligned, resample
from twin_daemon.simulation.parameters import KINDS
from twin_daemon.simulation.rollout import never_forgets, remembers, roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.turns import Bent
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Candidate:
    """One point of the search as it enters a roll-out."""

    model: mujoco.MjModel
    measurement: Measurement
    onsets_s: tuple[float, ...]


def times_before(recording: Aligned, model: mujoco.MjModel) -> np.ndarray:
    """(H,) s, negative: the steps before a recording whose commands its roll-out has to know."""
    if not remembers(model):
        return np.empty(0)
    whole_s = -(float(recording.signal.time_s[0]) + recording.onset_s) if never_forgets(model) else 0.0
    step_s = float(model.opt.timestep)
    return -np.arange(round(max(PAST_S, whole_s) / step_s), 0, -1) * step_s


class Problem:
    """The error of a twin over recordings, as a function of variables in unit coordinates.

    `objective` are the joints that count. The sum of squares of `residuals` is the mean over these joints of
    the mean squared error (rad^2) plus the priors' share: a prior missed by one sigma costs `prior_weight`^2.
    """

    def __init__(
        self,
        twin: TwinModel,
        recordings: Sequence[Aligned],
        variables: Sequence[Variable],
        objective: Sequence[str],
        *,
        threads: int | None = None,
        prior_weight: float = 0.0,
    ) -> None:
        self.twin = twin
        self.recordings = tuple(recordings)
        self.variables = tuple(variables)
        self.objective = tuple(objective)
        self.threads = threads
        self.evaluations = 0
        self._columns = np.array([twin.joints.index(name) for name in objective], int)
        refs = [twin.parameter(name) for variable in variables for name in variable.parameters_moved]
        # in the kinds' order: a spring's stiffness is written before its preload
        self._refs = {ref.name: ref for ref in sorted(refs, key=lambda ref: list(KINDS).index(ref.kind.key))}
        self._nominal = {name: ref.read(twin.base_model) for name, ref in self._refs.items()}
        self._links = [(i, v) for i, v in enumerate(self.variables) if isinstance(v, LinkVariable)]
        self._constants = any(ref.kind.constants for ref in self._refs.values())
        self._grids = [np.arange(int(np.ceil(r.time_s[-1] / twin.model.opt.timestep)) + 1) for r in recordings]
        self._starts = [tuple(part[None] for part in r.start_state(twin)) for r in recordings]
        weights = [np.isfinite(r.measured[:, self._columns]) for r in recordings]
        self._known = weights
        self._per_joint = np.maximum(sum(w.sum(axis=0) for w in weights), 1)
        self.prior_weight = prior_weight
        self._last: tuple[bytes, list[np.ndarray]] | None = None
        # what was last asked of each recording, which most points ask for again
        self._told: dict[int, tuple[tuple[float, int], np.ndarray]] = {}
        self._felt: dict[int, tuple[Measurement, np.ndarray]] = {}

    def beginning(self, recordings: Sequence[Sequence[Aligned]]) -> Problem:
        """The same over each recording with S starts, one for each of S points.

        They are the same recordings, which only begin elsewhere: what they are told and feel is kept, and a joint that
        is never commanded holds where it began before.
        """
        other = copy.copy(self)
        other._last = None
        states = [[r.start_state(self.twin) for r in begun] for begun in recordings]
        other._starts = [(np.array([q for q, _ in each]), np.array([v for _, v in each])) for each in states]
        return other

    # -- points --------------------------------------------------------------------------------------------

    @property
    def start(self) -> np.ndarray:
        """(p,) the variables' own start in unit coordinates."""
        return np.array([variable.coordinate(variable.start) for variable in self.variables])

    def start_from(self, units: Mapping[str, float]) -> np.ndarray:
        """(p,) unit coordinates: what is already known by variable name, else the variables' own start."""
        return np.array([units.get(v.name, u) for v, u in zip(self.variables, self.start, strict=True)])

    def values(self, unit: np.ndarray) -> np.ndarray:
        """Unit coordinates (p,) -> values in the variables' units."""
        return np.array([variable.value(u) for variable, u in zip(self.variables, unit, strict=True)])

    def candidate(self, unit: np.ndarray) -> Candidate:
        """Builds the model, measurement model and onsets of one point."""
        parameters, effects, onsets = self.settings(unit)
        if effects is not None or self.twin.terms.effects:
            # effects share parameters out between elements of their own: they are built anew around them
            terms = Terms(
                parameters={**self.twin.terms.parameters, **parameters},
                effects=self.twin.terms.effects if effects is None else effects,
            )
            built = self.twin.changed(terms)
            return Candidate(built.model, built.measurement, onsets)
        model, measurement = copy.copy(self.twin.model), self.twin.measurement
        for name, value in parameters.items():
            self._refs[name].write(model, value)
        if self._constants:
            mujoco.mj_setConst(model, mujoco.MjData(model))
        return Candidate(model, measurement, onsets)

    def settings(self, unit: np.ndarray) -> tuple[dict[str, float], tuple[EffectTerm, ...] | None, tuple[float, ...]]:
        """(parameters by name, effects or None where no variable moves one, onset of each recording) of a point."""
        point = Settings(
            nominal=self._nominal,
            parameters={},
            effects={(t.effect, t.target): dict(t.values) for t in self.twin.terms.effects},
            onsets_s=[r.onset_s for r in self.recordings],
        )
        for variable, value in zip(self.variables, self.values(unit), strict=True):
            variable.write(value, point)
        terms = tuple(EffectTerm(effect=k, target=t, values=v) for (k, t), v in point.effects.items())
        order = {name: index for index, name in enumerate(self._refs)}
        ordered = dict(sorted(point.parameters.items(), key=lambda item: order[item[0]]))
        return ordered, terms if point.effects_moved else None, tuple(point.onsets_s)

    # -- errors --------------------------------------------------------------------------------------------

    def predict(self, points: np.ndarray) -> list[np.ndarray]:
        """Predicted readings of the objective's joints, one (B, n, k) array a recording, for points (B, p).

        What one point was last asked for is kept: rows, offsets and floors are asked of the same roll-out. Raises
        OutOfTime where a time limit that is enforced is over.
        """
        last, asked = self._last, points.tobytes()
        if last is not None and len(points) == 1 and last[0] == asked:
            return last[1]
        readings = self._predicted(points)
        if len(points) == 1:
            self._last = asked, readings
        return readings

    def _predicted(self, points: np.ndarray) -> list[np.ndarray]:
        check_time()
        found = [self._possible(point) for point in points]
        self.evaluations += len(found)
        impossible = [candidate is None for candidate in found]
        candidates = [candidate or self.candidate(self.start) for candidate in found]
        step_s = float(self.twin.model.opt.timestep)
        readings = []
        for index, recording in enumerate(self.recordings):
            onsets = [c.onsets_s[index] for c in candidates]
            grid = self._grids[index] * step_s
            past = times_before(recording, candidates[0].model)
            whole = np.concatenate([past, grid])
            distinct = {onset: self._told_by(index, whole, onset) for onset in dict.fromkeys(onsets)}
            if len(distinct) == 1:
                controls = next(iter(distinct.values()))[None]
            else:
                controls = np.stack([distinct[onset] for onset in onsets])
            qpos, qvel = self._begun(index, [c.measurement for c in candidates])
            positions = roll_out(
                [c.model for c in candidates],
                controls[:, len(past) :],
                qpos,
                qvel,
                before=controls[:, : len(past)] if len(past) else None,
                applied=self._applied(index, grid, [c.measurement for c in candidates], points),
                loaded=True,
                turns=self._turns(recording),
                threads=self.threads,
            )
            sampled = resample(positions[:, :, self.twin.qpos_adr], step_s, recording.time_s)
            read = [c.measurement.apply(self.twin.joints, s) for c, s in zip(candidates, sampled, strict=True)]
            readings.append(np.stack(read)[:, :, self._columns])
            readings[-1][impossible] = np.nan
        return readings

    def is_possible(self, unit: np.ndarray) -> bool:
        """Whether the values of a point (p,) can stand beside each other."""
        return self._possible(unit) is not None

    def _possible(self, unit: np.ndarray) -> Candidate | None:
        """A point's candidate; None where its values cannot stand beside each other, such as a negative armature."""
        try:
            return self.candidate(unit)
        except BadInput:
            return None

    def _turns(self, recording: Aligned) -> Mapping[int, Bent] | None:
        """How far the motion before a recording has bent bristles, by degree of freedom."""
        return recording.turns.by_dof(self.twin.dof_adr) if recording.turns is not None else None

    def _begun(self, index: int, measurements: Sequence[Measurement]) -> tuple[np.ndarray, np.ndarray]:
        """((1 or B, nq), (1 or B, nv)) where roll-outs of a recording begin: where the joints were by its readings."""
        qpos, qvel = self._starts[index]
        own = self.twin.measurement
        if all(measurement == own for measurement in measurements):
            return qpos, qvel
        seen = self.recordings[index].start_position
        known = np.isfinite(seen)
        starts = np.array(np.broadcast_to(qpos, (len(measurements), qpos.shape[1])))
        for start, measurement in zip(starts, measurements, strict=True):
            moved = measurement.invert(self.twin.joints, seen) - own.invert(self.twin.joints, seen)
            start[self.twin.qpos_adr[known]] += moved[known]
        return starts, qvel

    def _applied(
        self, index: int, grid: np.ndarray, measurements: Sequence[Measurement], points: np.ndarray
    ) -> np.ndarray | None:
        """(1 or B, T, nv) what is outside of the model does to it on a grid of times (T,) s, for points (B, p)."""
        recording = self.recordings[index]
        if recording.reaction is None:
            return None
        distinct: list[Measurement] = []
        for measurement in measurements:
            if measurement not in distinct:
                distinct.append(measurement)
        forces = [self._felt_as(index, grid, measurement) for measurement in distinct]
        if len(distinct) == 1:
            found = forces[0][None]
        else:
            found = np.stack([forces[distinct.index(measurement)] for measurement in measurements])
        sigmas = np.array([[v.value(point[i]) for i, v in self._links] for point in points])
        if sigmas.any():
            by_sigma = recording.reaction.applied_by_links(self.twin, grid)[:, :, [v.number for _, v in self._links]]
            found = found + np.einsum("tvq,bq->btv", by_sigma, sigmas)
        return found

    def _felt_as(self, index: int, grid: np.ndarray, measurement: Measurement) -> np.ndarray:
        """(T, nv) what the joints outside do to the model along a recording that was read with a measurement."""
        kept, reaction = self._felt.get(index), self.recordings[index].reaction
        if kept is None or kept[0] != measurement:
            assert reaction is not None
            kept = self._felt[index] = measurement, reaction.applied(self.twin, grid, measurement)
        return kept[1]

    def _told_by(self, index: int, grid: np.ndarray, onset_s: float) -> np.ndarray:
        """Controls (T, nu) of a recording on a grid of times (T,) s."""
        asked, kept = (onset_s, len(grid)), self._told.get(index)
        if kept is None or kept[0] != asked:
            kept = self._told[index] = asked, self._controls(self.recordings[index], grid, onset_s)
        return kept[1]

    def _controls(self, recording: Aligned, grid: np.ndarray, onset_s: float) -> np.ndarray:
        """Controls (T, nu) of a roll-out on a grid of times (T,) s."""
        return recording.controls(self.twin, grid, onset_s)

    def joint_residuals(self, points: np.ndarray) -> list[np.ndarray]:
        """Measured minus predicted in rad, (B, n, k) a recording; what was not measured counts as 0."""
        out = []
        for recording, known, read in zip(self.recordings, self._known, self.predict(points), strict=True):
            measured = np.where(known, recording.measured[:, self._columns], 0.0)
            gap = np.where(known[None], measured[None] - read, 0.0)
            out.append(np.nan_to_num(gap, nan=DIVERGED_RAD, posinf=DIVERGED_RAD, neginf=-DIVERGED_RAD))
        return out

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, m) residuals whose sum of squares is the objective."""
        scale = 1.0 / np.sqrt(self._per_joint * len(self._columns))
        rows = [(r * scale).reshape(len(points), -1) for r in self.joint_residuals(points)]
        prior = self.prior_residuals(points)
        return np.concatenate([*rows, prior], axis=1)

    def prior_residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, q) pulls towards the variables' priors; zero-width where none has one."""
        columns = []
        for index, variable in enumerate(self.variables):
            if variable.prior is not None:
                position = variable.low + points[:, index] * (variable.high - variable.low)
                columns.append(variable.prior.missed(position) * self.prior_weight)
        return np.stack(columns, axis=1) if columns else np.zeros((len(points), 0))

    @property
    def samples_per_joint(self) -> np.ndarray:
        """(k,) measured samples of each joint of the objective, over all recordings."""
        return self._per_joint

    def mse(self, points: np.ndarray) -> np.ndarray:
        """(B,) mean squared error in rad^2 over the objective's joints, without priors."""
        total = np.zeros(len(points))
        for residual in self.joint_residuals(points):
            total += ((residual**2).sum(axis=1) / self._per_joint).mean(axis=1)
        return total

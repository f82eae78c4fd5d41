"""The error of a twin with laws at a joint, as a function of one law's coefficients and of what is uncertain anyway."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from twin_daemon.effects.base import INVERTED
from twin_daemon.estimation.posterior import Correction, Posterior
from twin_daemon.estimation.problem import Candidate, times_before
from twin_daemon.estimation.variables import ParameterVariable, Variable
from twin_daemon.proposals.features import OF_NEIGHBOURS, Feature
from twin_daemon.proposals.law_feedback import LawFeedback, feedback_of_all, remembered
from twin_daemon.proposals.thresholds import RIDGE
from twin_daemon.proposals.track import Track
from twin_daemon.simulation.alignment import Aligned, resample
from twin_daemon.simulation.feedback import roll_out_with_feedback
from twin_daemon.simulation.rollout import initial_state
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True, eq=False)
class GivenLaw:
    """A law that is there already, with its coefficients (k,) in its unit."""

    feature: Feature
    coefficients: np.ndarray


Law = tuple[Feature, np.ndarray]
"""A law at several points: its feature, and its coefficients (B, k) there."""


class LawProblem(Posterior):
    """A problem whose last variables are the coefficients of one law: their unit coordinate 0.5 is none of it.

    The law acts within the roll-outs, where the joint comes to lie in them, beside those that are `given` there;
    without a `feature` these act alone. `smoothness` is the weight of the curve's second differences beside the data.
    """

    def __init__(
        self,
        twin: TwinModel,
        pieces: Sequence[Aligned],
        nuisances: Sequence[Variable],
        joints: Sequence[str],
        floor: np.ndarray,
        *,
        feature: Feature | None,
        joint: str,
        actuator: int,
        tracks: Sequence[Track],
        given: Sequence[GivenLaw] = (),
        smoothness: float = 0.0,
        corrections: Sequence[Correction] | None = None,
        threads: int | None = 1,
    ) -> None:
        own: list[Variable] = []
        if feature:
            most = feature.most
            own = [ParameterVariable(f"law.{i}", feature.unit, -most, most, 0.0) for i in range(len(feature.knots))]
        super().__init__(twin, pieces, (*nuisances, *own), joints, floor, corrections=corrections, threads=threads)
        self.feature, self.joint, self.actuator = feature, joint, actuator
        self.tracks, self.given, self.smoothness = tuple(tracks), tuple(given), smoothness
        by_name = {t.sha256: t for t in tracks}
        self._track_of = [by_name[piece.recording.sha256] for piece in pieces]
        self._begin = [t.begin_s(piece) for t, piece in zip(self._track_of, pieces, strict=True)]
        self._shift: np.ndarray | None = None
        self.own = len(nuisances)

    @property
    def knots(self) -> tuple[float, ...]:
        """Of the law's own curve, one for each of its coefficients."""
        return self.feature.knots if self.feature else ()

    def coefficients(self, points: np.ndarray) -> np.ndarray:
        """(B, k) of the law, in its unit, of points (B, p)."""
        return (points[:, self.own :] - 0.5) * 2.0 * (self.feature.most if self.feature else 0.0)

    def point(self, nuisances: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """(p,) from the nuisances' unit coordinates and the law's coefficients."""
        most = self.feature.most if self.feature else 1.0
        return np.concatenate([nuisances, np.clip(0.5 + coefficients / (2.0 * most), 0.0, 1.0)])

    def shifted(self, pieces: Sequence[Aligned]) -> LawProblem:
        """The same problem over its pieces with their commands at other times."""
        other = LawProblem(
            self.twin,
            pieces,
            self.variables[: self.own],
            self.objective,
            self.floor,
            feature=self.feature,
            joint=self.joint,
            actuator=self.actuator,
            tracks=self.tracks,
            given=self.given,
            smoothness=self.smoothness,
            corrections=self.corrections,
            threads=self.threads,
        )
        other._begin = self._begin
        return other

    # -- roll-outs -----------------------------------------------------------------------------------------

    def _laws(self, points: np.ndarray) -> list[Law]:
        """All laws at points (B, p): the given ones, and the problem's own."""
        found = [(one.feature, np.tile(one.coefficients, (len(points), 1))) for one in self.given]
        return [*found, (self.feature, self.coefficients(points))] if self.feature else found

    def _predicted(self, points: np.ndarray) -> list[np.ndarray]:
        """As `predict`, with the laws at work; those of a reading say what is read, and move nothing."""
        laws = self._laws(points)
        readings = [law for law in laws if law[0].port == "reading"]
        self._shift = None
        if readings:
            self._shift = np.array([self._misread_start(readings, index) for index in range(len(self.recordings))])
        moved_by = points.copy()
        if self.feature and self.feature.port == "reading":
            moved_by[:, self.own :] = 0.5
        distinct, first, place = np.unique(moved_by, axis=0, return_index=True, return_inverse=True)
        acting = [(feature, values[first]) for feature, values in laws if feature.port != "reading"]
        if acting:
            self.evaluations += len(distinct)
            moved = self._rolled(distinct, [self.candidate(point) for point in distinct], acting)
        else:
            moved = super()._predicted(distinct)  # where it starts is the matter of what is read, too
        return [self._misread(index, found[place.ravel()], readings) for index, found in enumerate(moved)]

    def _misread(self, index: int, angles: np.ndarray, readings: Sequence[Law]) -> np.ndarray:
        """(B, n, k) what is read where the joints are at angles (B, n, k) of a piece."""
        if not readings:
            return angles
        column, time_s = self.objective.index(self.joint), self.recordings[index].time_s
        angle, out = angles[:, :, column], angles.copy()
        for feature, values in readings:
            x = angle
            if feature.over != "position":
                x = np.broadcast_to(self._exogenous(feature, index, time_s), angle.shape)
            out[:, :, column] += feature.curve(values, x)
        return out

    def _misread_start(self, readings: Sequence[Law], index: int) -> float:
        """How far from its reading the joint is where a piece begins, as the first of several points has the laws."""
        start = float(self.recordings[index].start_position[self.twin.joints.index(self.joint)])

        def added(feature: Feature, values: np.ndarray, x: float) -> float:
            return float(feature.curve(values[:1], np.array([[x]]))[0, 0])

        over_angle = [law for law in readings if law[0].over == "position"]
        beside = sum(
            added(feature, values, float(self._exogenous(feature, index, np.zeros(1))[0]))
            for feature, values in readings
            if feature.over != "position"
        )
        shift = -beside
        for _ in range(INVERTED if over_angle else 0):
            shift = -beside - sum(added(feature, values, start + shift) for feature, values in over_angle)
        return shift

    def _begun(self, index, measurements):
        qpos, qvel = super()._begun(index, measurements)
        if self._shift is not None:
            qpos = qpos.copy()
            qpos[:, self.twin.qpos_adr[self.twin.joints.index(self.joint)]] += self._shift[index]
        return qpos, qvel

    def _exogenous(self, feature: Feature, index: int, time_s: np.ndarray) -> np.ndarray:
        """(n,) what a law depends on beside the joint's own state, at times (n,) s of a piece."""
        track, at = self._track_of[index], self._begin[index] + time_s
        if feature.over == "time":
            return at
        if feature.over in ("heat", "orientation"):
            return np.interp(at, track.time_s, track.of(feature.over))
        if feature.over not in OF_NEIGHBOURS:
            return np.zeros_like(time_s)
        return np.interp(at, track.time_s, track.of_neighbour(feature.neighbour, feature.over))

    def _rolled(self, points: np.ndarray, candidates: Sequence[Candidate], acting: Sequence[Law]) -> list[np.ndarray]:
        twin, step_s = self.twin, float(self.twin.model.opt.timestep)
        order = sorted(range(len(self.recordings)), key=lambda i: -len(self._grids[i]))
        longest, width = len(self._grids[order[0]]), twin.model.nu + twin.model.nv
        inputs: list[np.ndarray] = []
        known: dict[tuple[int, float, int], int] = {}
        distinct, alike = np.unique(points[:, [i for i, _ in self._links]], axis=0, return_inverse=True)
        _, shown = np.unique(alike.ravel(), return_index=True)
        states, input_of, steps = [], [], []
        data = mujoco.MjData(candidates[0].model)
        for index in order:
            piece, grid = self.recordings[index], self._grids[index] * step_s
            past = times_before(piece, candidates[0].model)
            applied = self._applied(index, grid, [candidates[0].measurement] * len(distinct), points[shown])
            (qpos,), (qvel,) = self._begun(index, [candidates[0].measurement])
            for candidate, load in zip(candidates, alike.ravel().tolist(), strict=True):
                onset = candidate.onsets_s[index]
                if (index, onset, load) not in known:
                    controls = self._told_by(index, np.concatenate([past, grid]), onset)
                    row = np.zeros((longest, width))
                    row[: len(grid), : controls.shape[1]] = controls[len(past) :]
                    if applied is not None:
                        row[: len(grid), twin.model.nu :] = applied[min(load, len(applied) - 1)]
                    known[index, onset, load] = len(inputs)
                    inputs.append(row)
                    earlier = controls[: len(past)] if len(past) else None
                    self._before[index, onset] = controls[len(past)], earlier
                first, earlier = self._before[index, onset]
                filled = np.zeros(twin.model.nu)
                filled[: len(first)] = first
                turns = self._turns(piece)
                model = candidate.model
                states.append(initial_state(model, data, filled, qpos, qvel, earlier, loaded=True, turns=turns))
                input_of.append(known[index, onset, load])
                steps.append(len(grid))
        count = len(candidates)
        models = [c.model for _ in order for c in candidates]
        if any(feature.factor == "direction" for feature, _ in acting):
            models = [copy.copy(model) for model in models]  # each simulation has a friction of its own
        grid = np.arange(longest) * step_s
        feedback = [
            LawFeedback(
                twin,
                feature,
                self.joint,
                self.actuator,
                models,
                laws=np.tile(values, (len(order), 1)),
                memory=np.repeat([self._memory(feature, index) for index in order], count, axis=0),
                piece_of=np.repeat(order, count),
                exogenous=np.stack([self._exogenous(feature, i, grid) for i in range(len(order))]),
            )
            for feature, values in acting
        ]
        positions = roll_out_with_feedback(
            models,
            np.array(states),
            np.stack(inputs),
            np.array(input_of),
            np.array(steps),
            feedback_of_all(feedback),
            threads=self.threads,
        )
        found: list[np.ndarray] = [np.zeros(0)] * len(order)
        for place, index in enumerate(order):
            own = positions[place * count : (place + 1) * count, : len(self._grids[index]) + 1]
            sampled = resample(own[:, :, twin.qpos_adr], step_s, self.recordings[index].time_s)
            read = [c.measurement.apply(twin.joints, s) for c, s in zip(candidates, sampled, strict=True)]
            found[index] = np.stack(read)[:, :, self._columns]
        return found

    @cached_property
    def _before(self) -> dict[tuple[int, float], tuple[np.ndarray, np.ndarray | None]]:
        return {}

    def _memory(self, feature: Feature, index: int) -> np.ndarray:
        """(m,) what a law remembers where a piece begins, from the measured motion before it."""
        if (feature, index) not in self._remembered:
            track, begin = self._track_of[index], self._begin[index]
            before = track.time_s <= max(begin, 0.0)
            step_s = float(self.twin.model.opt.timestep)
            self._remembered[feature, index] = remembered(feature, track, before, step_s)
        return self._remembered[feature, index]

    @cached_property
    def _remembered(self) -> dict[tuple[Feature, int], np.ndarray]:
        return {}

    # -- smoothness ----------------------------------------------------------------------------------------

    def prior_residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, q) the nuisances' priors, and the curve's second differences."""
        found = super().prior_residuals(points)
        return np.concatenate([found, self.coefficients(points) @ self._bends.T], axis=1)

    def prior_slopes(self) -> np.ndarray:
        """(q, p) their derivative by the points."""
        bends = np.zeros((len(self._bends), len(self.variables)))
        if self.feature is not None:
            bends[:, self.own :] = self._bends * 2.0 * self.feature.most
        return np.concatenate([super().prior_slopes(), bends])

    @cached_property
    def _bends(self) -> np.ndarray:
        """(q, k) rows that a smooth curve, or a weak memory, makes small. A straight line is smooth on any knots."""
        if self.feature is None:
            return np.zeros((0, 0))
        count, scale = len(self.feature.knots), 1.0 / self.feature.most
        weak = RIDGE * scale * np.eye(count)
        if self.feature.memory:
            return weak
        apart = np.diff(self.feature.knots)
        slopes = np.diff(np.eye(count), axis=0) / apart[:, None]
        turns = np.diff(slopes, axis=0) * 0.5 * (apart[1:] + apart[:-1])[:, None]
        return np.concatenate([weak, self.smoothness * scale * turns])

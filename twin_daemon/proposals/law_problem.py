"""The error of a twin with a law at one port, as a function of its coefficients and of what is uncertain anyway."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property

import mujoco
import numpy as np

from twin_daemon.effects.base import INVERTED
from twin_daemon.estimation.posterior import Correction, Posterior
from twin_daemon.estimation.problem import Candidate, times_before
from twin_daemon.estimation.variables import ParameterVariable, Variable
from twin_daemon.proposals.features import OF_NEIGHBOURS, Feature
from twin_daemon.proposals.law_feedback import LawFeedback, remembered
from twin_daemon.proposals.thresholds import RIDGE
from twin_daemon.proposals.track import Track
from twin_daemon.simulation.alignment import Aligned, resample
from twin_daemon.simulation.feedback import roll_out_with_feedback
from twin_daemon.simulation.rollout import initial_state
from twin_daemon.simulation.twin import TwinModel


class LawProblem(Posterior):
    """A problem whose last variables are the coefficients of one law: their unit coordinate 0.5 is none of it.

    The law acts within the roll-outs, where the joint comes to lie in them. `smoothness` is the weight of the curve's
    second differences beside the data.
    """

    def __init__(
        self,
        twin: TwinModel,
        pieces: Sequence[Aligned],
        nuisances: Sequence[Variable],
        joints: Sequence[str],
        floor: np.ndarray,
        *,
        feature: Feature,
        joint: str,
        actuator: int,
        tracks: Sequence[Track],
        smoothness: float = 0.0,
        corrections: Sequence[Correction] | None = None,
        threads: int | None = 1,
    ) -> None:
        most = feature.most
        own = [ParameterVariable(f"law.{index}", feature.unit, -most, most, 0.0) for index in range(len(feature.knots))]
        super().__init__(twin, pieces, (*nuisances, *own), joints, floor, corrections=corrections, threads=threads)
        self.feature, self.joint, self.actuator = feature, joint, actuator
        self.tracks, self.smoothness = tuple(tracks), smoothness
        by_name = {t.sha256: t for t in tracks}
        self._track_of = [by_name[piece.recording.sha256] for piece in pieces]
        self._begin = [t.begin_s(piece) for t, piece in zip(self._track_of, pieces, strict=True)]
        self._shift: np.ndarray | None = None
        self.own = len(nuisances)

    def coefficients(self, points: np.ndarray) -> np.ndarray:
        """(B, k) of the law, in its unit, of points (B, p)."""
        return (points[:, self.own :] - 0.5) * 2.0 * self.feature.most

    def point(self, nuisances: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """(p,) from the nuisances' unit coordinates and the law's coefficients."""
        return np.concatenate([nuisances, np.clip(0.5 + coefficients / (2.0 * self.feature.most), 0.0, 1.0)])

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
            smoothness=self.smoothness,
            corrections=self.corrections,
            threads=self.threads,
        )
        other._begin = self._begin
        return other

    # -- roll-outs -----------------------------------------------------------------------------------------

    def _predicted(self, points: np.ndarray) -> list[np.ndarray]:
        """As `predict`, with the law at work."""
        laws = self.coefficients(points)
        if self.feature.port == "reading":
            return self._misread(points, laws)
        candidates = [self.candidate(point) for point in points]
        self.evaluations += len(points)
        return self._rolled(points, candidates, laws)

    def _misread(self, points: np.ndarray, laws: np.ndarray) -> list[np.ndarray]:
        """The joint moves as it does; what is read of it is not where it is."""
        distinct, place = np.unique(points[:, : self.own], axis=0, return_inverse=True)
        self._shift = np.array([self._misread_start(laws[:1], index) for index in range(len(self.recordings))])
        whole = np.concatenate([distinct, np.full((len(distinct), points.shape[1] - self.own), 0.5)], axis=1)
        found = super()._predicted(whole)  # where it starts is the law's matter, too
        column = self.objective.index(self.joint)
        out = []
        for index, (piece, readings) in enumerate(zip(self.recordings, found, strict=True)):
            every = readings[place.ravel()].copy()
            every[:, :, column] += self.feature.curve(laws, self._read_over(index, piece.time_s, every[:, :, column]))
            out.append(every)
        return out

    def _read_over(self, index: int, time_s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """(B, n) the variable of a reading's law at times (n,) of a piece, where the joint is at `angle` (B, n)."""
        if self.feature.over == "position":
            return angle
        return np.broadcast_to(self._exogenous(index, time_s), angle.shape)

    def _misread_start(self, law: np.ndarray, index: int) -> float:
        """How far from its reading the joint is where a piece begins, with a law (1, k)."""
        if self.feature.over != "position":
            return -float(self.feature.curve(law, self._exogenous(index, np.zeros(1))[None])[0, 0])
        start = float(self.recordings[index].start_position[self.twin.joints.index(self.joint)])
        shift = 0.0
        for _ in range(INVERTED):
            shift = -float(self.feature.curve(law, np.array([[start + shift]]))[0, 0])
        return shift

    def _begun(self, index, measurements):
        qpos, qvel = super()._begun(index, measurements)
        if self._shift is not None:
            qpos = qpos.copy()
            qpos[:, self.twin.qpos_adr[self.twin.joints.index(self.joint)]] += self._shift[index]
        return qpos, qvel

    def _exogenous(self, index: int, time_s: np.ndarray) -> np.ndarray:
        """(n,) what the law depends on beside the joint's own state, at times (n,) s of a piece."""
        track, at = self._track_of[index], self._begin[index] + time_s
        if self.feature.over == "time":
            return at
        if self.feature.over in ("heat", "orientation"):
            return np.interp(at, track.time_s, track.of(self.feature.over))
        if self.feature.over not in OF_NEIGHBOURS:
            return np.zeros_like(time_s)
        return np.interp(at, track.time_s, track.of_neighbour(self.feature.neighbour, self.feature.over))

    def _rolled(self, points: np.ndarray, candidates: Sequence[Candidate], laws: np.ndarray) -> list[np.ndarray]:
        twin, step_s = self.twin, float(self.twin.model.opt.timestep)
        order = sorted(range(len(self.recordings)), key=lambda i: -len(self._grids[i]))
        longest, width = len(self._grids[order[0]]), twin.model.nu + twin.model.nv
        inputs: list[np.ndarray] = []
        known: dict[tuple[int, float, int], int] = {}
        distinct, alike = np.unique(points[:, [i for i, _ in self._links]], axis=0, return_inverse=True)
        _, shown = np.unique(alike.ravel(), return_index=True)
        states, input_of, steps, begun = [], [], [], []
        data = mujoco.MjData(candidates[0].model)
        for index in order:
            piece, grid = self.recordings[index], self._grids[index] * step_s
            past = times_before(piece, candidates[0].model)
            applied = self._applied(index, grid, [candidates[0].measurement] * len(distinct), points[shown])
            (qpos,), (qvel,) = self._begun(index, [candidates[0].measurement])
            memory = self._memory(index)
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
                begun.append(memory)
        count = len(candidates)
        models = [c.model for _ in order for c in candidates]
        if self.feature.factor == "direction":
            models = [copy.copy(model) for model in models]  # each simulation has a friction of its own
        feedback = LawFeedback(
            twin,
            self.feature,
            self.joint,
            self.actuator,
            models,
            laws=np.tile(laws, (len(order), 1)),
            memory=np.array(begun),
            piece_of=np.repeat(order, count),
            exogenous=np.stack([self._exogenous(i, np.arange(longest) * step_s) for i in range(len(order))]),
        )
        positions = roll_out_with_feedback(
            models,
            np.array(states),
            np.stack(inputs),
            np.array(input_of),
            np.array(steps),
            feedback.torque,
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

    def _memory(self, index: int) -> np.ndarray:
        """(m,) what the law remembers where a piece begins, from the measured motion before it."""
        if index not in self._remembered:
            track, begin = self._track_of[index], self._begin[index]
            before = track.time_s <= max(begin, 0.0)
            self._remembered[index] = remembered(self.feature, track, before, float(self.twin.model.opt.timestep))
        return self._remembered[index]

    @cached_property
    def _remembered(self) -> dict[int, np.ndarray]:
        return {}

    # -- smoothness ----------------------------------------------------------------------------------------

    def prior_residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, q) the nuisances' priors, and the curve's second differences."""
        found = super().prior_residuals(points)
        return np.concatenate([found, self.coefficients(points) @ self._bends.T], axis=1)

    def prior_slopes(self) -> np.ndarray:
        """(q, p) their derivative by the points."""
        bends = np.zeros((len(self._bends), len(self.variables)))
        bends[:, self.own :] = self._bends * 2.0 * self.feature.most
        return np.concatenate([super().prior_slopes(), bends])

    @cached_property
    def _bends(self) -> np.ndarray:
        """(q, k) rows that a smooth curve, or a weak memory, makes small. A straight line is smooth on any knots."""
        count, scale = len(self.feature.knots), 1.0 / self.feature.most
        weak = RIDGE * scale * np.eye(count)
        if self.feature.memory:
            return weak
        apart = np.diff(self.feature.knots)
        slopes = np.diff(np.eye(count), axis=0) / apart[:, None]
        turns = np.diff(slopes, axis=0) * 0.5 * (apart[1:] + apart[:-1])[:, None]
        return np.concatenate([weak, self.smoothness * scale * turns])

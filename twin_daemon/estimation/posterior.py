"""The statistics of a diagnosis: residuals in units of what a right model would leave."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.estimation.floor import floor_variance
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.start_errors import Whitening, each_held
from twin_daemon.estimation.thresholds import (
    END_SIGMA,
    FINER_STEPS,
    FLOOR_CHI_SQUARE,
    LEAST_CORRELATION_S,
    OFFSET_FLOORS,
    REACTION_ERROR,
)
from twin_daemon.estimation.variables import ParameterVariable, Variable
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.prescribed import response_time_s
from twin_daemon.simulation.twin import TwinModel


def correlation_s(twin: TwinModel, joints: Sequence[str]) -> float:
    """Over this time the residual of a right model repeats itself: as long as the joints' servos take to follow."""
    times = [response_time_s(twin, joint) for joint in joints]
    return float(max(np.median(times), LEAST_CORRELATION_S)) if times else LEAST_CORRELATION_S


@dataclass(frozen=True)
class Correction:
    """What a roll-out itself gets wrong of a recording: an `error` (n, k) rad, which is taken out of the residuals, and
    a `variance` (n, k) rad^2 beside the floor, of what is known of that error no better."""

    error: np.ndarray
    variance: np.ndarray

    def weight(self, floor: np.ndarray) -> np.ndarray:
        """(n, k) what a residual counts, one that has no more than the floor (k,) rad^2 counting 1."""
        return np.sqrt(floor / (floor + self.variance))


class Posterior(Problem):
    """A problem whose cost is minus twice the log posterior, tempered by the residual's correlation.

    A constant offset of each joint's reading is profiled out exactly under its prior, except for the joints in
    `offset_held` (where a candidate speaks for the offset itself).
    """

    def __init__(
        self,
        twin: TwinModel,
        recordings: Sequence[Aligned],
        variables: Sequence[Variable],
        objective: Sequence[str],
        floor: np.ndarray,
        *,
        offset_held: Collection[str] = (),
        corrections: Sequence[Correction] | None = None,
        threads: int | None = 1,
    ) -> None:
        super().__init__(twin, recordings, variables, objective, threads=threads)
        self.corrections: Sequence[Correction] = list(corrections or ())
        self._counts = [one.weight(floor) for one in self.corrections]
        self._boxes = np.array([v.low for v in variables]), np.array([v.high - v.low for v in variables])
        believed = [v for v in variables if v.prior is not None]
        self._priors = np.array([[_counts(v, other) for other in variables] for v in believed], float)
        self._priors = self._priors.reshape(len(believed), len(variables))
        self._means = np.array([v.prior.mean for v in believed if v.prior])
        self._sigmas = np.array([v.prior.sigma for v in believed if v.prior])
        self.floor = floor
        correlation = correlation_s(twin, objective)
        periods = [float(np.median(np.diff(r.time_s))) for r in recordings]
        self._tau = [max(1.0, correlation / period) for period in periods]
        self._started = [self._whitening(i) for i in range(len(recordings))]
        self._offset_held = offset_held
        self._free_offset = np.array([joint not in offset_held for joint in objective])

    def _controls(self, recording: Aligned, grid: np.ndarray, onset_s: float) -> np.ndarray:
        return recording.controls(self.twin, grid, onset_s, mean_over_s=float(self.twin.model.opt.timestep))

    def joint_residuals(self, points: np.ndarray) -> list[np.ndarray]:
        """Measured minus predicted (B, n, k) rad, less what the roll-out itself gets wrong and what starts may do.

        Where that error is known no better than to more than the floor, less of a residual counts.
        """
        residuals = super().joint_residuals(points)
        if self.corrections:
            zipped = zip(residuals, self.corrections, self._counts, self._known, strict=True)
            residuals = [(r - np.where(known, c.error, 0.0)[None]) * counts for r, c, counts, known in zipped]
        both = zip(residuals, self._started, strict=True)
        return [r if started is None else started(r) for r, started in both]

    def _whitening(self, index: int) -> Whitening | None:
        """What takes the uncertain start of a recording out of its residuals; None where that does nothing."""
        response = self.recordings[index].start_response
        if response is None:
            return None
        seen = np.where(self._known[index][None], response[:, :, self._columns], 0.0)
        if self.corrections:
            seen = seen * self._counts[index]
        return Whitening(seen, np.sqrt(self.floor * self._tau[index]))

    def blocks(self) -> list[tuple[int, int]]:
        """Where the rows of each recording are; those of the priors come behind all of them."""
        sizes = [len(r.time_s) * len(self.objective) for r in self.recordings]
        ends = np.cumsum(sizes)
        return [(int(end - size), int(end)) for size, end in zip(sizes, ends, strict=True)]

    @property
    def uncertainty_cost(self) -> float:
        """What it costs (-2 log posterior) that samples are uncertain beyond the floor: the log of their variance.

        Else a law that says little of a sample would gain by that.
        """
        counted = zip(self._counts, self._known, self._tau, strict=True) if self._counts else ()
        return float(sum((-2.0 * np.log(counts) * known).sum() / tau for counts, known, tau in counted))

    @property
    def correlation(self) -> float:
        """How many samples of a residual count as one."""
        return float(np.mean(self._tau))

    @property
    def effective_samples(self) -> float:
        """How many independent samples the recordings are worth, over all joints."""
        return float(sum(known.sum() / tau for known, tau in zip(self._known, self._tau, strict=True)))

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, m) residuals in standard deviations of the floor, tempered by their correlation, and the priors' rows."""
        residuals = self.joint_residuals(points)
        offset, share = self._offsets(residuals)
        # with this part of the mean taken out, the sum of squares is the profiled one
        taken = (1.0 - np.sqrt(1.0 - share)) * offset
        rows = [
            (np.where(known[None], residual - taken[:, None, :], 0.0) / np.sqrt(self.floor * tau)).reshape(
                len(residual), -1
            )
            for residual, known, tau in zip(residuals, self._known, self._tau, strict=True)
        ]
        return np.concatenate([*rows, self.prior_residuals(points)], axis=1)

    def _offsets(self, residuals: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """((B, k) rad weighted mean of each joint's residual, (k,) how much of it the prior lets go as an offset)."""
        weights = np.array([known.sum(axis=0) / tau for known, tau in zip(self._known, self._tau, strict=True)])
        sums = np.sum([r.sum(axis=1) / tau for r, tau in zip(residuals, self._tau, strict=True)], axis=0)
        total = np.maximum(weights.sum(axis=0), 1e-9)
        power = total / self.floor
        share = np.where(self._free_offset, power / (power + 1.0 / (OFFSET_FLOORS**2 * self.floor)), 0.0)
        return sums / total, share

    def times_floor(self, point: np.ndarray) -> np.ndarray:
        """(k,) mean squared residual of each joint in floors at a point (p,), beyond a plausible offset."""
        residuals = self.joint_residuals(point[None])
        offset, share = self._offsets(residuals)
        taken = (share * offset)[0]
        total = np.sum(
            [(np.where(k, r[0] - taken, 0.0) ** 2).sum(axis=0) for r, k in zip(residuals, self._known, strict=True)],
            axis=0,
        )
        return total / self.samples_per_joint / self.floor

    def offsets(self, point: np.ndarray) -> dict[str, float]:
        """How many sigma each joint's reading would have to be off at a point (p,), by joint."""
        offset, share = self._offsets(self.joint_residuals(point[None]))
        sigmas = share * offset[0] / (OFFSET_FLOORS * np.sqrt(self.floor))
        return {
            joint: float(s) for joint, s, free in zip(self.objective, sigmas, self._free_offset, strict=True) if free
        }

    def corrected(self, corrections: Sequence[Correction]) -> Posterior:
        """The same problem with other corrections."""
        other = self.over(self.recordings, self.variables, corrections)
        other._last = self._last
        return other

    def over(
        self, recordings: Sequence[Aligned], variables: Sequence[Variable], corrections: Sequence[Correction]
    ) -> Posterior:
        """The same problem over other recordings."""
        return Posterior(
            self.twin,
            recordings,
            variables,
            self.objective,
            self.floor,
            offset_held=self._offset_held,
            corrections=corrections,
            threads=self.threads,
        )

    def prior_residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, q) how many sigma each parameter is from its prior; factors on one parameter count together."""
        low, span = self._boxes
        return ((low + points * span) @ self._priors.T - self._means) / self._sigmas

    def prior_slopes(self) -> np.ndarray:
        """(q, p) derivative of the priors' rows by the points."""
        return self._priors * self._boxes[1] / self._sigmas[:, None]

    def deviations(self, point: np.ndarray) -> dict[str, float]:
        """How many sigma each nuisance is from its prior, by name."""
        names = [v.name for v in self.variables if v.prior is not None]
        return dict(zip(names, map(float, self.prior_residuals(point[None])[0]), strict=True))

    def corrections_at(self, point: np.ndarray) -> list[Correction]:
        """What the roll-out of a point (p,) gets wrong of each recording.

        The error is how it moves without a time step, less how it moves at its own. Candidates are tried at the model's
        own step, which is off by more than the sensors' noise where steps are commanded. To first order the error is
        the same nearby, so it is computed once and taken out (`corrections`). MuJoCo's integrators are of first order:
        a quarter of the step leaves a third of what it takes away.
        """
        own = self.predict(point[None])
        at_quarter = self.at_finer_step(FINER_STEPS, point)
        whole = 1.0 + 1.0 / (FINER_STEPS - 1.0)
        each = zip(at_quarter, own, self._variances_at(point), strict=True)
        # of a roll-out that went beyond all bounds nothing is known of its error
        return [
            Correction(np.nan_to_num(whole * (fine - coarse[0]), posinf=0.0, neginf=0.0), variance)
            for fine, coarse, variance in each
        ]

    def _variances_at(self, point: np.ndarray) -> list[np.ndarray]:
        """(n, k) rad^2 a recording: how uncertain the roll-out of a point (p,) is."""
        own = self.predict(point[None])
        variances = [np.zeros_like(read[0]) for read in own]
        for other in self._otherwise():
            both = zip(variances, other.predict(point[None]), own, strict=True)
            variances = [
                known + np.nan_to_num((there[0] - here[0]) ** 2, posinf=0.0, neginf=0.0) for known, there, here in both
            ]
        return variances

    def _otherwise(self) -> Iterator[Posterior]:
        """The same problem with what is not known about its roll-outs one sigma off.

        What neighbours do to a part is read off their measured motion. A servo within its limits hardly lets an error
        of that show; one at its limit, or a joint that is about to slip, lets it grow. And how a joint comes back from
        beyond the end of its travel is the simulator's own number, as what a contact does.

        Joints that no servo holds apart let it grow all the time, so that nothing would count: of these it is not
        asked.
        """
        if not each_held(self.twin, self.objective):
            return
        if any(recording.reaction is not None for recording in self.recordings):
            stronger = [_stronger(one) for one in self.recordings]
            yield Posterior(self.twin, stronger, self.variables, self.objective, self.floor)
        share = self.twin.hand.description.nominal_uncertainty.ends
        if share > 0.0 and self._beyond_an_end():
            softer = self.twin.with_softer_ends(1.0 + share)
            yield Posterior(softer, self.recordings, self.variables, self.objective, self.floor)

    def _beyond_an_end(self) -> bool:
        """Whether a joint was measured beyond an end of its travel, by more than its reading's noise."""
        model = self.twin.model
        ids = [model.dof_jntid[self.twin.dof_adr[column]] for column in self._columns]
        limited = model.jnt_limited[ids].astype(bool)
        low, high = np.where(limited, model.jnt_range[ids].T, [[-np.inf], [np.inf]])
        noise = END_SIGMA * np.sqrt(self.floor)
        read = [recording.measured[:, self._columns] for recording in self.recordings]
        return any(bool(((one < low - noise) | (one > high + noise)).any()) for one in read)

    def at_finer_step(self, steps: float, point: np.ndarray) -> list[np.ndarray]:
        """(n, k) rad a recording: how a point (p,) moves at so many time steps in one."""
        twin = self.twin.at_step(float(self.twin.model.opt.timestep) / steps)
        fine = Posterior(twin, self.recordings, self.variables, self.objective, self.floor, threads=1)
        return [read[0] for read in fine.predict(point[None])]


def floor_and_corrections(
    twin: TwinModel, recordings: Sequence[Aligned], variables: Sequence[Variable], joints: Sequence[str]
) -> tuple[np.ndarray, list[Correction]]:
    """((k,) rad^2, by recording): the floor with what is left of the time step's error, and that error.

    What is left is of second order: half a step should take away two thirds of what a quarter does, and what it takes
    beside that, twice, is what the extrapolation gets wrong (Richardson 1911).
    """
    floor = floor_variance(recordings, joints)
    nominal = Posterior(twin, recordings, variables, joints, floor)
    point = nominal.start
    own = nominal.predict(point[None])
    corrections = nominal.corrections_at(point)
    half = nominal.at_finer_step(2.0, point)
    each = zip(corrections, half, own, strict=True)
    beside = [2.0 * (0.5 * one.error - (at_half - at_own[0])) for one, at_half, at_own in each]
    return tolerated(twin, floor + np.mean([one.var(axis=0) for one in beside], axis=0)), corrections


def _stronger(recording: Aligned) -> Aligned:
    """With what neighbours do off by as much as that is known."""
    reaction = recording.reaction
    return recording if reaction is None else replace(recording, reaction=replace(reaction, scale=1.0 + REACTION_ERROR))


def tolerated(twin: TwinModel, floor: np.ndarray) -> np.ndarray:
    """(k,) rad^2: the floor, or where the robot's description tolerates more, what of that counts as one floor."""
    tolerance = twin.hand.description.tolerance_rad
    return floor if tolerance is None else np.maximum(floor, tolerance**2 / FLOOR_CHI_SQUARE)


def _counts(variable: Variable, other: Variable) -> bool:
    """Whether another variable multiplies the parameter that a factor's prior is about: the first that it moves."""
    factors = variable.factors if isinstance(variable, ParameterVariable) else ()
    return other is variable or (bool(factors) and factors[0] in other.factors)

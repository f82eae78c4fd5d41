"""The statistics of a diagnosis: residuals in units of what a right model would leave."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from twin_daemon.comparison.noise import noise_variance
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.thresholds import (
    CORRELATION_S,
    FINER_STEPS,
    MODEL_FLOOR_RAD,
    OFFSET_SIGMA_RAD,
    STEP_ERROR_SHARE,
)
from twin_daemon.estimation.variables import ParameterVariable, Variable
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


def floor_variance(recordings: Sequence[Aligned], joints: Sequence[str]) -> np.ndarray:
    """(k,) rad^2: each joint's sensor noise and resolution, and the model's own floor."""
    out = []
    for joint in joints:
        noise = [noise_variance(r.measured[:, r.joints.index(joint)]) for r in recordings]
        out.append(float(np.median(noise)) + MODEL_FLOOR_RAD**2)
    return np.array(out)


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
        corrections: Sequence[np.ndarray] | None = None,
        threads: int | None = 1,
    ) -> None:
        super().__init__(twin, recordings, variables, objective, threads=threads)
        self.corrections: Sequence[np.ndarray] = list(corrections or ())
        self._boxes = np.array([v.low for v in variables]), np.array([v.high - v.low for v in variables])
        believed = [v for v in variables if v.prior is not None]
        self._priors = np.array([[_counts(v, other) for other in variables] for v in believed], float)
        self._priors = self._priors.reshape(len(believed), len(variables))
        self._means = np.array([v.prior.mean for v in believed if v.prior])
        self._sigmas = np.array([v.prior.sigma for v in believed if v.prior])
        self.floor = floor
        periods = [float(np.median(np.diff(r.time_s))) for r in recordings]
        self._tau = [max(1.0, CORRELATION_S / period) for period in periods]
        self._offset_held = offset_held
        self._free_offset = np.array([joint not in offset_held for joint in objective])

    def _controls(self, recording: Aligned, grid: np.ndarray, onset_s: float) -> np.ndarray:
        return recording.controls(self.twin, grid, onset_s, mean_over_s=float(self.twin.model.opt.timestep))

    def joint_residuals(self, points: np.ndarray) -> list[np.ndarray]:
        """Measured minus predicted (B, n, k) rad, the nominal model's time-step error taken out."""
        residuals = super().joint_residuals(points)
        if not self.corrections:
            return residuals
        zipped = zip(residuals, self.corrections, self._known, strict=True)
        return [r - np.where(known, c, 0.0)[None] for r, c, known in zipped]

    @property
    def correlation(self) -> float:
        """How many samples of a residual count as one."""
        return float(np.mean(self._tau))

    @property
    def effective_samples(self) -> float:
        """How many independent samples the recordings are worth, over all joints."""
        return float(sum(known.sum() / tau for known, tau in zip(self._known, self._tau, strict=True)))

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, m) whitened residuals and priors."""
        rows = [
            self._whiten(residual, known, tau)
            for residual, known, tau in zip(self.joint_residuals(points), self._known, self._tau, strict=True)
        ]
        return np.concatenate([*rows, self.prior_residuals(points)], axis=1)

    def _whiten(self, residual: np.ndarray, known: np.ndarray, tau: float) -> np.ndarray:
        count = np.maximum(known.sum(axis=0), 1)
        mean = residual.sum(axis=1) / count  # (B, k)
        weight = count / tau / self.floor
        share = np.where(self._free_offset, weight / (weight + 1.0 / OFFSET_SIGMA_RAD**2), 0.0)
        # with this share of the mean taken out, the sum of squares is the profiled one
        shifted = np.where(known[None], residual - ((1.0 - np.sqrt(1.0 - share)) * mean)[:, None, :], 0.0)
        return (shifted / np.sqrt(self.floor * tau)).reshape(len(residual), -1)

    def corrected(self, corrections: Sequence[np.ndarray]) -> Posterior:
        """The same problem with other corrections."""
        return self.over(self.recordings, self.variables, corrections)

    def over(
        self, recordings: Sequence[Aligned], variables: Sequence[Variable], corrections: Sequence[np.ndarray]
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

    def step_errors(self, point: np.ndarray) -> list[np.ndarray]:
        """(n, k) rad a recording: how a point (p,) moves at a quarter of the time step, less how it moves at its own.

        Candidates are tried at the model's own step, which is off by more than the sensors' noise where steps are
        commanded. To first order the error is the same nearby, so it is computed once and taken out (`corrections`).
        """
        step_s = float(self.twin.model.opt.timestep)
        fine = Posterior(
            self.twin.at_step(step_s / FINER_STEPS),
            self.recordings,
            self.variables,
            self.objective,
            self.floor,
            threads=1,
        )
        return [f[0] - c[0] for f, c in zip(fine.predict(point[None]), self.predict(point[None]), strict=True)]


def floor_and_corrections(
    twin: TwinModel, recordings: Sequence[Aligned], variables: Sequence[Variable], joints: Sequence[str]
) -> tuple[np.ndarray, list[np.ndarray]]:
    """((k,) rad^2, (n, k) rad a recording): the floor with what is left of the time step's error, and that error."""
    floor = floor_variance(recordings, joints)
    nominal = Posterior(twin, recordings, variables, joints, floor)
    errors = nominal.step_errors(nominal.start)
    return floor + np.mean([(STEP_ERROR_SHARE * e).var(axis=0) for e in errors], axis=0), errors


def _counts(variable: Variable, other: Variable) -> bool:
    """Whether another variable multiplies the parameter that a factor's prior is about: the first that it moves."""
    factors = variable.factors if isinstance(variable, ParameterVariable) else ()
    return other is variable or (bool(factors) and factors[0] in other.factors)

"""The statistics of a diagnosis: residuals in units of what a right model would leave."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from twin_daemon.comparison.noise import noise_variance
from twin_daemon.diagnosis.nuisances import OFFSET_SIGMA_RAD
from twin_daemon.fitting.knobs import Knob
from twin_daemon.fitting.problem import Problem
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

MODEL_FLOOR_RAD = 6e-4
"""What a right model still leaves even after the time step's error is taken out."""

_FINER = 4.0
_STEP_ERROR_SHARE = 0.5  # of the time step's error that is left after it has been taken out

CORRELATION_S = 0.08
"""Over this time the residual of a right model repeats itself: that many samples count as one."""


def floor_variance(recordings: Sequence[Aligned], joints: Sequence[str]) -> np.ndarray:
    """(k,) rad^2: each joint's sensor noise and resolution, and the model's own floor."""
    out = []
    for joint in joints:
        noise = [noise_variance(r.measured[:, r.joints.index(joint)]) for r in recordings]
        out.append(float(np.median(noise)) + MODEL_FLOOR_RAD**2)
    return np.array(out)


class WhitenedProblem(Problem):
    """A problem whose cost is minus twice the log posterior, tempered by the residual's correlation.

    A constant offset of each joint's reading is profiled out exactly under its prior, except for the joints in
    `offset_held` (where a candidate speaks for the offset itself).
    """

    def __init__(
        self,
        twin: TwinModel,
        recordings: Sequence[Aligned],
        knobs: Sequence[Knob],
        objective: Sequence[str],
        floor: np.ndarray,
        *,
        offset_held: Collection[str] = (),
        corrections: Sequence[np.ndarray] | None = None,
        threads: int | None = 1,
    ) -> None:
        super().__init__(twin, recordings, knobs, objective, threads=threads)
        self.corrections: Sequence[np.ndarray] = list(corrections or ())
        self._boxes = np.array([k.low for k in knobs]), np.array([k.high - k.low for k in knobs])
        believed = [k for k in knobs if k.prior is not None]
        self._priors = np.array([[_counts(k, other) for other in knobs] for k in believed], float)
        self._priors = self._priors.reshape(len(believed), len(knobs))
        self._means = np.array([k.prior.mean for k in believed if k.prior])
        self._sigmas = np.array([k.prior.sigma for k in believed if k.prior])
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

    def corrected(self, corrections: Sequence[np.ndarray]) -> WhitenedProblem:
        """The same problem with other corrections."""
        return self.over(self.recordings, self.knobs, corrections)

    def over(
        self, recordings: Sequence[Aligned], knobs: Sequence[Knob], corrections: Sequence[np.ndarray]
    ) -> WhitenedProblem:
        """The same problem over other recordings."""
        return WhitenedProblem(
            self.twin,
            recordings,
            knobs,
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

    def strains(self, point: np.ndarray) -> dict[str, float]:
        """How many sigma each nuisance is from its prior, by name."""
        names = [k.name for k in self.knobs if k.prior is not None]
        return dict(zip(names, map(float, self.prior_residuals(point[None])[0]), strict=True))

    def step_errors(self, point: np.ndarray) -> list[np.ndarray]:
        """(n, k) rad a recording: how a point (p,) moves at a quarter of the time step, less how it moves at its own.

        Candidates are tried at the model's own step, which is off by more than the sensors' noise where steps are
        commanded. To first order the error is the same nearby, so it is computed once and taken out (`corrections`).
        """
        step_s = float(self.twin.model.opt.timestep)
        fine = WhitenedProblem(
            self.twin.at_step(step_s / _FINER), self.recordings, self.knobs, self.objective, self.floor, threads=1
        )
        return [f[0] - c[0] for f, c in zip(fine.predict(point[None]), self.predict(point[None]), strict=True)]


def floor_and_corrections(
    twin: TwinModel, recordings: Sequence[Aligned], knobs: Sequence[Knob], joints: Sequence[str]
) -> tuple[np.ndarray, list[np.ndarray]]:
    """((k,) rad^2, (n, k) rad a recording): the floor with what is left of the time step's error, and that error."""
    floor = floor_variance(recordings, joints)
    nominal = WhitenedProblem(twin, recordings, knobs, joints, floor)
    errors = nominal.step_errors(nominal.start)
    return floor + np.mean([(_STEP_ERROR_SHARE * e).var(axis=0) for e in errors], axis=0), errors


def _counts(knob: Knob, other: Knob) -> bool:
    """Whether another knob turns the parameter that a knob's prior is about: the first that it writes."""
    return other is knob or (knob.mode == "scale" and other.mode == "scale" and knob.writes[0] in other.writes)


def block_gain(before: np.ndarray, after: np.ndarray, block: int, seed: int, draws: int = 400) -> tuple[float, float]:
    """95 % interval of 1 - after/before by a bootstrap over blocks in time of squared errors (n,) each."""
    blocks = max(2, len(before) // max(block, 1))
    sums_before = np.array([part.sum() for part in np.array_split(before, blocks)])
    sums_after = np.array([part.sum() for part in np.array_split(after, blocks)])
    chosen = np.random.default_rng(seed).integers(0, blocks, (draws, blocks))
    total = np.maximum(sums_before[chosen].sum(axis=1), 1e-30)
    gains = 1.0 - sums_after[chosen].sum(axis=1) / total
    low, high = np.quantile(gains, [0.025, 0.975])
    return float(low), float(high)

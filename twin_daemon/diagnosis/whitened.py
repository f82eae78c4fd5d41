"""The statistics of a diagnosis: residuals in units of what a right model would leave."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from twin_daemon.comparison.noise import noise_variance
from twin_daemon.diagnosis.nuisances import OFFSET_SIGMA_RAD
from twin_daemon.fitting.knobs import Knob
from twin_daemon.fitting.problem import Problem
from twin_daemon.simulation.alignment import Aligned, predict
from twin_daemon.simulation.twin import TwinModel

MODEL_FLOOR_RAD = 6e-4
"""What a right model still leaves even after the time step's error is taken out."""

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
    ) -> None:
        super().__init__(twin, recordings, knobs, objective)
        self._corrections = corrections
        self.prior_weight = 1.0
        self.floor = floor
        periods = [float(np.median(np.diff(r.time_s))) for r in recordings]
        self._tau = [max(1.0, CORRELATION_S / period) for period in periods]
        self._free_offset = np.array([joint not in offset_held for joint in objective])

    def joint_residuals(self, points: np.ndarray) -> list[np.ndarray]:
        """Measured minus predicted (B, n, k) rad, the nominal model's time-step error taken out."""
        residuals = super().joint_residuals(points)
        if self._corrections is None:
            return residuals
        zipped = zip(residuals, self._corrections, self._known, strict=True)
        return [r - np.where(known, c, 0.0)[None] for r, c, known in zipped]

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

    def chi_square(self, points: np.ndarray) -> np.ndarray:
        """(B,) mean of the squared residual over the floor: 1 is what a right model leaves, without the priors."""
        rows = self.residuals(points)
        prior = self.prior_residuals(points)
        data = (rows**2).sum(axis=1) - (prior**2).sum(axis=1)
        return data / self.effective_samples


def step_corrections(twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str]) -> list[np.ndarray]:
    """(n, k) rad a recording: what the model moves at a quarter of its time step beyond what it moves at its own.

    Candidates are tried at the model's own step, which is off by more than the sensors' noise where steps are
    commanded. To first order the error is the same with and without a small effect, so it is computed once.
    """
    columns = [twin.joints.index(joint) for joint in joints]
    fine = twin.at_step(float(twin.model.opt.timestep) / 4.0)
    return [(predict(fine, r) - predict(twin, r))[:, columns] for r in recordings]


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

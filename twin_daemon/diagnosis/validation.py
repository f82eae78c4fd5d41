"""The validation: an effect counts only if motion that it was not fitted to gets better by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.in_turn import by_motion
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import ADEQUATE_FLOORS, AS_BEFORE, FORGIVEN_OFFSET_SIGMA, RELATIVE_ERROR
from twin_daemon.estimation.floor import floor_variance
from twin_daemon.estimation.thresholds import OFFSET_FLOORS
from twin_daemon.estimation.uncertainty import block_gain, block_samples, sample_squares
from twin_daemon.simulation.alignment import Aligned


@dataclass(frozen=True)
class HeldOutMotion:
    """A fit on one held-out recording beside the model without the effect. Errors in rad^2.

    `by_joint` (k,) is what is left of each joint in floors, `allowed` (k,) what a right model may leave. `asked` is
    whether the model without the effect leaves more than that: otherwise this motion cannot speak for an effect.
    """

    name: str
    mse_before: float
    mse_after: float
    gain_ci95: tuple[float, float]
    by_joint: np.ndarray
    allowed: np.ndarray
    asked: bool

    @property
    def adequacy(self) -> float:
        """What is left of the worst joint, in what a right model may leave."""
        return float((self.by_joint / self.allowed).max())

    @property
    def worse(self) -> bool:
        """Whether it is predicted worse with 97.5 % certainty."""
        return self.gain_ci95[1] < 0.0


@dataclass(frozen=True)
class HeldOut:
    """A fit on all held-out motion beside the model without the effect. Errors in rad^2.

    Errors and the gain are over all of it; whether the model is right is asked of each recording, and the worst counts.
    """

    mse_before: float
    mse_after: float
    gain: float
    gain_ci95: tuple[float, float]
    motions: tuple[HeldOutMotion, ...]

    @property
    def silent(self) -> bool:
        """Whether this motion speaks neither for the effect nor against it."""
        return not any(motion.asked or motion.worse for motion in self.motions)

    @property
    def passes(self) -> bool:
        """Whether the gain is there with 97.5 % certainty, and no motion is predicted worse than a right model may."""
        return self.gain_ci95[0] > 0.0 and self.spoilt is None

    @property
    def spoilt(self) -> HeldOutMotion | None:
        """Of several motions the one that is certainly predicted worse, and not as a right model would; None else."""
        if len(self.motions) < 2:
            return None
        worse = [motion for motion in self.motions if motion.worse and motion.adequacy > 1.0]
        return max(worse, key=lambda motion: motion.adequacy, default=None)

    @property
    def adequate(self) -> bool:
        """Whether what is left is what a right model leaves, in every motion."""
        return self.adequacy <= 1.0

    @property
    def adequacy(self) -> float:
        """What is left of the worst joint in the worst motion, in what a right model may leave."""
        return max(motion.adequacy for motion in self.motions)


class Validation:
    """Held-out motion for one part, against which any of its fits is judged.

    What the recordings alone determine, such as the time step's error on them, is computed once for all fits.
    """

    def __init__(
        self, part: PartFit, holdout: Sequence[Aligned], *, seed: int, first: Validation | None = None
    ) -> None:
        """`first` is the validation of the part before any effect was found."""
        self._part = part
        self._holdout = holdout
        self._seed = seed
        self._before: dict[tuple[tuple[str, ...], bool], list[np.ndarray]] = {}
        self._known = [np.isfinite(r.measured[:, [r.joints.index(j) for j in part.joints]]) for r in holdout]
        self._motions = by_motion(holdout)
        base = part.held_out(part.base, holdout)
        self.allowed = self._allowed(base) if first is None else first.allowed
        self._before[(), False] = base
        self._block = block_samples(holdout[0].time_s)

    def judge(self, fit: Fit) -> HeldOut:
        """Compares a fit with the nuisances alone, both as fitted, on the held-out recordings.

        A nuisance that the effect speaks for is held at its nominal value beside it: what stood in for the effect
        does not count against it.
        """
        part = self._part
        owned = tuple(sorted(fit.hypothesis.speaks_for(part.twin))) if fit.hypothesis else ()
        before = self._without(owned, adjusted=False)
        after = before if fit is part.base else part.held_out(fit, self._holdout)
        floor = part.floor
        left = self._left(after, floor)
        if any((left[name] > self.allowed[name]).any() for name in self._motions):
            # what the fitted motion leaves loose is not held against either, nor what jitter does to faster motion
            before = self._without(owned, adjusted=True)
            after = before if fit is part.base else part.held_out(fit, self._holdout, adjusted=True)
            floor = self._floor
            left = self._left(after, floor)
        left_before = self._left(before, floor)
        squares = [sample_squares([r], [known]) for r, known in zip(before, self._known, strict=True)]
        squares_after = [sample_squares([r], [known]) for r, known in zip(after, self._known, strict=True)]
        total_before, total_after, gain = self._gain(range(len(before)), squares, squares_after)
        motions = []
        for name, members in self._motions.items():
            mse_before, mse_after, interval = self._gain(members, squares, squares_after)
            asked = bool((left_before[name] > self.allowed[name]).any())
            recorded = self._holdout[members[0]].recording.name
            motions.append(
                HeldOutMotion(recorded, mse_before, mse_after, interval, left[name], self.allowed[name], asked)
            )
        return HeldOut(
            mse_before=total_before,
            mse_after=total_after,
            gain=1.0 - total_after / max(total_before, 1e-30),
            gain_ci95=gain,
            motions=tuple(motions),
        )

    def _gain(
        self, members: Sequence[int], before: Sequence[np.ndarray], after: Sequence[np.ndarray]
    ) -> tuple[float, float, tuple[float, float]]:
        """(mean squared errors in rad^2 of some pieces before and after, the 95 % interval of the gain)."""
        old, new = (np.concatenate([squares[i] for i in members]) for squares in (before, after))
        return float(old.mean()), float(new.mean()), block_gain(old, new, self._block, self._seed)

    def _left(self, residuals: Sequence[np.ndarray], floor: np.ndarray) -> dict[str, np.ndarray]:
        """(k,) what is left of each joint in floors, by recording."""
        return {
            name: _left([residuals[i] for i in members], [self._known[i] for i in members], floor)
            for name, members in self._motions.items()
        }

    def squares(self) -> np.ndarray:
        """(n,) rad^2: mean over the joints of each held-out sample's squared error, by the nuisances alone."""
        return sample_squares(self._without((), adjusted=False), self._known)

    @cached_property
    def _floor(self) -> np.ndarray:
        """(k,) rad^2: the part's floor, with what jitter makes of held-out motion that is faster than the fitted."""
        part = self._part
        fitted, own = (floor_variance(recordings, part.joints) for recordings in (part.recordings, self._holdout))
        return part.floor + np.maximum(own - fitted, 0.0)

    def _without(self, owned: tuple[str, ...], *, adjusted: bool) -> list[np.ndarray]:
        """The model without an effect on the held-out motion, computed once for all effects that own the same."""
        if (owned, adjusted) not in self._before:
            fit = _without_stand_in(self._part, set(owned)) if owned else self._part.base
            self._before[owned, adjusted] = self._part.held_out(fit, self._holdout, adjusted=adjusted)
        return self._before[owned, adjusted]

    def _allowed(self, base: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
        """(k,) floors by recording: for joints that fit well what they leave anyway, for the others a part of that.

        What nuisances that had to stand in for something get wrong on other motion allows nothing: where the part left
        less on its own motion, that counts.
        """
        most = np.maximum(self._part.times_floor, ADEQUATE_FLOORS)
        left = self._left(base, self._part.floor)
        return {name: most_left(self._part, np.minimum(own, most)) for name, own in left.items()}


def most_left(part: PartFit, before: np.ndarray) -> np.ndarray:
    """(k,) floors that a right model may leave of each joint, by what the part leaves `before` (k,) any effect.

    Of joints at which something is missing a share, since laws differ in form; of the others no more than before.
    """
    share = np.array([RELATIVE_ERROR if joint in part.suspects else AS_BEFORE for joint in part.joints])
    return np.maximum(ADEQUATE_FLOORS, share * before)


def _without_stand_in(part: PartFit, owned: set[str]) -> Fit:
    variables = part.base.problem.variables
    start = part.base.problem.start
    point = [start[i] if variable.name in owned else part.base.point[i] for i, variable in enumerate(variables)]
    return replace(part.base, point=np.array(point))


def _left(residuals: Sequence[np.ndarray], known: Sequence[np.ndarray], floor: np.ndarray) -> np.ndarray:
    """(k,) mean squared error over the floor; a plausible constant offset is not held against a model."""
    count = np.maximum(np.sum([mask.sum(axis=0) for mask in known], axis=0), 1)
    pairs = list(zip(residuals, known, strict=True))
    offset = np.sum([np.where(mask, r, 0.0).sum(axis=0) for r, mask in pairs], axis=0) / count
    most = FORGIVEN_OFFSET_SIGMA * OFFSET_FLOORS * np.sqrt(floor)
    offset = np.clip(offset, -most, most)
    return np.sum([(np.where(mask, r - offset, 0.0) ** 2).sum(axis=0) for r, mask in pairs], axis=0) / count / floor

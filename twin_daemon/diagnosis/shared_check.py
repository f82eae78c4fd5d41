"""Whether a cause that several groups share leaves of each what a right model may, on held-out motion too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.diagnosis.far_off import beyond_any_hand, needed
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import RELATIVE_ERROR
from twin_daemon.diagnosis.validation import Validation
from twin_daemon.estimation.partition import Reduced
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE


def passing(
    above: Sequence[tuple[Reduced, PartFit]], looked_at: Sequence[tuple[Reduced, PartFit]], seed: int
) -> list[tuple[np.ndarray, np.ndarray] | None]:
    """By group (n,) squared errors on held-out motion without and with a cause, in rad^2; None where it does not pass.

    A right model leaves no more, and forces no uncertain value further off than any hand has it. Both are lists of the
    same groups, the second with the cause in their models; empty where a group has too little motion in which it
    touches nothing. Held-out motion is asked only where most groups pass on the fitted one.
    """
    both = list(zip(above, looked_at, strict=True)) if looked_at else []
    fitting = [_fits(old, new) for (_, old), (_, new) in both]
    most = 2 * sum(fitting) > len(fitting)
    return [_held_out(*two, seed) if fits and most else None for fits, two in zip(fitting, both, strict=True)]


def _fits(old: PartFit, new: PartFit) -> bool:
    # of what nobody has fitted no share says anything
    share = 0.0 if old.nominal else RELATIVE_ERROR
    most = np.maximum(FLOOR_CHI_SQUARE, share * old.times_floor)
    return not ((new.times_floor > most).any() or beyond_any_hand(needed(new, most)))


def _held_out(
    without: tuple[Reduced, PartFit], beside: tuple[Reduced, PartFit], seed: int
) -> tuple[np.ndarray, np.ndarray] | None:
    (reduced, old), (changed, new) = without, beside
    before = Validation(old, reduced.holdout, seed=seed)
    after = Validation(new, changed.holdout, seed=seed, first=None if old.nominal else before)
    return (before.squares(), after.squares()) if after.judge(new.base).adequate else None

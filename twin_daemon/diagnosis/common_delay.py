"""The delay that all commands of a recording have in common, told by the groups of joints that agree on it.

When the commands of a recording take effect is known to a cycle of the robot only. But it is one time for all joints:
the ones that move as one delay says leave no such freedom to one that is later than all others.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import COMMON_DELAY_SIGMA, DEVIATING_SIGMA, JOINTS_APART
from twin_daemon.estimation.solvers.trust_region import differenced
from twin_daemon.estimation.variables import OnsetVariable
from twin_daemon.executor import concurrently


@dataclass(frozen=True)
class CommonDelay:
    """When all commands of each recording take effect, s by its sha256: (delay, sigma); `late` are the parts later."""

    by_recording: Mapping[str, tuple[float, float]]
    late: tuple[PartFit, ...]


@dataclass(frozen=True)
class _Said:
    """What a part says of a recording's delay, s; `rounded_s` is how far two parts may differ by the model's step.

    `known_to_s` is how well the delay is known before any motion is looked at. The part is known by its `number`: it
    may be another process that has asked it.
    """

    number: int
    delay_s: float
    sigma_s: float
    rounded_s: float
    known_to_s: float

    def later_than(self, delay_s: float, sigma_s: float) -> float:
        """By how many sigma it comes later."""
        return (self.delay_s - delay_s) / float(np.linalg.norm([self.sigma_s, sigma_s, self.rounded_s]))


def common_delay(parts: Sequence[PartFit]) -> CommonDelay | None:
    """What the parts have in common where one of them is later than that; None where they agree, or tell too little.

    Only later: no servo knows a command before it comes. Of two parts the earlier one counts, of more most have to
    agree.
    """
    if len(parts) < 2:  # what one says is later than nothing, and costs a derivative
        return None
    said = _said_by_all(list(enumerate(parts)))
    _, late = _later(said)
    if not late:
        return None
    # a joint that sticks may have come to rest at another delay, in a hollow as deep as the time step's error
    numbers = sorted(late)
    anew = list(zip(numbers, concurrently(_thoroughly, [parts[number] for number in numbers]), strict=True))
    for sha256, each in _said_by_all(anew).items():
        said[sha256] = [*(one for one in said[sha256] if one.number not in late), *each]
    common, late = _later(said)
    return CommonDelay(common, tuple(parts[number] for number in sorted(late))) if late else None


def _later(said: Mapping[str, Sequence[_Said]]) -> tuple[dict[str, tuple[float, float]], set[int]]:
    """(the delay that most parts have in common with its sigma, s by sha256; which of them are later)."""
    common: dict[str, tuple[float, float]] = {}
    late: set[int] = set()
    for sha256, each in said.items():
        agreeing = _agreeing(each)
        if not agreeing or len(agreeing) < min(2, len(each) - 1) or 2 * len(agreeing) < len(each):
            continue
        mean, sigma = _mean(agreeing)
        common[sha256] = mean, float(np.hypot(sigma, agreeing[0].rounded_s))
        late |= {one.number for one in each if one.later_than(mean, sigma) > DEVIATING_SIGMA}
    return common, late


def _thoroughly(part: PartFit) -> PartFit:
    return PartFit(part.twin, part.recordings, part.joints, thoroughly=True, begun=part)


def within_a_cycle(parts: Sequence[PartFit]) -> dict[str, tuple[float, float]] | None:
    """When all commands of each recording take effect, s by its sha256: (delay, sigma), as all parts agree.

    None where they do not, or where that is later than a cycle of the robot explains.
    """
    common: dict[str, tuple[float, float]] = {}
    for sha256, each in _said_by_all(list(enumerate(parts))).items():
        mean, sigma = _mean(each)
        if len(_agreeing(each)) < len(parts) or abs(mean) > COMMON_DELAY_SIGMA * each[0].known_to_s:
            return None
        common[sha256] = mean, float(np.hypot(sigma, each[0].rounded_s))
    return common or None


def _said_by_all(parts: Sequence[tuple[int, PartFit]]) -> dict[str, list[_Said]]:
    """By recording what each part says of its delay, with its number."""
    said: dict[str, list[_Said]] = defaultdict(list)
    for found in concurrently(_said_by, parts):
        for sha256, one in found.items():
            said[sha256].append(one)
    return said


def _mean(said: Sequence[_Said]) -> tuple[float, float]:
    """(s, s): the weighed mean with its sigma."""
    weights = np.array([one.sigma_s**-2 for one in said])
    return float(weights @ [one.delay_s for one in said] / weights.sum()), float(weights.sum() ** -0.5)


def _agreeing(said: Sequence[_Said]) -> list[_Said]:
    """The largest set that one delay explains; of sets of one size the earliest."""
    sets = []
    for centre in said:
        near = [one for one in said if abs(one.later_than(centre.delay_s, centre.sigma_s)) < DEVIATING_SIGMA]
        sets.append((near, centre.delay_s))
    return min(sets, key=lambda one: (-len(one[0]), one[1]))[0] if sets else []


def _said_by(numbered: tuple[int, PartFit]) -> dict[str, _Said]:
    """By recording: one Gauss-Newton step from where a part's nuisances are, and how sure that is."""
    number, part = numbered
    problem, point = part.base.problem, part.base.point
    rows = problem.residuals(point[None])[0]
    slopes = differenced(problem, point, rows, range(len(point)))
    covariance = np.linalg.pinv(slopes.T @ slopes)
    moved = point - covariance @ (slopes.T @ rows)
    rounded = JOINTS_APART * float(part.twin.model.opt.timestep)
    found = {}
    for index, variable in enumerate(problem.variables):
        if isinstance(variable, OnsetVariable) and variable.recordings and variable.prior is not None:
            span = variable.upper - variable.lower
            sha256 = part.recordings[variable.recordings[0]].recording.sha256
            delay_s = variable.lower + span * float(moved[index])
            sigma_s = span * float(covariance[index, index]) ** 0.5
            found[sha256] = _Said(number, delay_s, sigma_s, rounded, variable.prior.sigma)
    return found

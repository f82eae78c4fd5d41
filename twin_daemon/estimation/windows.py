"""Windows of recordings, each with a roll-out of its own: pieces from rest to rest, and stretches of a long recording.

A free roll-out forgets nothing: the split of a coupled pair is a nearly neutral mode that creeps with friction, and
a small cause at the start is a large error at the end. Short pieces that start from the measured pose keep the
comparison about causes (multiple shooting, Bock and Plitt 1984). What a contact does hangs on surfaces that nobody
has measured, so the time in which a finger touches something says little about the finger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_daemon.estimation.thresholds import (
    AFTER_CONTACT_S,
    BEFORE_CONTACT_S,
    BENDS,
    LEAST_NOISE_RAD,
    LEAST_PIECE_S,
    LOOK_FOR_REST_S,
    MOST_EXCERPT_S,
    MOST_PIECE_S,
    START_SLOPE_S,
    STILL_S,
    STILL_SIGMA,
    STIRS_SIGMA,
    STRETCH_S,
    UNSCORED_S,
)
from twin_daemon.recordings.noise import noise_variance
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.turns import Turns, turning_points


def segments(
    aligned: Aligned, joints: Sequence[str], touching: np.ndarray | None = None, least: np.ndarray | None = None
) -> list[Aligned]:
    """The recording in pieces of 1.2 to 4.2 s that start where the given joints stand still, or are slowest.

    With `touching` (n,) bool the samples at which they touch something are left out, and some time around them.
    `least` (j,) is what `noise_travel` says of its joints, where that is known already.
    """
    columns = [aligned.joints.index(joint) for joint in joints]
    least = noise_travel(aligned) if least is None else least
    time_s, position = aligned.time_s, aligned.states[:, columns] / least[columns]
    width = max(2, round(STILL_S / float(np.median(np.diff(time_s)))))
    spans = [(0, len(time_s))] if touching is None or not touching.any() else _free(time_s, touching)
    turns = _Turning(aligned, least)
    pieces = []
    for start, stop in spans:
        first = start if start == 0 else _calmest(time_s, position, (start, stop), LOOK_FOR_REST_S, width)
        if stop - start < len(time_s) and time_s[stop - 1] - time_s[first] < LEAST_PIECE_S:
            continue
        cuts = [first]
        while time_s[stop - 1] - time_s[cuts[-1]] > LEAST_PIECE_S + MOST_PIECE_S:
            earliest = int(np.searchsorted(time_s, time_s[cuts[-1]] + LEAST_PIECE_S))
            cuts.append(_calmest(time_s, position, (earliest, stop), MOST_PIECE_S - LEAST_PIECE_S, width))
        pieces += [_piece(aligned, a, b, width, turns) for a, b in zip(cuts, [*cuts[1:], stop], strict=True)]
    return [piece for piece in pieces if np.isfinite(piece.measured[:, columns]).any()]


def spread(pieces: Sequence[Aligned], most_s: float) -> list[Aligned]:
    """The pieces, or where they last longer, so many of them that are spread evenly over all."""
    whole_s = length_s(pieces)
    if whole_s <= most_s:
        return list(pieces)
    kept = max(1, int(len(pieces) * most_s / whole_s))
    return [pieces[index] for index in np.linspace(0, len(pieces) - 1, kept).round().astype(int)]


def length_s(pieces: Sequence[Aligned]) -> float:
    """Time covered by all pieces, but for samples that are hidden or too near to a start to count."""
    seen = [np.isfinite(piece.measured).any(axis=1).mean() for piece in pieces]
    return float(sum(piece.time_s[-1] * share for piece, share in zip(pieces, seen, strict=True)))


def _free(time_s: np.ndarray, touching: np.ndarray) -> list[tuple[int, int]]:
    """[start, stop) of the runs of samples that are clear of every contact."""
    blocked = np.zeros(len(time_s), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], touching, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2):
        near = (time_s >= time_s[begin] - BEFORE_CONTACT_S) & (time_s <= time_s[end - 1] + AFTER_CONTACT_S)
        blocked |= near
    free = np.flatnonzero(np.diff(np.concatenate([[False], ~blocked, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in free.reshape(-1, 2)]


def _calmest(time_s: np.ndarray, position: np.ndarray, span: tuple[int, int], within_s: float, width: int) -> int:
    """The sample of a span's first seconds around which the joints move least: the first at which they stand still.

    `position` (n, k) counts in what a joint travels by its noise at most.
    """
    start, stop = span
    last = int(np.searchsorted(time_s, time_s[start] + within_s))
    candidates = range(min(start + width, stop - 1), max(min(last, stop), min(start + width, stop - 1) + 1))
    spreads = _spreads(position[candidates[0] - width : candidates[-1] + 1], width + 1)
    still = np.flatnonzero(spreads < 1.0)
    return candidates[int(still[0] if still.size else np.argmin(spreads))]


def _spreads(position: np.ndarray, count: int) -> np.ndarray:
    """(n - count + 1,) the largest travel of a joint within each run of samples; infinite where one is missing."""
    runs = np.lib.stride_tricks.sliding_window_view(position, count, axis=0)
    travel = (runs.max(axis=2) - runs.min(axis=2)).max(axis=1)
    return np.where(np.isfinite(travel), travel, np.inf)


def _piece(aligned: Aligned, start: int, stop: int, width: int, turning: _Turning) -> Aligned:
    begin = float(aligned.time_s[start])
    time_s = aligned.time_s[start:stop] - begin
    if start == 0:
        return replace(aligned, time_s=time_s, measured=aligned.measured[:stop], unhidden=None)
    measured = aligned.measured[start:stop].copy()
    measured[time_s < UNSCORED_S] = np.nan
    pose, speed, sigma = _state(aligned.time_s - begin, aligned.states, start, width)
    return replace(
        aligned,
        time_s=time_s,
        measured=measured,
        unhidden=None,
        onset_s=aligned.onset_s - begin,
        start_position=pose,
        start_velocity=speed,
        start_sigma=sigma,
        reaction=None if aligned.reaction is None else aligned.reaction.shifted(begin),
        turns=turning.before(start, pose),
    )


def noise_travel(aligned: Aligned) -> np.ndarray:
    """(j,) how far each joint has to travel before that is told from its sensor's noise and resolution."""
    noise = np.sqrt([noise_variance(column) for column in aligned.measured.T])
    return STIRS_SIGMA * np.maximum(noise, LEAST_NOISE_RAD)


class _Turning:
    """Where the joints of a recording turn, by more than their noise makes of them."""

    def __init__(self, aligned: Aligned, least: np.ndarray) -> None:
        """`least` (j,) is the travel of each joint that is told from its noise."""
        self._states, self._least = aligned.states, least
        self._at = [turning_points(column, float(way)) for column, way in zip(self._states.T, least, strict=True)]

    def before(self, start: int, pose: np.ndarray) -> Turns:
        """The turns before a sample at which the joints were at `pose` (j,) rad."""
        seen = [[index for index in turns if index < start] for turns in self._at]
        angles = (np.append(column[at], q) for column, at, q in zip(self._states.T, seen, pose, strict=True))
        return Turns(tuple(a[np.isfinite(a)] for a in angles), self._least)


def _state(
    time_s: np.ndarray, measured: np.ndarray, index: int, width: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """((j,) rad, (j,) rad/s, (2, j) their sigmas) of all joints at a sample, from the line or the cubic around it.

    A joint that is turning bends: the mean of the samples around it is then not where it is. One that sets off or stops
    within a sample or two is neither a line nor a cubic: the samples before that or those after it say where it is.
    What these say otherwise is counted as uncertain: few samples a second show no speed that a servo soon changes.
    """
    half = max(2, width // 3)
    around = slice(max(0, index - half), index + half + 1)
    sides = slice(max(0, index - 2 * half), index + 1), slice(index, index + 2 * half + 1)
    pose, speed, sigma = (
        np.full(measured.shape[1], np.nan),
        np.zeros(measured.shape[1]),
        np.zeros((2, measured.shape[1])),
    )
    for joint, column in enumerate(measured.T):
        local = _Local.of(time_s[around], column[around])
        if local is not None:
            others = [other for side in sides if (other := _Local.of(time_s[side], column[side])) is not None]
            if local.bends:
                best = min(others, key=lambda other: other.variance, default=local)
                local = best if local.variance > BENDS * best.variance else local
            pose[joint], speed[joint] = local.position, local.velocity
            sigma[:, joint] = local.uncertain(others)
        elif np.isfinite(column[around]).any():
            pose[joint] = np.nanmean(column[around])
    return pose, speed, sigma


class _Local(NamedTuple):
    """A joint at time 0 by some samples: rad, rad/s, their sigmas, rad^2 that the curve leaves, whether they bend."""

    position: float
    velocity: float
    position_sigma: float
    velocity_sigma: float
    variance: float
    bends: bool

    @classmethod
    def of(cls, time_s: np.ndarray, values: np.ndarray) -> _Local | None:
        """By samples (n,), NaN where one is missing: the mean of a joint that stands still, a line, or the cubic where
        a line leaves far more than that. None where fewer than four are known."""
        known = np.isfinite(values)
        if known.sum() < 4:
            return None
        time_s, values = time_s[known], values[known]
        line, sigma, line_variance = _curve(time_s, values, 1)
        where = (line_variance / len(values)) ** 0.5
        if len(values) > 6:
            cubic, cubic_sigma, variance = _curve(time_s, values, 3)
            if line_variance > BENDS * variance:
                return cls(
                    float(cubic[-1]), float(cubic[-2]), (variance / len(values)) ** 0.5, cubic_sigma, variance, True
                )
        slope = float(line[0])
        if abs(slope) < STILL_SIGMA * sigma:
            return cls(float(values.mean()), 0.0, where, max(sigma, abs(slope)), line_variance, False)
        return cls(float(line[1]), slope, where, sigma, line_variance, False)

    def uncertain(self, others: Sequence[_Local]) -> tuple[float, float]:
        """(rad, rad/s): its sigmas with what others say otherwise; both are what there is at a bend of few samples."""
        away = max((abs(other.position - self.position) for other in others), default=0.0)
        faster = max((abs(other.velocity - self.velocity) for other in others), default=0.0)
        return float(np.hypot(self.position_sigma, away)), float(np.hypot(self.velocity_sigma, faster))


def _curve(time_s: np.ndarray, values: np.ndarray, degree: int) -> tuple[np.ndarray, float, float]:
    """The polynomial through samples (n,), sigma of its slope at 0, and the rad^2 left for each degree of freedom."""
    fit = np.polyfit(time_s, values, degree)
    left = max(float(((np.polyval(fit, time_s) - values) ** 2).sum()) / (len(values) - len(fit)), 1e-18)
    span = float(np.abs(time_s).max())
    powers = np.vander(time_s / span, degree + 1)
    return fit, float(np.sqrt(np.linalg.inv(powers.T @ powers)[-2, -2] * left)) / span, left


def excerpts(recordings: Sequence[Aligned]) -> list[Aligned]:
    """The recordings, each one that is longer than 40 s as five stretches of 8 s spread over it.

    A stretch starts from the state measured there, so that a search costs what the stretches last; errors are
    reported on whole recordings all the same.
    """
    out: list[Aligned] = []
    for recording in recordings:
        if recording.time_s[-1] <= MOST_EXCERPT_S:
            out.append(recording)
            continue
        count = int(MOST_EXCERPT_S // STRETCH_S)
        begins = np.linspace(0.0, recording.time_s[-1] - STRETCH_S, count)
        cut = (stretch(recording, begin, STRETCH_S) for begin in begins)
        out.extend(part for part in cut if part is not None)
    return out


def stretch(recording: Aligned, begin_s: float, seconds: float) -> Aligned | None:
    """So many seconds from the first sample after `begin_s` that knows every moving joint; None where none does."""
    usable = np.isfinite(recording.states[:, recording.moving]).all(axis=1) & (recording.time_s >= begin_s)
    if not usable.any():
        return None
    first = int(np.argmax(usable))
    origin = float(recording.time_s[first])
    window = (recording.time_s >= origin) & (recording.time_s <= origin + seconds)
    if window.sum() < 2:
        return None
    pose = recording.states[first]
    position = np.where(np.isfinite(pose), pose, recording.start_position)
    return replace(
        recording,
        time_s=recording.time_s[window] - origin,
        measured=recording.measured[window],
        unhidden=None if recording.unhidden is None else recording.unhidden[window],
        onset_s=recording.onset_s - origin,
        start_position=position,
        start_velocity=_slopes(recording, origin),
        start_sigma=None,
        reaction=None if recording.reaction is None else recording.reaction.shifted(origin),
    )


def _slopes(recording: Aligned, origin_s: float) -> np.ndarray:
    """(j,) rad/s: the measured slope about a time, 0 where too few samples say."""
    near = np.abs(recording.time_s - origin_s) <= START_SLOPE_S
    out = np.zeros(len(recording.joints))
    for joint, column in enumerate(recording.states[near].T):
        known = np.isfinite(column)
        if known.sum() >= 3:
            out[joint] = np.polyfit(recording.time_s[near][known], column[known], 1)[0]
    return out

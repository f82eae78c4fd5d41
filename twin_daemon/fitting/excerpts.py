"""Stretches of a long recording that stand for all of it in a search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.simulation.alignment import Aligned

_MOST_S = 40.0
_STRETCH_S = 8.0
_SLOPE_S = 0.06  # to either side of a start, from which its velocity is read


def excerpts(recordings: Sequence[Aligned]) -> list[Aligned]:
    """The recordings, each one that is longer than 40 s as five stretches of 8 s spread over it.

    A stretch starts from the state measured there, so that a search costs what the stretches last; errors are
    reported on whole recordings all the same.
    """
    out: list[Aligned] = []
    for recording in recordings:
        if recording.time_s[-1] <= _MOST_S:
            out.append(recording)
            continue
        count = int(_MOST_S // _STRETCH_S)
        begins = np.linspace(0.0, recording.time_s[-1] - _STRETCH_S, count)
        cut = (_stretch(recording, begin) for begin in begins)
        out.extend(part for part in cut if part is not None)
    return out


def _stretch(recording: Aligned, begin_s: float) -> Aligned | None:
    """The stretch from the first sample after `begin_s` that knows every moving joint; None where none does."""
    usable = np.isfinite(recording.states[:, recording.moving]).all(axis=1) & (recording.time_s >= begin_s)
    if not usable.any():
        return None
    first = int(np.argmax(usable))
    origin = float(recording.time_s[first])
    window = (recording.time_s >= origin) & (recording.time_s <= origin + _STRETCH_S)
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
    )


def _slopes(recording: Aligned, origin_s: float) -> np.ndarray:
    """(j,) rad/s: the measured slope about a time, 0 where too few samples say."""
    near = np.abs(recording.time_s - origin_s) <= _SLOPE_S
    out = np.zeros(len(recording.joints))
    for joint, column in enumerate(recording.states[near].T):
        known = np.isfinite(column)
        if known.sum() >= 3:
            out[joint] = np.polyfit(recording.time_s[near][known], column[known], 1)[0]
    return out

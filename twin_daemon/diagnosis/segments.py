"""A recording cut where the hand stands still, each piece with a roll-out of its own.

A free roll-out forgets nothing: the split of a coupled pair is a nearly neutral mode that creeps with friction, and
a small cause at the start is a large error at the end. Short pieces that start from the measured pose keep the
comparison about causes (multiple shooting, Bock and Plitt 1984).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.simulation.alignment import Aligned

_LEAST_S = 2.5
_QUIET_RAD_S = 0.03
_QUIET_S = 0.12
_UNSCORED_S = 0.1  # what effects with a memory need to find their state after a start


def segments(aligned: Aligned, joints: Sequence[str]) -> list[Aligned]:
    """The recording in pieces of 2.5 s or more that start where all the given joints stand still."""
    columns = [aligned.joints.index(joint) for joint in joints]
    time_s, position = aligned.time_s, aligned.measured[:, columns]
    period = float(np.median(np.diff(time_s)))
    width = max(2, round(_QUIET_S / period))
    cuts = [0]
    for index in range(width, len(time_s) - width):
        if time_s[index] - time_s[cuts[-1]] < _LEAST_S:
            continue
        if time_s[-1] - time_s[index] < _LEAST_S:
            break
        around = position[index - width : index + 1]
        if np.isfinite(around).all() and np.ptp(around, axis=0).max() < _QUIET_RAD_S * _QUIET_S + 3e-3:
            cuts.append(index)
    return [_piece(aligned, start, stop) for start, stop in zip(cuts, [*cuts[1:], len(time_s)], strict=True)]


def _piece(aligned: Aligned, start: int, stop: int) -> Aligned:
    begin = float(aligned.time_s[start])
    time_s = aligned.time_s[start:stop] - begin
    if start == 0:
        return replace(aligned, time_s=time_s, measured=aligned.measured[:stop])
    measured = aligned.measured[start:stop].copy()
    around = aligned.measured[max(0, start - 4) : start + 1]
    known = np.isfinite(around).any(axis=0)
    pose = np.full(measured.shape[1], np.nan)
    pose[known] = np.nanmean(around[:, known], axis=0)
    measured[time_s < _UNSCORED_S] = np.nan
    return replace(
        aligned,
        time_s=time_s,
        measured=measured,
        onset_s=aligned.onset_s - begin,
        start_position=pose,
        start_velocity=np.zeros(len(pose)),
    )

"""Held-out motion from a recording that has to serve for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.simulation.alignment import Aligned

_SHARE = 1.0 / 3.0
_LEAST_S = 1.0


def hold_out(recordings: Sequence[Aligned]) -> tuple[list[Aligned], list[Aligned]]:
    """The first two thirds of each recording for fitting, the last third held out.

    The held-out part is a block in time with a roll-out of its own that starts from its own measured state:
    a random choice of samples would hold nothing out, because neighbours know each other. Raises BadInput where
    a recording is too short to be cut.
    """
    train, held = [], []
    for recording in recordings:
        end = float(recording.time_s[-1])
        if end * _SHARE < _LEAST_S:
            raise BadInput(
                f"{end:.1f} s is too short to hold a part of it out",
                where=recording.recording.path,
                allowed=f"at least {_LEAST_S / _SHARE:.0f} s",
                todo="Give another recording with --holdout",
            )
        cut = end * (1.0 - _SHARE)
        train.append(window(recording, 0.0, cut))
        held.append(window(recording, cut, end))
    return train, held


def window(aligned: Aligned, start_s: float, end_s: float) -> Aligned:
    """A stretch of a recording on a clock of its own, with the commands shifted along."""
    chosen = (aligned.time_s >= start_s) & (aligned.time_s <= end_s)
    begin = float(aligned.time_s[np.flatnonzero(chosen)[0]])
    return replace(
        aligned,
        time_s=aligned.time_s[chosen] - begin,
        measured=aligned.measured[chosen],
        onset_s=aligned.onset_s - begin,
    )

"""Held-out motion from a recording that has to serve for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.simulation.alignment import Aligned

_HELD_SHARE = 1.0 / 3.0
_LEAST_S = 3.0
_PERIOD_S = 4.0


def hold_out(recordings: Sequence[Aligned]) -> tuple[list[Aligned], list[Aligned]]:
    """Each recording twice: with every third stretch of time hidden, and with only these stretches.

    Blocks in time, because neighbouring samples know each other: a random choice would hold nothing out. Both
    parts share the roll-out's start, so nothing measured inside a held-out block reaches its prediction; where
    roll-outs start anew on the way, hidden samples give the pose that they start from, and are not compared.
    Raises BadInput where a recording is too short to be cut.
    """
    train, held = [], []
    for recording in recordings:
        end = float(recording.time_s[-1])
        if end < _LEAST_S:
            raise BadInput(
                f"{end:.1f} s is too short to hold a part of it out",
                where=recording.recording.path,
                allowed=f"at least {_LEAST_S:.0f} s",
                todo="Give another recording with --holdout",
            )
        periods = int(np.clip(round(end / _PERIOD_S), 2, 12))
        phase = (recording.time_s / end * periods) % 1.0
        hidden = phase >= 1.0 - _HELD_SHARE
        train.append(masked(recording, hidden))
        held.append(masked(recording, ~hidden))
    return train, held


def masked(aligned: Aligned, hidden: np.ndarray) -> Aligned:
    """The recording with the samples of a mask (n,) treated as not measured."""
    measured = aligned.measured.copy()
    measured[hidden] = np.nan
    return replace(aligned, measured=measured, unhidden=aligned.states)

"""The measured recordings beside the checkout, aligned to the nominal twin."""

from __future__ import annotations

from pathlib import Path

from bench.frame import LeftOut
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.twin import TwinModel

_DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "shadow_hand_real"
_FILES = {"hand_closing": "hand_closing.csv", "thumb_calibration": "thumb_calibration.bag"}


def real(motion: str) -> tuple[TwinModel, Aligned]:
    """(the nominal twin, a recording of the real hand): 'hand_closing' or 'thumb_calibration'."""
    if not _DATA.is_dir():
        raise LeftOut("the measured recordings (../shared/data) are not on this machine")
    hand = load_hand()
    twin = TwinModel.load(hand)
    trajectory = load_trajectory(f"{_DATA / 'trajectories.yaml'}:{motion}", hand)
    return twin, align(twin, load_recording(_DATA / _FILES[motion]), trajectory)

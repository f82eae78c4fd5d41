"""The measured recordings beside the checkout, aligned to the nominal twin."""

from __future__ import annotations

from pathlib import Path

from bench.frame import LeftOut
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.alignment import Aligned, align, model_onset
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.workflows.session import open_session

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


def calibrated_closing() -> tuple[TwinModel, Aligned]:
    """(the twin of the version `real_closing`, the closing aligned to it)."""
    if not _DATA.is_dir():
        raise LeftOut("the measured recordings (../shared/data) are not on this machine")
    session = open_session(None, None, version="real_closing")
    trajectory = f"{_DATA / 'trajectories.yaml'}:hand_closing"
    (recording,) = session.recordings([_DATA / _FILES["hand_closing"]], trajectory)
    return session.twin, recording.with_onset(model_onset(session.twin, recording))

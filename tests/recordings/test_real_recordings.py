"""The measured recordings: what is known about them comes out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin_daemon.recordings import load_joint_map, load_recording


def test_hand_closing(shared_data: Path) -> None:
    recording = load_recording(shared_data / "shadow_hand_real" / "hand_closing.csv")
    assert len(recording.joints) == 24
    assert recording.quality.samples == 801
    assert recording.quality.rate_hz == pytest.approx(125, abs=1)
    assert recording.duration_s == pytest.approx(6.4, abs=0.01)
    assert recording.quality.dropped == {}
    assert recording.stamp_ns[0] == 1678993486702788012
    assert np.isfinite(recording.position).all()
    assert recording.velocity is not None
    assert recording.commands is None


def test_thumb_calibration(shared_data: Path) -> None:
    recording = load_recording(shared_data / "shadow_hand_real" / "thumb_calibration.bag")
    assert len(recording.joints) == 24
    assert recording.quality.samples == 2580
    assert recording.quality.rate_hz == pytest.approx(125, abs=1)
    assert recording.duration_s == pytest.approx(20.6, abs=0.1)
    assert recording.stamp_ns[0] == 1686653488311353034  # the header's, 2 ms before it was received
    thumb = recording.select(["rh_THJ5"])
    assert np.ptp(thumb.position) > 0.1


def test_multisine_has_its_commands(shared_data: Path) -> None:
    folder = shared_data / "so101_real"
    recording = load_recording(folder / "multisine", load_joint_map(folder / "joint_map.yaml"))
    assert recording.joints == ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
    assert recording.commands is not None
    assert recording.commands.names == recording.joints
    assert recording.quality.rate_hz == pytest.approx(50, abs=0.5)
    assert recording.duration_s == pytest.approx(120, abs=1)
    assert recording.quality.dropped == {}
    for joint in range(6):
        sent = np.interp(recording.stamp_ns, recording.commands.stamp_ns, recording.commands.position[:, joint])
        assert np.corrcoef(sent, recording.position[:, joint])[0, 1] > 0.5

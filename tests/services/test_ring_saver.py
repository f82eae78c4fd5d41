"""Saving the ring: into the folder, within the quota, and nothing of the user's is ever removed."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.settings import DaemonSettings
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.services.ring import Ring
from twin_daemon.services.ring_saver import RingSaver

NAMES = ("rh_FFJ1", "rh_FFJ2")
BEGIN_NS = 1_700_000_000_000_000_000
PERIOD_NS = 8_000_000
COUNT = 250


def ring() -> Ring:
    """Two seconds of all four streams."""
    held, now_s = Ring(60.0, 2**24), time.monotonic() - 2.0
    for number in range(COUNT):
        stamp_ns, arrival_s = BEGIN_NS + number * PERIOD_NS, now_s + number * PERIOD_NS * 1e-9
        sample = JointSample(stamp_ns, NAMES, np.array([0.001 * number, 0.1]))
        for stream in ("joint_commands", "joint_states", "twin_joint_states"):
            held.add(stream, stamp_ns, cdr.encode(sample), arrival_s)
        residual = {"stamp_ns": stamp_ns, "residual_rad": {"rh_FFJ1": 0.01, "rh_FFJ2": None}}
        held.add("residual", stamp_ns, json.dumps(residual).encode(), arrival_s)
    return held


def saver(folder: Path, **settings: object) -> RingSaver:
    return RingSaver(ring(), load_hand().description, folder, DaemonSettings.model_validate(settings))


def test_what_is_kept_loads_as_a_recording(tmp_path: Path) -> None:
    answer = saver(tmp_path / "recordings").save()
    assert answer["kept"], answer
    assert (answer["messages"], answer["limited_by"]) == (4 * COUNT, "keep_minutes")
    assert answer["seconds"] == pytest.approx((COUNT - 1) * PERIOD_NS * 1e-9)
    path = Path(answer["path"])
    assert path.stat().st_size == answer["bytes"]
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    recording = load_recording(path)
    np.testing.assert_array_equal(recording.stamp_ns, BEGIN_NS + PERIOD_NS * np.arange(COUNT))
    np.testing.assert_array_equal(recording.position[:, 0], 0.001 * np.arange(COUNT))
    assert recording.commands is not None


@pytest.mark.parametrize(("ago_s", "kept_s"), [(50.0, 51.0), (5.0, 31.0), (500.0, 99.5)])
def test_what_the_hand_did_since_a_moment_is_kept_but_half_a_minute_at_least(
    tmp_path: Path, ago_s: float, kept_s: float
) -> None:
    held, count = Ring(600.0, 2**24), 200
    for number in range(count):
        stamp_ns = BEGIN_NS + number * 500_000_000
        payload = cdr.encode(JointSample(stamp_ns, NAMES, np.array([0.001 * number, 0.1])))
        for stream in ("joint_commands", "joint_states"):
            held.add(stream, stamp_ns, payload, 100.0 + 0.5 * number)
    one = RingSaver(held, load_hand().description, tmp_path, DaemonSettings())
    newest_ns = BEGIN_NS + (count - 1) * 500_000_000
    answer = one.save(newest_ns - round(ago_s * 1e9))
    assert answer["seconds"] == pytest.approx(kept_s)
    assert load_recording(Path(answer["path"])).stamp_ns[-1] == newest_ns


def test_two_keeps_are_two_files(tmp_path: Path) -> None:
    one = saver(tmp_path)
    assert one.save()["path"] != one.save()["path"]


def test_nothing_is_kept_of_nothing(tmp_path: Path) -> None:
    description = load_hand().description
    for seconds, why in ((60.0, "nothing has arrived"), (0.0, "keep_minutes is 0")):
        answer = RingSaver(Ring(seconds, 2**20), description, tmp_path / "r", DaemonSettings()).save()
        assert (answer["kept"], answer["messages"], answer["path"]) == (False, 0, None)
        assert why in answer["why"]
    assert not (tmp_path / "r").exists()


def test_beyond_the_quota_nothing_is_written_and_nothing_removed(tmp_path: Path) -> None:
    (tmp_path / "kept-20200101T000000.000000Z.mcap").write_bytes(bytes(900_000))
    (tmp_path / "mine.mcap").write_bytes(bytes(200_000))
    before = sorted(tmp_path.iterdir())
    answer = saver(tmp_path, recordings_quota_mib=1).save()
    assert not answer["kept"]
    assert "recordings_quota_mib" in answer["why"]
    assert str(tmp_path) in answer["why"]
    assert sorted(tmp_path.iterdir()) == before


def test_rotation_removes_the_oldest_kept_ones_only_as_far_as_needed(tmp_path: Path) -> None:
    for year in (2020, 2021, 2022):
        (tmp_path / f"kept-{year}0101T000000.000000Z.mcap").write_bytes(bytes(300_000))
    (tmp_path / "mine.mcap").write_bytes(bytes(100_000))
    answer = saver(tmp_path, recordings_quota_mib=1, recordings_rotate=True).save()
    assert answer["kept"], answer
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {
        "kept-20210101T000000.000000Z.mcap",
        "kept-20220101T000000.000000Z.mcap",
        "mine.mcap",
        Path(answer["path"]).name,
    }
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 2**20


def test_rotation_that_would_not_be_enough_removes_nothing(tmp_path: Path) -> None:
    (tmp_path / "kept-20200101T000000.000000Z.mcap").write_bytes(bytes(100_000))
    (tmp_path / "mine.mcap").write_bytes(bytes(1_000_000))
    answer = saver(tmp_path, recordings_quota_mib=1, recordings_rotate=True).save()
    assert not answer["kept"]
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_that_cannot_be_written_is_an_answer(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    answer = saver(tmp_path / "file").save()
    assert not answer["kept"]
    assert os.strerror(17) in answer["why"] or os.strerror(20) in answer["why"]

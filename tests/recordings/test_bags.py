"""Bags of every form give the same samples, by header stamp and joint name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.recordings import load_recording

from .bag_files import FORMS, Custom, JointState, write_bag

START = 1_678_993_486_702_788_012
STEP = 8_000_000
NAMES = ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3")


def samples(count: int = 20, **fields) -> list[JointState]:
    return [
        JointState(START + i * STEP, NAMES, (0.1 * i, 0.2, -0.3), (1.0, 2.0, 3.0 * i), (i, 0.0, 0.5), **fields)
        for i in range(count)
    ]


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_stamps_and_values_exactly(form: str, tmp_path: Path) -> None:
    written = samples()
    delayed = [
        JointState(m.stamp_ns, m.names, m.position, m.velocity, m.effort, received_ns=m.stamp_ns + 777 * i)
        for i, m in enumerate(written)
    ]
    mixed = [x for i, m in enumerate(delayed) for x in (m, Custom(m.stamp_ns + 778 * i))]
    recording = load_recording(write_bag(form, tmp_path, mixed))
    assert recording.joints == NAMES
    np.testing.assert_array_equal(recording.stamp_ns, [m.stamp_ns for m in written])
    np.testing.assert_array_equal(recording.position, [m.position for m in written])
    np.testing.assert_array_equal(recording.velocity, [m.velocity for m in written])
    np.testing.assert_array_equal(recording.effort, [m.effort for m in written])
    assert recording.commands is None
    assert recording.name == "motion"
    assert recording.quality.rate_hz == pytest.approx(125.0)
    assert recording.quality.dropped == {}
    assert recording.quality.messages == recording.quality.samples == 20


def test_what_is_read_cannot_be_changed(tmp_path: Path) -> None:
    recording = load_recording(write_bag("mcap", tmp_path, samples()))
    for array in (recording.stamp_ns, recording.position, recording.velocity, recording.effort):
        assert array is not None
        with pytest.raises(ValueError):
            array[0] = 0


def test_storage_files_without_metadata_are_a_bag(tmp_path: Path) -> None:
    first = write_bag("mcap_file", tmp_path / "a", samples(10), name="part_0")
    later = [JointState(START + i * STEP, NAMES, (i, i, i)) for i in range(10, 20)]
    second = write_bag("mcap_file", tmp_path / "b", later, name="part_1")
    folder = tmp_path / "split"
    folder.mkdir()
    for file in (first, second):
        file.rename(folder / file.name)
    recording = load_recording(folder)
    assert recording.quality.samples == 20
    assert recording.velocity is not None
    assert np.isnan(recording.velocity[10:]).all()
    assert np.isfinite(recording.velocity[:10]).all()


def test_fingers_in_alternating_messages_are_matched_by_name(tmp_path: Path) -> None:
    fingers = (("FFJ1", "FFJ2"), ("MFJ2", "MFJ1"))
    messages = [JointState(START + i * STEP, fingers[i % 2], (i, -i)) for i in range(1, 21)]
    recording = load_recording(write_bag("bag", tmp_path, messages))
    assert set(recording.joints) == {"FFJ1", "FFJ2", "MFJ1", "MFJ2"}
    assert recording.quality.samples == 20
    column = recording.position[:, recording.joints.index("MFJ1")]
    np.testing.assert_array_equal(column[0::2], [-i for i in range(1, 21, 2)])
    assert np.isnan(column[1::2]).all()
    finger = recording.select(["MFJ1", "MFJ2"])
    assert finger.quality.samples == 10
    assert finger.quality.rate_hz == pytest.approx(125.0 / 2)
    np.testing.assert_array_equal(finger.position[:, 0], -finger.position[:, 1])


def test_fingers_with_one_stamp_become_one_sample(tmp_path: Path) -> None:
    messages = []
    for i in range(1, 11):
        messages += [JointState(START + i, ("a", "b"), (i, 2 * i)), JointState(START + i, ("c",), (3 * i,))]
    recording = load_recording(write_bag("mcap", tmp_path, messages))
    assert recording.joints == ("a", "b", "c")
    np.testing.assert_array_equal(recording.position, [(i, 2 * i, 3 * i) for i in range(1, 11)])
    assert recording.quality.merged == 10
    assert recording.quality.dropped == {}


def test_publishers_with_other_joints_need_not_agree_on_the_order(tmp_path: Path) -> None:
    messages = []
    for i in range(1, 11):  # the arm's stamps always lag behind those of the hand that came before
        messages += [
            JointState(START + i * STEP, ("hand",), (i,), received_ns=START + 2 * i),
            JointState(START + i * STEP - STEP // 2, ("arm",), (-i,), received_ns=START + 2 * i + 1),
        ]
    recording = load_recording(write_bag("mcap", tmp_path, messages))
    assert recording.quality.samples == 20
    assert recording.quality.dropped == {}
    assert (np.diff(recording.stamp_ns) > 0).all()


def test_reordered_names_land_in_their_columns(tmp_path: Path) -> None:
    messages = [
        JointState(START + i, ("a", "b") if i % 2 else ("b", "a"), (1.0, 2.0) if i % 2 else (2.0, 1.0))
        for i in range(10)
    ]
    recording = load_recording(write_bag("sqlite", tmp_path, messages))
    order = [recording.joints.index("a"), recording.joints.index("b")]
    np.testing.assert_array_equal(recording.position[:, order], np.tile([1.0, 2.0], (10, 1)))


@pytest.mark.parametrize("form", ["bag", "mcap"])
def test_everything_unusable_is_counted(form: str, tmp_path: Path) -> None:
    good = samples(20)
    at = good[9].stamp_ns
    bad = [
        JointState(at, NAMES, (9, 9, 9)),  # duplicate
        JointState(at - STEP, NAMES, (9, 9, 9)),  # backward
        JointState(at + 1, NAMES, (9, 9)),  # wrong length
        JointState(at + 2, (), ()),
        JointState(at + 3, ("x", "x"), (1, 1)),
        JointState(at + 4, NAMES, (np.nan, np.inf, np.nan)),
        JointState(0, NAMES, (1, 1, 1), received_ns=at + 5),
        JointState(at + 6, NAMES, (1, np.nan, 1), (1, 2), (1, 2, 3, 4)),  # kept, but for what is wrong
    ]
    messages = [*good[:10], *bad, *good[10:]]
    received = [
        JointState(m.stamp_ns, m.names, m.position, m.velocity, m.effort, received_ns=START + i)
        for i, m in enumerate(messages)
    ]
    quality = (recording := load_recording(write_bag(form, tmp_path, received))).quality
    assert quality.dropped == {
        "duplicate": 1,
        "backward": 1,
        "wrong_length": 1,
        "empty": 1,
        "repeated_names": 1,
        "all_nan": 1,
        "no_stamp": 1,
        "nan": 4,
        "velocity_wrong_length": 1,
        "effort_wrong_length": 1,
    }
    assert quality.samples == 21
    assert quality.messages == quality.samples + quality.merged + quality.dropped_messages
    odd = recording.stamp_ns.tolist().index(at + 6)
    np.testing.assert_array_equal(recording.position[odd], (1, np.nan, 1))
    assert any("left out" in note for note in quality.notes)


def test_one_stamp_from_the_future_costs_one_sample(tmp_path: Path) -> None:
    messages = samples(20)
    stamps = [m.stamp_ns for m in messages]
    stamps[5] += 3600 * 10**9
    messages = [JointState(s, NAMES, (1, 2, 3), received_ns=START + i) for i, s in enumerate(stamps)]
    recording = load_recording(write_bag("mcap", tmp_path, messages))
    assert recording.quality.dropped == {"ahead": 1}
    assert recording.quality.gaps == 0


def test_receive_times_stand_in_where_no_stamp_is_set(tmp_path: Path) -> None:
    messages = [JointState(0, NAMES, (1, 2, 3), received_ns=START + i * STEP) for i in range(10)]
    recording = load_recording(write_bag("mcap", tmp_path, messages))
    np.testing.assert_array_equal(recording.stamp_ns, [START + i * STEP for i in range(10)])
    assert any("header stamps" in note for note in recording.quality.notes)


def test_a_gap_is_reported_and_not_taken_for_jitter(tmp_path: Path) -> None:
    messages = [m for i, m in enumerate(samples(100)) if not 40 <= i < 50]
    quality = load_recording(write_bag("mcap", tmp_path, messages)).quality
    assert quality.gaps == 1
    assert quality.longest_gap_s == pytest.approx(11 * STEP * 1e-9)
    assert quality.jitter_s == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("topic", ["joint_states", "/joint_states", "/rh/joint_states"])
def test_the_topic_may_be_in_a_namespace(topic: str, tmp_path: Path) -> None:
    other = [JointState(m.stamp_ns, ("other",), (1.0,), topic="/gripper") for m in samples()]
    recording = load_recording(write_bag("mcap", tmp_path, [*other, *samples(topic=topic)]))
    assert recording.joints == NAMES
    assert recording.quality.measured_topic == topic


def test_a_prediction_beside_the_measurement_is_not_taken_for_it(tmp_path: Path) -> None:
    prediction = [JointState(m.stamp_ns, NAMES, (9, 9, 9), topic="/twin/joint_states") for m in samples()]
    recording = load_recording(write_bag("mcap", tmp_path, [*prediction, *samples(topic="/a/b/c/joint_states")]))
    assert recording.quality.measured_topic == "/a/b/c/joint_states"
    assert any("/twin/joint_states" in note for note in recording.quality.notes)


def test_without_joint_states_the_error_names_what_is_there(tmp_path: Path) -> None:
    path = write_bag("mcap", tmp_path, [*samples(topic="/elsewhere"), Custom(START)])
    with pytest.raises(BadInput, match="/elsewhere"):
        load_recording(path)


def test_the_digest_follows_the_bytes(tmp_path: Path) -> None:
    one = load_recording(write_bag("bag", tmp_path, samples(), name="one"))
    same = load_recording(write_bag("bag", tmp_path, samples(), name="same"))
    other = load_recording(write_bag("bag", tmp_path, samples(19), name="other"))
    assert one.sha256 == same.sha256 != other.sha256


def test_a_window_keeps_the_commands_that_led_into_it(tmp_path: Path) -> None:
    commands = [JointState(START, ("rh_FFJ3",), (0.5,), topic="/joint_commands")]
    recording = load_recording(write_bag("mcap", tmp_path, [*commands, *samples()]))
    first, second = recording.window(0.0, 0.08), recording.window(0.08)
    assert first.quality.samples + second.quality.samples == 20
    assert second.stamp_ns[0] == START + 10 * STEP
    assert second.commands is not None
    assert second.commands.position.tolist() == [[0.5]]
    with pytest.raises(BadInput, match="no samples"):
        recording.window(5.0, 6.0)
    with pytest.raises(BadInput, match="rh_FFJ9"):
        recording.select(["rh_FFJ9"])

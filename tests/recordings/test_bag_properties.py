"""Laws that hold for every stream of messages, however partial, shuffled, repeated or broken it is."""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin_daemon.errors import BadInput
from twin_daemon.recordings import load_recording
from twin_daemon.recordings.assemble import assemble
from twin_daemon.recordings.batch import Batch
from twin_daemon.recordings.joint_state_wire import JointStateReader
from twin_daemon.recordings.quality import VALUE_KINDS

from .bag_files import ROS1, ROS2, JointState, joint_state_bytes, write_bag

START = 1_700_000_000_000_000_000
JOINTS = ("rh_FFJ1", "rh_FFJ2", "rh_THJ5", "Elbow")
values = st.one_of(st.floats(-2, 2), st.sampled_from([np.nan, np.inf, -np.inf, 1e300, 0.0]))


@st.composite
def messages(draw: st.DrawFn) -> list[JointState]:
    out, stamp = [], START
    for index in range(draw(st.integers(1, 12))):
        names = draw(st.lists(st.sampled_from(JOINTS), min_size=0, max_size=4, unique=draw(st.booleans())))
        stamp += draw(st.sampled_from([1_000_000, 1_000_000, 999, 0, -1, -5_000_000]))
        position = draw(
            st.lists(values, min_size=len(names), max_size=len(names) + draw(st.sampled_from([0, 0, 0, 1])))
        )
        velocity = draw(st.lists(values, min_size=0, max_size=len(names) + 1))
        out.append(
            JointState(
                draw(st.sampled_from([stamp, stamp, stamp, stamp, 0])),
                names,
                position,
                velocity,
                [0.5] * draw(st.sampled_from([0, len(names)])),
                received_ns=START + index,
            )
        )
    return out


def _finite(stream: list[JointState]) -> dict[tuple[int, str], set[float]]:
    """Every finite value that was sent for a joint, by stamp."""
    sent: dict[tuple[int, str], set[float]] = {}
    for index, m in enumerate(stream):
        for name, value in zip(m.names, m.position, strict=False):
            for stamp in {m.stamp_ns, START + index}:
                sent.setdefault((stamp, name), set()).add(value)
    return sent


@settings(max_examples=60, deadline=None)
@given(stream=messages(), form=st.sampled_from(["bag", "mcap", "sqlite"]))
def test_what_comes_out_increases_is_finite_and_every_message_is_accounted_for(
    stream: list[JointState], form: str
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        try:
            recording = load_recording(write_bag(form, Path(folder), stream))
        except BadInput as error:
            line = str(error)
        else:
            line = None
    if line is not None:  # not every stream holds something usable
        assert "can be used" in line
        return
    quality = recording.quality
    assert (np.diff(recording.stamp_ns) > 0).all()
    assert not np.isinf(recording.position).any()
    assert np.isfinite(recording.position).any(axis=1).all()
    assert set(recording.joints) <= set(JOINTS)
    assert quality.messages == len(stream) == quality.samples + quality.merged + quality.dropped_messages
    sent = _finite(stream)
    for row, column in zip(*np.nonzero(np.isfinite(recording.position)), strict=True):
        key = (int(recording.stamp_ns[row]), recording.joints[column])
        assert float(recording.position[row, column]) in sent[key]


frames = st.sampled_from(["", "x", "base_link"])


@settings(max_examples=150, deadline=None)
@given(
    stream=st.lists(st.tuples(messages(), frames, st.booleans()), min_size=1, max_size=3),
    ros1=st.booleans(),
    cuts=st.lists(st.tuples(st.integers(0, 30), st.integers(0, 400), st.integers(0, 255)), max_size=3),
    together=st.sampled_from([1, 2, 7, 100]),
)
def test_reading_by_layout_equals_reading_each_message_in_general(
    stream: list[tuple[list[JointState], str, bool]], ros1: bool, cuts: list[tuple[int, int, int]], together: int
) -> None:
    raw = [
        joint_state_bytes(message, ros1=ros1, frame=frame, little_endian=little)
        for part, frame, little in stream
        for message in part * 2
    ]
    for which, at, byte in cuts:  # damage: a byte overwritten, or the end cut off
        index = which % len(raw)
        if at < len(raw[index]):
            head, rest = raw[index][:at], raw[index][at + 1 :]
            raw[index] = head + bytes([byte]) + rest if byte % 2 else head
    fast, fast_counts = _read(raw, ros1, True, together)
    general, general_counts = _read(raw, ros1, False)
    assert fast_counts == general_counts
    if fast is None or general is None:
        assert fast is general
        return
    assert (fast.joints, fast.merged, fast.by_receive_time) == (general.joints, general.merged, general.by_receive_time)
    for key in ("stamp_ns", "position", "velocity", "effort"):
        one, other = getattr(fast, key), getattr(general, key)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other)


def _batch(raw: list[bytes], first: int) -> Batch:
    end = np.cumsum([len(message) for message in raw])
    begin = end - [len(message) for message in raw]
    return Batch(b"".join(raw), np.zeros(len(raw), int), begin, end, START + first + np.arange(len(raw)))


def _read(raw: list[bytes], ros1: bool, fast: bool, together: int = 1):
    counts: Counter[str] = Counter()
    reader = JointStateReader(ROS1 if ros1 else ROS2, ros1=ros1, dropped=counts, fast=fast)
    for index in range(0, len(raw), together):
        if together == 1:
            reader.feed(raw[index], START + index)
        else:
            reader.feed_batch(_batch(raw[index : index + together], index))
    try:
        stream = assemble(reader.finish(), counts)
    except BadInput:
        stream = None
    assert reader.messages == len(raw)
    assert all(counts[kind] <= len(raw) for kind in counts if kind not in VALUE_KINDS)
    return stream, +counts


@pytest.mark.parametrize("ros1", [True, False])
def test_repeating_messages_are_read_in_bulk(ros1: bool) -> None:
    counts: Counter[str] = Counter()
    reader = JointStateReader(ROS1 if ros1 else ROS2, ros1=ros1, dropped=counts)
    general = reader._general
    seen = []
    reader._general = lambda *message: (seen.append(message), general(*message))[1]  # type: ignore[method-assign]
    for index in range(3000):
        reader.feed(joint_state_bytes(JointState(START + index, JOINTS, (index, 1, 2, 3)), ros1=ros1), START)
    stream = assemble(reader.finish(), counts)
    assert stream is not None
    np.testing.assert_array_equal(stream.position[:, 0], np.arange(3000))
    assert len(seen) == 1


@pytest.mark.parametrize("expected", [0, 7, 3000, 10**6, 2**62, -1])
def test_what_a_file_announces_of_its_messages_changes_nothing(expected: int) -> None:
    """Room is made for it where there is any; a number may be too small, too large for any machine, or none."""
    counts: Counter[str] = Counter()
    reader = JointStateReader(ROS2, ros1=False, dropped=counts, expected=expected)
    for index in range(3000):
        reader.feed(joint_state_bytes(JointState(START + index, JOINTS, (index, 1, 2, 3)), ros1=False), START)
    stream = assemble(reader.finish(), counts)
    assert stream is not None
    np.testing.assert_array_equal(stream.position, [(index, 1, 2, 3) for index in range(3000)])

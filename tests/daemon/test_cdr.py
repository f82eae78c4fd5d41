"""Joint states as bytes: what ROS 2 reads, and nothing a stranger sends can break the reader."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample, MalformedPayload

SAMPLE = JointSample(
    1_700_000_000_123_456_789,
    ("rh_FFJ1", "rh_FFJ2"),
    np.array([0.1, -0.2]),
    np.array([1.0, 2.0]),
    np.array([np.nan, 3.0]),
)


def test_a_sample_survives_the_way_there_and_back() -> None:
    back = cdr.decode(cdr.encode(SAMPLE))
    assert (back.stamp_ns, back.names) == (SAMPLE.stamp_ns, SAMPLE.names)
    for name in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(back, name), getattr(SAMPLE, name))


def test_the_bytes_are_little_endian_cdr_with_the_stamp_first() -> None:
    payload = cdr.encode(SAMPLE)
    assert payload[:4] == b"\x00\x01\x00\x00"
    assert int.from_bytes(payload[4:8], "little") == 1_700_000_000
    assert int.from_bytes(payload[8:12], "little") == 123_456_789


def outcome(payload: bytes) -> str:
    """`read`, or the kind that the payload is counted under."""
    try:
        cdr.decode(payload)
    except MalformedPayload as error:
        return error.kind
    return "read"


@given(st.binary(max_size=400))
def test_arbitrary_bytes_are_a_sample_or_malformed(payload: bytes) -> None:
    assert outcome(payload) in ("read", "malformed")


@given(st.integers(0, 200), st.integers(0, 255))
def test_a_flipped_byte_never_raises_anything_else(position: int, value: int) -> None:
    payload = bytearray(cdr.encode(SAMPLE))
    payload[position % len(payload)] = value
    assert outcome(bytes(payload)) in ("read", "malformed")


def test_a_huge_payload_is_not_even_read() -> None:
    with pytest.raises(MalformedPayload) as caught:
        cdr.decode(b"\x00" * (cdr.MAX_BYTES + 1))
    assert caught.value.kind == "too_large"


STORE = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE: Any = STORE.types[cdr.JOINT_STATE]
HEADER: Any = STORE.types["std_msgs/msg/Header"]
TIME: Any = STORE.types["builtin_interfaces/msg/Time"]


def by_rosbags(sample: JointSample, frame_id: str, *, little_endian: bool = True) -> bytes:
    header = HEADER(stamp=TIME(*divmod(sample.stamp_ns, 1_000_000_000)), frame_id=frame_id)
    message = JOINT_STATE(header, list(sample.names), sample.position, sample.velocity, sample.effort)
    return bytes(STORE.serialize_cdr(message, cdr.JOINT_STATE, little_endian=little_endian))


def read_by_rosbags(payload: bytes) -> tuple[object, ...] | None:
    """All that a sample holds, to the bit; None where rosbags refuses the bytes."""
    try:
        message: Any = STORE.deserialize_cdr(payload, cdr.JOINT_STATE)
    except Exception:
        return None
    arrays = (message.position, message.velocity, message.effort)
    stamp = message.header.stamp
    return (
        stamp.sec * 1_000_000_000 + stamp.nanosec,
        tuple(message.name),
        *(values.astype("<f8").tobytes() for values in arrays),
    )


def read(payload: bytes) -> tuple[object, ...] | None:
    try:
        sample = cdr.decode(payload)
    except MalformedPayload as error:
        return None if error.kind == "malformed" else (error.kind,)
    arrays = (sample.position, sample.velocity, sample.effort)
    return sample.stamp_ns, sample.names, *(values.tobytes() for values in arrays)


numbers = st.lists(st.floats(), max_size=5).map(lambda values: np.array(values, dtype=float))
samples = st.builds(
    JointSample,
    st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1),
    st.lists(st.text(max_size=6), max_size=5).map(tuple),
    numbers,
    numbers,
    numbers,
)


@given(samples, st.text(max_size=9))
def test_the_bytes_are_those_of_rosbags(sample: JointSample, frame_id: str) -> None:
    expected = by_rosbags(sample, frame_id)
    for _ in range(2):  # the second time the names are known
        assert cdr.encode(sample, frame_id) == expected


def cut(payload: bytes, at: int, _: int) -> bytes:
    return payload[: at % len(payload)]


def extend(payload: bytes, at: int, value: int) -> bytes:
    return payload + bytes([value % 256]) * (at % 9)


def flip(payload: bytes, at: int, value: int) -> bytes:
    at %= len(payload)
    return payload[:at] + bytes([value % 256]) + payload[at + 1 :]


def recount(payload: bytes, at: int, value: int) -> bytes:
    """Another number where a count may be."""
    at = at % len(payload) // 4 * 4
    return payload[:at] + value.to_bytes(4, "little") + payload[at + 4 :]


@given(
    samples,
    st.text(max_size=9),
    st.booleans(),
    st.sampled_from([cut, extend, flip, recount]),
    st.integers(0, 2000),
    st.integers(0, 60) | st.integers(0, 2**32 - 1),
)
def test_whatever_rosbags_reads_or_refuses_is_read_or_refused_alike(
    sample: JointSample,
    frame_id: str,
    little_endian: bool,
    damage: Callable[[bytes, int, int], bytes],
    at: int,
    value: int,
) -> None:
    good = by_rosbags(sample, frame_id, little_endian=little_endian)
    damaged = damage(good, at, value)
    for payload in (good, good, damaged, good, damaged):  # before and after its names are known
        assert read(payload) == read_by_rosbags(payload)


@pytest.mark.parametrize("velocities", [0, 1, 2])
def test_every_wrong_count_is_judged_as_rosbags_does(velocities: int) -> None:
    good = by_rosbags(JointSample(0, ("a", "bc"), np.zeros(2), np.zeros(velocities), np.zeros(1)), "f")
    for at in range(8, len(good), 4):
        for count in range(7):
            cdr.decode(good)
            damaged = recount(good, at, count)
            assert read(damaged) == read_by_rosbags(damaged)


@pytest.mark.parametrize("counts", [(2, 0, 0), (2, 2, 2), (0, 2, 0), (2, 1, 2)])
@pytest.mark.parametrize("frame_id", ["", "palm"])
def test_the_names_of_a_stream_are_read_once(counts: tuple[int, int, int], frame_id: str) -> None:
    first, second = (
        cdr.decode(by_rosbags(JointSample(stamp, ("a", "b"), *(np.full(n, stamp) for n in counts)), frame_id))
        for stamp in (1, 2)
    )
    assert first.names is second.names


def test_a_stream_whose_numbers_change_is_read_by_its_names() -> None:
    first = by_rosbags(SAMPLE, "palm")
    moved = JointSample(5, SAMPLE.names, SAMPLE.position + 1.0, SAMPLE.velocity, SAMPLE.effort)
    renamed = JointSample(5, ("rh_FFJ1", "rh_FFJ3"), SAMPLE.position, SAMPLE.velocity, SAMPLE.effort)
    shifted = JointSample(5, SAMPLE.names, np.zeros(0), SAMPLE.velocity, np.ones(4))
    for payload in (first, by_rosbags(moved, "palm"), by_rosbags(renamed, "palm"), by_rosbags(shifted, "palm"), first):
        assert read(payload) == read_by_rosbags(payload)


def test_what_was_read_can_be_written_to_and_is_nobody_elses() -> None:
    payload = cdr.encode(SAMPLE)
    for _ in range(2):
        sample = cdr.decode(payload)
        np.testing.assert_array_equal(sample.position, SAMPLE.position)
        sample.position[:] = 7.0


def test_senders_that_invent_names_do_not_fill_the_memory() -> None:
    tracemalloc.start()
    try:
        for number in range(400):
            names = (f"{number}" * 2000, "a" * number)  # of a length of its own
            cdr.decode(cdr.encode(JointSample(0, names, np.zeros(2))))
        assert tracemalloc.get_traced_memory()[0] < 3e6
    finally:
        tracemalloc.stop()

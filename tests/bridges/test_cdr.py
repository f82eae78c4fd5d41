"""Joint states as bytes: what ROS 2 reads, and nothing a stranger sends can break the reader."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridges import cdr
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

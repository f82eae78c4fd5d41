"""The recorder's own decisions: what is written, what is refused, and what is said of a full disk."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample, MalformedPayload
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.services.recorder import Recorder
from twin_daemon.services.residual_message import residual_sample

BEGIN_NS = 1_700_000_000_000_000_000
NAMES = ("rh_FFJ1", "rh_FFJ2")


class Network:
    """A network of one process: what is put goes to whoever listens to that key at once."""

    def __init__(self) -> None:
        self.heard: dict[str, Callable[[bytes], None]] = {}

    def listen(self, key: str, take: Callable[[bytes], None]) -> Callable[[], None]:
        self.heard[key] = take

        def end() -> None:
            del self.heard[key]

        return end

    def put(self, key: str, payload: bytes) -> None:
        self.heard[key](payload)


def recorder(path: Path) -> tuple[Network, Recorder]:
    network = Network()
    return network, Recorder(network.listen, load_hand().description, path)


def joint_state(number: int) -> bytes:
    return cdr.encode(JointSample(BEGIN_NS + number * 8_000_000, NAMES, np.array([0.1, 0.2])))


def test_what_no_reader_could_use_is_counted_by_topic_and_not_written(tmp_path: Path) -> None:
    network, recording = recorder(tmp_path / "r.mcap")
    with recording:
        for number in range(50):
            network.put("shadow_hand/joint_states", joint_state(number))
        network.put("shadow_hand/joint_states", b"garbage")
        network.put("shadow_hand/joint_states", cdr.encode(JointSample(BEGIN_NS, NAMES, np.zeros(1))))
        network.put("shadow_hand/joint_commands", b"\0" * 400_000)
        network.put("twin/shadow_hand/joint_states", cdr.encode(JointSample(BEGIN_NS, (), np.zeros(0))))
        network.put("twin/shadow_hand/residual", b"{}")
        recording.work(0.0)
    assert network.heard == {}
    assert recording.done.joint_states == recording.done.messages.total() == 50
    assert recording.done.refused == {
        "joint_states": 2,
        "joint_commands": 1,
        "twin/joint_states": 1,
        "twin/residual": 1,
    }
    assert load_recording(tmp_path / "r.mcap").quality.messages == 50


def test_without_a_message_there_is_no_file(tmp_path: Path) -> None:
    network, recording = recorder(tmp_path / "r.mcap")
    with recording:
        network.put("shadow_hand/joint_states", b"garbage")
    assert recording.done.refused.total() == 1
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_says_where_the_rest_is(tmp_path: Path) -> None:
    network, recording = recorder(tmp_path / "r.mcap")

    def record() -> None:
        with recording:
            recording._file._file.close()
            recording._file._file = Path("/dev/full").open("wb")  # noqa: SIM115 - the recorder closes it
            network.put("shadow_hand/joint_states", joint_state(0))

    with pytest.raises(BadInput, match=r"No space left.*twin record --recover"):
        record()
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap.part"]


def test_an_error_beside_the_recorder_leaves_the_part(tmp_path: Path) -> None:
    network, recording = recorder(tmp_path / "r.mcap")

    def record() -> None:
        with recording:
            network.put("shadow_hand/joint_states", joint_state(0))
            recording.work(0.0)
            raise RuntimeError("of somebody else")

    with pytest.raises(RuntimeError, match="somebody"):
        record()
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap.part"]


def test_a_residual_that_is_not_known_is_nan() -> None:
    sample = residual_sample(json.dumps({"stamp_ns": 5, "residual_rad": {"a": 0.25, "b": None}}).encode())
    assert (sample.stamp_ns, sample.names) == (5, ("a", "b"))
    np.testing.assert_array_equal(sample.position, [0.25, np.nan])


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@given(
    st.binary(max_size=60)
    | json_values.map(lambda value: json.dumps(value).encode())
    | st.fixed_dictionaries({"stamp_ns": json_values, "residual_rad": json_values}).map(
        lambda value: json.dumps(value).encode()
    )
)
def test_whatever_comes_is_a_residual_or_malformed(payload: bytes) -> None:
    try:
        sample = residual_sample(payload)
    except MalformedPayload:
        return
    assert len(sample.names) == len(sample.position)
    cdr.decode(cdr.encode(sample))

"""The last minutes in memory: bounded by time and by bytes, in order, the newest always there."""

from __future__ import annotations

import itertools
import threading

from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.services.ring import OVERHEAD_BYTES, Ring

STREAMS = ("joint_states", "joint_commands", "twin_joint_states", "residual")
arrivals = st.lists(
    st.tuples(st.floats(0.0, 20.0), st.integers(0, 900), st.sampled_from(STREAMS)), min_size=1, max_size=80
)


def filled(steps: list[tuple[float, int, str]], seconds: float, size_bytes: int) -> tuple[Ring, list[tuple]]:
    """A ring after these messages (seconds after the one before, size, stream), and all that was put in."""
    ring, now_s, sent = Ring(seconds, size_bytes), 0.0, []
    for stamp_ns, (pause_s, size, stream) in enumerate(steps):
        now_s += pause_s
        sent.append((now_s, stamp_ns, stream, bytes(size)))
        ring.add(stream, stamp_ns, bytes(size), now_s)
    return ring, sent


@given(arrivals, st.floats(0.1, 100.0), st.integers(1, 20_000))
def test_it_holds_the_newest_messages_within_both_bounds(
    steps: list[tuple[float, int, str]], seconds: float, size_bytes: int
) -> None:
    ring, sent = filled(steps, seconds, size_bytes)
    held = ring.messages()
    assert held == sent[len(sent) - len(held) :], "the newest, in the order in which they came"
    used = sum(len(message.payload) + OVERHEAD_BYTES for message in held)
    assert used == ring.used_bytes <= size_bytes
    assert all(message.arrival_s >= sent[-1][0] - seconds for message in held)
    if len(held) < len(sent):
        arrival_s, _, _, payload = sent[-len(held) - 1]
        too_old = arrival_s < sent[-1][0] - seconds
        assert too_old or used + len(payload) + OVERHEAD_BYTES > size_bytes, "nothing goes without need"


@given(arrivals)
def test_a_ring_that_is_off_holds_nothing(steps: list[tuple[float, int, str]]) -> None:
    ring, _ = filled(steps, 0.0, 1_000_000)
    assert ring.messages() == []
    assert ring.used_bytes == 0


def test_it_says_which_bound_holds() -> None:
    steps = [(1.0, 100, "joint_states")] * 20
    assert filled(steps, 1000.0, 3000)[0].full
    assert not filled(steps, 5.0, 1_000_000)[0].full


def test_what_came_last_stays_when_the_hand_falls_silent() -> None:
    ring, _ = filled([(0.1, 10, "joint_states")] * 5, 1.0, 100_000)
    assert len(ring.messages()) == 5


def test_looking_while_it_is_filled_sees_a_run_without_gaps() -> None:
    ring, stop, gaps = Ring(0.5, 200_000), threading.Event(), []

    def look() -> None:
        while not stop.is_set():
            stamps = [kept.stamp_ns for kept in ring.messages()]
            gaps.extend((a, b) for a, b in itertools.pairwise(stamps) if b != a + 1)

    looking = threading.Thread(target=look)
    looking.start()
    for stamp_ns in range(20_000):
        ring.add("joint_states", stamp_ns, b"x" * 50, stamp_ns * 1e-3)
    stop.set()
    looking.join()
    assert not gaps

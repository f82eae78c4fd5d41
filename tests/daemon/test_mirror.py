"""What the hand last said of each joint, however its messages are cut."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.daemon.intake import Accepted
from twin_daemon.daemon.mirror import Mirror

JOINTS = ("a", "b", "c", "d", "e")
EVERYTHING = np.arange(5)

steps = st.lists(
    st.tuples(st.integers(1, 900_000_000), st.sampled_from(["whole", "whole", "whole", "first two", "forget"])),
    max_size=12,
)


@given(steps, st.integers(0, 2**32 - 1))
def test_whole_messages_say_the_same_as_their_parts(steps: list[tuple[int, str]], seed: int) -> None:
    random = np.random.default_rng(seed)
    whole, parts = Mirror(JOINTS), Mirror(JOINTS)
    stamp_ns, now_s = 1_700_000_000_000_000_000, 5.0
    for elapsed_ns, what in steps:
        stamp_ns, now_s = stamp_ns + elapsed_ns, now_s + elapsed_ns * 1e-9
        position = random.normal(size=5)
        if what == "forget":
            whole.forget()
            parts.forget()
        elif what == "whole":
            whole.update(Accepted(stamp_ns, EVERYTHING, position), now_s)
            for index in (EVERYTHING[:2], EVERYTHING[2:]):
                parts.update(Accepted(stamp_ns, index, position[index]), now_s)
        else:
            for mirror in (whole, parts):
                mirror.update(Accepted(stamp_ns, EVERYTHING[:2], position[:2]), now_s)
        for name in ("position", "velocity", "stamp_ns", "arrival_s"):
            np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name), strict=True)


def test_the_velocity_is_differentiated_and_a_pause_begins_it_anew() -> None:
    mirror = Mirror(JOINTS)
    for sample in range(100):
        mirror.update(Accepted(sample * 8_000_000, EVERYTHING, np.full(5, 0.004 * sample)), 0.008 * sample)
    np.testing.assert_allclose(mirror.velocity, 0.5, rtol=1e-6)
    mirror.update(Accepted(2_000_000_000, EVERYTHING, np.zeros(5)), 2.0)
    np.testing.assert_array_equal(mirror.velocity, 0.0)

"""Names of one joint in its many spellings."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.hand.groups import derive_groups
from twin_daemon.hand.naming import canonical, match

BARE = st.sampled_from(["FFJ0", "FFJ3", "THJ5", "WRJ1", "Rotation", "shoulder_pan"])


@given(bare=BARE, side=st.sampled_from(["", "rh_", "lh_"]), mark=st.sampled_from(["", "A_"]))
def test_every_spelling_has_the_same_bare_name(bare: str, side: str, mark: str) -> None:
    assert canonical(side + mark + bare) == bare
    assert canonical(canonical(bare)) == bare
    assert match(side + mark + bare, ["other", bare]) == bare


@pytest.mark.parametrize(
    ("name", "candidates", "found"),
    [
        ("rh_FFJ3", ["rh_A_FFJ3", "rh_FFJ3"], "rh_FFJ3"),  # itself first
        ("rh_FFJ3", ["rh_A_FFJ3", "rh_A_FFJ4"], "rh_A_FFJ3"),
        ("FFJ3", ["rh_FFJ3", "lh_FFJ3"], None),  # two hands: which one?
        ("rh_FFJ3", ["lh_FFJ3"], None),  # the other hand
        ("lh_FFJ3", ["rh_FFJ3", "lh_A_FFJ3"], "lh_A_FFJ3"),
        ("FFJ3", ["FFJ33", "MFJ3"], None),
        ("", ["FFJ3"], None),
    ],
)
def test_match(name: str, candidates: list[str], found: str | None) -> None:
    assert match(name, candidates) == found


def test_groups_of_other_robots_are_only_all() -> None:
    assert derive_groups(["pan", "tilt"]) == {"all": ["pan", "tilt"]}

"""When a verdict about a hand with a healthy recording beside it counts as right."""

from __future__ import annotations

from typing import Any

import pytest

from bench.healthy_cases import is_right

_RIGHT = ["actuator_gain", "tendon_elasticity"]


def _said(verdict: str, *findings: tuple[str, str, list[str]]) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "findings": [{"effect": e, "joints": [joint], "confusable_with": rivals} for e, joint, rivals in findings],
    }


@pytest.mark.parametrize(
    ("found", "counts"),
    [
        (_said("explained", ("actuator_gain", "rh_FFJ3", [])), True),
        (_said("explained", ("actuator_gain", "rh_MFJ3", [])), False),
        (_said("unexplained", ("actuator_gain", "rh_FFJ3", [])), False),
        (_said("explained", ("tendon_elasticity", "rh_FFJ3", [])), False),
        (_said("ambiguous", ("tendon_elasticity", "rh_FFJ3", ["actuator_gain:rh_A_FFJ3"])), True),
        (_said("ambiguous", ("tendon_elasticity", "rh_FFJ3", ["actuator_gain:rh_A_FFJ3", "backlash:rh_FFJ3"])), False),
        (_said("within_noise"), False),
    ],
)
def test_the_planted_effect_stands_first_or_beside_what_these_data_cannot_tell_from_it(
    found: dict[str, Any], counts: bool
) -> None:
    assert is_right(found, _RIGHT, ["rh_FFJ3"]) is counts


def test_of_a_healthy_hand_only_within_noise_is_right() -> None:
    assert is_right(_said("within_noise"), [], [])
    assert not is_right(_said("not_excited"), [], [])

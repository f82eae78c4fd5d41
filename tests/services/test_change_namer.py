"""What the daemon says of a change, and how loud."""

from __future__ import annotations

from typing import Any

import pytest

from twin_daemon.services.change_namer import beyond, change_in_words


def _change(effect: str, ratio: float | None, rivals: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "effect": effect,
        "ratio": {"value": ratio},
        "rivals": rivals,
        "words": "FFJ3: more",
        "remedy": "Grease it.",
    }


@pytest.mark.parametrize(
    ("effect", "ratio", "loud"),
    [
        ("viscous_friction", 1.3, False),
        ("viscous_friction", 1.6, True),
        ("actuator_gain", 0.8, False),
        ("actuator_gain", 0.6, True),
        ("backlash", None, True),
        ("sensor_offset", None, False),
    ],
)
def test_what_a_recalibration_should_not_hide_is_said_louder(effect: str, ratio: float | None, loud: bool) -> None:
    assert beyond(_change(effect, ratio), 1.5) is loud


def test_a_change_is_said_with_what_looks_alike_and_what_to_do() -> None:
    assert change_in_words(_change("viscous_friction", 1.3)) == "FFJ3: more; Grease it."
    assert "(or tendon_elasticity:FFJ3, which looks alike)" in change_in_words(
        _change("actuator_gain", 0.8, ("tendon_elasticity:FFJ3",))
    )

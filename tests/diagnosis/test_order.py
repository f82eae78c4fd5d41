"""Which of several findings is named first."""

from __future__ import annotations

import pytest

from tests.diagnosis.findings import finding
from twin_daemon.diagnosis.conclude import ranked

HERE, THERE = ("rh_FFJ3",), ("rh_MFJ3",)


@pytest.mark.parametrize(
    ("one", "other", "first"),
    [
        # (effect, joints, nats, probability, what it leaves of held-out motion): at other joints the nats decide
        (("backlash", HERE, 900.0, 0.99, 0.1), ("spring", THERE, 1000.0, 0.99, 0.1), "spring"),
        # no number of the model stands for a gap, however many nats it has
        (("backlash", HERE, 900.0, 0.99, 0.1), ("actuator_gain", HERE, 1000.0, 0.99, 0.1), "backlash"),
        (("backlash", HERE, 900.0, 0.99, 0.1), ("actuator_saturation", HERE, 9000.0, 0.99, 0.1), "backlash"),
        # but where it takes nearly all there is, the rest may be the form of its law
        (
            ("joint_stop", HERE, 900.0, 0.99, 0.1),
            ("actuator_saturation", HERE, 90000.0, 0.99, 0.1),
            "actuator_saturation",
        ),
        # unless another law leaves nothing of that rest
        (("backlash", HERE, 900.0, 0.99, 0.01), ("actuator_saturation", HERE, 90000.0, 0.99, 0.1), "backlash"),
        # a second effect's nats are over another floor
        (("hysteresis", HERE, 1000.0, 0.57, 0.1), ("actuator_lag", HERE, 900.0, 0.97, 0.1), "actuator_lag"),
    ],
)
def test_what_is_named_first(
    one: tuple[str, tuple[str, ...], float, float, float],
    other: tuple[str, tuple[str, ...], float, float, float],
    first: str,
) -> None:
    found = [
        finding(effect, joints[0], joints, "").model_copy(
            update={"evidence_nats": nats, "probability": probability, "holdout_mse_after_rad2": left * 1e-3}
        )
        for effect, joints, nats, probability, left in (one, other)
    ]
    for given in (found, found[::-1]):
        assert ranked(given)[0].effect == first

"""The dissertation's second approach in a minute; the whole of it is a command of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence

from bench.dissertation_page import SPACES
from bench.frame import Row
from bench.real import real
from twin_daemon.calibration.calibrate import calibrate
from twin_daemon.calibration.spaces import load_space

_MOST_S = 60.0


def second_approach(quick: bool, seed: int) -> Sequence[Row]:
    """Least squares in its space, from its start and with its bounds, until it ends by itself."""
    reported = SPACES["second-approach"].best_rad2
    twin, aligned = real("hand_closing")
    space = load_space("second-approach")
    found, processor_s = [], []
    for number in range(1 if quick else 3):
        began = time.process_time()
        found.append(calibrate(twin, [aligned], [], space, "least-squares", seed=seed + number))
        processor_s.append(time.process_time() - began)
    errors = sorted(fit.after_rad2 for fit in found)
    spread = (errors[0] / reported, errors[-1] / reported)
    return [
        Row(
            "error, over the joints of the table",
            errors[len(errors) // 2],
            reported,
            "rad²",
            errors[len(errors) // 2] / reported,
            spread,
            "below 1",
            errors[-1] < reported,
            "both fitted on the whole recording; the two models differ in their actuators",
        ),
        Row(
            "processor's time of all threads, the slowest",
            max(processor_s),
            goal=f"below {_MOST_S:.0f} s",
            met=max(processor_s) < _MOST_S,
            note=f"{max(fit.wall_s for fit in found):.0f} s on the clock, beside whatever else ran; the dissertation's "
            "took four hours, in real time",
        ),
    ]

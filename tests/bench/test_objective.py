"""Searches of others are judged on what `twin calibrate` fits."""

from __future__ import annotations

import numpy as np

from bench.objective import Objective
from tests.simulation.made import FINGER, recorded
from twin_daemon.calibration.calibrate import calibrate
from twin_daemon.calibration.spaces import Space
from twin_daemon.estimation.solvers.random import random_search
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

SPACE = Space.model_validate(
    {
        "schema": 1,
        "name": "small",
        "about": "a gain and a damping",
        "parameters": [
            {"kind": "kp", "of": ["rh_FFJ0"], "lower": 0.1, "upper": 100.0},
            {"kind": "damping", "of": ["rh_FFJ3"], "lower": 0.001, "upper": 5.0},
        ],
    }
)


def test_the_same_search_finds_the_same_either_way() -> None:
    twin = TwinModel.load(load_hand())
    wear = {"rh_FFJ0.kp": 0.3, "rh_FFJ3.damping": 6.0}
    values = {name: factor * twin.parameter(name).read(twin.model) for name, factor in wear.items()}
    worn = twin.changed(Terms(parameters=values))
    train, held = (align(twin, recorded(worn, FINGER, np.random.default_rng(seed))) for seed in (5, 6))
    product = calibrate(twin, [train], [held], SPACE, "random", budget=40, seed=3)
    found = Objective(twin, [train], [held], SPACE).run(lambda tracker: random_search(tracker, 40, 3))
    assert found.history == product.history
    assert found.after_rad2 == product.after_rad2 < found.before_rad2 == product.before_rad2
    assert found.held_rad2 == product.holdout_after_rad2
    assert found.at_bound == [name for name, p in product.parameters.items() if p.at_bound]

"""Dry friction that holds a joint away from its target for ever, which a model's own does not unless it is told to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded
from twin_daemon.calibration.calibrate import calibrate
from twin_daemon.calibration.spaces import load_space, variables_of
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

_MODEL = """<mujoco model="one"><compiler angle="radian"/><option timestep="0.002"/><worldbody>
<body name="one"><joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.02" frictionloss="0.1"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
_MOTION: Motion = {"elbow": ([0.0, 0.4, 0.7, 3.4, 3.7, 6.4, 6.7, 8.0], [0.0, 0.0, 0.5, 0.5, 0.1, 0.1, -0.3, -0.3])}


@pytest.mark.parametrize("softness", [1e-4, 0.05])
def test_how_firmly_friction_holds_is_found(tmp_path: Path, softness: float) -> None:
    path = tmp_path / "one.xml"
    path.write_text(_MODEL)
    twin = TwinModel.load(load_hand(model=path))
    plant = twin.changed(Terms(parameters={"elbow.friction_softness": softness, "elbow.frictionloss": 0.13}))
    trained = align(twin, recorded(plant, _MOTION, np.random.default_rng(1), seconds=8.0))
    other = {"elbow": (_MOTION["elbow"][0], [-0.6 * value for value in _MOTION["elbow"][1]])}
    held = align(twin, recorded(plant, other, np.random.default_rng(2), seconds=8.0))
    space = load_space("physical")
    assert "elbow.friction_softness" in {variable.name for variable in variables_of(space, twin, ("elbow",))}
    found = calibrate(twin, [trained], [held], space, "least-squares", budget=600)
    assert found.after_rad2 < 3.0 * (3e-4) ** 2
    assert found.holdout_after_rad2 is not None
    assert found.holdout_after_rad2 < 5.0 * (3e-4) ** 2
    value = found.parameters["elbow.friction_softness"]
    if softness == 1e-4:  # a hundred times as firm as what a model says that says nothing
        assert value.value < 3e-3
    else:
        low, high = value.ci95
        assert low < softness < high
        assert value.value == pytest.approx(softness, rel=0.1)

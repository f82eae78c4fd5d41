"""What is uncertain about a part, fitted without any effect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded
from twin_daemon.diagnosis.group import look
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

GAIN = 0.64
_MODEL = """<mujoco model="wrist"><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body name="link"><joint name="joint" axis="0 0 1" range="-3 3" damping="2" armature="0.1"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02" mass="0.4" contype="0" conaffinity="0"/></body></worldbody>
<actuator><general name="joint" joint="joint" gainprm="2000" biastype="affine" biasprm="0 -2000 -200"
ctrlrange="-3 3" forcerange="-12 12"/></actuator></mujoco>"""


def _steps(rng: np.random.Generator) -> Motion:
    """Ramps and holds that bring the servo to its limit now and then."""
    times, angles = [0.0, 0.5], [0.0, 0.0]
    while times[-1] < 11.5:
        angle = float(rng.uniform(-0.45, 0.45))
        times += [times[-1] + 0.3, times[-1] + 0.3 + float(rng.uniform(0.3, 0.9))]
        angles += [angle, angle]
    return {"joint": (times, angles)}


def test_a_value_that_went_far_for_another_one_comes_back(tmp_path: Path) -> None:
    """A servo that is cut off at its limit makes a rough cost: a light joint's inertia stayed where it had gone."""
    path = tmp_path / "wrist.xml"
    path.write_text(_MODEL)
    twin = TwinModel.load(load_hand(model=path))
    weak = EffectTerm(effect="actuator_gain", target="joint", values={"factor": GAIN, "derivative": 1.0})
    plant = twin.changed(Terms(effects=(weak,))).at_step(0.0005)
    made = align(
        twin, recorded(plant, _steps(np.random.default_rng(2)), np.random.default_rng(1), seconds=12.0, noise_rad=1e-4)
    )
    (group,) = drive_groups(twin)
    reduced = Reduction(twin, [made], [made]).of(twin, group, group.joints)
    assert reduced is not None
    _, part = look(reduced)
    sigma = twin.hand.description.nominal_uncertainty.of("joint.kp")
    assert part.base.deviations["joint.kp"] == pytest.approx(np.log(GAIN) / sigma, abs=0.3)
    assert abs(part.base.deviations["joint.armature"]) < 4.0

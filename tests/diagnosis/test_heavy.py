"""A slide of a machine tool: its maker's own numbers are beyond what the parts of a hand have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.conftest import called
from tests.simulation.made import Motion, recorded, saved
from twin_daemon.diagnosis.candidates import hypotheses
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

DAMPING = 30_300.0
OFFSET_M = 0.01
_MODEL = f"""<mujoco model="mill"><option timestep="0.002"/><worldbody><body name="table">
<joint name="table" type="slide" axis="0 0 1" range="-0.21 0.21" damping="{DAMPING}" armature="1310" frictionloss="2"/>
<geom type="box" size="0.2 0.2 0.05" mass="20" contype="0" conaffinity="0"/></body></worldbody><actuator>
<position name="table" joint="table" kp="90100" ctrlrange="-0.21 0.21" forcerange="-18800 18800"/>
</actuator></mujoco>"""
_MOTION: Motion = {
    "table": (
        [0.0, 0.5, 1.5, 2.0, 2.01, 3.0, 3.3, 4.0, 5.0, 6.0],
        [0.0, 0.0, 0.12, 0.12, 0.05, 0.05, -0.12, -0.12, 0.1, 0.0],
    )
}


@pytest.fixture
def mill(tmp_path: Path) -> TwinModel:
    path = tmp_path / "mill.xml"
    path.write_text(_MODEL)
    return TwinModel.load(load_hand(model=path))


@pytest.mark.slow
def test_a_wrong_zero_of_it_is_found(mill: TwinModel, tmp_path: Path) -> None:
    off = EffectTerm(effect="sensor_offset", target="table", values={"offset": OFFSET_M})
    plant = mill.changed(Terms(effects=(off,)))
    made = [recorded(plant, _MOTION, np.random.default_rng(seed), seconds=6.0, noise_rad=2e-6) for seed in (1, 2)]
    fit, held = (str(saved(one, tmp_path / f"{i}.mcap")) for i, one in enumerate(made))
    asked = ("diagnose", "--model", str(mill.hand.model_path), "--recording", fit, "--holdout", held)
    said = called(*asked, result=tmp_path / "said.json")
    assert said["verdict"] in ("explained", "ambiguous")
    assert said["findings"][0]["effect"] == "sensor_offset"
    assert said["findings"][0]["parameters"]["offset"]["value"] == pytest.approx(OFFSET_M, rel=0.02)


@pytest.mark.parametrize("factor", [0.05, 0.5, 3.0, 20.0])
def test_what_an_uncertain_value_stood_in_for_begins_within_what_an_effect_allows(
    factor: float, mill: TwinModel
) -> None:
    for hypothesis in hypotheses(mill, ["table"], whole_hand=False):
        for name in hypothesis.speaks_for(mill):
            assert hypothesis.freed(mill, {name: factor})


def test_a_model_of_another_size_brings_its_own_limits(mill: TwinModel) -> None:
    for value in (0.5 * DAMPING, 2.0 * DAMPING):
        changed = mill.changed(Terms(parameters={"table.damping": value}))
        assert changed.parameter("table.damping").read(changed.model) == pytest.approx(value)
    with pytest.raises(BadInput, match=r"not physical.*Allowed"):
        mill.changed(Terms(parameters={"table.damping": 100.0 * DAMPING}))

"""Two sessions of a joint that passes something close by: what is only near lets it be looked at, a touch does not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded, saved
from twin_daemon.changes.group import Group, Sessions, begun, group_of
from twin_daemon.changes.quantities import quantities
from twin_daemon.cli.app import main
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

_JOINT, _RADIUS_M = "elbow", 0.02
_BEFORE: Motion = {
    _JOINT: (
        [0.0, 0.4, 0.41, 1.2, 2.2, 2.5, 2.51, 3.2, 4.4, 5.5],
        [0.0, 0.0, 0.6, 0.6, -0.5, -0.5, 0.1, 0.1, -0.3, 0.3],
    )
}
_NOW: Motion = {
    _JOINT: (
        [0.0, 0.3, 0.31, 1.0, 1.9, 2.6, 2.61, 3.0, 4.3, 5.5],
        [0.1, 0.1, -0.5, -0.5, 0.4, 0.4, 0.7, 0.7, -0.1, -0.2],
    )
}


def _arm(path: Path, gap_m: float) -> Path:
    """An arm that swings along a wall, so far from it."""
    path.write_text(f"""<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002"/><worldbody>
<geom name="wall" type="box" size="0.5 0.01 0.5" pos="0 {_RADIUS_M + gap_m + 0.01} 0"/><body name="link">
<joint name="{_JOINT}" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="{_RADIUS_M}" mass="0.2"/></body></worldbody>
<actuator><position name="{_JOINT}" joint="{_JOINT}" kp="4" ctrlrange="-1.5 1.5"/></actuator></mujoco>""")
    return path


def _bag(model: Path, motion: Motion, seed: int, terms: Terms) -> Path:
    """A session of the arm, as it moves where there is no wall."""
    clear = _arm(model.parent / "clear.xml", 0.1)
    plant = TwinModel.load(load_hand(model=clear)).changed(terms).at_step(0.0005)
    one = recorded(plant, motion, np.random.default_rng(seed), noise_rad=1e-3, name=f"bag{seed}")
    return saved(one, model.parent / f"bag{seed}.mcap")


@pytest.mark.parametrize(
    ("gap_m", "verdict", "said"),
    [(0.0005, "within_noise", "seen only while less than 1 mm"), (-0.0005, "not_excited", "touches something")],
)
def test_what_only_comes_near_is_looked_at_and_what_touches_is_not(
    tmp_path: Path, gap_m: float, verdict: str, said: str
) -> None:
    model = _arm(tmp_path / "arm.xml", gap_m)
    before, now = (_bag(model, motion, seed, Terms()) for seed, motion in enumerate((_BEFORE, _NOW)))
    path = tmp_path / "found.json"
    asked = ["--model", str(model), "--recording", str(now), "--baseline", str(before)]
    assert main(["diagnose", *asked, "--json", str(path)]) == 0
    found = json.loads(path.read_text())
    assert found["verdict"] == verdict
    assert any(said in note for note in found["notes"])


def test_steps_are_finer_where_something_may_have_appeared(tmp_path: Path) -> None:
    """What the model's own step gets wrong is known of the model, not of what an effect makes of it."""
    model = _arm(tmp_path / "arm.xml", 0.1)
    twin = TwinModel.load(load_hand(model=model))
    stiffer = Terms(parameters={f"{_JOINT}.kp": 8.0})
    bags = [_bag(model, *one) for one in ((_BEFORE, 0, Terms()), (_NOW, 1, Terms()), (_NOW, 2, stiffer))]
    before, same, other = (align(twin, load_recording(bag)) for bag in bags)

    def opened(now: Aligned) -> Group:
        (group,) = drive_groups(twin)
        (reduced,) = Reduction(twin, [before], [now]).each(twin, [(group, [_JOINT])])
        assert reduced is not None
        sessions = Sessions(before=tuple(reduced.train), now=tuple(reduced.holdout))
        return group_of(begun(reduced, sessions, quantities(twin, (_JOINT,))))

    steps = [float(opened(now).reduced.twin.model.opt.timestep) for now in (same, other)]
    assert steps[0] == pytest.approx(0.002)
    assert steps[1] < 0.001

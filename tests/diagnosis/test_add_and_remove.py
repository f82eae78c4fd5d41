"""Effects go into the twin and out again as versions; what is exported moves alike."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnosis.conftest import GAP_RAD, JOINT, called
from tests.diagnosis.rig import FRICTION_N_M, rubbing_rig
from twin_daemon.cli.app import main
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore


def test_an_effect_is_added_with_given_values_and_removed_again(tmp_path: Path, twin: TwinModel) -> None:
    joints = ("--joint", "FFJ3", "rh_MFJ3")
    added = called("add", "backlash", *joints, "--set", "gap=0.03", result=tmp_path / "a.json")
    assert added["targets"] == ["rh_FFJ3", "rh_MFJ3"]
    assert added["before"] == added["after"] == {"mse_rad2": None}
    store = VersionStore(twin.hand.name)
    version = store.get(added["version"])
    assert version.kind == "effect_added"
    assert {(t["effect"], t["target"]) for t in version.terms["effects"]} == {
        ("backlash", "rh_FFJ3"),
        ("backlash", "rh_MFJ3"),
    }
    assert all(t["values"]["gap"] == 0.03 for t in version.terms["effects"])
    assert store.last_promoted() is None

    removed = called(
        "remove", "backlash", "--joint", "rh_FFJ3", "--version", added["version"], result=tmp_path / "r.json"
    )
    record = store.get(removed["version"])
    assert (record.kind, record.parent) == ("effect_removed", added["version"])
    assert [t["target"] for t in record.terms["effects"]] == ["rh_MFJ3"]


@pytest.mark.slow
def test_an_effect_is_fitted_beside_what_is_uncertain(played: Path, tmp_path: Path) -> None:
    result = called("add", "backlash", "--joint", JOINT, "--recording", str(played), result=tmp_path / "a.json")
    gap = result["parameters"][f"backlash:{JOINT}.gap"]
    assert gap["value"] == pytest.approx(GAP_RAD, rel=0.15)
    assert not gap["at_bound"]
    assert result["after"]["mse_rad2"] < result["before"]["mse_rad2"]
    assert result["holdout_after"]["mse_rad2"] < result["holdout_before"]["mse_rad2"]
    assert [t["effect"] for t in result["terms"]["effects"]] == ["backlash"]


def test_friction_is_fitted_to_a_model_that_states_none(tmp_path: Path) -> None:
    """One of the effect's usual starts takes friction away: here there is none to take."""
    model, bag = rubbing_rig(tmp_path)
    arguments = ("--model", str(model), "--recording", str(bag))
    added = called("add", "coulomb_friction", "--joint", "left", *arguments, result=tmp_path / "added.json")
    low, high = added["parameters"]["coulomb_friction:left.friction"]["ci95"]
    assert low <= FRICTION_N_M <= high
    assert added["after"]["mse_rad2"] < 0.2 * added["before"]["mse_rad2"]


def test_what_is_set_is_not_fitted(sound: Path, tmp_path: Path) -> None:
    result = called(
        "add", "backlash", "--joint", JOINT, "--set", "gap=0.01", "motor_share=0.3", "--recording", str(sound),
        result=tmp_path / "a.json",
    )  # fmt: skip
    assert result["parameters"] == {}
    assert result["terms"]["effects"][0]["values"] == {
        "gap": 0.01,
        "motor_share": 0.3,
        "damping_share": 0.0,
        "braked": 0.0,
    }


def test_an_exported_twin_with_effects_moves_like_the_twin(tmp_path: Path, twin: TwinModel) -> None:
    called("add", "backlash", "--joint", JOINT, "--set", "gap=0.03", result=tmp_path / "a.json")
    added = called("add", "coupling", "--joint", "rh_FFJ0", "--version", "candidate", result=tmp_path / "b.json")
    path = tmp_path / "hand.xml"
    assert main(["versions", "export", added["version"], "-o", str(path)]) == 0
    model = mujoco.MjModel.from_xml_path(str(path))

    rich_twin = twin.changed(Terms.model_validate(added["terms"]))
    steps = 1500
    controls = np.zeros((1, steps, len(twin.actuators)))
    wave = 0.5 - 0.5 * np.cos(np.arange(steps) * twin.model.opt.timestep * 3.0)
    controls[0, :, twin.actuators.index("rh_FFJ3")] = 0.8 * wave
    controls[0, :, twin.actuators.index("rh_FFJ0")] = 1.6 * wave
    start = rich_twin.initial_qpos(np.full(len(twin.joints), np.nan))
    expected = roll_out([rich_twin.model], controls, start[None])[0]

    data = mujoco.MjData(model)
    names = [rich_twin.hand.description.joints[name].joint for name in rich_twin.joints]
    addresses = [int(model.joint(name).qposadr[0]) for name in names]
    data.qpos[:] = start
    worst = 0.0
    for step in range(steps):
        data.ctrl[: controls.shape[2]] = controls[0, step]
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.qpos[addresses] - expected[step + 1, rich_twin.qpos_adr]).max()))
    assert np.ptp(expected[:, rich_twin.qpos_adr], axis=0).max() > 0.5
    assert worst < 1e-6

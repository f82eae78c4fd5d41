"""The versions that come with the program are what they say."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin_daemon.cli.app import main
from twin_daemon.hand import load_hand
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore

HAND = "shadow_hand"
STORE = VersionStore(HAND, root=Path("/nonexistent"))
NAMES = [name for version in STORE.list()[1:] for name in STORE.names(version.id)]
GOAL_RAD2 = 1.2e-5


@pytest.mark.parametrize("name", NAMES)
def test_it_is_intact_and_moves_as_plain_mjcf(name: str) -> None:
    version = STORE.get(name)
    twin = TwinModel.load(load_hand(HAND), Terms.model_validate(version.terms))
    plain = mujoco.MjModel.from_xml_string(STORE.model(name))
    controls = 0.6 * np.abs(np.sin(np.linspace(0.0, 6.0, 1500)))[:, None] * np.ones(twin.model.nu)
    start = twin.initial_qpos(np.zeros(len(twin.joints)))
    moved = [
        roll_out([model], controls[None], start[None], np.zeros((1, model.nv)), threads=1)
        for model in (twin.model, plain)
    ]
    assert np.abs(moved[0] - moved[1]).max() < 1e-6


def test_the_real_closing_is_reproduced_by_all_four_fingers(
    shared_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shared_data / "shadow_hand_real"
    if not (folder / "hand_closing.csv").is_file():
        pytest.skip("shadow_hand_real/hand_closing.csv is not on this machine")
    motion = f"{folder / 'trajectories.yaml'}:hand_closing"
    data = ["--recording", str(folder / "hand_closing.csv"), "--trajectory", motion]
    assert main(["compare", *data, "--version", "real_closing", "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["mse_rad2"] < GOAL_RAD2
    assert {
        finger: result["groups"][finger]["mse_rad2"] < 1.5e-5 for finger in ("FF", "MF", "RF", "LF")
    } == dict.fromkeys(("FF", "MF", "RF", "LF"), True)

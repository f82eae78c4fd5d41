"""Recordings and the demo as people call them."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant
from twin_daemon.recordings import load_recording
from twin_daemon.recordings.writer import McapWriter
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.versions import VersionStore

BEGIN = 1_600_000_000_000_000_000
PERIOD_S = 0.008


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of a closing hand, with its commands, made by the stand-in faster than real time."""
    hand = load_hand()
    plant, motion = Plant(hand, seed=1, spread=0.2), load_trajectory("hand_closing", hand).by_command(hand)
    path = tmp_path_factory.mktemp("recordings") / "closing.mcap"
    with McapWriter(path) as writer:
        for sample in range(375):
            stamp = BEGIN + round(sample * PERIOD_S * 1e9)
            target = motion.sample([sample * PERIOD_S])[0]
            plant.set_targets(dict(zip(motion.joints, target.tolist(), strict=True)))
            writer.joint_commands(stamp, motion.joints, target)
            names, position, velocity, effort = plant.measure()
            writer.joint_states(stamp, names, position, velocity, effort)
            plant.advance(PERIOD_S)
    return path


@pytest.mark.slow
def test_a_recording_played_before_the_daemon_starts_is_followed(twin: Any, recording: Path) -> None:
    player = twin.start("play", str(recording), "--json", "-")
    daemon = twin.start("run")
    code, out, err = twin.finish(player)
    assert code == 0, err
    played = json.loads(out)
    assert (played["joint_states"], played["joint_commands"], played["listened"]) == (375, 375, True)
    residual = twin.query("residual")
    assert residual["status"] in ("following", "stale")
    assert len(residual["joints"]) == 24
    assert residual["mse_rad2"] < 0.01
    health = twin.query("health")
    assert health["joint_states"]["accepted"] >= 370
    assert health["joint_states"]["counts"] == {}
    assert twin.end(daemon)[0] == 0


@pytest.mark.slow
def test_kept_stamps_and_a_second_round_are_followed(twin: Any, recording: Path) -> None:
    daemon = twin.start("run")
    for _ in range(2):
        code, _, err = twin.run("play", str(recording), "--keep-stamps", "--speed", "5")
        assert code == 0, err
        assert "nobody listened" not in err
    health = twin.query("health")
    assert health["joint_states"]["counts"]["stamps_restarted"] == 1
    assert twin.query("state")["stamp_ns"] == BEGIN + round(374 * PERIOD_S * 1e9)
    assert twin.end(daemon)[0] == 0


def test_a_real_recording_is_followed_under_its_trajectory(twin: Any, shared_data: Path) -> None:
    folder = shared_data / "shadow_hand_real"
    trajectory = f"{folder / 'trajectories.yaml'}:hand_closing"
    daemon = twin.start("run")
    code, _, err = twin.run("play", str(folder / "hand_closing.csv"), "--trajectory", trajectory, "--speed", "2")
    assert code == 0, err
    residual = twin.query("residual")
    assert all(joint["samples"] > 700 for joint in residual["joints"].values())
    assert residual["mse_rad2"] < 0.1
    assert twin.end(daemon)[0] == 0


def test_a_file_that_is_no_recording_is_refused(twin: Any, tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_text("nothing of the kind")
    code, _, err = twin.run("play", "no.mcap")
    assert code == 3
    assert len(err.strip().splitlines()) == 1


@pytest.mark.slow
def test_the_demo_ends_by_itself_with_a_smaller_error(twin: Any, state_dir: Path) -> None:
    code, out, err = twin.finish(
        twin.start("demo", "--record-seconds", "6", "--budget", "60", "--json", "-"), timeout_s=170.0
    )
    assert code == 0, err
    result = json.loads(out)
    assert result["after"]["mse_rad2"] < result["before"]["mse_rad2"]
    assert result["holdout_after"]["mse_rad2"] < result["holdout_before"]["mse_rad2"]
    assert result["version"]
    store = VersionStore("shadow_hand")
    own = [version for version in store.list()[1:] if not store.shipped(version.id)]
    assert own == [], "the versions of the user's own hand are not touched"
    assert load_recording(state_dir / "demo" / "learn.mcap").commands is not None


def test_an_interrupted_demo_leaves_no_process_behind(twin: Any, until: Any) -> None:
    demo = twin.start("demo")
    children = until(lambda: [] if len(found := psutil.Process(demo.pid).children()) < 2 else found)
    time.sleep(1.0)
    assert twin.end(demo, timeout_s=20.0)[0] == 130
    until(lambda: not any(child.is_running() for child in children))


def agreement(twin: Any, folder: Path, data: list[str], model: list[str], speed: float) -> dict[str, float]:
    """Live mean square residual over the offline one, by joint that moves, after a recording was played."""
    (folder / "free.yaml").write_text(
        "daemon: {horizon_s: 3600.0, residual_window_s: 600.0, max_catch_up_s: 10.0, stale_after_s: 60.0}\n"
    )
    code, _, err = twin.run("compare", "--recording", *data, *model, "--version", "nominal", "--json", "offline.json")
    assert code == 0, err
    daemon = twin.start("run", "-c", "free.yaml", *model)
    code, _, err = twin.run("play", *data, *model, "--speed", str(speed))
    assert code == 0, err
    time.sleep(0.5)
    code, out, err = twin.run("query", "residual", *model, "--json", "-")
    assert code == 0, err
    live = json.loads(out)["joints"]
    assert twin.end(daemon)[0] == 0
    offline = json.loads((folder / "offline.json").read_text())["joints"]
    return {n: live[n]["mse_rad2"] / values["mse_rad2"] for n, values in offline.items() if values["moves"]}


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_the_live_residuals_are_those_of_the_offline_comparison(
    twin: Any, recording: Path, tmp_path: Path, speed: float
) -> None:
    ratios = agreement(twin, tmp_path, [str(recording)], [], speed)
    assert len(ratios) > 10
    assert all(ratio == pytest.approx(1.0, abs=0.05) for ratio in ratios.values()), ratios


@pytest.mark.slow
def test_the_live_residuals_of_the_real_arm_are_the_offline_ones(twin: Any, tmp_path: Path, shared_data: Path) -> None:
    arm = shared_data / "so101_real"
    if not (arm / "multisine").is_dir():
        pytest.skip("so101_real/multisine is not on this machine")
    data = [str(arm / "multisine"), "--joint-map", str(arm / "joint_map.yaml")]
    ratios = agreement(twin, tmp_path, data, ["--model", str(arm / "so101.xml")], 10.0)
    assert len(ratios) == 6
    assert all(ratio == pytest.approx(1.0, abs=0.05) for ratio in ratios.values()), ratios

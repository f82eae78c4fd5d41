"""Two causes at one joint that together look most like a third."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnosis.conftest import called
from tests.simulation.made import RATE_HZ, Motion, recorded, saved
from twin_daemon.hand import load_hand
from twin_daemon.recordings.recording import Recording
from twin_daemon.simulation.twin import TwinModel

STIFFNESS = 3000.0

_WRIST = """<mujoco model="wrist"><compiler angle="radian"/><option timestep="0.002"/><worldbody><body name="link">
<joint name="wrist" axis="0 1 0" range="-3 3" damping="15" armature="0.1"/>
<geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.03" mass="2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="wrist" joint="wrist" kp="3000" forcerange="-28 28"/></actuator></mujoco>"""


def _motion(speed: float) -> Motion:
    """Slow ramps, held steps and reversals of a joint, at a share of some speed."""
    rng = np.random.default_rng(round(100 * speed))
    times, targets = [0.0, 1.0], [0.0, 0.0]
    for _ in range(12):
        to, pause = float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.2, 0.8))
        reached = times[-1] + max(abs(to - targets[-1]) / (speed * float(rng.uniform(0.3, 1.2))), 0.4)
        times += [reached, reached + pause]
        targets += [to, to]
    return {"wrist": (times, targets)}


def _played(model: Path, made: Recording, seed: int, band: float) -> Recording:
    """The same commands at a servo that is silent within a band, and gives less torque by what that would have been."""
    plant = mujoco.MjModel.from_xml_path(str(model))
    plant.opt.timestep = 0.0005
    data = mujoco.MjData(plant)
    assert made.commands is not None
    targets = made.commands.position[:, 0]
    per_sample = round(1.0 / (RATE_HZ * plant.opt.timestep))
    angles = np.empty((len(targets), 1))
    for place, target in enumerate([*[targets[0]] * RATE_HZ, *targets]):
        if place >= RATE_HZ:  # a second to come to rest before
            angles[place - RATE_HZ] = data.qpos[0]
        for _ in range(per_sample):
            data.ctrl[0] = target
            error = target - data.qpos[0]
            data.qfrc_applied[0] = -STIFFNESS * np.clip(error, -band, band)
            mujoco.mj_step(plant, data)
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(angles.shape)
    return replace(made, position=angles + noise)


# rad of play: with more the servo saturates most of the time, and dry friction leaves but 1 % of the error
@pytest.mark.slow
@pytest.mark.parametrize("band", [0.0034, 0.005])
def test_play_in_a_servo_that_saturates_is_not_taken_for_friction(tmp_path: Path, band: float) -> None:
    model = tmp_path / "wrist.xml"
    model.write_text(_WRIST)
    sound = TwinModel.load(load_hand(model=model))
    bags = []
    for seed, (speed, seconds) in enumerate(((1.3, 16.0), (1.0, 12.0))):
        made = recorded(sound, _motion(speed), np.random.default_rng(seed), seconds=seconds)
        bags.append(str(saved(_played(model, made, seed, band), tmp_path / f"{seed}.mcap")))
    said = called("diagnose", "--model", str(model), "--recording", bags[0], "--holdout", bags[1],
                  result=tmp_path / "d.json")  # fmt: skip
    assert said["verdict"] in ("explained", "ambiguous")
    first, second = said["findings"]
    assert first["effect"] in ("backlash", "dead_zone")  # one law with two names
    assert second["effect"] in ("actuator_gain", "actuator_saturation")
    limit = second["parameters"]["limit"]["value"] * (28.0 if second["effect"] == "actuator_gain" else 1.0)
    assert limit == pytest.approx(28.0 - STIFFNESS * band, rel=0.1)

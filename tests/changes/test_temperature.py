"""A colder day makes all joints rub more: what it explains is no wear for sure, and what it does not explain is."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.simulation.made import START_NS, Motion, recorded, saved
from twin_daemon.changes.answer import BY_TEMPERATURE
from twin_daemon.cli.app import main
from twin_daemon.hand import load_hand
from twin_daemon.recordings.recording import Recording
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

LATER_NS = 30 * 86_400 * 10**9

_ARM = """<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002"/><worldbody><body name="link">
<joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/>
<body name="tip" pos="0.2 0 0"><joint name="wrist" axis="0 1 0" range="-1.5 1.5" damping="0.1" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.02" mass="0.1" contype="0" conaffinity="0"/></body></body>
</worldbody><actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5"/>
<position name="wrist" joint="wrist" kp="2" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
_WHEN = [0.0, 0.3, 0.31, 1.0, 1.9, 2.6, 2.61, 3.0, 3.9, 4.3, 4.31, 5.2, 6.3, 7.0]
_TARGETS = [0.1, 0.1, -0.5, -0.5, 0.4, 0.4, 0.7, 0.7, 0.2, 0.3, -0.1, -0.1, -0.6, -0.2]
_HEALTHY: Motion = {"elbow": (_WHEN, _TARGETS), "wrist": (_WHEN, [-0.7 * one for one in reversed(_TARGETS)])}
_NOW: Motion = {"elbow": (_WHEN, _TARGETS[::-1]), "wrist": (_WHEN, [0.8 * one for one in _TARGETS])}


@pytest.fixture(scope="module")
def since(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., dict[str, Any]]:
    """What is said of an arm a month later, whose joints are damped so many times as much."""
    folder = tmp_path_factory.mktemp("arm")
    model = folder / "arm.xml"
    model.write_text(_ARM)
    dampings = {"elbow.damping": 0.2, "wrist.damping": 0.1}

    def made(name: str, motion: Motion, seed: int, factors: dict[str, float]) -> Recording:
        worn = Terms(parameters={key: value * factors.get(key, 1.0) for key, value in dampings.items()})
        plant = TwinModel.load(load_hand(model=model)).changed(worn).at_step(0.0005)
        return recorded(plant, motion, np.random.default_rng(seed), seconds=7.0, noise_rad=3e-4, name=name)

    healthy = saved(made("healthy", _HEALTHY, 1, {}), folder / "healthy.mcap")

    def answer(name: str, factors: dict[str, float], *options: str) -> dict[str, Any]:
        bag, path = folder / f"{name}.mcap", folder / f"{name}.json"
        if not bag.exists():
            saved(_later(made(name, _NOW, 2, factors)), bag)
        given = ["--model", str(model), "--recording", str(bag), "--baseline", str(healthy), *options]
        assert main(["diagnose", *given, "--json", str(path)]) == 0
        return json.loads(path.read_text())

    return answer


@pytest.mark.slow
def test_friction_of_all_joints_may_be_the_weather_unless_it_was_as_warm(
    since: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    cold = {"elbow.damping": 1.15, "wrist.damping": 1.15}
    found = since("cold", cold)
    assert found["verdict"] == "ambiguous"
    assert {change["effect"] for change in found["changes"]} == {"viscous_friction"}
    assert all(BY_TEMPERATURE in change["rivals"] for change in found["changes"])
    assert any("--covariate" in note for note in found["notes"])

    warm = tmp_path / "warm.csv"
    days = [START_NS * 1e-9 + 86_400 * day for day in (-1, 1, 10, 29, 31)]
    warm.write_text("time,celsius\n" + "".join(f"{d},{c}\n" for d, c in zip(days, (21, 21, 25, 21, 21), strict=True)))
    again = since("cold", cold, "--covariate", str(warm))
    assert again["verdict"] == "explained"
    assert not any(BY_TEMPERATURE in change["rivals"] for change in again["changes"])


def test_friction_of_one_joint_is_not_the_weather(since: Callable[..., dict[str, Any]]) -> None:
    found = since("worn", {"elbow.damping": 1.15})
    assert [(change["effect"], change["joints"]) for change in found["changes"]] == [("viscous_friction", ["elbow"])]
    assert BY_TEMPERATURE not in found["changes"][0]["rivals"]
    assert found["verdict"] == "explained"


def test_a_covariate_needs_two_sessions(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", "--model", "hand.xml", "--recording", "bag", "--covariate", "warm.csv"]) == 2
    assert "--baseline or --since" in capsys.readouterr().err


def test_a_version_of_no_day_cannot_be_as_warm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, bag, warm = tmp_path / "arm.xml", tmp_path / "now.mcap", tmp_path / "warm.csv"
    model.write_text(_ARM)
    plant = TwinModel.load(load_hand(model=model))
    saved(recorded(plant, _NOW, np.random.default_rng(3), seconds=7.0), bag)
    days = (START_NS * 1e-9 + 86_400 * day for day in (-1, 1))
    warm.write_text("time,celsius\n" + "".join(f"{day},21\n" for day in days))
    given = ["--model", str(model), "--recording", str(bag), "--since", "nominal", "--covariate", str(warm)]
    assert main(["diagnose", *given]) != 0
    assert "is of no day" in capsys.readouterr().err


def _later(recording: Recording) -> Recording:
    assert recording.commands is not None
    commands = replace(recording.commands, stamp_ns=recording.commands.stamp_ns + LATER_NS)
    return replace(recording, stamp_ns=recording.stamp_ns + LATER_NS, commands=commands)

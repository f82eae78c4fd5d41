"""The hidden suite's runner, its page, and the plain baseline beside it."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.hidden_page import clopper_pearson, page
from bench.hidden_suite import _answer, results, run
from bench.plain_baseline import diagnosed
from bench.random_robots.cases import Recording, plan, plans
from bench.random_robots.dice import dice
from bench.random_robots.export import write_bag
from bench.random_robots.laws import Law, Site
from bench.random_robots.laws.sensors import Offset
from bench.random_robots.motions import commands
from bench.random_robots.plants import Plant, measured, nominal
from bench.random_robots.robots import draw_robot

_FINGER = 2  # the seed of a finger without a coupled tendon


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [(0, 10, 0.0, 0.3085), (10, 10, 0.6915, 1.0), (38, 44, 0.7265, 0.9483)],
)
def test_intervals_of_shares_are_those_of_the_tables(count: int, total: int, low: float, high: float) -> None:
    assert clopper_pearson(count, total) == pytest.approx((low, high), abs=1e-4)


def _result(kind: str, verdict: str, *found: str, strength: float = 5.0, value: float = 0.1) -> dict[str, Any]:
    effects = [] if kind == "nothing" else [{
        "effect": "spring", "joints": ["a"], "scope": "joint", "strength": strength, "parameters": {"stiffness": 0.1},
    }]  # fmt: skip
    robot = {"kind": "arm", "joints": 3, "rate_hz": 100.0}
    findings = [
        {"effect": name, "joints": ["a"], "parameters": {"stiffness": {"value": value, "ci95": [0.08, 0.12]}}}
        for name in found
    ]
    measured = {"processor_s": 10.0, "memory_mb": 300.0, "wall_s": 11.0, "commit": "abc"}
    return {
        "truth": {"case": "case_0000", "kind": kind, "effects": effects, "right": ["spring"], "robot": robot,
                  "strength": strength},
        "said": {"verdict": verdict, "findings": findings} | measured,
    }  # fmt: skip


def test_the_page_counts_what_is_right_and_what_is_surely_wrong() -> None:
    cases = [
        _result("single", "explained", "spring"),
        _result("single", "explained", "payload"),
        _result("single", "failed", strength=2.0),
        _result("nothing", "within_noise"),
    ]
    text = page(cases, 200, "test")
    assert (
        "right name first, `explained` or a tie | >= 90 %, lower bound >= 85 % | 50.0% | 1 of 2 | 1.3% to 98.7%" in text
    )
    assert "| one effect, 1.5 to 3 times the floor | - | 0.0% | 0 of 1 |" in text
    assert "| all: `explained` with a wrong name | <= 2 % | 25.0% | 1 of 4 |" in text
    assert "1 of 1 values lie in their 95 % interval (100%" in text
    assert "| nothing | 10 | 10 | 10 | 300 MB | - |" in text
    assert "4 of 200 cases have run, on commit abc" in text
    assert "| a law of no library: `unexplained` | >= 95 % | - | 0 | - | - |" in text


def test_a_diagnosis_that_does_not_end_is_stopped_and_counts_as_failed(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "import time; time.sleep(60)"]
    said = _answer(command, tmp_path / "said.json", tmp_path / "log.txt", 0.1)
    assert said is not None
    assert (said["verdict"], said["findings"]) == ("failed", [])
    assert "not ended" in said["why"]
    assert said["wall_s"] < 30


def test_what_has_run_is_not_run_again(tmp_path: Path) -> None:
    chosen = plans(2, "development")
    for one in chosen:
        (tmp_path / f"{one.name}.json").write_text('{"verdict": "unexplained"}')
        (tmp_path / f"{one.name}.truth.json").write_text(json.dumps({"case": one.name}))
    run(chosen, tmp_path, 1.0)
    assert not (tmp_path / "made").exists()
    assert [one["truth"]["case"] for one in results([*chosen, plan(99)], tmp_path)] == ["case_0000", "case_0002"]


def _recorded(folder: Path, law: type[Law] | None) -> tuple[Path, Path, Path]:
    """(model, recording, other recording) of a finger that moves for some seconds."""
    robot = replace(draw_robot(_FINGER, "finger", pair=False), rate_hz=100.0, step_s=0.002, contacts=False)
    robot = replace(robot, noise=np.full_like(robot.noise, 1e-3), integrator="implicitfast", delay_s=0.0)
    plant, laws, paths = Plant(robot, 0, "exact"), [], []
    for number, kind in enumerate(("fit", "holdout")):
        targets = commands(robot, number, kind, seconds=2.5)
        if law is not None and not laws:
            angles, peaks = nominal(robot, targets)
            site = Site(robot, 1, 1, angles[:, 1], targets[:, 1], float(peaks[1]), angles)
            laws = [law(site, dice(0, "law"))]
            laws[0].size = 0.05
        stamps, readings = measured(robot, plant.run(targets, laws), number, kind)
        paths.append(folder / kind)
        sent = np.arange(len(targets)) / robot.rate_hz
        write_bag(paths[-1], Recording(sent, targets, stamps, readings), robot.joints, robot.commands)
    (folder / "robot.xml").write_text(robot.xml)
    return folder / "robot.xml", paths[0], paths[1]


@pytest.mark.slow
def test_the_plain_baseline_names_an_offset_and_leaves_a_sound_robot_alone(tmp_path: Path) -> None:
    sound, off = tmp_path / "sound", tmp_path / "off"
    sound.mkdir()
    off.mkdir()
    assert diagnosed(*_recorded(sound, None))["verdict"] == "within_noise"
    model, fit, held = _recorded(off, Offset)
    said = diagnosed(model, fit, held)
    assert said["verdict"] == "explained"
    first = said["findings"][0]
    assert first["effect"] in ("sensor_offset", "spring")  # which a stiff servo cannot tell apart
    assert said["tried"][0]["held_over_nominal"] < 0.2
    assert said["candidates"] > 40

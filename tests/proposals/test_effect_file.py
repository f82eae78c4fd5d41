"""Effect files are data: what is broken or hostile is refused in one line and takes nothing else away."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from twin_daemon.cli.app import main
from twin_daemon.effects import LIBRARY, reload_files
from twin_daemon.effects.base import Measurement, ReadingCurve
from twin_daemon.effects.from_files import EffectFile, folder, load_effect_file, save_effect_file
from twin_daemon.proposals.formula import FAMILIES
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

PLAIN: dict[str, Any] = {
    "schema": 1,
    "name": "my_law",
    "title": "a law",
    "port": "torque",
    "over": "position",
    "unit": "N m",
    "knots": [-1.0, 0.0, 1.0],
    "values": [0.1, 0.0, -0.1],
    "visited": [-1.0, 1.0],
}

BROKEN = {
    "no such port": {"port": "os.system"},
    "not finite": {"values": [0.1, float("nan"), 0.0]},
    "too many knots": {"knots": list(range(2000)), "values": [0.0] * 2000},
    "knots that turn back": {"knots": [0.0, 1.0, 0.5]},
    "too few values": {"values": [0.1, 0.2]},
    "a path for a name": {"name": "../../etc/passwd"},
    "a path for a neighbour": {"over": "neighbour", "neighbour": "../x"},
    "a curve of one knot": {"knots": [0.1], "values": [0.1]},
    "another field": {"run": "import os"},
    "a reading without an inverse": {"port": "reading", "values": [2.0, 0.0, -2.0]},
}


def _written(content: dict[str, Any] | str, name: str = "my_law") -> Path:
    folder().mkdir(parents=True, exist_ok=True)
    path = folder() / f"{name}.effect.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content), encoding="utf-8")
    return path


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_file_is_refused_in_one_line(what: str, arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _written(PLAIN | BROKEN[what])
    assert main(["add", "my_law", "--joint", "elbow", "--model", str(arm)]) == 3
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "my_law.effect.yaml" in line
    assert len(line) < 800


@pytest.mark.parametrize(
    "text",
    ["!!python/object/apply:os.system ['touch /tmp/x']", "a: [", "x" * 100_000, "[" * 500, "\x00", ""],
    ids=["code", "no yaml", "too large", "too deep", "no text", "empty"],
)
def test_what_is_no_data_is_refused_in_one_line(text: str, arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _written(text)
    assert main(["add", "my_law", "--joint", "elbow", "--model", str(arm)]) == 3
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "my_law.effect.yaml" in line


def test_a_broken_file_takes_nothing_else_away(capsys: pytest.CaptureFixture[str]) -> None:
    _written(PLAIN)
    _written(PLAIN | {"name": "other", "port": "nothing"}, "other")
    assert main(["effects"]) == 0
    told = capsys.readouterr().out
    assert "my_law" in told
    assert "left out" in told
    assert "backlash" in LIBRARY


def test_an_effect_goes_with_its_file() -> None:
    path = save_effect_file(EffectFile.model_validate(PLAIN))
    assert reload_files() == {}
    assert "my_law" in LIBRARY
    path.unlink()
    reload_files()
    assert "my_law" not in LIBRARY


def test_an_effect_that_stays_is_in_the_library_while_files_are_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    save_effect_file(EffectFile.model_validate(PLAIN))
    reload_files()
    seen = []

    def watched(path: Path) -> EffectFile:
        seen.append("my_law" in LIBRARY)
        return load_effect_file(path)

    monkeypatch.setattr("twin_daemon.effects.discovery.load_effect_file", watched)
    reload_files()
    assert seen == [True]


def test_a_file_cannot_take_the_name_of_an_effect_of_the_library() -> None:
    _written(PLAIN | {"name": "backlash"}, "backlash")
    assert "backlash" in reload_files()
    assert LIBRARY["backlash"].title != "a law"


def test_a_reading_with_curves_has_an_inverse() -> None:
    knots = tuple(np.linspace(-1.0, 1.0, 41))
    own = ReadingCurve("", knots, tuple(0.05 * np.sin(9.0 * np.array(knots))))
    beside = ReadingCurve("a", knots, tuple(0.1 * np.array(knots)))
    measurement = Measurement(gain={"a": 1.02}, offset_rad={"b": 0.01}, curves={"a": (own,), "b": (beside,)})
    angle = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2))
    again = measurement.invert(("a", "b"), measurement.apply(("a", "b"), angle))
    assert np.abs(again - angle).max() < 1e-9


@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_a_torque_over_the_angle_holds_the_joint_where_it_balances_the_servo(twin: TwinModel, strength: float) -> None:
    """The elbow hangs still under gravity; the law pulls it by torque over stiffness."""
    save_effect_file(EffectFile.model_validate(PLAIN | {"values": [0.4, 0.4, 0.4]}))
    reload_files()
    term = EffectTerm(effect="my_law", target="elbow", values={"strength": strength})
    changed = twin.changed(Terms(effects=(term,)))
    ends = []
    for one in (twin, changed):
        controls = np.zeros((1, 2000, 2))
        ends.append(
            roll_out([one.model], controls, np.zeros((1, one.model.nq)))[
                0, -1, one.qpos_adr[twin.joints.index("elbow")]
            ]
        )
    moved = ends[1] - ends[0]
    assert moved == pytest.approx(strength * 0.4 / 8.0, abs=0.006)


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("constant", [0.1]),
        ("line", [0.1, -0.4]),
        ("above", [30.0, 0.5]),
        ("below", [30.0, -0.5]),
        ("both", [30.0, -0.5, 0.5]),
        ("sine", [0.2, 9.0, 0.7, 0.05]),
    ],
)
def test_a_formula_with_a_native_form_pulls_as_it_says(twin: TwinModel, key: str, values: list[float]) -> None:
    family = FAMILIES[key]
    at = np.array([-1.0, -0.3, 0.2, 0.9])
    told = {name: (value, value, value) for name, value in zip(family.names, values, strict=True)}
    content = EffectFile.model_validate(PLAIN | {"formula_values": told})
    save_effect_file(content)
    reload_files()
    changed = twin.changed(Terms(effects=(EffectTerm(effect="my_law", target="elbow", values={"strength": 1.0}),)))
    elbow = twin.joints.index("elbow")
    for angle, torque in zip(at, family.shape(np.array(values), at), strict=True):
        given = []
        for one in (twin, changed):
            data = mujoco.MjData(one.model)
            data.qpos[one.qpos_adr[elbow]] = angle
            mujoco.mj_forward(one.model, data)
            given.append((data.qfrc_passive + data.qfrc_actuator)[one.dof_adr[elbow]])
        assert given[1] - given[0] == pytest.approx(torque, abs=1e-6)
    assert "the whole law is in it" in LIBRARY["my_law"].story.remedy


def test_a_law_without_a_native_form_says_what_its_model_lacks() -> None:
    content = EffectFile.model_validate(PLAIN | {"port": "command", "over": "time", "factor": "error", "unit": "1"})
    save_effect_file(content)
    reload_files()
    assert "mean gain" in LIBRARY["my_law"].story.remedy


def test_a_law_that_no_model_can_have_is_not_added(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _written(PLAIN | {"over": "time", "knots": [0.0, 1.0, 2.0]})
    assert main(["add", "my_law", "--joint", "elbow", "--model", str(arm)]) == 3
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "no element" in line


def test_what_a_model_leaves_out_is_said_when_it_is_added(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _written(PLAIN)
    assert main(["add", "my_law", "--joint", "elbow", "--model", str(arm)]) == 0
    assert "sines of the angle" in " ".join(capsys.readouterr().out.split())

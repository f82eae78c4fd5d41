"""The generator of the hidden suite: robots that could exist, cases that follow from their seed, effects that show."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import bench.random_robots
from bench.random_robots.cases import STRONGEST, WEAKEST, Case, build, plan, plans
from bench.random_robots.dice import dice
from bench.random_robots.export import export
from bench.random_robots.laws import EVERYWHERE, FOREIGN, LIBRARY, Site
from bench.random_robots.motions import commands
from bench.random_robots.plants import Plant, nominal
from bench.random_robots.robots import Robot, draw_robot
from bench.random_robots.score import is_cause, outcome
from bench.random_robots.strength import NOMINAL_SIGMA, response, rms, told
from bench.random_robots.ties import ties
from bench.random_robots.trees import KINDS
from twin_daemon.effects import LIBRARY as PRODUCT
from twin_daemon.hand import load_hand
from twin_daemon.hand.schema import NominalUncertainty
from twin_daemon.recordings import load_recording

_FINGER = (2, 3)  # seeds of the finger without and with a coupled tendon
_SOUND = 50  # a gantry of two slides
_SMALL = 44  # rotor inertia in an arm of three joints, 200 Hz
_PACKAGE = Path(bench.random_robots.__file__).parent


@pytest.fixture(scope="module")
def case() -> Case:
    """A small case with one effect at one joint."""
    return build(plan(_SMALL))


def _quick(kind: str, seed: int = 0) -> tuple[Robot, np.ndarray]:
    robot = draw_robot(seed, kind)
    return robot, commands(robot, seed, "fit", seconds=3.0)


def test_the_judge_shares_no_law_with_the_library_and_no_code_with_the_diagnosis() -> None:
    for path in _PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            assert not [name for name in names if name.startswith(("twin_daemon", "bridges"))], path


def test_every_effect_of_the_library_has_a_plant_and_eight_laws_are_of_no_library() -> None:
    planted = {law.key for forms in LIBRARY for law in forms}
    foreign = {law.key for law in FOREIGN}
    assert set(PRODUCT) <= planted
    assert len(foreign) == len(FOREIGN) >= 8
    assert not foreign & set(PRODUCT)
    assert {"command_delay", "actuator_lag", "actuator_gain"} <= {law.key for law in EVERYWHERE}


def test_planted_values_bear_the_names_of_the_library() -> None:
    robot, targets = _quick("arm")
    angles, peaks = nominal(robot, targets)
    site = Site(robot, 1, 1, angles[:, 1], targets[:, 1], float(peaks[1]), angles)
    for forms in LIBRARY:
        for form in forms:
            if form.key in PRODUCT and form.at != "pair":
                known = {parameter.name for parameter in PRODUCT[form.key].parameters}
                assert set(form(site, dice(0, "law")).values()) <= known, form


def test_both_halves_hold_the_same_kinds_and_no_seed_is_in_both() -> None:
    halves = {half: plans(200, half) for half in ("development", "test")}
    kinds = {half: sorted(plan.kind for plan in chosen) for half, chosen in halves.items()}
    laws = {half: {law for plan in chosen for law in plan.laws} for half, chosen in halves.items()}
    assert kinds["development"] == kinds["test"]
    assert kinds["test"].count("single") == 100
    assert laws["development"] == laws["test"] == {law for forms in LIBRARY for law in forms} | {*EVERYWHERE, *FOREIGN}
    assert not {plan.seed for plan in halves["development"]} & {plan.seed for plan in halves["test"]}
    assert {plan.half for plan in plans(9, "test", first=4)} == {"test"}


def test_the_same_seed_is_the_same_case_to_the_last_bit() -> None:
    first, again = (build(plan(_SOUND)) for _ in range(2))
    assert again.robot.xml == first.robot.xml
    one, other = first.recording("fit"), again.recording("fit")
    assert np.array_equal(one.readings, other.readings)
    assert np.array_equal(one.stamps_s, other.stamps_s)
    assert not np.array_equal(one.targets[:500], first.targets("holdout")[:500])


@pytest.mark.parametrize("kind", KINDS)
def test_a_robot_could_exist_and_its_nominal_model_follows(kind: str) -> None:
    for seed in range(2):
        robot = replace(draw_robot(seed, kind), contacts=False)
        model = mujoco.MjModel.from_xml_string(robot.xml)
        assert [model.joint(i).name for i in range(model.njnt)] == list(robot.joints)
        assert (model.body_mass[2:] > 0).all()
        inertia = model.body_inertia[2:]
        assert (inertia.sum(axis=1) >= 2 * inertia.max(axis=1) * (1 - 1e-6)).all()  # of a body that has a shape
        assert 1e-5 * 0.79 <= robot.noise.max() <= 3e-3 * 1.26
        targets = commands(robot, seed, "fit", seconds=2.0)
        for index, servo in enumerate(robot.servos):
            assert servo.low <= targets[:, index].min() < targets[:, index].max() <= servo.high
        angles, _ = nominal(robot, targets)
        low, high = model.jnt_range.T
        assert (angles > low - 0.15 * (high - low)).all()
        assert (angles < high + 0.15 * (high - low)).all()


def test_a_plant_without_laws_and_errors_is_its_nominal_model_up_to_the_time_step() -> None:
    robot, targets = _quick("arm", 7)
    exact, off = (Plant(robot, 7, error).run(targets) for error in ("exact", "bodies"))
    fine, _ = nominal(robot, targets, Plant(robot, 7).clock.step_s)
    assert rms(exact - fine).max() < 1e-4
    assert rms(off - fine).max() > rms(exact - fine).max()


_FORMS = [form for forms in (*LIBRARY, tuple(EVERYWHERE), tuple(FOREIGN)) for form in forms]


@cache
def _small(pair: bool) -> tuple[Plant, np.ndarray, np.ndarray, Site]:
    """A finger, what drives it for some seconds, what its sound plant reads, and the place of a law."""
    robot = replace(draw_robot(_FINGER[pair], "finger", pair), rate_hz=100.0, step_s=0.002, contacts=False)
    targets = commands(robot, 5, "fit", seconds=2.5)
    angles, peaks = nominal(robot, targets)
    servo = next(i for i, one in enumerate(robot.servos) if len(one.joints) == 1 + pair)
    joint = robot.servos[servo].joints[-1]
    site = Site(robot, joint, servo, angles[:, joint], targets[:, servo], float(peaks[servo]), angles)
    plant = Plant(robot, 5)
    return plant, targets, plant.run(targets), site


@pytest.mark.parametrize("form", _FORMS, ids=lambda form: form.__name__)
def test_a_law_changes_what_is_read_and_more_so_when_it_is_larger(form: Any) -> None:
    plant, targets, sound, site = _small(form.at == "pair")
    law = form(site, dice(1, "law"))
    moved = []
    low, high = np.log(form.sizes)
    for share in (0.0, 0.75):
        law.size = float(np.exp(low + share * (high - low)))
        moved.append(float(rms(plant.run(targets, [law]) - sound).max()))
    assert moved[1] > max(3 * moved[0], 1e-5)


def test_a_hidden_effect_is_as_strong_as_was_drawn(case: Case) -> None:
    hidden = case.hidden[0]
    assert WEAKEST <= hidden.strength <= 1.2 * STRONGEST
    targets = case.targets("fit")
    sound = case.plant.run(targets)
    floor = np.hypot(case.robot.floor(), rms(sound - nominal(case.robot, targets)[0]))
    moved = rms(case.plant.run(targets, [hidden.law]) - sound) / floor
    joint = case.robot.joints.index(hidden.law.places[0])
    assert told(hidden.law, moved[joint]) == pytest.approx(hidden.strength, rel=1e-6)
    assert np.argmax(moved) == joint


def test_a_change_within_what_is_known_of_the_model_is_weak_however_well_it_is_seen() -> None:
    assumed = NominalUncertainty()
    assert {assumed.of(kind) for kind in ("damping", "frictionloss", "armature", "kp")} == {NOMINAL_SIGMA}
    gain = next(form for forms in LIBRARY for form in forms if form.key == "actuator_gain")
    _, _, _, site = _small(pair=False)
    law = gain(site, dice(1, "law"))
    law.size = 0.12
    assert told(law, 100.0) == pytest.approx(1.0, rel=1e-3)
    law.size = 0.5
    assert told(law, 1.0) == pytest.approx(1.0, rel=0.05)
    assert told(law, 100.0) == pytest.approx(0.5 / 0.12, rel=1e-2)


def test_an_exported_case_is_read_by_the_product_and_by_the_scorer(case: Case, tmp_path: Path) -> None:
    export(case, tmp_path)
    name = case.plan.name
    hand = load_hand(model=tmp_path / f"{name}.xml")
    assert set(hand.joints) == set(case.robot.joints)
    recording = load_recording(tmp_path / f"{name}_fit")
    assert set(recording.joints) == set(case.robot.joints)
    assert set(recording.commands.names if recording.commands else ()) == set(case.robot.commands)
    truth = json.loads((tmp_path / f"{name}.truth.json").read_text())
    assert truth["right"][0] == truth["effects"][0]["effect"] == case.plan.laws[0].key
    assert name in (tmp_path / "SEALED.sha256").read_text()
    said = {
        "verdict": "explained",
        "findings": [{"effect": truth["right"][0], "joints": truth["joints"], "confusable_with": []}],
    }
    (tmp_path / f"{name}.json").write_text(json.dumps(said))
    ran = subprocess.run([sys.executable, "score.py", "."], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "single: 1 of 1 right, 0 explained with a wrong name" in ran.stdout


def _truth(kind: str, *effects: dict[str, Any], right: tuple[str, ...] = ()) -> dict[str, Any]:
    return {"kind": kind, "effects": list(effects), "right": list(right)}


def _effect(key: str, *joints: str, scope: str = "joint") -> dict[str, Any]:
    return {"effect": key, "joints": list(joints), "scope": scope}


def _said(verdict: str, *findings: tuple[str, list[str], list[str]]) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "findings": [{"effect": e, "joints": j, "confusable_with": c} for e, j, c in findings],
    }


@pytest.mark.parametrize(
    ("truth", "said", "right", "sure_and_wrong"),
    [
        (_truth("nothing"), _said("within_noise"), True, False),
        (_truth("nothing"), _said("explained", ("spring", ["a"], [])), False, True),
        (_truth("foreign", _effect("x", "a")), _said("unexplained", ("spring", ["a"], [])), True, False),
        (_truth("single", _effect("spring", "a")), _said("explained", ("spring", ["a"], [])), True, False),
        (_truth("single", _effect("spring", "a")), _said("explained", ("spring", ["b"], [])), False, True),
        (_truth("single", _effect("spring", "a")), _said("unexplained", ("spring", ["a"], [])), False, False),
        (_truth("single", _effect("sensor_gain", "a"), right=("sensor_gain", "spring")),
         _said("ambiguous", ("spring", ["a"], ["sensor_gain:a"])), True, False),
        (_truth("single", _effect("sensor_gain", "a"), right=("sensor_gain", "spring")),
         _said("ambiguous", ("spring", ["a"], ["sensor_gain:a", "payload:a"])), False, False),
        (_truth("robot", _effect("command_delay", "a", "b", scope="robot")),
         _said("explained", ("command_delay", ["a", "b"], [])), True, False),
        (_truth("robot", _effect("command_delay", "a", "b", scope="robot")),
         _said("explained", ("command_delay", ["a"], []), ("command_delay", ["b"], [])), False, True),
        (_truth("pair", _effect("spring", "a"), _effect("payload", "b")),
         _said("explained", ("payload", ["b"], []), ("spring", ["a"], [])), True, False),
        (_truth("pair", _effect("spring", "a"), _effect("payload", "b")),
         _said("explained", ("payload", ["b"], [])), False, False),
    ],
)  # fmt: skip
def test_what_is_right_follows_from_what_was_hidden(
    truth: dict[str, Any], said: dict[str, Any], right: bool, sure_and_wrong: bool
) -> None:
    assert outcome(truth, said) == {"right": right, "sure_and_wrong": sure_and_wrong}


def test_of_a_foreign_law_only_that_counts_which_no_simple_law_takes() -> None:
    _, _, sound, site = _small(False)
    floor = np.full(sound.shape[1], 1e-3)
    like_a_spring = sound.copy()
    like_a_spring[:, site.joint] *= 1.05
    strange = sound.copy()
    strange[:, site.joint] += 0.01 * np.sin(40 * sound[:, site.joint])
    eccentric = next(law for law in FOREIGN if law.key == "x_eccentric_sensor")(site, dice(0, "law"))
    offset = next(forms[0] for forms in LIBRARY if forms[0].key == "sensor_offset")(site, dice(0, "law"))
    assert response(eccentric, like_a_spring, sound, floor) < 0.1 < response(offset, like_a_spring, sound, floor)
    assert response(eccentric, strange, sound, floor) > 3


def test_a_short_delay_and_a_short_lag_are_a_tie_and_long_ones_are_none() -> None:
    _, _, _, site = _small(False)
    delay = next(forms[0] for forms in LIBRARY if forms[0].key == "command_delay")(site, dice(0, "law"))
    delay.size = 1e-3
    assert "actuator_lag" in ties(delay, 3.0)
    delay.size = 1.0
    assert "actuator_lag" not in ties(delay, 100.0)


@pytest.mark.parametrize(
    ("causes", "truth", "right"),
    [
        (["nothing"], _truth("nothing"), True),
        (["unknown"], _truth("nothing"), False),
        (["unknown"], _truth("foreign", _effect("x", "F1J3")), True),
        (["spring:F1J3"], _truth("single", _effect("spring", "F1J3")), True),
        (["payload:F1J3"], _truth("single", _effect("spring", "F1J3")), False),
        (["spring:F1J3"], _truth("single", _effect("spring", "F1J1")), False),
        (["spring:F1J3"], _truth("single", _effect("spring", "F1J2", "F1J1", "F1J0")), False),
        (["spring:joint_3"], _truth("single", _effect("spring", "joint_4")), False),
        (["spring:F1J0"], _truth("single", _effect("spring", "F1J2")), True),
        (["spring:F1J0"], _truth("single", _effect("spring", "F1J3")), False),
        (["spring:F2J0"], _truth("single", _effect("spring", "F1J1")), False),
        (["lag:robot"], _truth("robot", _effect("lag", "lift", "elbow", scope="robot")), True),
        (["gravity_tilt:hand"], _truth("robot", _effect("gravity_tilt", "lift", "elbow", scope="robot")), True),
        (["lag:lift"], _truth("robot", _effect("lag", "lift", "elbow", scope="robot")), False),
        (["lag:lift"], _truth("robot", _effect("lag", "lift", scope="robot")), True),
        (["lag:F1J0"], _truth("robot", _effect("lag", "F1J2", "F1J1", scope="robot")), True),
        (["spring:a", "payload:b"], _truth("pair", _effect("payload", "b"), _effect("spring", "a")), True),
        (["spring:a"], _truth("pair", _effect("payload", "b"), _effect("spring", "a")), False),
    ],
)
def test_a_set_of_causes_is_right_where_each_is_named_at_its_own_place(
    causes: list[str], truth: dict[str, Any], right: bool
) -> None:
    assert is_cause(causes, truth) is right

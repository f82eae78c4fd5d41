"""Two sessions of one robot: a change is named with its size, and where nothing has changed nothing is named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded, saved
from twin_daemon.changes.group import Sessions, begun, group_of
from twin_daemon.changes.quantities import quantities, term_of, with_companions
from twin_daemon.cli.app import main
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore
from twin_daemon.versions.version import Draft, ParameterRecord, RecordingUsed

JOINT = "elbow"
OFF = {f"{JOINT}.damping": 0.23, f"{JOINT}.frictionloss": 0.017, f"{JOINT}.kp": 3.5}  # the hand, not the model

_MODEL = """<mujoco model="elbow"><compiler angle="radian"/><option timestep="0.002"/><worldbody><body name="link">
<joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
_ARM = """<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002"/><worldbody><body name="link">
<joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/>
<body name="tip" pos="0.2 0 0"><joint name="wrist" axis="0 1 0" range="-1.5 1.5" damping="0.05" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.02" mass="0.1" contype="0" conaffinity="0"/></body></body>
</worldbody><actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5"/>
<position name="wrist" joint="wrist" kp="2" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
_HEALTHY: Motion = {
    JOINT: (
        [0.0, 0.4, 0.41, 1.2, 2.2, 2.5, 2.51, 3.2, 3.8, 4.4, 4.41, 5.5, 6.5, 7.0],
        [0.0, 0.0, 0.6, 0.6, -0.5, -0.5, 0.1, 0.1, 0.3, 0.1, -0.3, -0.3, 0.4, 0.4],
    )
}
_NOW: Motion = {
    JOINT: (
        [0.0, 0.3, 0.31, 1.0, 1.9, 2.6, 2.61, 3.0, 3.9, 4.3, 4.31, 5.2, 6.3, 7.0],
        [0.1, 0.1, -0.5, -0.5, 0.4, 0.4, 0.7, 0.7, 0.2, 0.3, -0.1, -0.1, -0.6, -0.2],
    )
}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("elbow") / "elbow.xml"
    path.write_text(_MODEL)
    return path


@pytest.fixture(scope="module")
def since(model: Path) -> Callable[..., dict[str, Any]]:
    """What `twin diagnose --baseline` writes about a hand of which some things are other ones than before."""

    def made(name: str, motion: Motion, seed: int, terms: Terms) -> Path:
        plant = TwinModel.load(load_hand(model=model)).changed(terms).at_step(0.0005)
        one = recorded(plant, motion, np.random.default_rng(seed), seconds=7.0, noise_rad=1e-3, name=name)
        return saved(one, model.parent / f"{name}.mcap")

    @cache
    def healthy() -> Path:
        return made("healthy", _HEALTHY, 1, Terms(parameters=OFF))

    answers: dict[str, dict[str, Any]] = {}

    def answer(name: str, factors: dict[str, float], *effects: EffectTerm) -> dict[str, Any]:
        if name in answers:
            return answers[name]
        worn = Terms(parameters={k: v * factors.get(k, 1.0) for k, v in OFF.items()}, effects=effects)
        now = made(name, _NOW, 2, worn)
        path = model.parent / f"{name}.json"
        given = ["--model", str(model), "--recording", str(now), "--baseline", str(healthy())]
        assert main(["diagnose", *given, "--json", str(path)]) == 0
        answers[name] = json.loads(path.read_text())
        return answers[name]

    return answer


@pytest.mark.parametrize(
    ("kind", "factor", "effect"),
    [
        ("damping", 1.3, "viscous_friction"),
        ("frictionloss", 1.6, "coulomb_friction"),
        ("kp", 0.75, "actuator_gain"),
    ],
)
@pytest.mark.slow
def test_a_parameter_that_has_changed_is_named_with_how_much(
    since: Callable[..., dict[str, Any]], kind: str, factor: float, effect: str
) -> None:
    found = since(kind, {f"{JOINT}.{kind}": factor})
    change = found["changes"][0]
    assert (change["effect"], change["parameter"], change["joints"]) == (effect, f"{JOINT}.{kind}", [JOINT])
    assert len(found["changes"]) == 1
    assert change["probability"] > 0.5
    assert change["ratio"]["value"] == pytest.approx(factor, rel=0.06)
    assert change["before"]["value"] == pytest.approx(OFF[f"{JOINT}.{kind}"], rel=0.1)
    assert change["ratio"]["ci95"][0] < change["ratio"]["value"] < change["ratio"]["ci95"][1]
    assert change["first_seen"].startswith("2023-11-14T")
    assert found["verdict"] in ("explained", "ambiguous")
    first = found["findings"][0]
    assert (first["effect"], first["joints"]) == (effect, [JOINT])
    rivals = {rival.partition(":")[0] for rival in change["rivals"]}
    assert rivals <= ({"tendon_elasticity"} if kind == "kp" else set()), "in series with a servo a tendon yields alike"
    assert change["remedy"]


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("sensor_gain", {"factor": 0.94}),
        ("nonlinear_spring", {"cubic": 1.2, "centre": 0.3}),
        ("spring", {"stiffness": 0.3, "preload": 0.1}),
    ],
)
@pytest.mark.slow
def test_an_effect_that_has_appeared_is_named_with_its_values(
    since: Callable[..., dict[str, Any]], effect: str, values: dict[str, float]
) -> None:
    found = since(effect, {}, EffectTerm(effect=effect, target=JOINT, values=values))
    change, first = found["changes"][0], found["findings"][0]
    assert len(found["changes"]) == 1
    assert (change["effect"], change["joints"]) == (effect, [JOINT])
    assert {rival.partition(":")[0] for rival in change["rivals"]} <= {"spring", "sensor_gain", "actuator_gain"}
    assert change["now"]["value"] == pytest.approx(next(iter(values.values())), rel=0.15)
    for name, value in values.items():
        assert first["values"][name] == pytest.approx(value, rel=0.15, abs=0.05), name


@pytest.mark.slow
@pytest.mark.parametrize("another_day", [False, True])
def test_a_load_that_has_been_put_on_is_one_change_of_all_joints_that_carry_it(
    tmp_path: Path, another_day: bool
) -> None:
    """On another day the joints have a little more or less of all that they have, which is not held against a load."""
    model = tmp_path / "arm.xml"
    model.write_text(_ARM)
    off = {"elbow.damping": 0.23, "elbow.kp": 3.6, "wrist.kp": 2.2}
    elsewhere = {"elbow.damping": 0.22, "elbow.kp": 3.75, "wrist.kp": 2.1}
    load = EffectTerm(effect="payload", target="wrist", values={"mass": 0.06})
    sessions: list[tuple[str, Motion, Terms]] = [
        ("--baseline", _HEALTHY, Terms(parameters=off)),
        ("--recording", _NOW, Terms(parameters=off, effects=(load,))),
        ("--holdout", _HEALTHY, Terms(parameters=elsewhere, effects=(load,))),
    ]
    given = ["--model", str(model)]
    for seed, (option, motion, terms) in enumerate(sessions if another_day else sessions[:2]):
        points = motion[JOINT]
        both: Motion = {JOINT: points, "wrist": (points[0], [-0.7 * target for target in reversed(points[1])])}
        plant = TwinModel.load(load_hand(model=model)).changed(terms).at_step(0.0005)
        one = recorded(plant, both, np.random.default_rng(seed), seconds=7.0, noise_rad=1e-3, name=f"bag{seed}")
        given += [option, str(saved(one, tmp_path / f"bag{seed}.mcap"))]
    path = tmp_path / "found.json"
    assert main(["diagnose", *given, "--json", str(path)]) == 0
    found = json.loads(path.read_text())
    (change,) = found["changes"]
    assert change["effect"] == "payload"
    assert set(change["joints"]) == {"elbow", "wrist"}
    assert change["now"]["value"] == pytest.approx(0.06, rel=0.1)
    assert change["before"]["value"] is None


@pytest.mark.slow
def test_a_tendon_that_has_become_softer_is_no_weaker_servo_where_the_motor_shows(model: Path, tmp_path: Path) -> None:
    """The earlier session shows that there is one: what it takes off that session is no evidence of a change."""
    given = ["--model", str(model)]
    for seed, (option, motion, stiffness) in enumerate((("--baseline", _HEALTHY, 6.0), ("--recording", _NOW, 3.6))):
        values = {"stiffness": stiffness, "motor_share": 0.05, "damping_share": 0.6}
        tendon = EffectTerm(effect="tendon_elasticity", target=JOINT, values=values)
        plant = TwinModel.load(load_hand(model=model)).changed(Terms(parameters=OFF, effects=(tendon,))).at_step(0.0005)
        one = recorded(plant, motion, np.random.default_rng(seed), seconds=7.0, noise_rad=1e-3, name=f"bag{seed}")
        given += [option, str(saved(one, tmp_path / f"bag{seed}.mcap"))]
    path = tmp_path / "found.json"
    assert main(["diagnose", *given, "--json", str(path)]) == 0
    found = json.loads(path.read_text())
    first = found["changes"][0]
    named = {first["effect"], *(rival.partition(":")[0] for rival in first["rivals"])}
    assert "tendon_elasticity" in named <= {"tendon_elasticity", "actuator_gain"}
    if first["effect"] == "tendon_elasticity":
        assert first["ratio"]["ci95"][0] < 0.6 < first["ratio"]["ci95"][1]


def test_what_is_said_beside_an_effect_is_no_change_of_its_own(model: Path) -> None:
    every = quantities(TwinModel.load(load_hand(model=model)), (JOINT,))
    names = [quantity.name for quantity in every]
    spring, preload = names.index(f"spring:{JOINT}.stiffness"), names.index(f"spring:{JOINT}.preload")
    assert with_companions(every, [spring]) == {spring, preload}
    assert [every[spring].wears, every[preload].wears] == [True, False]
    stiffens = next(quantity for quantity in every if quantity.effect == "nonlinear_spring")
    term = stiffens.term(1.0, {"centre": 0.4})
    assert term.values == {"cubic": pytest.approx(stiffens.typical), "centre": 0.4}
    gives = names.index(f"tendon_elasticity:{JOINT}.stiffness")
    braked = term_of(every, gives, np.where(np.arange(len(every)) == gives, 0.5, 0.0))
    assert braked.values["stiffness"] == pytest.approx(2.0 * every[gives].typical)
    assert braked.values["damping_share"] == pytest.approx(0.5), "where nothing is known of it"


def test_where_nothing_has_changed_nothing_is_named_and_what_would_have_been_seen_is_said(
    since: Callable[..., dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    found = since("same", {})
    assert (found["verdict"], found["changes"], found["findings"]) == ("within_noise", [], [])
    seen = {one["effect"]: one["least_ratio"] for one in found["unchanged"]}
    assert 1.0 < seen["viscous_friction"] < 1.25
    assert 1.0 < seen["actuator_gain"] < 1.25
    assert "nothing that these recordings would show has changed" in " ".join(capsys.readouterr().out.split())


def test_since_a_version_takes_the_recordings_that_it_was_fitted_to_or_its_values_where_they_are_gone(
    since: Callable[..., dict[str, Any]], model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    since("same", {})
    healthy, now = model.parent / "healthy.mcap", model.parent / "same.mcap"
    monkeypatch.setenv("TWIN_STATE_DIR", str(tmp_path))
    hand, seen = load_hand(model=model), load_recording(healthy)
    interval = {name: ParameterRecord(value=v, ci95=(0.97 * v, 1.03 * v)) for name, v in OFF.items()}
    terms = Terms(parameters=OFF)
    draft = Draft(
        hand=hand.name,
        kind="calibrated",
        terms=terms.as_json(),
        parameters=interval,
        fitted_on=(RecordingUsed(name=seen.name, sha256=seen.sha256),),
    )
    store = VersionStore.of(hand)
    version = store.add(draft, TwinModel.load(hand, terms).mjcf())
    store.promote(version.id, force=True, reason="known to be right")
    (tmp_path / "recordings").mkdir()
    kept = tmp_path / "recordings" / healthy.name
    shutil.copy(healthy, kept)
    asked = ["diagnose", "--model", str(model), "--recording", str(now), "--json", str(tmp_path / "found.json")]

    assert main([*asked, "--since", version.id[:8]]) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert (found["verdict"], found["since_version"]) == ("within_noise", version.id)
    assert [read["name"] for read in found["baseline"]] == [seen.name]

    kept.unlink()
    assert main([*asked, "--since", "2126-01-01"]) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert (found["verdict"], found["baseline"], found["since_version"]) == ("within_noise", [], version.id)
    assert any("its values stand for them" in note for note in found["notes"])
    assert main([*asked, "--since", "1999-01-01"]) == 3


def test_the_same_recording_twice_is_refused(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plant = TwinModel.load(load_hand(model=model))
    one = recorded(plant, _NOW, np.random.default_rng(3), seconds=7.0, name="twice")
    bag = str(saved(one, model.parent / "twice.mcap"))
    assert main(["diagnose", "--model", str(model), "--recording", bag, "--baseline", bag]) == 3
    assert "same recording" in capsys.readouterr().err


def test_options_that_exclude_each_other_are_refused(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bags = ["--recording", "a.mcap", "--baseline", "b.mcap"]
    assert main(["diagnose", "--model", str(model), *bags, "--since", "nominal"]) == 2
    assert "--since and --baseline" in capsys.readouterr().err
    assert main(["diagnose", "--model", str(model), *bags, "--cluster", "tcp://127.0.0.1:1"]) == 2
    assert "--cluster" in capsys.readouterr().err


def test_an_effect_is_looked_for_only_where_the_later_session_is_off(
    since: Callable[..., dict[str, Any]], model: Path
) -> None:
    """What the model gets wrong in both sessions alike has not appeared in the later one."""
    since("same", {})
    stiff = EffectTerm(effect="nonlinear_spring", target=JOINT, values={"cubic": 1.0})
    twin = TwinModel.load(load_hand(model=model))
    plant = twin.changed(Terms(parameters=OFF, effects=(stiff,))).at_step(0.0005)
    off = recorded(plant, _NOW, np.random.default_rng(3), seconds=7.0, noise_rad=1e-3, name="off")
    healthy, same = (align(twin, load_recording(model.parent / f"{name}.mcap")) for name in ("healthy", "same"))
    asked = []
    for now in (same, align(twin, off)):
        (group,) = drive_groups(twin)
        (reduced,) = Reduction(twin, [healthy], [now]).each(twin, [(group, [JOINT])])
        assert reduced is not None
        sessions = Sessions(before=tuple(reduced.train), now=tuple(reduced.holdout))
        asked.append(group_of(begun(reduced, sessions, quantities(twin, (JOINT,)))).without.asks_for_an_effect)
    assert asked == [False, True]

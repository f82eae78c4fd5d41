"""How sure a version is of its values: together, over time, and where its own recordings say nothing."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded, saved
from twin_daemon.cli.app import main
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, ParameterRecord, VersionStore
from twin_daemon.versions.posterior import after_fit, intervals, posterior_of, widened

_START = datetime(2026, 1, 1, tzinfo=UTC)
_MODEL = """<mujoco model="two"><compiler angle="radian"/><option timestep="0.002"/><worldbody>
<body name="one"><joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body>
<body name="two" pos="0 1 0">
<joint name="wrist" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5"/>
<position name="wrist" joint="wrist" kp="4" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
_TIMES = [0.0, 0.4, 0.41, 1.2, 2.2, 2.5, 2.51, 3.2, 3.8, 4.4, 4.41, 5.0]
_TARGETS = [0.0, 0.0, 0.6, 0.6, -0.5, -0.5, 0.1, 0.1, 0.3, 0.1, -0.3, -0.3]


def _record(value: float, sigma: float, seen: str = "identifiable") -> ParameterRecord:
    half = 1.959963984540054 * sigma
    return ParameterRecord(value=value, unit="u", ci95=(value - half, value + half), identifiable=seen)


def test_values_that_were_fitted_together_keep_their_correlation_and_others_what_was_known() -> None:
    correlation = np.array([[1.0, -0.8], [-0.8, 1.0]])
    first = after_fit({"a": _record(2.0, 0.1), "b": _record(4.0, 0.2)}, [(("a", "b"), correlation)], None)
    assert first.covariance[0][1] == pytest.approx(-0.8 * 0.1 * 0.2)
    assert (first.names, first.not_excited) == (("a", "b"), ())
    later = widened(first, 9.0)  # 1 % of a value by the square root of a week
    assert later.covariance[0][0] == pytest.approx(0.1**2 + 0.06**2)

    # the next session sees a well, b hardly; and knows something of c
    second = after_fit({"a": _record(2.2, 0.05), "b": _record(3.9, 3.0, "not_identifiable")}, [], later)
    known = intervals(second)
    assert known["a"].value == 2.2
    assert second.covariance[0][0] == pytest.approx(0.05**2)
    assert known["b"].value == 4.0, "what it cannot see stays what it was"
    assert second.covariance[1][1] == pytest.approx(later.covariance[1][1])
    assert second.not_excited == ("b",)
    third = after_fit({"c": _record(1.0, 0.1)}, [], second)
    assert (third.names, third.not_excited) == (("c", "a", "b"), ("a", "b"))
    assert intervals(third)["a"].value == 2.2


def test_a_covariance_stays_one(rng: np.random.Generator) -> None:
    known = None
    for _ in range(20):
        names = [n for n in "abcdef" if rng.random() < 0.7] or ["a"]
        root = rng.normal(size=(len(names), len(names)))
        matrix = root @ root.T
        sigma = np.sqrt(np.diag(matrix))
        fitted = {n: _record(1.0 + rng.normal(0, 0.1), float(rng.uniform(0.01, 0.4))) for n in names}
        known = widened(after_fit(fitted, [(tuple(names), matrix / np.outer(sigma, sigma))], known), 1.0)
        assert np.linalg.eigvalsh(np.array(known.covariance)).min() > 0.0


def test_a_version_without_fitted_values_knows_nothing_and_stays_so() -> None:
    nothing = after_fit({}, [], None)
    assert widened(nothing, weeks=4.0) == nothing
    assert after_fit({}, [], nothing) == nothing


def test_a_version_of_before_gets_one_of_its_intervals(tmp_path: Path, mjcf: str) -> None:
    store = VersionStore("hand", root=tmp_path, shipped=tmp_path / "none", now=lambda: _START)
    draft = Draft(hand="hand", kind="calibrated", terms={}, parameters={"a": _record(2.0, 0.1)})
    version = store.add(draft, mjcf)
    assert version.posterior is None
    found = posterior_of(version, _START + timedelta(weeks=4))
    assert found.covariance[0][0] == pytest.approx(0.1**2 + 0.04**2)
    sealed = store.add(draft.model_copy(update={"posterior": posterior_of(version)}), mjcf)
    assert sealed.id != version.id, "how sure it is is part of what it is"
    assert store.get(sealed.id).posterior == posterior_of(version)
    with pytest.raises(ValueError, match="differ in length"):
        found.model_validate(found.model_dump() | {"means": []})


def test_a_calibration_stores_what_it_knows_and_the_next_one_keeps_what_it_cannot_see(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TWIN_STATE_DIR", str(tmp_path / "state"))
    model = tmp_path / "two.xml"
    model.write_text(_MODEL)
    plant = TwinModel.load(load_hand(model=model)).changed(
        Terms(parameters={"elbow.damping": 0.25, "wrist.damping": 0.3})
    )

    def calibrated(name: str, motion: Motion, *more: str) -> dict[str, Any]:
        bag = saved(
            recorded(plant, motion, np.random.default_rng(1), seconds=5.0, name=name), tmp_path / f"{name}.mcap"
        )
        given = ["--model", str(model), "--recording", str(bag), "--search", "least-squares", *more]
        assert main(["calibrate", *given, "--json", str(tmp_path / "out.json")]) == 0
        version = json.loads((tmp_path / "out.json").read_text())["version"]
        assert main(["versions", "show", version, "--model", str(model), "--json", str(tmp_path / "out.json")]) == 0
        return json.loads((tmp_path / "out.json").read_text())

    both = calibrated("both", {"elbow": (_TIMES, _TARGETS), "wrist": (_TIMES, _TARGETS[::-1])})
    first = both["posterior"]
    assert {"elbow.damping", "wrist.damping"} <= set(first["names"])
    covariance = np.array(first["covariance"])
    assert (np.abs(covariance - np.diag(np.diag(covariance))) > 0.0).any(), "values of one joint trade off"
    one = calibrated("one", {"elbow": (_TIMES, _TARGETS[::-1])}, "--version", both["id"])["posterior"]
    place, before = one["names"].index("wrist.damping"), first["names"].index("wrist.damping")
    assert one["means"][place] == first["means"][before]
    assert one["covariance"][place][place] == pytest.approx(first["covariance"][before][before], rel=0.01)
    assert "wrist.damping" in one["not_excited"]
    assert "elbow.damping" not in one["not_excited"]

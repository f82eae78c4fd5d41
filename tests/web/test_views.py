"""What the panels ask for: the residual at a glance, what it depends on, where the bodies are."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.processes.conftest import Twin, until
from tests.simulation.made import FINGER, recorded, saved
from tests.web.conftest import Workbench
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import Draft, VersionStore

GAP_RAD = 0.03


@pytest.fixture(scope="module")
def loose(tmp_path_factory: pytest.TempPathFactory) -> tuple[TwinModel, Path]:
    """A finger with play, and a recording of it."""
    play = EffectTerm(effect="backlash", target="rh_FFJ3", values={"gap": GAP_RAD, "motor_share": 0.2})
    twin = TwinModel.load(load_hand()).changed(Terms().with_effect(play))
    path = tmp_path_factory.mktemp("bags") / "loose.mcap"
    return twin, saved(recorded(twin, FINGER, np.random.default_rng(4)), path)


@pytest.fixture(scope="module")
def served(loose: tuple[TwinModel, Path], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workbench]:
    with Twin(tmp_path_factory.mktemp("served")) as processes:
        running = Workbench(processes, "--recording", str(loose[1]))
        yield running
        assert running.end() == 0


def recording(served: Workbench) -> str:
    return served.ask("/api/recordings")[1]["recordings"][0]["id"]


def asked(served: Workbench, path: str) -> dict[str, Any]:
    def ready() -> dict[str, Any] | None:
        found = served.ask(path)[1]
        return None if found.get("pending") or found.get("curves_pending") else found

    return until(ready, 60.0)


def test_the_figures_of_the_page_are_those_of_the_command_line(
    served: Workbench, loose: tuple[TwinModel, Path]
) -> None:
    found = asked(served, f"/api/errors?recording={recording(served)}&version=nominal")
    code, out, err = served.twin.run("compare", "--recording", str(loose[1]), "--version", "nominal", "--json", "-")
    assert code == 0, err
    said = json.loads(out)
    assert found["mse_rad2"] == pytest.approx(said["mse_rad2"], rel=1e-9)
    for name, error in found["joints"].items():
        for figure in ("mse_rad2", "rmse_rad", "max_abs_rad", "bias_rad", "lag_s"):
            assert error[figure] == pytest.approx(said["joints"][name][figure], rel=1e-9), (name, figure)
    glance = asked(served, f"/api/overview?recording={recording(served)}&version=nominal")
    assert [one["name"] for one in glance["joints"]] == list(found["joints"])
    assert glance["joints"][0]["name"] == "rh_FFJ3"
    assert max(map(abs, glance["joints"][0]["spark"])) == pytest.approx(
        1e3 * found["joints"]["rh_FFJ3"]["max_abs_rad"], abs=1e-3
    )


def test_the_error_of_a_loose_finger_depends_on_its_direction_(
    served: Workbench,
) -> None:
    base = f"/api/dependence?recording={recording(served)}&version=nominal&joint=rh_FFJ3"
    plots = {one["name"]: one for one in asked(served, base)["plots"]}
    assert list(plots) == ["position", "velocity", "load", "time since a reversal"]
    assert [plots[name]["unit"] for name in plots] == ["rad", "rad/s", "N m", "s"]
    (_, up), (_, down) = plots["position"]["points"]["moving up"], plots["position"]["points"]["moving down"]
    apart_mrad = np.median(down) - np.median(up)
    assert apart_mrad == pytest.approx(1e3 * GAP_RAD, rel=0.25)
    for joint in ("rh_WRJ1", "nobody"):  # one that rests, and none
        assert served.ask(base.replace("rh_FFJ3", joint))[0] == 400


def test_what_a_version_says_of_the_error_lies_on_the_points(workbench: Any, loose: tuple[TwinModel, Path]) -> None:
    twin, path = loose
    hand = load_hand()
    stored = VersionStore(hand.name).add(
        Draft(hand=hand.name, kind="effect_added", title="play", terms=twin.terms.as_json()), twin.mjcf()
    )
    served = workbench("--recording", str(path))
    found = asked(
        served,
        f"/api/dependence?recording={recording(served)}&version=nominal&joint=rh_FFJ3&against={stored.id}",
    )
    plot = found["plots"][0]
    for way in ("moving up", "moving down"):
        _, points = plot["points"][way]
        _, curve = plot["curves"][stored.id][way]
        assert np.median([value for value in curve if value is not None]) == pytest.approx(np.median(points), abs=3.0)


def test_curves_are_what_was_asked_for_of_a_joint(served: Workbench) -> None:
    base = f"recording={recording(served)}&version=nominal&joint=rh_FFJ3&from=1&to=4"

    def curves(more: str) -> tuple[str, dict[str, Any]]:
        found = served.ask(f"/api/window?{base}{more}")[1]
        return found["unit"], found["curves"]["rh_FFJ3"]

    asked(served, f"/api/errors?recording={recording(served)}&version=nominal")
    unit, position = curves("")
    assert unit == "rad"
    unit, speed = curves("&quantity=velocity&lowpass_hz=15")
    assert unit == "rad/s"
    slope = np.gradient(position["measured"], position["t"])
    same = np.interp(position["t"], speed["t"], speed["measured"])
    assert np.corrcoef(slope, same)[0, 1] > 0.98, "the same motion, without the noise of differences"
    jump = np.abs(np.diff(speed["measured"])).mean()
    assert jump < 0.9 * np.abs(np.diff(curves("&quantity=velocity")[1]["measured"])).mean()
    assert curves("&derivative=1")[1]["measured"] == curves("&quantity=velocity")[1]["measured"]
    unit, effort = curves("&quantity=effort")
    assert unit == "N m"
    assert 0.0 < max(map(abs, effort["twins"]["nominal"])) < 5.0
    found = served.ask(f"/api/spectrum?{base}&to=4")[1]
    slow = [value for f, value in zip(found["f"], found["measured"], strict=True) if f < 2.0]
    fast = [value for f, value in zip(found["f"], found["measured"], strict=True) if f > 40.0]
    assert min(slow) > 10.0 * max(fast)
    for wrong in ("&quantity=colour", "&lowpass_hz=60", "&lowpass_hz=-1", "&lowpass_hz=x"):
        assert served.ask(f"/api/window?{base}{wrong}")[0] == 400, wrong
    assert served.ask(f"/api/spectrum?{base}".replace("to=4", "to=1.01"))[0] == 400


def test_a_prediction_that_is_moved_is_moved_in_every_error(served: Workbench) -> None:
    base = f"recording={recording(served)}&version=nominal"
    told = asked(served, f"/api/errors?{base}")
    late = asked(served, f"/api/errors?{base}&lag_ms=40")
    assert late["mse_rad2"] != told["mse_rad2"]
    lag_s = told["joints"]["rh_FFJ2"]["lag_s"]
    assert late["joints"]["rh_FFJ2"]["lag_s"] == pytest.approx(lag_s - 0.04, abs=3e-3)
    best_ms = asked(served, f"/api/align?{base}")["lag_ms"]
    assert min(one["lag_s"] for one in told["joints"].values()) <= 1e-3 * best_ms + 1e-5
    aligned = asked(served, f"/api/overview?{base}&lag_ms=40")
    assert {one["name"]: one["rmse_rad"] for one in aligned["joints"]} == {
        name: one["rmse_rad"] for name, one in late["joints"].items()
    }


def test_tips_contacts_and_reversals_are_those_of_the_motion(served: Workbench) -> None:
    base = f"recording={recording(served)}&version=nominal"
    scene = served.ask("/api/scene?version=nominal")[1]
    assert {one["name"] for one in scene["tendons"]} >= {"rh_FFJ0", "rh_LFJ0"}
    assert scene["tips"]["rh_FFJ3"] == scene["tips"]["rh_FFJ1"], "one finger has one tip"
    asked(served, f"/api/errors?{base}")
    path = asked(served, f"/api/path?{base}&joint=rh_FFJ3&from=1&to=3")
    measured, predicted = np.array(path["measured"]), np.array(path["predicted"])
    assert measured.shape == predicted.shape
    assert np.ptp(measured, axis=0).max() > 0.02, "m: the finger bends"
    assert 1e-4 < np.abs(measured - predicted).max() < 0.02
    still = np.array(asked(served, f"/api/path?{base}&joint=rh_MFJ3&from=1&to=3")["measured"])
    assert np.ptp(still, axis=0).max() < 5e-3
    found = served.ask(f"/api/contacts?{base}&at=2")[1]
    assert all(len(one) == 4 and abs(one[3]) < 0.01 for one in [*found["measured"], *found["predicted"]])
    turns = served.ask(f"/api/reversals?recording={recording(served)}&joint=rh_FFJ3")[1]
    assert turns["count"] == len(turns["times"]) >= 4
    assert turns["times"] == sorted(turns["times"])
    for path in (f"path?{base}&joint=nobody", f"reversals?{base}&joint=nobody", f"contacts?{base}&at=nan"):
        assert served.ask(f"/api/{path}")[0] == 400, path


def test_an_effect_by_hand_moves_its_finger_as_the_values_say(served: Workbench) -> None:
    base = f"recording={recording(served)}&version=nominal&effect=backlash&place=rh_FFJ3"
    sliders = {one["name"]: one for one in served.ask(f"/api/trial/values?{base}")[1]["parameters"]}
    gap = sliders["gap"]
    assert gap["unit"] == "rad"
    assert gap["lower"] <= gap["neutral"] < gap["value"] < gap["upper"]
    query = f"/api/trial?{base}&joint=rh_FFJ3&from=0.5&to=5"
    found = asked(served, f"{query}&value=gap:{GAP_RAD}&value=motor_share:0.2")
    nothing = asked(served, f"{query}&value=gap:0")
    assert found["rmse_rad"] < 0.2 * found["without_rmse_rad"], "the planted values leave little of the error"
    assert nothing["rmse_rad"] == pytest.approx(nothing["without_rmse_rad"], rel=0.05)
    assert found["t"][0] >= 0.5
    assert found["t"][-1] <= 5.0
    assert set(found["curves"]) >= {"rh_FFJ3", "rh_FFJ2"}
    for right, wrong in (
        ("effect=backlash", "effect=backlush"),
        ("place=rh_FFJ3", "place=rh_MFJ3"),  # another finger
        ("place=rh_FFJ3", "place=rh_FFJ2"),  # moved by a tendon of its own name
        ("joint=rh_FFJ3", "joint=nobody"),
        ("&value=gap:0", "&value=gap:9"),
        ("&value=gap:0", "&value=gap:nan"),
        ("&value=gap:0", "&value=gap"),
        ("to=5", "to=0.5"),
    ):
        assert served.ask(f"{query}&value=gap:0".replace(right, wrong))[0] == 400, wrong


def test_the_bodies_of_a_moment_are_both_hands(served: Workbench) -> None:
    scene = served.ask("/api/scene?version=nominal")[1]
    asked(served, f"/api/overview?recording={recording(served)}&version=nominal")
    query = f"/api/poses?recording={recording(served)}&version=nominal&from=1&to=2&frames=5"
    with urllib.request.urlopen(served.address + query, timeout=60) as answer:
        assert answer.headers["X-Predicted"] == "yes"
        poses = np.frombuffer(answer.read(), "<f4").reshape(5, 2, scene["bodies"], 7)
    assert np.isfinite(poses).all()
    apart = np.abs(poses[:, 0] - poses[:, 1]).max()
    assert 1e-4 < apart < 0.05
    for right, wrong in (
        ("frames=5", "frames=0"),
        ("frames=5", "frames=601"),
        ("from=1", "from=nan"),
        ("nominal", "no"),
    ):
        assert served.ask(query.replace(right, wrong))[0] == 400, wrong

"""The region that a version was fitted in, and what is said of motion outside of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.conftest import called
from tests.diagnosis.rig import rig_model
from tests.simulation.made import Motion, recorded, saved
from twin_daemon.comparison.region import Region, outside, region_of
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.twin import TwinModel

NEAR: Motion = {"left": ([0.0, 0.5, 1.5, 2.5, 4.0], [0.0, 0.0, 0.3, -0.3, 0.0])}
FAR: Motion = {"left": ([0.0, 0.5, 1.5, 2.5, 4.0], [0.0, 0.0, 0.9, 0.9, 0.0])}
FAST: Motion = {"left": ([0.0, 0.5, 0.6, 1.5, 1.6, 4.0], [0.0, 0.0, 0.3, 0.3, -0.2, -0.2])}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, TwinModel, dict[str, Path]]:
    """(a rig that gravity pulls at, as a model, recordings of it by name)."""
    folder = tmp_path_factory.mktemp("region")
    model = rig_model(folder)
    model.write_text(model.read_text().replace('axis="0 0 1"', 'axis="0 1 0"'))
    twin = TwinModel.load(load_hand(model=model))
    motions = {"near": NEAR, "far": FAR, "fast": FAST}
    bags = {
        name: saved(recorded(twin, motion, np.random.default_rng(1), seconds=4.0), folder / f"{name}.mcap")
        for name, motion in motions.items()
    }
    return model, twin, bags


def _taken(twin: TwinModel, path: Path):
    from twin_daemon.recordings import load_recording

    return align(twin, load_recording(path))


def test_a_region_holds_its_own_motion(rig: tuple[Path, TwinModel, dict[str, Path]]) -> None:
    _, twin, bags = rig
    near = _taken(twin, bags["near"])
    region = region_of(twin, [near])
    assert region is not None
    assert outside(twin, region, [near]) == []
    assert Region.model_validate_json(region.model_dump_json()) == region


def test_what_leaves_it_is_named_by_joint_and_quantity(rig: tuple[Path, TwinModel, dict[str, Path]]) -> None:
    _, twin, bags = rig
    region = region_of(twin, [_taken(twin, bags["near"])])
    assert region is not None
    far = outside(twin, region, [_taken(twin, bags["far"])])
    assert {(one.joint, one.quantity) for one in far} >= {("left", "position"), ("left", "load")}
    assert all(0.05 < one.share < 1.0 for one in far)
    assert "left: position" in " ".join(map(str, far))


def test_speed_counts_without_its_sign(rig: tuple[Path, TwinModel, dict[str, Path]]) -> None:
    _, twin, bags = rig
    slow, fast = _taken(twin, bags["near"]), _taken(twin, bags["fast"])
    region = region_of(twin, [fast])
    assert region is not None
    assert not [one for one in outside(twin, region, [slow]) if one.quantity == "speed"]


def test_a_joint_that_stays_still_keeps_what_was_known_of_it(rig: tuple[Path, TwinModel, dict[str, Path]]) -> None:
    _, twin, bags = rig
    near, far = (region_of(twin, [_taken(twin, bags[name])]) for name in ("near", "far"))
    assert near is not None
    assert far is not None
    assert near.beside(far, []).joints["left"] == far.joints["left"]
    assert near.beside(far, ["left"]).joints["left"] == near.joints["left"]


def test_a_version_remembers_it_and_commands_say_what_is_outside(
    rig: tuple[Path, TwinModel, dict[str, Path]], tmp_path: Path, state_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, _, bags = rig
    of = ("--model", str(model))
    fitted = called(
        "calibrate", "--recording", str(bags["near"]), "--budget", "30", "--search", "least-squares", *of,
        result=tmp_path / "fit.json",
    )  # fmt: skip
    version = ("--version", fitted["version"])
    inside = called("compare", "--recording", str(bags["near"]), *version, *of, result=tmp_path / "in.json")
    assert inside["region"] == {"known": True, "outside": []}
    capsys.readouterr()
    beyond = called("compare", "--recording", str(bags["far"]), *version, *of, result=tmp_path / "out.json")
    assert {one["quantity"] for one in beyond["region"]["outside"]} >= {"position", "load"}
    assert "outside of what this version has seen" in capsys.readouterr().out
    checked = called("check", "--recording", str(bags["far"]), *version, *of, result=tmp_path / "check.json")
    assert checked["region"] == beyond["region"]
    nominal = called(
        "compare", "--recording", str(bags["far"]), "--version", "nominal", *of, result=tmp_path / "n.json"
    )
    assert nominal["region"] == {"known": False, "outside": []}

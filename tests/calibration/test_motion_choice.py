"""Which motions of a set say most, and what all of them lack."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.conftest import called
from tests.diagnosis.rig import rig_model
from tests.simulation.made import Motion, recorded, saved
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel

RICH_S = [0.0, 0.4, 0.41, 1.2, 2.2, 2.21, 3.0, 3.4, 3.41, 4.4, 4.8, 5.5]
RICH = [0.0, 0.0, 0.6, 0.6, 0.3, -0.4, -0.4, 0.5, 0.1, 0.1, -0.6, -0.6]
MOTIONS: dict[str, Motion] = {
    "one": {"left": (RICH_S, RICH)},
    "again": {"left": (RICH_S, [0.98 * value for value in RICH])},
    "other": {"middle": (RICH_S, RICH)},
    "slow": {"left": ([0.0, 0.5, 5.5], [0.0, 0.0, 0.2])},
}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Path]]:
    folder = tmp_path_factory.mktemp("choice")
    model = rig_model(folder)
    model.write_text(model.read_text().replace('axis="0 0 1"', 'axis="0 1 0"'))
    twin = TwinModel.load(load_hand(model=model))
    bags = {
        name: saved(recorded(twin, motion, np.random.default_rng(1)), folder / f"{name}.mcap")
        for name, motion in MOTIONS.items()
    }
    return model, bags


def test_what_a_motion_adds_to_those_before_it_decides(
    rig: tuple[Path, dict[str, Path]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, bags = rig
    said = called(
        "check", "--recording", *map(str, bags.values()), "--model", str(model), result=tmp_path / "said.json"
    )
    order = said["motions"]["order"]
    names = [one["name"] for one in order]
    # another joint says more than the same motion of the same joint once again, and a slow one least
    assert set(names[:2]) < {"one", "again", "other"}
    assert "other" in names[:2]
    assert names[-1] == "slow"
    assert [one["gain_nats"] for one in order] == sorted((one["gain_nats"] for one in order), reverse=True)
    assert order[-1]["share"] == pytest.approx(1.0)
    assert any(name.startswith("middle.") for name in order[names.index("other")]["learns"])
    lacks = {one["joint"]: one["lacks"] for one in said["motions"]["missing"]}
    assert set(lacks["right"]) == {"load", "speed", "reversals", "holds"}
    assert "speed" not in lacks.get("left", [])
    printed = capsys.readouterr().out
    assert "say most" in printed
    assert "right lacks" in printed


def test_a_slow_sweep_lacks_speeds_and_reversals(rig: tuple[Path, dict[str, Path]], tmp_path: Path) -> None:
    model, bags = rig
    said = called("check", "--recording", str(bags["slow"]), "--model", str(model), result=tmp_path / "slow.json")
    assert len(said["motions"]["order"]) == 1
    lacks = {one["joint"]: one["lacks"] for one in said["motions"]["missing"]}
    assert {"speed", "reversals", "holds"} <= set(lacks["left"])

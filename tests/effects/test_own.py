"""Effects of a user: a file in a folder of his own, or a package, as docs/add-an-effect.md tells it."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Callable
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest

from tests.simulation.made import recorded, saved
from twin_daemon.effects import BUILT_IN, discovery
from twin_daemon.effects.discovery import user_effects
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.plant.motions import rich
from twin_daemon.resources import twin_command
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

PAGE = Path(__file__).resolve().parents[2] / "docs" / "add-an-effect.md"
JOINT, DRAG = "rh_FFJ3", 0.2


@pytest.fixture(scope="module")
def example() -> str:
    """The file that the page shows."""
    found = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that the configuration names."""
    place = tmp_path / "effects"
    place.mkdir(mode=0o755)
    monkeypatch.setenv("TWIN_EFFECTS", str(place))
    return place


@pytest.mark.slow
def test_the_effect_of_the_page_is_diagnosed(example: str, folder: Path, tmp_path: Path) -> None:
    (folder / "quadratic_drag.py").write_text(example, encoding="utf-8")
    hand = load_hand()
    spec = TwinModel.load(hand).nominal.copy()
    spec.joint(JOINT).damping[1] = DRAG  # planted without the file that is to find it
    plant = TwinModel(hand, spec, Terms())
    for name, seed in (("fit", 1), ("held", 2)):
        motion = rich(hand, [JOINT], 6.0, seed)
        waypoints = {JOINT: (list(motion.times_s), list(motion.positions[:, 0]))}
        made = recorded(plant, waypoints, np.random.default_rng(seed), seconds=6.0, noise_rad=1e-3)
        saved(made, tmp_path / f"{name}.mcap")
    result = tmp_path / "found.json"
    told = twin_command(
        "diagnose", "--recording", str(tmp_path / "fit.mcap"), "--holdout", str(tmp_path / "held.mcap"),
        "--joints", JOINT, "--json", str(result),
    )  # fmt: skip
    environment = {**os.environ, "TWIN_STATE_DIR": str(tmp_path / "state")}
    ran = subprocess.run(told, env=environment, capture_output=True, text=True, check=False, timeout=800)
    assert ran.returncode == 0, ran.stderr
    said = json.loads(result.read_text(encoding="utf-8"))
    first = said["findings"][0]
    assert (first["effect"], first["target"]) == ("quadratic_drag", JOINT)
    assert said["verdict"] in ("explained", "ambiguous")
    assert first["parameters"]["drag"]["value"] == pytest.approx(DRAG, rel=0.2)


def test_a_file_in_the_folder_is_an_effect(example: str, folder: Path) -> None:
    (folder / "quadratic_drag.py").write_text(example, encoding="utf-8")
    (folder / "_notes.py").write_text("raise RuntimeError", encoding="utf-8")
    (effect,) = user_effects(BUILT_IN)
    assert effect.key == "quadratic_drag"
    assert BUILT_IN["viscous_friction"].rank < effect.rank < BUILT_IN["coulomb_friction"].rank


def test_without_the_variable_nothing_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TWIN_EFFECTS", raising=False)
    assert user_effects(BUILT_IN) == []


def test_a_package_offers_its_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TWIN_EFFECTS", raising=False)
    there = EntryPoints([EntryPoint("mine", "twin_daemon.effects.spring:Spring", "twin_daemon.effects")])
    monkeypatch.setattr(discovery, "entry_points", lambda group: there.select(group=group))
    assert [effect.key for effect in user_effects(())] == ["spring"]
    with pytest.raises(BadInput, match="'spring' is that of an effect of the library"):
        user_effects(BUILT_IN)


def _open_to_all(folder: Path, example: str) -> None:
    (folder / "a.py").write_text(example, encoding="utf-8")
    (folder / "a.py").chmod(0o666)


def _state_inside(folder: Path, example: str) -> None:
    (folder / "a.py").write_text(example, encoding="utf-8")
    os.environ["TWIN_STATE_DIR"] = str(folder / "state")


def _written(text: str) -> Callable[[Path, str], None]:
    return lambda folder, example: (folder / "a.py").write_text(text or example, encoding="utf-8") and None


@pytest.mark.parametrize(
    ("prepare", "says"),
    [
        (_open_to_all, "others can write to it"),
        (_state_inside, "what comes over the network|keeps what comes"),
        (_written("import nothing_like_that"), "ModuleNotFoundError"),
        (_written("x = 1"), "holds no effect"),
        (_written("from twin_daemon.effects.spring import Spring\nclass Mine(Spring):\n    pass"), "'spring' is that"),
        (lambda folder, _: folder.rmdir(), "is no folder"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_place(
    prepare: Callable[[Path, str], None], says: str, folder: Path, example: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TWIN_STATE_DIR", str(folder.parent / "state"))
    prepare(folder, example)
    with pytest.raises(BadInput, match=says):
        user_effects(BUILT_IN)

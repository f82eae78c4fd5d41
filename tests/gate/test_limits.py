"""How far and how fast: what the description does not say is not commanded, and what limits nothing is no limit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.gate.conftest import Rig
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel

MODEL = """<mujoco model="rig"><worldbody>
  <body name="a"><joint name="turn" axis="0 0 1"/><geom size="0.05" mass="0.2"/>
  <body name="b" pos="0 0 0.2"><joint name="push" type="slide" axis="1 0 0" range="0 0.1" limited="true"/>
    <geom size="0.05" mass="0.2"/></body></body>
</worldbody><actuator>
  <position name="turn" joint="turn" kp="20"/><position name="push" joint="push" kp="200" ctrlrange="0 0.1"/>
</actuator></mujoco>"""


def rig_of(folder: Path, joints: dict[str, Any] | None, **settings: Any) -> Rig:
    """A hand with a joint that turns without end, and one that slides."""
    (folder / "rig.xml").write_text(MODEL)
    if joints is None:
        return Rig(TwinModel.load(load_hand(model=folder / "rig.xml")), **settings)
    commands = {name: {"actuator": name, "joints": [name]} for name in ("turn", "push")}
    described = {"schema": 1, "name": "rig", "model": "rig.xml", "joints": joints, "commands": commands}
    (folder / "hand.yaml").write_text(yaml.safe_dump(described))
    return Rig(TwinModel.load(load_hand(folder / "hand.yaml")), **settings)


def test_what_has_no_bounds_is_refused_until_the_description_gives_them(tmp_path: Path) -> None:
    bare = rig_of(tmp_path, None)
    bare.arm()
    assert bare.ask("move", targets={"turn": 0.1})["check"] == "unbounded"
    assert "range" in bare.ask("target", targets={"turn": 0.1})["why"]
    slide = bare.ask("move", targets={"push": 0.05})
    assert "velocity limit" in slide["why"]
    assert "velocity_limit_m_s" in slide["allowed"]
    assert bare.turn() is None
    whole = rig_of(
        tmp_path,
        {
            "turn": {"lower_rad": -1.0, "upper_rad": 1.0, "velocity_limit_rad_s": 1.0},
            "push": {"velocity_limit_m_s": 0.05},
        },
    )
    whole.arm()
    assert whole.ask("move", targets={"turn": 1.2})["check"] == "bounds"
    assert whole.ask("move", targets={"push": 0.05}, seconds=0.5)["check"] == "velocity"
    answer = whole.ask("move", targets={"turn": 0.5, "push": 0.05})
    assert answer["accepted"], answer
    assert answer["seconds"] > 1.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"turn": {"velocity_limit_m_s": 1.0}, "push": {}},
        {"turn": {}, "push": {"velocity_limit_rad_s": 1.0}},
        {"turn": {}, "push": {"upper_m": 30.0}},
        {"turn": {"lower_rad": 1.0, "upper_rad": -1.0}, "push": {}},
    ],
)
def test_descriptions_in_another_unit_or_beyond_the_model_are_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises(BadInput):
        rig_of(tmp_path, wrong)


@pytest.mark.parametrize(
    "limit",
    [
        {"upper_rad": 30.0},
        {"lower_rad": -15.0},
        {"velocity_rad_s": 200.0},
        {"acceleration_rad_s2": 1e5},
        {"step_rad": 0.5},
        {"upper_m": 0.5},
    ],
)
def test_a_limit_of_the_site_that_limits_nothing_is_an_error(twin: TwinModel, limit: dict[str, float]) -> None:
    with pytest.raises(BadInput, match=r"gate\.limits\.rh_FFJ3"):
        Rig(twin, limits={"rh_FFJ3": limit})
    Rig(twin, limits={"rh_FFJ3": {"upper_rad": 1.5708, "velocity_rad_s": 4.0}})

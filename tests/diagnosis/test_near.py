"""A joint that is near something all the time is looked at; one that touches something all the time is no noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.rig import motion_of, rig_model
from tests.simulation.made import recorded, saved
from twin_daemon.diagnosis.search import diagnose
from twin_daemon.diagnosis.verdict import Diagnosis
from twin_daemon.hand import load_hand
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

_OFFSET_RAD = 0.1
_NAMES = ("left", "middle")
_PLAIN = 'contype="0" conaffinity="0"'


def _diagnosis(folder: Path, gap_m: float) -> Diagnosis:
    """What is said of a rig whose left link sweeps over a plate so far below it, and reads 0.1 rad too much."""
    model = rig_model(folder, _NAMES)
    text = model.read_text().replace(_PLAIN, 'condim="1"', 1)
    plate = f'<geom type="box" size="0.3 0.3 0.01" pos="0 0 {-0.03 - gap_m}" condim="1"/>'
    model.write_text(text.replace("<worldbody>", f"<worldbody>{plate}"))
    twin = TwinModel.load(load_hand(model=model))
    misread = EffectTerm(effect="sensor_offset", target="left", values={"offset": _OFFSET_RAD})
    plant = twin.changed(Terms(effects=(misread,)))
    made = [
        recorded(plant, motion_of(_NAMES), np.random.default_rng(seed), seconds=6.0, noise_rad=1e-3) for seed in (6, 7)
    ]
    fit, held = (
        [align(twin, load_recording(saved(one, folder / f"{number}.mcap")))] for number, one in enumerate(made)
    )
    return diagnose(twin, fit, held)


@pytest.mark.slow
def test_a_joint_that_only_comes_near_something_is_looked_at(tmp_path: Path) -> None:
    found = _diagnosis(tmp_path, 5e-4)
    assert found.findings[0].effect == "sensor_offset"
    assert found.findings[0].joints == ("left",)
    assert any("left: seen only while less than 1 mm" in note for note in found.notes)


def test_a_joint_that_touches_something_all_the_time_is_named_and_no_noise(tmp_path: Path) -> None:
    found = _diagnosis(tmp_path, -1e-4)
    assert found.verdict == "not_excited"
    assert found.reason.startswith(f"left ({1e3 * _OFFSET_RAD:.0f} mrad off): touching something")
    assert found.parts["middle"].within_floor

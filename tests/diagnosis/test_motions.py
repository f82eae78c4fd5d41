"""Several recordings: each is predicted by what the others say, and the worst one decides."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.conftest import called
from tests.diagnosis.rig import rig_model
from tests.simulation.made import Motion, recorded, saved
from twin_daemon.diagnosis.in_turn import by_motion, fitted_too
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.validation import HeldOut, HeldOutMotion
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.submodel import Part
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

STEPS: Motion = {
    "left": ([0.0, 0.4, 0.41, 1.2, 2.2, 2.21, 3.0, 3.9, 3.91, 5.5], [0, 0, 0.6, 0.6, 0.6, -0.4, -0.4, -0.4, 0.1, 0.1])
}
SWEEP: Motion = {"left": ([0.0, 0.5, 1.5, 2.5, 3.2, 3.9, 4.4, 5.5], [0.1, 0.1, -0.5, 0.5, 0.0, 0.4, -0.2, -0.2])}
SLOW: Motion = {"left": ([0.0, 0.5, 3.0, 5.5], [-0.3, -0.3, 0.4, -0.1])}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[TwinModel, tuple[Path, ...], Path]:
    """(the model of a rig, recordings of one whose left joint rubs, the rig's file)."""
    folder = tmp_path_factory.mktemp("motions")
    model = rig_model(folder)
    model.write_text(model.read_text().replace(' frictionloss="0.01"', ""))
    twin = TwinModel.load(load_hand(model=model))
    rubs = EffectTerm(effect="coulomb_friction", target="left", values={"friction": 0.1, "sticking": 0.0})
    plant = twin.changed(Terms(effects=(rubs,)))
    bags = []
    for number, (name, motion) in enumerate({"steps": STEPS, "sweep": SWEEP, "slow": SLOW}.items()):
        made = recorded(plant, motion, np.random.default_rng(number), seconds=6.0, noise_rad=3e-4)
        bags.append(saved(made, folder / f"{name}.mcap"))
    return twin, tuple(bags), model


def _pieces(twin: TwinModel, paths: tuple[Path, ...]) -> tuple[TwinModel, tuple[Aligned, ...]]:
    taken = [align(twin, load_recording(path)) for path in paths]
    reduced = Reduction(twin, taken, taken).of(twin, Part("left", ("left",), ()), ["left"])
    assert reduced is not None
    assert fitted_too(reduced.train, reduced.holdout) == set(by_motion(reduced.train))
    return reduced.twin, reduced.train


def _rms(rows: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


def test_each_motion_is_predicted_by_what_the_others_say(arm: tuple[TwinModel, tuple[Path, ...], Path]) -> None:
    small, pieces = _pieces(*arm[:2])
    part = PartFit(small, pieces, ["left"], thoroughly=True)
    in_turn = part.held_out(part.base, pieces)
    fitted = [rows[0] for rows in part.problem.joint_residuals(part.base.point[None])]
    for members in by_motion(pieces).values():
        anew = PartFit(small, [p for i, p in enumerate(pieces) if i not in members], ["left"], thoroughly=True)
        expected = _rms(anew.held_out(anew.base, [pieces[i] for i in members]))
        found = _rms([in_turn[i] for i in members])
        # a step stands for fitting anew: not the same, and no more of the motion itself in it than that
        assert found == pytest.approx(expected, rel=0.5)
        assert found > _rms([fitted[i] for i in members])


def test_one_recording_takes_no_turns(arm: tuple[TwinModel, tuple[Path, ...], Path]) -> None:
    twin, paths, _ = arm
    alone = align(twin, load_recording(paths[0]))
    assert fitted_too([alone], [alone]) == frozenset()


def _motion(after: float, gain: tuple[float, float], left: float) -> HeldOutMotion:
    return HeldOutMotion("m", 1e-4, after, gain, np.array([left]), np.array([3.0]), True)


@pytest.mark.parametrize(
    ("second", "passes", "adequate"),
    [
        (_motion(1e-6, (0.9, 0.99), 1.0), True, True),
        (_motion(2e-4, (-1.5, -0.6), 30.0), False, False),
        (_motion(2e-4, (-1.5, -0.6), 2.0), True, True),
        (_motion(1e-4, (-0.3, 0.2), 30.0), True, False),
    ],
    ids=["both better", "one worse", "one worse but as a right model", "one left as it was"],
)
def test_the_worst_motion_decides(second: HeldOutMotion, passes: bool, adequate: bool) -> None:
    judged = HeldOut(1e-4, 3e-5, 0.7, (0.5, 0.8), (_motion(1e-6, (0.9, 0.99), 1.0), second))
    assert (judged.passes, judged.adequate) == (passes, adequate)


@pytest.mark.slow
def test_a_diagnosis_of_several_recordings_says_how_each_was_predicted(
    arm: tuple[TwinModel, tuple[Path, ...], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, paths, model = arm
    said = called(
        "diagnose", "--recording", *map(str, paths), "--joints", "left", "--model", str(model),
        result=tmp_path / "said.json",
    )  # fmt: skip
    finding = said["findings"][0]
    assert finding["effect"] == "coulomb_friction"
    assert {motion["name"] for motion in finding["holdout_motions"]} == {path.stem for path in paths}
    assert all(motion["left"] <= 1.0 for motion in finding["holdout_motions"])
    assert any("in turn" in note for note in said["notes"])
    assert finding["free_holdout_mse_after"] is None
    assert "of 3 motions the worst is" in capsys.readouterr().out

"""What a diagnosis may take for granted, and how long it may take."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.conftest import JOINT, called
from twin_daemon.cli.app import main
from twin_daemon.cli.diagnose import assumptions
from twin_daemon.diagnosis.search import diagnose
from twin_daemon.estimation.problem import Problem
from twin_daemon.executor import concurrently
from twin_daemon.processor_time import OutOfTime, TimeLimit
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.twin import TwinModel


def test_an_error_that_is_tolerated_is_no_finding(misread: tuple[Path, Path], tmp_path: Path) -> None:
    fitted, held = map(str, misread)
    said = called(
        "diagnose", "--recording", fitted, "--holdout", held, "--tolerance-mrad", "300", result=tmp_path / "said.json"
    )
    assert (said["verdict"], said["findings"]) == ("within_noise", [])


def test_time_that_is_over_is_said_with_what_is_known(misread: tuple[Path, Path], tmp_path: Path) -> None:
    fitted, held = map(str, misread)
    said = called("diagnose", "--recording", fitted, "--holdout", held, "--within", "1", result=tmp_path / "said.json")
    assert said["verdict"] == "unexplained"
    assert said["interrupted"] is True
    assert "not searched to the end" in said["reason"]
    assert JOINT in said["reason"]
    assert said["probabilities"] == []  # nobody knows how probable a law is that has not been asked for


class _Ending(TimeLimit):
    """A limit that is over when somebody says so."""

    ended = False

    def over(self, share: float = 1.0) -> bool:
        return self.ended


@pytest.mark.slow
def test_what_was_found_before_time_was_over_is_in_the_answer(misread: tuple[Path, Path], twin: TwinModel) -> None:
    fitted, held = (align(twin, load_recording(path)) for path in misread)
    limit = _Ending()

    def say(line: str) -> None:
        limit.ended = limit.ended or line.startswith("  with ")  # the effect has been accepted

    found = diagnose(twin, [fitted], [held], joints=[JOINT], stream=say, limit=limit)
    assert limit.ended
    assert [f.effect for f in found.findings] == ["sensor_gain"]


class _Counted(TimeLimit):
    """A limit that is over after so many looks at it."""

    def __init__(self, looks: int) -> None:
        super().__init__()
        self._looks = looks

    def over(self, share: float = 1.0) -> bool:
        self._looks -= 1
        return self._looks < 0


@pytest.mark.parametrize("looks", [0, 3, 20, 100])
def test_wherever_time_ends_a_joint_that_was_looked_at_is_spoken_of(
    misread: tuple[Path, Path], twin: TwinModel, looks: int
) -> None:
    fitted, held = (align(twin, load_recording(path)) for path in misread)
    found = diagnose(twin, [fitted], [held], joints=[JOINT], limit=_Counted(looks))
    assert found.interrupted
    assert found.verdict == "unexplained"
    assert [part.joints for part in found.parts.values()] == [(JOINT,)]


def test_a_limit_that_is_enforced_ends_what_rolls_out(twin: TwinModel, misread: tuple[Path, Path]) -> None:
    problem = Problem(twin, [align(twin, load_recording(misread[0]))], (), [JOINT])
    limit = _Ending()
    with limit.enforced():
        (before,) = problem.predict(np.zeros((1, 0)))
        limit.ended = True
        with pytest.raises(OutOfTime):
            concurrently(lambda n: problem.predict(np.zeros((n, 0))), [2, 3])
    (after,) = problem.predict(np.zeros((2, 0)))
    assert np.array_equal(before[0], after[1])


@pytest.mark.slow
def test_what_an_exact_model_cannot_be_off_is_an_effect(sound: Path, tmp_path: Path) -> None:
    """The plant's friction and gain are up to 20 % off: noise beside a data sheet, beside an exact model not."""
    arguments = ["diagnose", "--recording", str(sound), "--joints", JOINT]
    assert called(*arguments, result=tmp_path / "sheet.json")["verdict"] == "within_noise"
    exact = called(*arguments, "--nominal-uncertainty", "0", "--within", "20", result=tmp_path / "exact.json")
    assert exact["verdict"] != "within_noise"


@pytest.mark.parametrize("given", ["much", "2", "stiffness=0.1", "gain="])
def test_a_share_that_is_none_is_one_line(given: str, sound: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", "--recording", str(sound), "--nominal-uncertainty", given]) == 3
    assert "0 to 1" in capsys.readouterr().err


def test_what_sessions_differ_in_is_stated_by_its_name_alone() -> None:
    """A model whose numbers are off by a fifth says nothing about another day."""
    assert "between_sessions" not in assumptions(None, ["0.2"])["nominal_uncertainty"]
    stated = assumptions(None, ["0.2", "between_sessions=0.03"])["nominal_uncertainty"]
    assert (stated["between_sessions"], stated["gain"]) == (0.03, 0.2)

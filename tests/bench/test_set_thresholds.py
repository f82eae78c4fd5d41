"""The numbers behind the probabilities are set on development cases alone, by the answers that came true."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from bench.set_thresholds import calibration_error, known, score
from twin_daemon.diagnosis.probability import IN_USE, Beliefs

PLAY = {"effect": "backlash", "joints": ["a"], "scope": "joint", "strength": 9.0}


def write(folder: Path, seed: int, effects: list[dict[str, Any]], causes: list[dict[str, float]], left: float) -> None:
    truth = {"half": ("development", "test")[seed % 2], "kind": "single" if effects else "nothing", "effects": effects}
    part = {"adequacy": left, "above": bool(causes), "named": bool(causes)}
    said = {"probabilities": [{}], "causes": causes, "parts": {"a": part}}
    (folder / f"case_{seed}.truth.json").write_text(json.dumps(truth))
    (folder / f"case_{seed}.json").write_text(json.dumps(said))


def test_what_came_true_is_scored_by_its_probability(tmp_path: Path) -> None:
    write(tmp_path, 2, [PLAY], [{"backlash:a": 0.9, "spring:a": 0.1}], 0.1)
    (case,) = known(tmp_path)
    certain = Beliefs(unknown_above=1e-9)
    assert score([case], certain) == pytest.approx(math.log(0.9), abs=1e-6)
    assert score([case], Beliefs(unknown_above=0.5, least_adequacy=1.0)) == pytest.approx(math.log(0.45), abs=1e-6)
    assert calibration_error([case], certain) == pytest.approx(0.1, abs=1e-6)


def test_a_weak_effect_behind_a_robot_at_its_floor_is_too_weak(tmp_path: Path) -> None:
    write(tmp_path, 2, [], [], 0.3)
    write(tmp_path, 4, [PLAY | {"strength": 2.0}], [], 0.3)
    cases = list(known(tmp_path))
    even, sure = (Beliefs(unknown_within=1e-9, too_weak=share) for share in (0.5, 0.01))
    assert score(cases, even) == pytest.approx(math.log(0.5), abs=1e-6)
    assert score(cases, even) > score(cases, sure)
    assert score(cases, IN_USE) > score(cases, sure)


def test_cases_of_the_test_half_are_refused(tmp_path: Path) -> None:
    write(tmp_path, 3, [PLAY], [{"backlash:a": 1.0}], 0.1)
    with pytest.raises(SystemExit, match="test half"):
        list(known(tmp_path))

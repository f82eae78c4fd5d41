"""A small part of the home suite: the whole of it is `python -m bench.home_suite`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bench.conditions import table
from bench.home_cases import Case, cases, conditions, planted
from bench.home_page import page
from bench.home_plant import main as make_recording
from tests.diagnosis.conftest import called
from twin_daemon.effects import BUILT_IN
from twin_daemon.hand import load_hand
from twin_daemon.plant import FOREIGN, parse_hidden

_FEW = ("none-1", "sensor_offset-mild")


def _diagnosed(name: str, folder: Path) -> dict[str, Any]:
    for which in ("fit", "held"):
        make_recording(name, which, folder)
    fitted, held = (str(folder / f"{name}-{which}.mcap") for which in ("fit", "held"))
    return called("diagnose", "--recording", fitted, "--holdout", held, result=folder / f"{name}.json")


@pytest.mark.slow
@pytest.mark.parametrize("name", _FEW)
def test_what_is_hidden_is_named_with_its_value(name: str, tmp_path: Path) -> None:
    case = next(case for case in cases() if case.name == name)
    said = _diagnosed(name, tmp_path)
    if not case.hidden:
        assert (said["verdict"], said["findings"]) == ("within_noise", [])
        return
    hidden = parse_hidden(case.hidden[0], load_hand())
    first = said["findings"][0]
    assert said["verdict"] in ("explained", "ambiguous")
    assert (first["effect"], hidden.joint in first["joints"]) == (hidden.key, True)
    text = page([case], tmp_path)
    assert "| single: the right name first | 95% | 100% | 1 of 1 |" in text
    assert "| planted value inside its 95 % interval | 90 to 98 % | 100% | 1 of 1 |" in text


def test_the_suite_has_every_effect_mild_and_severe_and_every_foreign_one() -> None:
    names = {case.name for case in cases()}
    assert {f"{key}-{how}" for key in (*BUILT_IN, *FOREIGN) for how in ("mild", "severe")} <= names
    assert len(names) == len(cases())


def test_a_case_that_was_never_diagnosed_counts_as_failed(tmp_path: Path) -> None:
    text = page([Case("none-1", (), "none", 1)], tmp_path)
    assert "| none: within_noise | 95% | 0% | 0 of 1 |" in text
    assert "failed" in text


@pytest.mark.parametrize("case", [c for c in cases() if c.kind == "single"], ids=lambda c: c.name)
def test_every_planted_value_is_one_that_the_library_can_say(case: Case) -> None:
    hidden = parse_hidden(case.hidden[0], load_hand())
    if hidden.key == "gravity_tilt":  # two angles in the library, one and its azimuth in the plant
        return
    found = planted(type(hidden)(hidden.key, hidden.joint, 1.0))
    assert found is not None
    assert found[0] in {parameter.name for parameter in BUILT_IN[hidden.key].parameters}


def test_conditions_ask_the_same_of_other_plants_sensors_and_lengths() -> None:
    under = conditions()
    asked = [tuple(case.hidden for case in cases) for cases in under.values()]
    names = [case.name for group in under.values() for case in group]
    assert len(set(asked)) == 1
    assert len(set(names) | {case.name for case in cases()}) == len(names) + len(cases())


@pytest.mark.parametrize(
    ("verdict", "effect", "cell"),
    [
        ("explained", "backlash", "explained, backlash:rh_FFJ3"),
        ("explained", "spring", "explained, spring:rh_FFJ3 ✗"),
        ("not_excited", None, "not_excited ✗"),
    ],
)
def test_a_wrong_answer_is_marked(verdict: str, effect: str | None, cell: str, tmp_path: Path) -> None:
    case = Case("one", ("backlash:FFJ3=severe",), "single", 1)
    findings = [{"effect": effect, "joints": ["rh_FFJ3"], "parameters": {}}] if effect else []
    (tmp_path / "answers").mkdir()
    (tmp_path / "answers" / "one.json").write_text('[{"key": "backlash", "joint": "rh_FFJ3", "value": 0.1}]')
    (tmp_path / "one.json").write_text(json.dumps({"verdict": verdict, "findings": findings, "wall_s": 1.0}))
    assert table({"here": [case]}, tmp_path)[-1] == f"| backlash:FFJ3=severe | {cell} |"

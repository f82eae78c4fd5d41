"""A servo that is silent near its target, and play of a motor that weighs nothing: one law with two names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.diagnosis.conftest import JOINT, called
from twin_daemon.hand import Hand
from twin_daemon.plant.motions import rich

BAND_RAD = 0.02


@pytest.fixture(scope="module")
def silent(recorded: Callable[..., Path], hand: Hand) -> tuple[str, str]:
    """(to fit, held out) of a joint whose servo is silent near its target."""
    hidden = f"dead_zone:{JOINT}={BAND_RAD}"
    bags = [recorded(f"silent_{i}", rich(hand, [JOINT], 8.0, i), hidden, seed=i) for i in (1, 2)]
    return str(bags[0]), str(bags[1])


@pytest.mark.slow
def test_a_silent_servo_is_found_and_never_named_for_sure(silent: tuple[str, str], tmp_path: Path) -> None:
    fitted, held = silent
    said = called("diagnose", "--recording", fitted, "--holdout", held, result=tmp_path / "said.json")
    assert said["verdict"] == "ambiguous"
    (finding,) = said["findings"]
    assert (finding["effect"], finding["joints"]) == ("backlash", [JOINT])
    assert f"dead_zone:{JOINT}" in finding["confusable_with"]
    assert finding["parameters"]["gap"]["value"] == pytest.approx(2 * BAND_RAD, rel=0.1)
    shares = {one["effects"][0]: one["probability"] for one in said["probabilities"]}
    assert min(shares[f"{key}:{JOINT}"] for key in ("backlash", "dead_zone")) > 0.05


@pytest.mark.slow
def test_its_band_is_fitted(silent: tuple[str, str], tmp_path: Path) -> None:
    fitted, held = silent
    added = called(
        "add", "dead_zone", "--joint", JOINT, "--recording", fitted, "--holdout", held, result=tmp_path / "added.json"
    )
    assert added["parameters"][f"dead_zone:{JOINT}.band"]["value"] == pytest.approx(BAND_RAD, rel=0.1)
    assert added["holdout_after"]["mse_rad2"] < 0.2 * added["holdout_before"]["mse_rad2"]

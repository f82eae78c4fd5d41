"""A servo that is later than all others, by less than anyone knows when commands take effect."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.diagnosis.conftest import called
from tests.diagnosis.rig import changed_rig, motion_of


@pytest.mark.slow
def test_one_late_servo_is_told_by_those_that_are_not(tmp_path: Path) -> None:
    """At 125 Hz a command is known to 8 ms: alone, a servo that is 4 ms late is sound."""
    delay_s = 0.004
    model, bag, other = changed_rig(tmp_path, "command_delay", {"delay": delay_s}, target="left")
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    (found,) = said["findings"]
    assert found["target"] == "left"
    assert "command_delay" in {found["effect"], *(name.partition(":")[0] for name in found["confusable_with"])}
    assert said["verdict"] in ("explained", "ambiguous")
    if found["effect"] == "command_delay":
        assert found["parameters"]["delay"]["value"] == pytest.approx(delay_s, rel=0.1)


def test_a_bus_that_is_late_for_all_is_no_one_servos(tmp_path: Path) -> None:
    """All are as late as the others: within what is known of the time of commands nothing is missing."""
    model, bag, other = changed_rig(tmp_path, "command_delay", {"delay": 0.004})
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    assert said["verdict"] == "within_noise"


def test_a_cycle_of_the_robot_is_no_fault_however_many_joints_tell_of_it(tmp_path: Path) -> None:
    """At 125 Hz a command may wait for 8 ms: six servos that agree on 7.5 ms know of one delay, not of six."""
    motion = motion_of([f"servo_{number}" for number in range(6)])
    model, bag, other = changed_rig(tmp_path, "command_delay", {"delay": 0.0075}, motion=motion)
    said = called("diagnose", "--model", str(model), "--recording", str(bag), "--holdout", str(other),
                  result=tmp_path / "d.json")  # fmt: skip
    assert said["verdict"] == "within_noise"

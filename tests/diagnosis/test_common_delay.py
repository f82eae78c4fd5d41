"""A servo that is later than all others, by less than anyone knows when commands take effect."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.diagnosis.conftest import called
from tests.diagnosis.rig import changed_rig, motion_of
from twin_daemon.diagnosis.common_delay import common_delay
from twin_daemon.diagnosis.group import look
from twin_daemon.estimation.partition import Reduction
from twin_daemon.hand import load_hand
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align, moving_joints
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.twin import TwinModel


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


@pytest.mark.parametrize(("target", "late"), [("left", {"left"}), ("robot", set[str]())])
def test_joints_that_get_their_commands_at_once_tell_less_than_a_time_step(
    tmp_path: Path, target: str, late: set[str]
) -> None:
    """The rig moves in steps of 2 ms: one servo that is 1.8 ms later is told, and all of them are not."""
    model, bag, _ = changed_rig(tmp_path, "command_delay", {"delay": 0.0018}, target=target)
    twin = TwinModel.load(load_hand(model=model))
    recordings = [align(twin, load_recording(bag))]
    moving = moving_joints(recordings)
    groups = [(group, [name for name in moving if name in group.joints]) for group in drive_groups(twin)]
    reduction = Reduction(twin, recordings, [])
    parts = [look(reduced)[1] for reduced in reduction.each(twin, groups) if reduced is not None]
    found = common_delay(parts)
    assert {joint for part in (found.late if found else ()) for joint in part.joints} == late


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

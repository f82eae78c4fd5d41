"""The stand-in hand: its own motion, and whom it obeys."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

from bridges.zenoh.stand_in import by_command, easy_motion, holding_the_rest
from twin_daemon.daemon.messages import JointSample
from twin_daemon.hand import load_hand
from twin_daemon.services.inbox import Inbox
from twin_daemon.services.pace import Pace
from twin_daemon.services.stop import StopSignal, on_termination
from twin_daemon.signals.trajectory import load_trajectory


def test_targets_by_joint_become_targets_by_command() -> None:
    description = load_hand().description
    names = ("FFJ1", "rh_FFJ2", "rh_FFJ3", "rh_MFJ2", "rh_RFJ3", "gripper")
    sample = JointSample(0, names, np.array([0.3, 0.4, 0.5, 0.6, np.nan, 1.0]))
    assert by_command(description, sample) == pytest.approx({"rh_FFJ0": 0.7, "rh_FFJ3": 0.5})


def test_the_easy_motion_is_closed_and_within_all_ranges() -> None:
    hand = load_hand()
    motion = easy_motion(hand)
    np.testing.assert_allclose(motion.positions[0], motion.positions[-1], atol=1e-12)
    for name, column in zip(motion.joints, motion.positions.T, strict=True):
        low, high = hand.command_range_rad[name]
        assert low <= column.min() <= column.max() <= high
        assert np.ptp(column) > 0.05


def test_the_oldest_message_gives_way_and_is_counted() -> None:
    inbox = Inbox(size=3)
    for number in range(5):
        inbox.put("joint_states", bytes([number]))
    assert [payload[0] for _, payload, _, _ in inbox.take(0.0)] == [2, 3, 4]
    assert inbox.dropped == 2
    assert inbox.take(0.0) == []


def test_a_stop_wakes_whoever_waits() -> None:
    stop = StopSignal()
    threading.Timer(0.1, stop.set).start()
    assert stop.wait(30.0)
    assert stop.wait(0.0)
    stop.close()


def test_sigterm_stops_and_the_handler_from_before_comes_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with on_termination() as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.wait(30.0)
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_long_stall_is_not_caught_up() -> None:
    stop = StopSignal()
    pace = Pace(stop)
    pace.begin_s -= 60.0
    assert pace.wait_until(0.0)
    assert pace.stalls == 1
    assert pace.lost_s >= 60.0
    assert time.monotonic() - pace.begin_s < 1.0
    stop.close()


def test_commands_that_a_motion_does_not_name_are_held_at_rest() -> None:
    hand = load_hand()
    motion = holding_the_rest(load_trajectory("index_closing", hand).by_command(hand), hand)
    assert set(motion.joints) == set(hand.commands)
    assert np.ptp(motion.positions[:, motion.joints.index("rh_FFJ3")]) > 1.0
    assert np.ptp(motion.positions[:, motion.joints.index("rh_MFJ3")]) == 0.0

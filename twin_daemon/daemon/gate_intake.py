"""What a gate hears of its hand by itself: joint states and commands, checked as the daemon checks them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from twin_daemon.daemon.intake import Intake, joint_ranges
from twin_daemon.daemon.messages import ROS_SOURCE, JointSample
from twin_daemon.daemon.mirror import Mirror
from twin_daemon.daemon.one_source import Doubts, in_words
from twin_daemon.gate.gate import Gate
from twin_daemon.hand.naming import match
from twin_daemon.simulation.twin import TwinModel


class GateIntake:
    """Tells one gate what is measured and what is sent to the hand. Safe in several threads."""

    def __init__(self, twin: TwinModel, gate: Gate, tell: Callable[[str, str, dict[str, Any]], None]) -> None:
        self._gate = gate
        self._doubts = Doubts(tell)
        self._intake = Intake(twin.joints, *joint_ranges(twin))
        self._mirror = Mirror(twin.joints)
        self._lock = threading.Lock()

    def on_joint_state(self, sample: JointSample, now_s: float) -> None:
        """One decoded joint state, which arrived at `now_s` on the monotonic clock."""
        with self._lock:
            accepted = self._intake.accept(sample, time.time_ns(), now_s)
            for doubt in self._intake.take_doubts():
                if doubt.serious:
                    self._gate.doubt(doubt.kind, in_words(doubt, self._gate.names_source), now_s)
                self._doubts.tell(doubt, self._gate.names_source, now_s)
            if accepted is None:
                return
            if accepted.restarted:
                self._mirror.forget()
            self._mirror.update(accepted, now_s)
            self._gate.measured(self._mirror.position, self._mirror.arrival_s, self._efforts(sample))

    def on_command(self, sample: JointSample, now_s: float) -> None:
        """One decoded command, whoever sent it."""
        # a bridge to ROS sends back what it was sent
        source = None if sample.source.startswith(ROS_SOURCE) else sample.source
        self._gate.seen(sample.stamp_ns, sample.names, sample.position, now_s, source)

    def _efforts(self, sample: JointSample) -> dict[str, float] | None:
        """The efforts that the gate has limits for, by joint."""
        watched = self._gate.settings.effort_limit
        if not watched or not len(sample.effort):
            return None
        by_name = dict(zip(sample.names, sample.effort.tolist(), strict=True))
        found = {joint: by_name[name] for joint in watched if (name := match(joint, by_name)) is not None}
        return {joint: value for joint, value in found.items() if np.isfinite(value)}

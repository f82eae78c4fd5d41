"""A gate under a clock that tests move by hand, and a hand that goes where it is sent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from twin_daemon.gate.gate import Gate
from twin_daemon.gate.requests import KINDS
from twin_daemon.gate.sendable import Sendable
from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import Who
from twin_daemon.simulation.twin import TwinModel

ANN, BOB, EVE = Who("ann", "operator"), Who("bob", "operator"), Who("eve", "viewer")


class Rig:
    """Asks, turns and measures. The hand is at rest at 0 rad, or where its range begins."""

    def __init__(self, twin: TwinModel, **settings: Any) -> None:
        self.entries: list[dict[str, Any]] = []
        self.gate = Gate(twin, GateSettings(**settings), self.entries.append, session="now")
        self.joints = twin.joints
        self.hand = twin.hand
        ranges = np.array([twin.hand.joint_range_rad[name] for name in twin.joints])
        self.pose = np.clip(np.zeros(len(twin.joints)), ranges[:, 0], ranges[:, 1])
        self.now_s, self.wall_ns, self.sequence = 50.0, 10**18, 0
        self.speaks = True
        self.lease = ""
        self.effort: dict[str, float] = {}
        self.hear()

    def hear(self) -> None:
        self.gate.measured(self.pose, np.full(len(self.joints), self.now_s), self.effort)

    def ask(self, verb: str, who: Who | None = ANN, **body: Any) -> dict[str, Any]:
        self.sequence += 1
        stamps = {"session": "now", "sequence": self.sequence, "stamp_ns": self.wall_ns, "lease": self.lease}
        answer = self.gate.ask(verb, KINDS[verb](**(stamps | body)), who, self.now_s, self.wall_ns)
        self.lease = answer.get("lease", self.lease)
        return answer

    def arm(self, who: Who = ANN, **body: Any) -> None:
        assert self.ask("arm", who, reason="a test", **body)["accepted"]

    def turn(self, after_s: float | None = None) -> Sendable | None:
        after_s = 1.0 / self.gate.settings.rate_hz if after_s is None else after_s
        self.now_s += after_s
        self.wall_ns += int(after_s * 1e9)
        if self.speaks:
            self.hear()
        sent = self.gate.turn(self.now_s, self.wall_ns)
        if sent is not None:
            for name, value in zip(sent.names, sent.position, strict=True):
                driven = self.hand.description.commands[name].joints
                for joint in driven:
                    self.pose[self.joints.index(joint)] = value / len(driven)
        return sent

    def turns(self, seconds: float, beat: bool = True) -> list[Sendable]:
        """What is sent in so many seconds, with a commander who keeps saying that he is there."""
        sent = []
        for number in range(round(seconds * self.gate.settings.rate_hz)):
            if beat and number % 10 == 0:
                self.ask("beat")
            one = self.turn()
            if one is not None:
                sent.append(one)
        return sent

    @property
    def status(self) -> dict[str, Any]:
        return self.gate.status(self.now_s)


@pytest.fixture(scope="session")
def twin() -> TwinModel:
    return TwinModel.load(load_hand())


@pytest.fixture
def rig(twin: TwinModel) -> Rig:
    return Rig(twin)

"""What a request asks, what the gate knows when it is asked, and how it refuses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from twin_daemon.gate.limits import Limits
from twin_daemon.gate.motion import Motion
from twin_daemon.gate.preview import Collision
from twin_daemon.gate.readings import Doubt
from twin_daemon.gate.requests import Request
from twin_daemon.gate.settings import GateSettings
from twin_daemon.security.identity import Who

NOTHING_SENT = "nothing was sent to the hand"


@dataclass(frozen=True)
class Refusal:
    """Why a request was refused. `check` is the name of the check, for programs."""

    check: str
    why: str
    allowed: str | None = None
    consequence: str = NOTHING_SENT

    def line(self) -> str:
        allowed = f". Allowed: {self.allowed}" if self.allowed else ""
        return f"{self.why}{allowed}; {self.consequence}"


@dataclass(frozen=True)
class Situation:
    """What the gate knows when it is asked. Arrays by command, (c,)."""

    mode: str  # read_only, armed, stopped
    commander: str | None
    held: bool  # the request carries the lease that is held
    lease_left_s: float
    stopped_because: str | None
    session: str
    last_sequence: int  # of this sender, among requests that have an order with this one
    limits: Limits
    settings: GateSettings
    setpoint: np.ndarray
    given: np.ndarray  # bool: which commands the gate has under way already
    away: Callable[[], np.ndarray]  # rad: farthest of the hand from `setpoint` in the last moments
    doubts: list[Doubt]  # readings of the last moments that cannot be
    age_s: np.ndarray  # since each command's joints were last measured; infinite before the first time
    letting_go: bool = False  # the setpoints still go back from what the hand presses against
    doubt: str | None = None  # why what is told of the hand may not be the hand's


@dataclass(frozen=True)
class Asked:
    """A request with what follows from it. `motion` is what it would do, where it would do something."""

    verb: str
    who: Who | None
    session: str = ""
    sequence: int = 0
    age_s: float = 0.0
    ahead_s: float = -np.inf  # of the sequence, read as a time in ns, before the gate's clock
    lease: str = field(default="", repr=False)
    reason: str = ""
    lease_s: float = 0.0
    targets: Mapping[str, float] = field(default_factory=dict)
    motion: Motion | None = None
    collision: Callable[[], Collision | None] = lambda: None

    @staticmethod
    def of(verb: str, request: Request, who: Who | None, wall_ns: int, settings: GateSettings) -> Asked:
        """Without what is planned for it; `wall_ns` is the present."""
        return Asked(
            verb=verb,
            who=who,
            session=request.session,
            sequence=request.sequence,
            age_s=(wall_ns - request.stamp_ns) * 1e-9,
            ahead_s=(request.sequence - wall_ns) * 1e-9,
            lease=request.lease,
            reason=getattr(request, "reason", ""),
            lease_s=getattr(request, "lease_s", None) or settings.lease_s,
        )

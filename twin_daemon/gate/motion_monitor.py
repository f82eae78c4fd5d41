"""What ends a motion that was allowed: each condition is looked at in every turn, and the setpoints then come to rest.

Where the hand may press against something they do not only stop: they go back to where the hand is (`let_go.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.readings import Doubt
from twin_daemon.gate.response import Response
from twin_daemon.gate.settings import GateSettings
from twin_daemon.gate.tracking import Tracking
from twin_daemon.hand import Hand, match

PRESSES = frozenset({"tracking", "frozen", "wrong_way", "too_far", "effort", "stopped"})
"""Kinds of protective stops (ISO 10218-1; `trip` in the audit log) after which the hand lets go. Not where a reading
cannot be: then none is believed."""


@dataclass(eq=False, slots=True)
class Turn:
    """What a turn of the gate sees. By command (c,): where the hand is sent and is, rad, NaN where unknown."""

    now_s: float
    since_last_turn_s: float
    lease_left_s: float
    commander_silent_s: float
    commander_patience_s: float
    names: tuple[str, ...]
    setpoint: np.ndarray
    measured: np.ndarray
    arrival_s: np.ndarray
    age_s: np.ndarray
    effort: dict[str, float]
    doubts: list[Doubt]
    letting_go: bool  # no motion is under way, and what springs back need not do what the twin does


@dataclass(frozen=True)
class ProtectiveStop:
    """Why a motion was ended. `kind` is for programs."""

    kind: str
    why: str


class MotionMonitor:
    """Looks at every turn; `tracking` and `response` remember where the hand was sent. Raises BadInput for effort
    limits of no joint."""

    def __init__(self, hand: Hand, settings: GateSettings) -> None:
        self._settings = settings
        self.tracking = Tracking(hand, settings)
        self.response = Response(self.tracking)
        self._command_of = {joint: name for name, info in hand.description.commands.items() for joint in info.joints}
        self.effort_limit: dict[str, float] = {}
        for name, most in settings.effort_limit.items():
            joint = match(name, hand.joints)
            if joint is None:
                raise BadInput(f"gate.effort_limit: no joint '{name}'", todo=nearest(name, hand.joints))
            self.effort_limit[joint] = most

    def forget(self) -> None:
        """What comes begins at rest."""
        self.tracking.forget()
        self.response.forget()

    def sent(self, now_s: float, setpoint: np.ndarray, expected: np.ndarray) -> None:
        """The setpoints (c,) in force from now on, and where the twin is, rad."""
        self.tracking.sent(now_s, setpoint, expected)
        self.response.sent(now_s, np.where(np.isfinite(setpoint), expected, np.nan))

    @property
    def suspects(self) -> bool:
        """Whether the hand does not do what it should at the moment; a protective stop may come of it."""
        return self.tracking.off or self.response.off

    @property
    def suspected(self) -> np.ndarray:
        """(c,) bool: the commands of which that is so."""
        return self.tracking.which | self.response.which

    def check(self, turn: Turn) -> ProtectiveStop | None:
        """The first reason for a protective stop in this turn, if there is one."""
        found = (
            self._lease(turn),
            self._standstill(turn),
            self._commander(turn),
            self._hand(turn),
            self._implausible(turn),
            self._effort(turn),
            self._response(turn),
            self._tracking(turn),
        )
        return next((stop for stop in found if stop is not None), None)

    def _lease(self, turn: Turn) -> ProtectiveStop | None:
        return ProtectiveStop("lease", "the lease has run out") if turn.lease_left_s <= 0.0 else None

    def _standstill(self, turn: Turn) -> ProtectiveStop | None:
        """A process that was stopped and goes on must not go on with what it did."""
        if turn.since_last_turn_s <= self._settings.state_timeout_s:
            return None
        return ProtectiveStop("standstill", f"the gate itself stood still for {turn.since_last_turn_s:.2f} s")

    def _commander(self, turn: Turn) -> ProtectiveStop | None:
        if turn.commander_silent_s <= turn.commander_patience_s:
            return None
        return ProtectiveStop("commander", f"the commander has been silent for {turn.commander_silent_s:.2f} s")

    def _hand(self, turn: Turn) -> ProtectiveStop | None:
        if not np.count_nonzero(turn.age_s > self._settings.state_timeout_s):
            return None
        age_s = np.where(np.isfinite(turn.setpoint), turn.age_s, 0.0)
        worst = int(np.argmax(age_s))
        if age_s[worst] <= self._settings.state_timeout_s:
            return None
        return ProtectiveStop("stale", f"{turn.names[worst]} was last heard {age_s[worst]:.2f} s ago")

    def _effort(self, turn: Turn) -> ProtectiveStop | None:
        for joint, most in self.effort_limit.items():
            if abs(turn.effort.get(joint, 0.0)) > most:
                return ProtectiveStop(
                    "effort", f"the effort of {joint} is {turn.effort[joint]:g}, at most {most:g} is allowed"
                )
        return None

    def _implausible(self, turn: Turn) -> ProtectiveStop | None:
        """With the cause where the motion has shown it already, and the site's `tracking_time_s` waits for longer."""
        if not turn.doubts:
            return None
        doubt = turn.doubts[0]
        command = self._command_of.get(doubt.joint)
        cause = None if command is None else self.response.cause(command)
        if cause is None or cause.kind != "wrong_way":
            return ProtectiveStop("implausible", doubt.why)
        return ProtectiveStop("implausible", f"{cause.why}; {doubt.why}")

    def _response(self, turn: Turn) -> ProtectiveStop | None:
        if turn.letting_go:
            return None
        found = self.response.look(turn.measured, turn.arrival_s)
        return None if found is None else ProtectiveStop(found.kind, found.why)

    def _tracking(self, turn: Turn) -> ProtectiveStop | None:
        if turn.letting_go:
            return None
        found = self.tracking.look(turn.measured, turn.arrival_s)
        if found is None:
            return None
        command, why = found
        cause = self.response.cause(command)
        return ProtectiveStop("tracking", why) if cause is None else ProtectiveStop(cause.kind, f"{why}; {cause.why}")

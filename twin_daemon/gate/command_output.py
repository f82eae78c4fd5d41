"""What leaves the gate: each setpoint once, numbered and stamped, and said again while it is held."""

from __future__ import annotations

import itertools

import numpy as np

from twin_daemon.gate.own import OwnCommands
from twin_daemon.gate.sendable import Sendable, make_sendable
from twin_daemon.gate.shaper import Shaper

_RESEND_S = 0.2  # a target that is held is said again: one message may be lost


class CommandOutput:
    """Makes commands of setpoints, and knows them again."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._named: tuple[bytes, tuple[str, ...]] = b"", ()
        self._own = OwnCommands()
        self._stamp_ns = 0
        self._sent_s = -np.inf
        self.number = 0
        """How many commands have left."""
        self.row = np.full(len(names), np.nan)
        """(c,) rad: where the hand was sent last; NaN where it never was."""
        self.is_last = False
        """Whether the hand's last command was the gate's."""
        self.first_s = -np.inf
        """When the first command since arming left, s."""

    def armed(self) -> None:
        """Nothing has left since."""
        self.first_s = -np.inf

    def is_own(self, stamp_ns: int, names: tuple[str, ...], position: np.ndarray, now_s: float) -> bool:
        """Whether this command was sent from here, to the last bit."""
        return self._own.holds(stamp_ns, names, position, now_s)

    def send(self, shaper: Shaper, now_s: float, wall_ns: int) -> Sendable | None:
        """The command that says where the setpoints are; None where that was said a moment ago."""
        if not shaper.is_given:
            return None
        given, row = shaper.given, shaper.position
        position = row[given]
        if not np.count_nonzero(position != self.row[given]) and now_s - self._sent_s < _RESEND_S:
            return None
        self.number += 1
        self._stamp_ns = max(wall_ns, self._stamp_ns + 1)
        self.row, self._sent_s, self.is_last = row.copy(), now_s, True
        if self.first_s < 0.0:
            self.first_s = now_s
        names = self._names_of(given)
        self._own.sent(self._stamp_ns, names, position, now_s)
        return make_sendable(self.number, self._stamp_ns, names, position)

    def _names_of(self, given: np.ndarray) -> tuple[str, ...]:
        if self._named[0] != (which := given.tobytes()):
            self._named = which, tuple(itertools.compress(self._names, given))
        return self._named[1]

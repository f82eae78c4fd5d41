"""The setpoints turn by turn: along a motion, to rest, or back to where the hand is, with the twin beside them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_daemon.gate.ahead import in_the_way, way_back
from twin_daemon.gate.feedback import Feedback
from twin_daemon.gate.hand_model import HandModel
from twin_daemon.gate.let_go import LetGo, Path
from twin_daemon.gate.limits import Limits
from twin_daemon.gate.motion import Motion
from twin_daemon.gate.motion_monitor import MotionMonitor, ProtectiveStop
from twin_daemon.gate.settings import GateSettings
from twin_daemon.gate.shaper import Shaper

DONE = "done"


class Drive:
    """Knows nothing of who commands. All arrays by command, (c,), in rad.

    Where a motion would run the hand into itself it calls `ended` with the reason and the time: that ends the motion.
    """

    def __init__(
        self,
        limits: Limits,
        settings: GateSettings,
        feedback: Feedback,
        monitor: MotionMonitor,
        hand_model: HandModel,
        ended: Callable[[ProtectiveStop, float], None],
    ) -> None:
        self._limits, self._settings, self._feedback, self._monitor = limits, settings, feedback, monitor
        self._ended = ended
        self._path = Path(len(limits.names))
        self._rest = np.full(len(limits.names), np.nan)
        self.shaper = Shaper(limits)
        self.motion: Motion | None = None
        self.letting_go: LetGo | None = None
        self.use(hand_model)

    def use(self, hand_model: HandModel) -> None:
        """Looks ahead, and lets the twin run beside, with this from now on."""
        self._preview, self._expected = hand_model.preview, hand_model.expected

    @property
    def is_under_way(self) -> bool:
        """Whether the setpoints move, or a motion is about to move them."""
        return self.motion is not None or not self.shaper.still

    @property
    def is_active(self) -> bool:
        """Whether something moves or lets go."""
        return not self.shaper.still or self.letting_go is not None

    def start(self) -> np.ndarray:
        """Where each command is: its setpoint, else where the hand is."""
        return self._feedback.start(self.shaper.position)

    def armed(self) -> None:
        """Somebody begins anew; what still lets go may need the whole way back."""
        if not self.shaper.is_given:
            self._path = Path(len(self._limits.names))
            self._monitor.forget()  # else what is behind has been so before: arming anew buys it no time

    def begin(self, motion: Motion) -> None:
        """The next turns go along this."""
        start, fresh = self.start(), motion.moved & ~self.shaper.given
        self.shaper.begin(np.where(fresh, start, np.nan))
        if self._expected.running and fresh.any():
            self._expected.place(fresh, self._feedback.pose, start)
        self.motion = motion
        self.letting_go = None

    def end(self) -> None:
        """The next turns bring the setpoints to rest."""
        self.motion = None

    def forget(self) -> None:
        """No command has a setpoint."""
        self.shaper.forget()
        self._expected.forget()
        self._monitor.forget()
        self.letting_go = None

    def advance(self, dt_s: float, now_s: float) -> str | None:
        """One turn. Returns a word where something comes to its end: DONE, or what has not gone back all the way."""
        shaper, rest = self.shaper, self._rest
        motion, word = self.motion, None
        if self.letting_go is None:
            position, velocity = shaper.toward(rest if motion is None else motion.advance(dt_s), dt_s)
        else:
            goal = self.letting_go.follow(self.believed(now_s), now_s)
            pose, now = self._feedback.pose, self.start()
            position, velocity, short = way_back(self._preview, shaper, pose, now, goal, dt_s)
            if self.letting_go.is_done(shaper.position, now_s, short):
                word = self.letting_go.not_back(self._limits.names, shaper.position)
                self.letting_go = None
                self._monitor.forget()
        if motion is not None and np.count_nonzero(velocity):
            now = self.start()
            then = np.where(shaper.given, shaper.stopping(position, velocity), now)
            stop = in_the_way(self._preview, self._monitor, self._feedback.pose, now, then)
            if stop is not None:
                self._ended(stop, now_s)
                position, velocity = shaper.toward(rest, dt_s)
        shaper.take(position, velocity)
        # a motion is not done while the hand stays behind
        if self.motion is not None and self.motion.over(position, shaper.still) and not self._monitor.suspects:
            self.motion, word = None, DONE
        return word

    def expect(self, since_s: float, now_s: float) -> None:
        """The twin goes on beside the hand; where it failed, or was replaced, it begins where the hand is."""
        if not self.shaper.is_given:
            return
        if not self._expected.running:
            self._expected.begin(self._feedback.pose, self.start())
            self._monitor.forget()
        self._expected.advance(self.shaper.position, since_s)
        self._path.add(self.shaper.position, self._feedback.by_command())
        self._monitor.sent(now_s, self.shaper.position.copy(), self._expected.reading)

    def let_go(self, sent: np.ndarray, is_last: bool, now_s: float) -> bool:
        """The setpoints go to where the hand is, so that it presses against nothing. Where they were given up already
        the hand still holds what was `sent` last, if that `is_last` of all. Whether they begin again for it."""
        shaper = self.shaper
        rest = np.where(shaper.given, shaper.stopping(shaper.position, shaper.velocity), sent)
        low, high = self._path.bounds()
        bounds = np.maximum(low, self._limits.lower), np.minimum(high, self._limits.upper)
        found = LetGo(rest, self.believed(now_s), self._limits.margin, bounds, now_s)
        begins = not shaper.is_given
        if begins:
            if not is_last or not found.is_needed:
                return False
            shaper.begin(rest)
        self.letting_go = found
        return begins

    def believed(self, now_s: float) -> np.ndarray:
        """Where the hand is, NaN where it is not heard or its readings cannot be. Where those of several joints cannot
        be it is no sensor's fault but the driver's, and none is believed."""
        heard = self._feedback.ages_s(now_s) <= self._settings.state_timeout_s
        if len(self._feedback.doubts(now_s)) > 1:
            heard = np.zeros_like(heard)
        return np.where(heard & ~self._feedback.doubted(now_s), self._feedback.by_command(), np.nan)

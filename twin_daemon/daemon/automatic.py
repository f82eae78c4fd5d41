"""A motion that the twin begins by itself: announced, counted down, under way, over."""

from __future__ import annotations

from typing import Any, Literal

from twin_daemon.daemon.schedule import Unfinished

Phase = Literal["announced", "starting", "moving"]
NOTHING: dict[str, Any] = {"schema": 1, "phase": "none", "begins_in_s": None, "words": "no automatic motion"}
"""What is told while there is none."""


class AutomaticRun:
    """Where one run is. `mover` is the identity in whose name it arms. Times are of a monotonic clock, s."""

    def __init__(self, run: Unfinished, trajectory: str, mover: str, now_s: float, countdown_s: float) -> None:
        self.run = run
        self.phase: Phase = "announced"
        self._trajectory = trajectory
        self._mover = mover
        self._begins_s = now_s + countdown_s

    def is_due(self, now_s: float) -> bool:
        """Whether it has been counted down to the end."""
        return self.phase == "announced" and now_s >= self._begins_s

    def started(self) -> None:
        """Its process has been started; it arms the hand some seconds later."""
        self.phase = "starting"

    def look(self, commander: str | None) -> bool:
        """Takes note of who has armed the hand; whether its motion is over."""
        moves = commander == self._mover
        over = self.phase == "moving" and not moves
        if self.phase == "starting" and moves:
            self.phase = "moving"
        return over

    def told(self, now_s: float) -> dict[str, Any]:
        """For a lamp, a buzzer, a page: what comes, why, and when."""
        left_s = max(self._begins_s - now_s, 0.0) if self.phase == "announced" else 0.0
        words = {
            "announced": f"the hand moves by itself in {left_s:.0f} s",
            "starting": "the hand moves by itself in a moment",
            "moving": "the hand moves by itself",
        }[self.phase]
        return {
            "schema": 1,
            "phase": self.phase,
            "begins_in_s": left_s,
            "why": self.run.why,
            "trajectory": self._trajectory,
            "words": f"{words}, along {self._trajectory} ({self.run.why}): keep clear; anybody may cancel or stop it",
        }

"""Turns in real time."""

from __future__ import annotations

import time

from twin_daemon.services.stop import Stoppable

_HOPELESS_S = 0.25


class Pace:
    """Waits for moments on the monotonic clock. A stall longer than a quarter of a second is not caught up."""

    def __init__(self, stop: Stoppable) -> None:
        self._stop = stop
        self.begin_s = time.monotonic()
        self.stalls = 0
        self.lost_s = 0.0

    def wait_until(self, since_begin_s: float) -> bool:
        """Sleeps until that time after the beginning. False when it is time to stop."""
        late_s = time.monotonic() - self.begin_s - since_begin_s
        if late_s > _HOPELESS_S:
            self.begin_s += late_s
            self.lost_s += late_s
            self.stalls += 1
        elif late_s < 0:
            return not self._stop.wait(-late_s)
        return not self._stop.is_set()

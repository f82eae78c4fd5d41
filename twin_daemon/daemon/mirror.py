"""The mirror: what the hand last said about each joint, with its own stamp and age."""

from __future__ import annotations

import numpy as np

from twin_daemon.daemon.intake import Accepted

_SMOOTHING_S = 0.03
_LONGEST_DIFFERENCE_S = 0.5


class Mirror:
    """Last measured position (j,) rad of each joint, NaN before its first, and an estimated velocity (j,) rad/s.

    The velocity is differentiated here: a hand whose motor pulls two joints reports one velocity for both.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        self.joints = joints
        self.forget()

    def forget(self) -> None:
        """Nothing is known, as before the first message."""
        count = len(self.joints)
        self.position = np.full(count, np.nan)
        self.velocity = np.zeros(count)
        self.stamp_ns = np.zeros(count, dtype=np.int64)
        self.arrival_s = np.full(count, -np.inf)
        self._whole_ns: int | None = None  # the stamp of the last message, where it had all joints

    def update(self, accepted: Accepted, now_s: float) -> None:
        """Takes over what one message says. `now_s` is the monotonic time of its arrival."""
        whole = len(accepted.index) == len(self.joints)
        last_ns, self._whole_ns = self._whole_ns, accepted.stamp_ns if whole else None
        elapsed_s = (accepted.stamp_ns - last_ns) * 1e-9 if whole and last_ns is not None else 0.0
        if not 0.0 < elapsed_s < _LONGEST_DIFFERENCE_S:
            self._update_some(accepted, now_s)
            return
        slope = (accepted.position - self.position) / elapsed_s
        self.velocity += (1.0 - np.exp(-elapsed_s / _SMOOTHING_S)) * (slope - self.velocity)
        self.position[:] = accepted.position
        self.stamp_ns.fill(accepted.stamp_ns)
        self.arrival_s.fill(now_s)

    def _update_some(self, accepted: Accepted, now_s: float) -> None:
        """The same where each joint has a past of its own."""
        index = accepted.index
        elapsed_s = (accepted.stamp_ns - self.stamp_ns[index]) * 1e-9
        usable = np.isfinite(self.position[index]) & (elapsed_s > 0) & (elapsed_s < _LONGEST_DIFFERENCE_S)
        safe_s = np.where(usable, elapsed_s, 1.0)
        slope = (accepted.position - self.position[index]) / safe_s
        weight = 1.0 - np.exp(-safe_s / _SMOOTHING_S)
        smoothed = self.velocity[index] + weight * (slope - self.velocity[index])
        self.velocity[index] = np.where(usable, smoothed, 0.0)
        self.position[index] = accepted.position
        self.stamp_ns[index] = accepted.stamp_ns
        self.arrival_s[index] = now_s

    def ages_s(self, now_s: float) -> np.ndarray:
        """(j,) seconds since each joint's last value arrived; infinite for a joint that was never heard."""
        return now_s - self.arrival_s

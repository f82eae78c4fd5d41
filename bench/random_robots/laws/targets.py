"""Between the bus and the servo: commands that come late, rounded, slowed or in stairs."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from .base import Law


class _OnCommand(Law):
    at = "servo"

    def commands(self, steps: np.ndarray, step_s: float) -> np.ndarray:
        out = steps.copy()
        out[:, self.site.servo] = self.shaped(steps[:, self.site.servo], step_s)
        return out

    def shaped(self, track: np.ndarray, step_s: float) -> np.ndarray:
        """(m,) what arrives of one command."""
        raise NotImplementedError

    @property
    def longest_s(self) -> float:
        return min(0.4 / self.site.robot.bandwidth_hz, 0.15)


class Delay(_OnCommand):
    """The command arrives late."""

    key = "command_delay"
    sizes = (2e-3, 1.0)

    def values(self) -> dict[str, float]:
        return {"delay": self.size * self.longest_s}

    def shaped(self, track: np.ndarray, step_s: float) -> np.ndarray:
        late = self.values()["delay"] / step_s
        whole = int(late)
        padded = np.concatenate([np.full(whole + 1, track[0]), track])
        share = late - whole
        return (1 - share) * padded[1 : len(track) + 1] + share * padded[: len(track)]


class Lag(_OnCommand):
    """A first-order filter on the command."""

    key = "actuator_lag"
    sizes = (2e-3, 2.0)

    def values(self) -> dict[str, float]:
        return {"tau": self.size * self.longest_s}

    def shaped(self, track: np.ndarray, step_s: float) -> np.ndarray:
        keep = float(np.exp(-step_s / self.values()["tau"]))
        return lfilter([1 - keep], [1.0, -keep], track, zi=[keep * track[0]])[0]


class RateLimit(_OnCommand):
    """The set point moves no faster than a limit."""

    key = "rate_limit"
    sizes = (0.02, 5.0)

    def values(self) -> dict[str, float]:
        return {"rate": self.site.fastest * float(np.exp(-self.size))}

    def shaped(self, track: np.ndarray, step_s: float) -> np.ndarray:
        most, here = self.values()["rate"] * step_s, float(track[0])
        out = []
        for wanted in track.tolist():
            here = min(max(wanted, here - most), here + most)
            out.append(here)
        return np.array(out)


class Stairs(_OnCommand):
    """A controller that reads its command only now and then and holds it."""

    key = "x_stair_commands"
    sizes = (0.3, 3.0)

    def shaped(self, track: np.ndarray, step_s: float) -> np.ndarray:
        every = max(1, round(self.size * 2 * self.longest_s / step_s))
        return track[np.arange(len(track)) // every * every]

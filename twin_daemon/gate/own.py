"""What the gate has sent, so that its own commands are told from others'. A stamp alone can be copied."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

_REMEMBERED = 1024
_AGE_S = 2.0  # a command comes back to whoever listens within this, also on a loaded machine


class OwnCommands:
    """By stamp: the names and values that were sent with it, and when, on the gate's monotonic clock."""

    def __init__(self) -> None:
        self._sent: OrderedDict[int, tuple[tuple[str, ...], bytes, float]] = OrderedDict()

    def sent(self, stamp_ns: int, names: tuple[str, ...], position: np.ndarray, now_s: float) -> None:
        self._sent[stamp_ns] = names, _bytes(position), now_s
        if len(self._sent) > _REMEMBERED:
            self._sent.popitem(last=False)

    def holds(self, stamp_ns: int, names: tuple[str, ...], position: np.ndarray, now_s: float) -> bool:
        """Whether this is one of them, to the last bit, and not sent again later."""
        known = self._sent.get(stamp_ns)
        return known is not None and known[:2] == (names, _bytes(position)) and now_s - known[2] <= _AGE_S


def _bytes(position: np.ndarray) -> bytes:
    return np.asarray(position, dtype=float).tobytes()

"""Who may command now: one session of somebody, known by a secret that the reply to its arming tells."""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field

from twin_daemon.gate.settings import GateSettings

_FORGETS, _USUALS = 0.9, 7.0


@dataclass
class Lease:
    """The right to command until `until_s`. A second session of the same name holds none of it: it does not have the
    `token`. Times are of the gate's monotonic clock."""

    name: str
    reason: str
    until_s: float
    beat_s: float
    sequence: int
    every_s: float = 1.0  # between two signs of life, lately; a few quick ones prove no habit
    token: str = field(default_factory=lambda: secrets.token_hex(16), repr=False)

    def beat(self, now_s: float) -> None:
        """A sign of life of the holder."""
        self.every_s = max(now_s - self.beat_s, _FORGETS * self.every_s)
        self.beat_s = now_s

    def patience_s(self, settings: GateSettings) -> float:
        """How long the holder may be silent: seven times what is usual with him. One who speaks 125 times a second is
        missed as soon as the hand would be."""
        return min(settings.heartbeat_s, max(settings.state_timeout_s, _USUALS * self.every_s))

    def is_held(self, name: str, token: str) -> bool:
        """Whether this name with this token is who holds it."""
        return name == self.name and hmac.compare_digest(token.encode(), self.token.encode())


class Sequences:
    """The last sequence of each name, and of the lease that is held: what others do in the same name does not touch
    the holder's. Names are those of the identity file, so there are not many."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}

    def last(self, name: str, lease: Lease | None) -> int:
        return self._last.get(name, 0) if lease is None else lease.sequence

    def take(self, name: str, lease: Lease | None, sequence: int) -> None:
        if lease is None:
            self._last[name] = sequence
        else:
            lease.sequence = sequence

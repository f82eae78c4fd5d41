"""Who may command now: one session of somebody, known by a secret that the reply to its arming tells."""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field


@dataclass
class Lease:
    """The right to command until `until_s`. A second session of the same name holds none of it: it does not have the
    `token`. Times are of the gate's monotonic clock."""

    name: str
    reason: str
    until_s: float
    beat_s: float
    sequence: int
    token: str = field(default_factory=lambda: secrets.token_hex(16), repr=False)

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

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
    every_s: float = 1.0  # between two signs of life, lately; a few quick ones prove no habit
    token: str = field(default_factory=lambda: secrets.token_hex(16), repr=False)
    last: dict[str, int] = field(default_factory=dict, repr=False)  # sequence of its holder, by order

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
    the holder's. Names are those of the identity file, so there are not many.

    Verbs are heard in threads of their own, so that one overtakes another. A heartbeat made after a trajectory and
    heard before it says nothing against the trajectory. Only where the later of two requests must win do they share an
    order: among those that move the hand, and among those that say who may."""

    def __init__(self) -> None:
        self._last: dict[str, dict[str, int]] = {}

    def last(self, name: str, lease: Lease | None, verb: str) -> int:
        return self._of(name, lease).get(_order(verb), 0)

    def take(self, name: str, lease: Lease | None, verb: str, sequence: int) -> None:
        self._of(name, lease)[_order(verb)] = sequence

    def _of(self, name: str, lease: Lease | None) -> dict[str, int]:
        return self._last.setdefault(name, {}) if lease is None else lease.last


def _order(verb: str) -> str:
    if verb in ("move", "trajectory", "target"):
        return "motion"
    return "authority" if verb in ("arm", "disarm", "release") else verb

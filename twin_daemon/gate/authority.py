"""Who may command, and until when: read-only until somebody arms, and stopped until somebody releases."""

from __future__ import annotations

import numpy as np

from twin_daemon.gate.asked import Asked, Refusal, Situation
from twin_daemon.gate.checks import IDENTITY, first_refusal, identity_proved
from twin_daemon.gate.latch import Latch
from twin_daemon.gate.lease import Lease, Sequences
from twin_daemon.gate.settings import GateSettings

_DOUBT_S = 2.0  # after the last sign of it


class Authority:
    """The mode (`read_only`, `armed`, `stopped`) and the lease. With a `latch` that is set it begins stopped."""

    def __init__(self, settings: GateSettings, latch: Latch | None) -> None:
        self._settings, self._latch = settings, latch
        self._sequences = Sequences()
        self._doubt, self._doubt_s = "", -np.inf
        stopped = latch is not None and latch.why is not None
        self.mode = "stopped" if stopped else "read_only"
        self.ended = latch.why or "" if stopped and latch is not None else ""
        """Why the last lease or motion ended."""
        self.lease: Lease | None = None
        self.generation = 0
        """Grows with each end: what was planned before it is void."""

    @property
    def is_armed(self) -> bool:
        return self.mode == "armed"

    def held_by(self, asked: Asked) -> Lease | None:
        """The lease, if the request carries it."""
        lease = self.lease
        return lease if lease and asked.who and lease.is_held(asked.who.name, asked.lease) else None

    def last_sequence(self, asked: Asked) -> int:
        return self._sequences.last("" if asked.who is None else asked.who.name, self.held_by(asked), asked.verb)

    def identified(self, asked: Asked, situation: Situation, dry: bool) -> Refusal | None:
        """Who asks, and whether it is new. In one step with the look at the last sequence, under the gate's lock: verbs
        are asked in threads of their own, and of a request that comes twice only the first may count."""
        if dry:
            return identity_proved(asked, situation)
        if asked.verb == "stop":  # anybody may stop: one that is refused for want of a key hurts
            return None
        refusal = first_refusal(IDENTITY, asked, situation)
        if refusal is None and asked.who is not None:
            self._sequences.take(asked.who.name, self.held_by(asked), asked.verb, asked.sequence)
        return refusal

    def arm(self, asked: Asked, name: str, now_s: float) -> None:
        """A lease for who asks, or a longer one for who holds it."""
        held = self.held_by(asked)
        if held is not None:
            held.until_s, held.reason = now_s + asked.lease_s, asked.reason
        else:
            self.lease = Lease(name, asked.reason, now_s + asked.lease_s, now_s)
            self._sequences.take(name, self.lease, asked.verb, asked.sequence)
        self.mode, self.ended = "armed", ""

    def end(self, why: str) -> str | None:
        """The lease ends; the name of who held it."""
        self.generation += 1
        self.ended = why
        lease, self.lease = self.lease, None
        if self.is_armed:
            self.mode = "read_only"
        return None if lease is None else lease.name

    def stop(self) -> None:
        """Nobody arms until somebody releases."""
        self.mode = "stopped"

    def unlatch(self) -> Refusal | None:
        """Takes the stop off the disk; why that cannot be."""
        if self._latch is None:
            return None
        try:
            self._latch.clear()
        except OSError as error:
            return Refusal("latch", f"the latch cannot be removed: {error.strerror}", "a disk that works")
        return None

    def release(self) -> None:
        """Somebody may arm again."""
        self.mode, self.ended = "read_only", ""

    def doubt(self, why: str, now_s: float) -> None:
        """Nobody arms in the next seconds."""
        self._doubt, self._doubt_s = why, now_s

    def doubted(self, now_s: float) -> str | None:
        """Why what is told of the hand may not be the hand's."""
        return self._doubt if now_s - self._doubt_s <= _DOUBT_S else None

    def lease_left_s(self, now_s: float) -> float:
        """s; 0 where there is none."""
        return 0.0 if self.lease is None else self.lease.until_s - now_s

    def silent_s(self, now_s: float) -> float:
        """For how long who holds the lease has not been heard, s; 0 where nobody does."""
        return 0.0 if self.lease is None else now_s - self.lease.beat_s

    def patience_s(self) -> float:
        """How long he may be silent, s."""
        return np.inf if self.lease is None else self.lease.patience_s(self._settings)

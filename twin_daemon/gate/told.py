"""What the gate says of a request: to whoever asked, and to the record."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from twin_daemon.gate.asked import Asked, Refusal
from twin_daemon.hand import Hand

_STREAM_S = 1.0  # targets closer than this are one stream


def reply(asked: Asked, refusal: Refusal | None) -> dict[str, Any]:
    """The reply to a request, without the gate's state."""
    return {
        "schema": 1,
        "verb": asked.verb,
        "accepted": refusal is None,
        "check": refusal.check if refusal is not None else None,
        "why": refusal.why if refusal is not None else None,
        "allowed": refusal.allowed if refusal is not None else None,
        "consequence": refusal.consequence if refusal is not None else None,
        "seconds": asked.motion.duration_s if asked.motion is not None else None,
    }


def entry(asked: Asked, refusal: Refusal | None) -> dict[str, Any]:
    """The entry of a decision in the audit log."""
    motion = asked.motion
    return {
        "verb": asked.verb,
        "who": asked.who.name if asked.who is not None else None,
        "accepted": refusal is None,
        "check": refusal.check if refusal is not None else None,
        "why": refusal.line() if refusal is not None else None,
        "reason": asked.reason or None,
        "lease_s": asked.lease_s if asked.verb == "arm" else None,
        "targets": dict(asked.targets) if motion is not None and motion.kind != "trajectory" else None,
        "motion": motion.name if motion is not None else None,
        "seconds": motion.duration_s if motion is not None else None,
    }


def warnings(hand: Hand, limited: Collection[str], heard: Collection[str]) -> list[str]:
    """What whoever arms has to know: which guard is not there. `limited` are the joints with an effort limit, `heard`
    those whose effort the hand tells."""
    driven = [joint for info in hand.description.commands.values() for joint in info.joints]
    without = [joint for joint in driven if joint not in limited]
    silent = [joint for joint in limited if joint not in heard]
    found = []
    if without:
        which = "no joint has an" if not limited else f"{len(without)} of {len(driven)} joints have no"
        found.append(f"{which} effort limit (gate.effort_limit): that a finger presses is noticed by its lag only")
    if silent:
        found.append(f"the hand tells no effort of {', '.join(silent)}: the limit set for it can end no motion")
    return found


class Stream:
    """Targets that follow each other closely: of these the first is told of."""

    def __init__(self) -> None:
        self._last_s = -np.inf

    def goes_on(self, asked: Asked, refusal: Refusal | None, now_s: float) -> bool:
        """Whether this request is a further one of a stream, or a mere sign of life."""
        if asked.verb == "beat" and refusal is None:
            return True
        if asked.verb != "target" or refusal is not None:
            return False
        last_s, self._last_s = self._last_s, now_s
        return now_s - last_s < _STREAM_S

"""What the gate says of a request: to whoever asked, and to the record."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from twin_daemon.gate.checks import Asked, Refusal
from twin_daemon.hand import Hand


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
        found.append(f"the hand tells no effort of {', '.join(silent)}: the limit set for it cannot trip")
    return found


def not_back(names: tuple[str, ...], left_rad: np.ndarray) -> str:
    """What is told of commands that have not gone back all the way, with what is left of it (c,), rad."""
    which = [f"{name} stays {left:.2f} rad" for name, left in zip(names, left_rad.tolist(), strict=True) if left > 0.0]
    return f"; {', '.join(which)} away from where the hand is measured: it would overlap itself there"

"""The checks that a request must pass, one function each. Each says what is wrong, what is allowed, what follows.

A check gets the request and the gate's situation, and has no memory and no clock of its own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_daemon.gate.asked import Asked, Refusal, Situation
from twin_daemon.gate.readings import RECENT_S

_RATIO_SLACK = 1.0 + 1e-6  # of velocities that were differentiated from rounded numbers


Check = Callable[[Asked, Situation], Refusal | None]


def identity_proved(asked: Asked, _: Situation) -> Refusal | None:
    if asked.who is not None:
        return None
    return Refusal("identity", "this identity is not known here, or its proof is wrong", "identities of the key file")


def may_command(asked: Asked, _: Situation) -> Refusal | None:
    if asked.who is not None and asked.who.role == "operator":
        return None
    name = asked.who.name if asked.who is not None else "nobody"
    return Refusal("role", f"{name} may look and stop, and not command", "an identity with the role operator")


def of_this_session(asked: Asked, situation: Situation) -> Refusal | None:
    if asked.session == situation.session:
        return None
    return Refusal(
        "session", "the gate was started again since this request was prepared", "the session that status tells"
    )


def in_order(asked: Asked, situation: Situation) -> Refusal | None:
    if asked.sequence <= situation.last_sequence:
        why = f"the {asked.verb} with sequence {asked.sequence} came after {situation.last_sequence}"
        return Refusal("order", why, "a sequence that grows with each")
    if asked.ahead_s <= situation.settings.command_age_s:
        return None
    # it would leave no number for the requests that follow in this name
    why = f"the sequence {asked.sequence} is too large"
    return Refusal("order", why, "a count, or the time in ns: no more than the present one")


def recent(asked: Asked, situation: Situation) -> Refusal | None:
    most_s = situation.settings.command_age_s
    if abs(asked.age_s) <= most_s:
        return None
    return Refusal("fresh", f"the request was made {asked.age_s:.3g} s ago", f"at most {most_s:g} s, either way")


def not_stopped(_: Asked, situation: Situation) -> Refusal | None:
    if situation.mode != "stopped":
        return None
    return Refusal("stopped", f"the gate is stopped: {situation.stopped_because}", "an explicit release first")


def is_stopped(_: Asked, situation: Situation) -> Refusal | None:
    if situation.mode == "stopped":
        return None
    return Refusal("release", "the gate is not stopped", "release after a stop", "nothing changes")


def has_reason(asked: Asked, _: Situation) -> Refusal | None:
    if asked.reason.strip():
        return None
    return Refusal("reason", f"{asked.verb} needs a reason, for the record", "a few words", "nothing changes")


def nobody_else(asked: Asked, situation: Situation) -> Refusal | None:
    holder = situation.commander
    if holder is None or situation.held:
        return None
    mine = asked.who is not None and asked.who.name == holder
    return Refusal(
        "commander",
        f"{holder} has armed the hand{' in another session' if mine else ''}, for {situation.lease_left_s:.0f} s more",
        f"to wait until {'that lease ends' if mine else f'{holder} disarms'}, or to stop it",
    )


def hand_is_heard(_: Asked, situation: Situation) -> Refusal | None:
    age_s = float(situation.age_s.min(initial=np.inf))
    if age_s <= situation.settings.state_timeout_s:
        return None
    return Refusal("heard", _silence("the hand", age_s), f"{situation.settings.state_timeout_s:g} s at most")


def hand_is_believed(_: Asked, situation: Situation) -> Refusal | None:
    if situation.doubt is None:
        return None
    return Refusal("doubt", situation.doubt, "one source of joint states, and two seconds of it alone")


def holds_the_lease(asked: Asked, situation: Situation) -> Refusal | None:
    """Of two sessions in one name only the one that armed commands, and only it says that it is there."""
    if situation.held:
        return None
    if armed_by_asker(asked, situation) is None:
        why = f"{situation.commander} has armed the hand in another session, and the request does not carry its lease"
        return Refusal("lease", why, "the lease that the reply to arm tells")
    return armed_by_asker(asked, situation)


def readings_can_be(_: Asked, situation: Situation) -> Refusal | None:
    if not situation.doubts:
        return None
    return Refusal("implausible", situation.doubts[0].why, "readings that can be, for half a second")


def starts_at_hand(asked: Asked, situation: Situation) -> Refusal | None:
    motion = asked.motion
    if motion is None or not (fresh := motion.moved & ~situation.given).any():
        return None
    most_rad = situation.settings.start_tolerance_rad
    away = np.where(fresh, situation.away(), 0.0)
    i = int(np.argmax(away))
    if away[i] <= most_rad:
        return None
    return Refusal(
        "start",
        f"the first command to {situation.limits.names[i]} would be {situation.setpoint[i]:.3f} rad, and in the last"
        f" {RECENT_S:g} s it was read {away[i]:.3f} rad from there",
        f"{most_rad:g} rad: a hand at rest, inside its limits, and one source of its states",
    )


def armed_by_asker(asked: Asked, situation: Situation) -> Refusal | None:
    """A lease whose session is lost can be ended in the same name: to disarm makes safe."""
    if situation.mode == "armed" and asked.who is not None and asked.who.name == situation.commander:
        return None
    return Refusal("armed", "the hand is not armed by you", "arm first, with a reason")


def something_asked(asked: Asked, _: Situation) -> Refusal | None:
    return None if asked.targets else Refusal("empty", "no joint is named", "one target or more")


def finite(asked: Asked, _: Situation) -> Refusal | None:
    for name, value in asked.targets.items():
        if not np.isfinite(value):
            return Refusal("finite", f"the target of {name} is {value}", "finite numbers, in rad")
    return None


def has_bounds(asked: Asked, situation: Situation) -> Refusal | None:
    limits, motion = situation.limits, asked.motion
    if motion is None or not (without := motion.moved & limits.unbounded).any():
        return None
    i = int(np.argmax(without))
    lacks = "range" if np.isinf(limits.lower[i]) or np.isinf(limits.upper[i]) else "velocity limit"
    unit = limits.units[i]
    keys = f"lower_{unit}, upper_{unit}" if lacks == "range" else f"velocity_limit_{unit}_s"
    return Refusal(
        "unbounded", f"{limits.names[i]} has no {lacks}", f"commands of joints whose description gives {keys}"
    )


def inside_bounds(asked: Asked, situation: Situation) -> Refusal | None:
    limits, motion = situation.limits, asked.motion
    if motion is None:
        return None
    # the first row of a longer table is where the hand is already
    table = motion.table[1:] if len(motion.table) > 1 else motion.table
    beyond = (table < limits.lower) | (table > limits.upper)
    if not beyond.any():
        return None
    i = int(np.argmax(beyond.any(axis=0)))
    column = table[beyond[:, i], i]
    return Refusal(
        "bounds",
        f"{limits.names[i]} would go to {column[np.argmax(np.abs(column))]:.4f} {limits.units[i]}",
        f"{limits.lower[i]:.4f} to {limits.upper[i]:.4f} {limits.units[i]}",
    )


def not_too_fast(asked: Asked, situation: Situation) -> Refusal | None:
    limits, motion = situation.limits, asked.motion
    if motion is None:
        return None
    share = motion.fastest() / limits.velocity
    worst = int(np.argmax(share))
    if share[worst] <= _RATIO_SLACK:
        return None
    return Refusal(
        "velocity",
        f"{limits.names[worst]} would move at {share[worst] * limits.velocity[worst]:.2f} {limits.units[worst]}/s",
        f"{limits.velocity[worst]:.2f} {limits.units[worst]}/s: {share[worst]:.1f} times the time would do",
    )


def no_jump(asked: Asked, situation: Situation) -> Refusal | None:
    motion, most_rad = asked.motion, situation.settings.jump_rad
    if motion is None:
        return None
    away = np.fmax(np.abs(motion.table[-1] - situation.setpoint), 0.0)
    worst = int(np.argmax(away))
    if away[worst] <= most_rad:
        return None
    return Refusal(
        "jump",
        f"the target of {situation.limits.names[worst]} is {away[worst]:.3f} rad from where the hand is sent",
        f"{most_rad:g} rad in one streamed target; 'move' goes farther",
    )


def joints_are_heard(asked: Asked, situation: Situation) -> Refusal | None:
    motion = asked.motion
    if motion is None:
        return None
    age_s = np.where(motion.moved, situation.age_s, 0.0)
    worst = int(np.argmax(age_s))
    if age_s[worst] <= situation.settings.state_timeout_s:
        return None
    name = situation.limits.names[worst]
    return Refusal("stale", _silence(name, age_s[worst]), f"{situation.settings.state_timeout_s:g} s at most")


def has_let_go(_: Asked, situation: Situation) -> Refusal | None:
    if not situation.letting_go:
        return None
    # a motion would begin from setpoints beyond the contact, and leave them there
    return Refusal("letting_go", "the hand still lets go of what it pressed", "motions once it has, within a second")


def no_collision(asked: Asked, _: Situation) -> Refusal | None:
    found = asked.collision()
    if found is None:
        return None
    return Refusal(
        "collision", f"{found}, {found.share:.0%} of the way", "a way on which the hand stays clear of itself"
    )


def _silence(what: str, age_s: float) -> str:
    return f"{what} was last heard {age_s:.3f} s ago" if np.isfinite(age_s) else f"{what} was never heard"


IDENTITY: tuple[Check, ...] = (identity_proved, may_command, of_this_session, in_order, recent)
"""Whose request it is, before anything is computed for it."""
ALLOWED: dict[str, tuple[Check, ...]] = {
    "arm": (not_stopped, nobody_else, has_reason, hand_is_heard, hand_is_believed, readings_can_be),
    "disarm": (armed_by_asker,),
    "beat": (holds_the_lease,),
    "stop": (),
    "release": (is_stopped, has_reason),
    "recalibrate": (),
    "move": (not_stopped, holds_the_lease),
    "trajectory": (not_stopped, holds_the_lease),
    "target": (not_stopped, holds_the_lease),
}
"""Whether the gate's mode allows it."""
PLANNED: tuple[Check, ...] = (
    something_asked,
    finite,
    joints_are_heard,
    readings_can_be,
    has_let_go,
    has_bounds,
    inside_bounds,
    starts_at_hand,
)
MOTION: dict[str, tuple[Check, ...]] = {
    "move": (*PLANNED, not_too_fast, no_collision),
    "trajectory": (*PLANNED, not_too_fast, no_collision),
    "target": (*PLANNED, no_jump, no_collision),
}
"""What a motion must pass. A rehearsal passes no other."""


BEGUN: tuple[Check, ...] = (readings_can_be, starts_at_hand)
"""What is asked again when a motion begins: the hand may have moved while it was planned."""


def first_refusal(checks: tuple[Check, ...], asked: Asked, situation: Situation) -> Refusal | None:
    """The first check that refuses, if any does."""
    for check in checks:
        refusal = check(asked, situation)
        if refusal is not None:
            return refusal
    return None

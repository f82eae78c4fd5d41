"""Names of hidden effects as people write them: KEY[:joint][=value[,name=value...]]."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from twin_daemon.errors import BadInput, nearest
from twin_daemon.hand import Hand, match

from .kinds import HIDDEN, Kind

Strength = Literal["mild", "severe"]


@dataclass(frozen=True)
class Hidden:
    """One effect to hide. `joint` and `value` None mean the defaults of the hand: FFJ3 or alike, mild."""

    key: str
    joint: str | None = None
    value: float | Strength | None = None
    more: Mapping[str, float] = field(default_factory=dict)

    @property
    def kind(self) -> Kind:
        return HIDDEN[self.key]

    def __str__(self) -> str:
        joint = f":{self.joint}" if self.joint else ""
        value = self.value if isinstance(self.value, str) or self.value is None else f"{self.value:g}"
        numbers = ([str(value)] if value is not None else []) + [f"{k}={v:g}" for k, v in self.more.items()]
        return self.key + joint + ("=" + ",".join(numbers) if numbers else "")


def parse_hidden(text: str, hand: Hand | None = None) -> Hidden:
    """`backlash:rh_FFJ3=0.05`, `coulomb_friction:FFJ3=severe`, `gravity_tilt`, `stribeck_friction=mild,velocity=0.2`.

    With `hand` the joint is checked and spelled as in the hand's data. Raises BadInput.
    """
    head, _, numbers = text.strip().partition("=")
    key, _, joint = (part.strip() for part in head.partition(":"))
    if key not in HIDDEN:
        raise BadInput(f"no hidden effect '{key}'", where=text, todo=nearest(key, HIDDEN))
    kind = HIDDEN[key]
    value: float | Strength | None = None
    more: dict[str, float] = {}
    for position, part in enumerate(part.strip() for part in numbers.split(",") if part.strip()):
        name, equals, number = part.partition("=")
        if equals:
            if name.strip() not in kind.more:
                known = nearest(name.strip(), kind.more) if kind.more else "It has its value only"
                raise BadInput(f"{key} has no '{name.strip()}'", where=text, todo=known)
            more[name.strip()] = _number(number, text)
        elif position == 0:
            value = _strength(part) or _number(part, text)
        else:
            raise BadInput(f"'{part}' is a second value", where=text, todo="Write further numbers as name=value")
    hidden = Hidden(key, joint or None, value, more)
    check_value(hidden)
    return resolve_joint(hidden, hand) if hand is not None else hidden


def resolve_joint(hidden: Hidden, hand: Hand) -> Hidden:
    """`hidden` with the joint (or command) it acts on, spelled as in the hand's data. Raises BadInput."""
    kind = hidden.kind
    if kind.acts_on == "hand":
        if hidden.joint is not None:
            raise BadInput(f"{kind.key} acts on the whole hand", where=str(hidden), todo="Leave the joint away")
        return hidden
    candidates = _candidates(kind, hand)
    if not candidates:
        raise BadInput(f"{hand.name} has nothing that {kind.key} could act on", where=str(hidden))
    if hidden.joint is None:
        joint = _default(kind, hand, candidates)
    else:
        joint = match(hidden.joint, candidates) or _by_command(hidden.joint, kind, hand)
        if joint is None:
            raise BadInput(
                f"{kind.key} cannot act on '{hidden.joint}'", where=str(hidden), todo=_hint(hidden, hand, candidates)
            )
    return Hidden(hidden.key, joint, hidden.value, dict(hidden.more))


def check_value(hidden: Hidden) -> None:
    """BadInput for a value that is no possible one of this effect."""
    kind, value = hidden.kind, hidden.value
    if value is None or isinstance(value, str):
        return
    infinite_is_neutral = math.isinf(kind.neutral) and value == kind.neutral
    if not (kind.lower <= value <= kind.upper) or (math.isinf(value) and not infinite_is_neutral):
        raise BadInput(
            f"{value:g} is no value of {kind.key} ({kind.meaning})",
            where=str(hidden),
            allowed=f"{kind.lower:g} to {kind.upper:g} {kind.unit}",
        )


def _candidates(kind: Kind, hand: Hand) -> list[str]:
    """What the effect can act on. A joint effect on a command of several joints acts along their tendon."""
    commands = hand.description.commands
    pairs = [name for name, info in commands.items() if len(info.joints) > 1]
    if kind.acts_on == "command":
        return list(commands)
    if kind.acts_on == "finger":
        return pairs
    if kind.acts_on == "sensor":
        return list(hand.joints)
    return list(hand.joints) + [name for name in pairs if name not in hand.joints]


def _by_command(joint: str, kind: Kind, hand: Hand) -> str | None:
    """The command of a joint, where that is no guess: its own servo, or for a finger effect the pair's."""
    wanted = match(joint, hand.joints)
    if wanted is None or kind.acts_on not in ("command", "finger"):
        return None
    for command, info in hand.description.commands.items():
        if wanted in info.joints and (len(info.joints) == 1) == (kind.acts_on == "command"):
            return command
    return None


def _hint(hidden: Hidden, hand: Hand, candidates: Sequence[str]) -> str:
    joint = match(hidden.joint or "", hand.joints)
    for command, info in hand.description.commands.items():
        if joint in info.joints and command in candidates:
            return f"'{joint}' has no servo of its own; use '{command}'"
    return nearest(hidden.joint or "", candidates)


def _default(kind: Kind, hand: Hand, candidates: Sequence[str]) -> str:
    """FFJ3 where there is one, else the middle one of the joints with a servo of their own: not base, not tool."""
    if kind.acts_on == "finger":
        return candidates[0]
    usual = match("FFJ3", candidates)
    if usual is not None:
        return usual
    alone = [
        command if kind.acts_on == "command" else info.joints[0]
        for command, info in hand.description.commands.items()
        if len(info.joints) == 1
    ]
    return alone[(len(alone) - 1) // 2] if alone else candidates[0]


def _strength(text: str) -> Strength | None:
    if text == "mild":
        return "mild"
    return "severe" if text == "severe" else None


def _number(text: str, where: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise BadInput(f"'{text.strip()}' is no number", where=where, allowed="a number, mild or severe")
    return number

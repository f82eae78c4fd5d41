"""The hands of one network: found by the liveliness token of each daemon, and what each says of itself.

Tokens and questions are under the usual keys (`twin/<ns>/...`): a hand whose description moves them is not found.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from typing import Any, TypeVar

import zenoh
from pydantic import BaseModel, ValidationError

from twin_daemon.hand import NAMESPACE, Keys

SILENT = "silent"
"""The status of a hand whose daemon has its token, but gives no answer that can be read."""

MOST_HANDS = 64
"""So many are looked at, by name: whoever is on the network can put up any number of tokens."""

_KEYS = Keys()
_BEFORE, _AFTER = _KEYS.alive.split("{ns}")
_LOOK_AGAIN_S = 0.1
_SETTLED_S = 0.5
_Answer = TypeVar("_Answer", bound=BaseModel)


@dataclass(frozen=True)
class HandSeen:
    """What a hand's daemon said when it was asked; None is unknown.

    `worst_joint` is the one with the largest rms residual over the daemon's window. `joints` are in its model's order.
    """

    hand: str | None = None
    status: str = SILENT
    version: str | None = None
    drift: str | None = None
    drifting_joints: tuple[str, ...] = ()
    worst_joint: str | None = None
    worst_rmse_rad: float | None = None
    gate: str | None = None
    age_s: float | None = None
    joints: tuple[str, ...] = ()


class _Health(BaseModel):
    hand: str
    status: str
    version: str
    gate: str | None
    age_s: float | None


class _Drift(BaseModel):
    verdict: str
    drifting_joints: tuple[str, ...]


class _Joint(BaseModel):
    rmse_rad: float | None


class _Residual(BaseModel):
    joints: dict[str, _Joint]


def find_hands(session: zenoh.Session, seconds: float) -> dict[str, HandSeen]:
    """The hands by namespace, as soon as no further one has come for a moment, at the latest after `seconds`.

    A session that was just opened does not know all tokens yet.
    """
    begin_s = changed_s = time.monotonic()
    known: list[str] = []
    while (now_s := time.monotonic()) < begin_s + seconds and not (known and now_s > changed_s + _SETTLED_S):
        found = _namespaces(session)
        if found != known:
            known, changed_s = found, now_s
        time.sleep(_LOOK_AGAIN_S)
    return look(session)


def look(session: zenoh.Session, timeout_s: float = 1.0) -> dict[str, HandSeen]:
    """The hands that have their token now, by namespace. All are asked at once: silent ones cost `timeout_s` once."""

    def asked(key: str, namespace: str) -> Any:
        return session.get(key.format(ns=namespace), timeout=timeout_s)

    questions = {
        namespace: (asked(_KEYS.health, namespace), asked(_KEYS.drift, namespace), asked(_KEYS.residual, namespace))
        for namespace in _namespaces(session)
    }
    return {
        namespace: _seen(_answer(_Health, health), _answer(_Drift, drift), _answer(_Residual, residual))
        for namespace, (health, drift, residual) in questions.items()
    }


def _namespaces(session: zenoh.Session) -> list[str]:
    keys = (
        str(reply.ok.key_expr) for reply in session.liveliness().get(f"{_BEFORE}**{_AFTER}", timeout=1.0) if reply.ok
    )
    names = {key.removeprefix(_BEFORE).removesuffix(_AFTER) for key in keys}
    return sorted(name for name in names if re.fullmatch(NAMESPACE, name))[:MOST_HANDS]


def _answer(kind: type[_Answer], replies: Any) -> _Answer | None:
    """The first answer that can be read; others on the network may say what they like."""
    for reply in replies:
        if reply.ok is not None:
            try:
                return kind.model_validate_json(reply.ok.payload.to_bytes())
            except ValidationError:
                continue
    return None


def _seen(health: _Health | None, drift: _Drift | None, residual: _Residual | None) -> HandSeen:
    if health is None:
        return HandSeen()
    errors = {name: joint.rmse_rad for name, joint in residual.joints.items()} if residual is not None else {}
    known = {name: error for name, error in errors.items() if error is not None}
    worst = max(known, key=lambda name: known[name], default=None)
    return HandSeen(
        hand=health.hand,
        status=health.status,
        version=health.version,
        drift=drift.verdict if drift is not None else None,
        drifting_joints=drift.drifting_joints if drift is not None else (),
        worst_joint=worst,
        worst_rmse_rad=known[worst] if worst is not None else None,
        gate=health.gate,
        age_s=health.age_s,
        joints=tuple(errors),
    )

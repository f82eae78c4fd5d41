"""Hands: their descriptions, the names of their joints, and how they fit their models."""

from __future__ import annotations

from twin_daemon.callable_packages import make_callable

from .description import DEFAULT_HAND, Hand, known_hands, load_hand
from .mjcf import compile_model, refuse_unphysical
from .naming import canonical, match
from .schema import NAMESPACE, CommandInfo, HandDescription, JointInfo, Keys, Topics

__all__ = [
    "DEFAULT_HAND",
    "NAMESPACE",
    "CommandInfo",
    "Hand",
    "HandDescription",
    "JointInfo",
    "Keys",
    "Topics",
    "canonical",
    "compile_model",
    "known_hands",
    "load_hand",
    "match",
    "refuse_unphysical",
]

make_callable(__name__)

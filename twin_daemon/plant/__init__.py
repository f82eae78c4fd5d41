"""A stand-in for the real hand, with hidden effects: what the twin is tested against when no hand is there."""

from __future__ import annotations

from .faults import FAULTS, Fault, Faulty, Hardware, parse_fault
from .hidden import Hidden, parse_hidden
from .kinds import FOREIGN, HIDDEN, Kind
from .plant import Plant

__all__ = [
    "FAULTS",
    "FOREIGN",
    "HIDDEN",
    "Fault",
    "Faulty",
    "Hardware",
    "Hidden",
    "Kind",
    "Plant",
    "parse_fault",
    "parse_hidden",
]
